"""Smoothing of the rotational motion across a lost stretch: dense twins, consistency, and what is refused."""

import numpy as np
import pytest
from motion_windows import INTERVAL, a_window, dense, small_window
from scipy.stats import chi2

from edl_filter.navigation import motion_smoother
from edl_filter.navigation.motion_smoother import predict_stretch, smooth_errors
from edl_filter.navigation.rotational_dynamics import ERROR_SIZE, SIZE


@pytest.fixture(scope="module")
def small():
    return small_window()


def test_the_smoothed_errors_are_those_of_dense_conditioning(small):
    window, motion, c = small
    mean, covariance, design = dense(window, motion, c)
    rows = np.repeat(window.observed, 6)
    h = design[rows]
    unit = np.sqrt(np.diag(covariance))
    scaled, h = covariance / np.outer(unit, unit), h * unit
    innovation = h @ scaled @ h.T + np.diag(c.row_variance.ravel()[rows])
    gain = np.linalg.solve(innovation, h @ scaled).T
    expected = mean + unit * (gain @ (motion.residual.ravel()[rows] - h @ (mean / unit)))
    posterior = (scaled - gain @ h @ scaled) * np.outer(unit, unit)
    smoothed, spread, _ = smooth_errors(motion, c, window.observed)
    sigma = np.sqrt(np.diag(posterior))
    np.testing.assert_allclose((smoothed.ravel() - expected) / sigma, 0.0, atol=1e-6)
    blocks = posterior.reshape(8, ERROR_SIZE, 8, ERROR_SIZE)[range(8), :, range(8)]
    scale = sigma.reshape(8, ERROR_SIZE)
    np.testing.assert_allclose((spread - blocks) / (scale[:, :, None] * scale[:, None, :]), 0.0, atol=1e-5)


def test_the_covariance_of_a_prediction_is_that_of_dense_conditioning(small):
    window, motion, c = small
    _, covariance, design = dense(window, motion, c)
    rows = np.repeat(window.observed, 6)
    joint = design @ covariance @ design.T + np.diag(c.row_variance.ravel())
    known, lost = np.flatnonzero(rows), np.flatnonzero(~rows)
    scale = np.sqrt(np.diag(joint))
    joint = joint / np.outer(scale, scale)
    expected = joint[np.ix_(lost, lost)] - joint[np.ix_(lost, known)] @ np.linalg.solve(
        joint[np.ix_(known, known)], joint[np.ix_(known, lost)]
    )
    expected *= np.outer(scale[lost], scale[lost])
    _, spread = motion_smoother._prediction(window, motion, c, window.observed, 3, 5)
    for axis in range(6):
        np.testing.assert_allclose(spread[axis], expected[axis::6, axis::6], rtol=1e-6)


def sums(window, truth, fills):
    """Errors of the sums over the stretch in sigmas (6,), and the errors (6,)."""
    part = slice(window.first, window.last)
    error = np.array([f.values.sum() for f in fills]) - truth[part].sum(axis=0)
    return error / np.sqrt([f.covariance.sum() for f in fills]), error


@pytest.mark.parametrize("disturbances", [(), (0.2, 1e-5, 2e-4, -1e-4, 0.03, 0.1)])
def test_a_stretch_of_several_oscillations_is_predicted_within_its_sigmas(disturbances):
    squares = []
    for seed in range(2):
        window, truth = a_window(160, 70, 94, disturbances, np.random.default_rng(seed))
        fills, _ = predict_stretch(window)
        ratio, error = sums(window, truth, fills)
        # the rotation across 3 s: an interpolation of the rates is wrong by degrees
        assert np.all(np.abs(error[:3]) * INTERVAL < np.radians(0.1))
        squares.append(ratio @ ratio)
    # not more than the chi-square distribution allows; less, since the least disturbances of the prior are not in it
    assert sum(squares) < chi2.ppf(0.999, 12)


def test_a_moment_that_begins_in_the_stretch_enlarges_its_sigma():
    def kick(t, state):
        return state + np.eye(SIZE)[5] * 0.02 if t == 82 else state

    steady, _ = a_window(160, 70, 94, random=np.random.default_rng(0))
    kicked, truth = a_window(160, 70, 94, random=np.random.default_rng(0), change=kick)
    fills = [predict_stretch(w)[0] for w in (steady, kicked)]
    sigma = [np.sqrt([f.covariance.sum() for f in fill]) for fill in fills]
    assert np.all(sigma[1][1:3] > 3.0 * sigma[0][1:3])
    ratio, _ = sums(kicked, truth, fills[1])
    assert np.all(np.abs(ratio) < 3.0)


def test_the_same_window_gives_the_same_bits():
    window, _ = a_window(100, 40, 56, random=np.random.default_rng(3))
    first, second = (predict_stretch(window)[0] for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.values, b.values)
        np.testing.assert_array_equal(a.covariance, b.covariance)


def test_readings_that_no_motion_explains_give_no_prediction():
    window, _ = a_window(60, 25, 33, random=np.random.default_rng(4))
    window.readings[:20] = np.nan
    assert predict_stretch(window) is None
