"""Weights of a robust update."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.navigation.estimator import Innovation
from edl_filter.navigation.robust import HUBER, STUDENT_DOF, measurement_weight, weighted


def innovation(residual, spread=4.0, noise=1.0):
    residual = np.atleast_1d(np.asarray(residual, float))
    eye = np.eye(len(residual))
    return Innovation.of(residual, spread * eye, noise * eye, np.zeros(0))


@pytest.mark.parametrize("robust", ["none", "huber", "student_t"])
def test_a_reading_nearly_as_predicted_keeps_its_noise(robust):
    for residual in (0.0, 0.3):
        assert measurement_weight(innovation(residual), robust) == 1.0
    unchanged = innovation(0.3)
    assert weighted(unchanged, 1.0) is unchanged


def test_huber_minimises_hubers_function():
    r, spread, noise = 30.0, 4.0, 1.0
    weight = measurement_weight(innovation(r, spread, noise), "huber")
    x = np.linspace(0.0, r, 300_001)  # the state's change, by brute force
    e = np.abs(r - x) / np.sqrt(noise)
    cost = 0.5 * x**2 / spread + np.where(e <= HUBER, 0.5 * e**2, HUBER * e - 0.5 * HUBER**2)
    assert spread / (spread + noise / weight) * r == pytest.approx(x[np.argmin(cost)], abs=2e-4)


@pytest.mark.parametrize("spread", [1e-3, 1.0, 100.0, 1e4])
@pytest.mark.parametrize("excess", [1.0001, 1.05, 2.0, 100.0])
def test_hubers_weight_in_closed_form(spread, excess):
    """One component: the posterior residual is that at which Huber's force equals the pull of the prediction."""
    limit = HUBER * (1.0 + spread)  # residual from which the weight is below one
    residual = excess * limit
    weight = measurement_weight(innovation(residual, spread), "huber")
    assert weight == pytest.approx(HUBER / (residual - HUBER * spread), rel=1e-5)
    assert measurement_weight(innovation(0.999 * limit, spread), "huber") == 1.0


def iterated_students_weight(residual, spread, noise):
    """The fixed-point iteration from 1 by itself, as long as it takes."""
    weight, before, count = 1.0, 2.0, len(residual)
    while before - weight > 1e-10 * weight:
        before, gain = weight, spread @ np.linalg.inv(spread + noise / weight)
        rest = residual - gain @ residual
        covariance = (np.eye(count) - gain) @ spread
        expected = rest @ np.linalg.solve(noise, rest) + np.trace(np.linalg.solve(noise, covariance))
        weight = min(1.0, (STUDENT_DOF + count) / (STUDENT_DOF + expected))
    return weight


@given(st.integers(0, 1000), st.integers(1, 3), st.floats(-3.0, 4.0), st.floats(0.0, 4.0))
def test_students_weight_is_the_largest_fixed_point(seed, count, log_spread, log_residual):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, count, count))
    spread, noise = 10.0**log_spread * (a @ a.T + np.eye(count)), b @ b.T + np.eye(count)
    residual = 10.0**log_residual * rng.normal(size=count)
    actual = measurement_weight(Innovation.of(residual, spread, noise, np.zeros(0)), "student_t")
    assert actual == pytest.approx(iterated_students_weight(residual, spread, noise), rel=1e-4)


@pytest.mark.parametrize(
    ("spread", "residual"),
    [
        (10.3979841848149, 13.422071527160119),  # the weights fall faster and faster at first
        (13.664483492953257, 16.426265840709313),  # an extrapolation without a check ends at 0.46
        (7.912342618981323, 10.967313315588179),  # nearly a double fixed point: all iterations are needed
    ],
)
def test_students_weight_where_the_iteration_slows_down_before_its_end(spread, residual):
    expected = iterated_students_weight(np.array([residual]), np.array([[spread]]), np.eye(1))
    assert measurement_weight(innovation(residual, spread), "student_t") == pytest.approx(expected, rel=1e-3)


def test_students_weight_is_the_fixed_point_of_its_expectation():
    r, spread, noise = np.array([20.0, -3.0]), 4.0, 1.0
    weight = measurement_weight(innovation(r, spread, noise), "student_t")
    gain = spread / (spread + noise / weight)
    expected = ((1.0 - gain) ** 2 * (r @ r) + 2.0 * (1.0 - gain) * spread) / noise
    assert weight == pytest.approx((STUDENT_DOF + 2.0) / (STUDENT_DOF + expected), rel=1e-4)
    assert 0.0 < weight < 0.2


@pytest.mark.parametrize("robust", ["huber", "student_t"])
def test_weights_fall_with_the_innovation(robust):
    weights = [measurement_weight(innovation(r), robust) for r in (1.0, 5.0, 20.0, 100.0)]
    assert weights == sorted(weights, reverse=True)
    assert weights[-1] < 0.03


def test_a_weighted_innovation_has_more_noise_and_nothing_else():
    original = innovation([3.0, -1.0])
    changed = weighted(original, 0.25)
    np.testing.assert_array_equal(changed.noise_covariance, 4.0 * np.eye(2))
    np.testing.assert_array_equal(changed.predicted_covariance, original.predicted_covariance)
    np.testing.assert_array_equal(changed.residual, [3.0, -1.0])


@pytest.mark.parametrize("count", [1, 3])
def test_weights_of_a_residual_far_beyond_its_noise(count):
    """The prediction being exact: Student's weight is (4 + m) / γ², Huber's √m · 1.345 / γ, of γ sigmas in all."""
    exact = innovation(np.full(count, 1e4 / np.sqrt(count)), spread=1e-12)
    assert measurement_weight(exact, "student_t") == pytest.approx((4.0 + count) / 1e8, rel=1e-4)
    assert measurement_weight(exact, "huber") == pytest.approx(1.345e-4 * np.sqrt(count), rel=1e-4)


def test_a_correlated_noise_counts_by_its_inverse():
    """Huber's weight of a residual along the long axis of the noise is that of its length in sigmas."""
    axes, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(2, 2)))
    noise = axes @ np.diag([100.0, 1.0]) @ axes.T
    of_long, of_short = (
        measurement_weight(Innovation.of(50.0 * axis, 1e-12 * np.eye(2), noise, np.zeros(0)), "huber")
        for axis in axes.T
    )
    assert of_long == pytest.approx(10.0 * of_short, rel=1e-5)
    assert of_short == pytest.approx(1.345 * np.sqrt(2.0) / 50.0, rel=1e-5)
