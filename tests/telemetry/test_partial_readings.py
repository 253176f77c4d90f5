"""A triad of which one axis is lost: what is read, and the estimate of the lost axis with its covariance."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.estimation.autoregression import Interpolation
from edl_filter.telemetry.partial_readings import given_readings, partial_readings


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.lists(st.floats(-100.0, 100.0), min_size=3, max_size=3),
    st.integers(0, 2),
)
def test_two_axes_and_the_lost_one_are_the_reading_in_body_axes(quaternion, reading, axis):
    matrix = rotations.to_matrix(np.array(quaternion) / np.linalg.norm(quaternion))
    readings = np.array([reading] * 4)
    readings[1, axis] = np.nan
    readings[2, [axis, axis - 1]] = np.nan
    readings[3] = np.nan
    partial = partial_readings(readings, matrix)
    assert not partial[[0, 2, 3]].any()  # complete, or more than one axis is lost
    known, direction = partial[1]
    np.testing.assert_allclose(direction, matrix[:, axis], atol=1e-12)
    np.testing.assert_allclose(known @ direction, 0.0, atol=1e-10)
    np.testing.assert_allclose(known + reading[axis] * direction, matrix @ reading, atol=1e-10)


def _predictions(random, count):
    """Three independent predictions of a stretch with full covariances."""
    factors = random.standard_normal((3, count, count)) * np.array([0.1, 1.0, 3.0])[:, None, None]
    covariances = factors @ factors.swapaxes(1, 2) + 0.01 * np.eye(count)
    return [Interpolation(random.standard_normal(count), c, 1, 1.0) for c in covariances]


@given(st.integers(0, 2**31), st.sampled_from([(1.0, 0.0, 0.0), (0.6, -0.8, 0.0), (0.48, 0.6, -0.64)]))
def test_the_lost_axis_is_the_weighted_least_squares_of_the_predictions(seed, axis):
    """Twin: the mean and covariance of three Gaussian vectors given two linear combinations of them."""
    random, axis, count = np.random.default_rng(seed), np.array(axis), 4
    fills = _predictions(random, count)
    readings = random.standard_normal((count, 3))
    out = given_readings(fills, readings, axis)
    # condition on (I - a a') x = (I - a a') p with a readings' noise that is nearly zero
    prior, mean = np.zeros((3 * count, 3 * count)), np.concatenate([f.values for f in fills])
    for i, fill in enumerate(fills):
        rows = slice(i * count, (i + 1) * count)
        prior[rows, rows] = fill.covariance
    basis = np.linalg.svd(axis[None])[2][1:]  # the two axes that are read
    observe = np.kron(basis, np.eye(count))
    innovation = (basis @ readings.T).ravel() - observe @ mean
    gain = prior @ observe.T @ np.linalg.inv(observe @ prior @ observe.T + 1e-14 * np.eye(2 * count))
    expected = (mean + gain @ innovation).reshape(3, count)
    square = innovation @ np.linalg.solve(observe @ prior @ observe.T, innovation)
    covariance = (prior - gain @ observe @ prior) * max(square / (2 * count), 1.0)
    np.testing.assert_allclose([f.values for f in out], expected, atol=1e-5)
    bound = np.zeros_like(prior)
    for i, fill in enumerate(out):
        rows = slice(i * count, (i + 1) * count)
        bound[rows, rows] = fill.covariance
    size = np.abs(covariance).max()
    assert np.linalg.eigvalsh(bound - covariance).min() > -1e-5 * size
    if axis[0] == 1.0:  # the lost axis is one of the body: the other two have no error, and the bound is exact
        np.testing.assert_allclose(bound, covariance, atol=1e-5 * size)


def test_an_impact_that_no_prediction_has_is_in_the_sigma_of_the_lost_axis():
    """The axes that are read deviate by thousands of their predicted sigmas: nothing is known of the lost one."""
    axis, count = np.array([0.8, 0.6, 0.0]), 4
    fills = [Interpolation(np.zeros(count), 1e-4 * np.eye(count), 1, 1.0)] * 3
    impact = np.random.default_rng(1).normal(0.0, 40.0, (count, 3))
    out = given_readings(fills, impact, axis)
    error = np.stack([f.values for f in out], axis=1) - impact
    sigma = np.stack([np.sqrt(np.diag(f.covariance)) for f in out], axis=1)
    assert np.all(np.abs(error) <= 4.0 * sigma + 1e-9)
    as_predicted = given_readings(fills, np.zeros((count, 3)), axis)
    assert np.sqrt(as_predicted[0].covariance[0, 0]) < 0.02
