"""The stochastic model of the rotational motion: its marginal likelihood, linearisation and covariances."""

import numpy as np
import pytest
from motion_windows import a_window, dense, small_window
from scipy.stats import multivariate_normal

from edl_filter.navigation.motion_model import MEDIANS, WIDTHS, covariances, linearise_window, log_posterior
from edl_filter.navigation.rotational_dynamics import DISTURBANCES, ERROR_SIZE, add_errors


@pytest.fixture(scope="module")
def small():
    return small_window()


def test_the_marginal_likelihood_is_that_of_a_dense_normal_distribution(small):
    window, motion, _ = small
    values = []
    for shift in (0.0, 0.7):
        log_sizes = MEDIANS + shift * WIDTHS
        c = covariances(window, motion, log_sizes)
        mean, covariance, design = dense(window, motion, c)
        rows = np.repeat(window.observed, 6)
        h = design[rows]
        law = multivariate_normal(h @ mean, h @ covariance @ h.T + np.diag(c.row_variance.ravel()[rows]))
        prior = 0.5 * len(log_sizes) * shift**2
        value = log_posterior(window, motion)(log_sizes)
        values.append((value, law.logpdf(motion.residual.ravel()[rows]) - prior))
    (a, b), (expected_a, expected_b) = np.array(values).T
    assert b - a == pytest.approx(expected_b - expected_a, rel=1e-7)


def test_a_linearised_motion_predicts_the_readings_of_a_motion_nearby():
    """Linearised off the true motion, the error that leads back to it explains all readings to second order."""
    window, truth = a_window(12, 4, 6)
    window.readings[:] = truth
    states = window.states.copy()
    remaining = []
    for size in (2e-3, 1e-3):
        moved = add_errors(states, np.full((12, ERROR_SIZE), size) * np.r_[np.ones(6), np.full(13, 0.01)])
        motion = linearise_window(window, moved)
        first = -np.full(ERROR_SIZE, size) * np.r_[np.ones(6), np.full(13, 0.01)]
        error, rest = first, []
        for t in range(12):
            rest.append(motion.residual[t] - motion.design[t] @ error)
            error = motion.transition[t] @ error
        remaining.append(np.abs(rest)[:4, :3].max())
        assert remaining[-1] < 0.1 * np.abs(motion.residual[:4, :3]).max()
    assert remaining[1] < 0.35 * remaining[0]


def test_without_noise_and_with_it_the_disturbances_are_stationary_processes(small):
    """Variance after a bin: decayed variance plus process noise is the variance before, whatever the size."""
    window, motion, _ = small
    for shift in (-1.0, 1.0):
        c = covariances(window, motion, MEDIANS + shift * WIDTHS)
        places = np.arange(ERROR_SIZE - len(DISTURBANCES), ERROR_SIZE)
        decay = motion.transition[0][places, places]
        noise = c.process_noise[0][places, places]
        sigma = np.sqrt(noise / (1.0 - decay**2))
        medians = np.exp(MEDIANS + shift * WIDTHS)
        np.testing.assert_allclose(sigma[[0, 4, 10]], medians[[2, 5, 10]], rtol=1e-9)
        assert np.all(np.diag(c.initial)[places] >= sigma**2 * (1.0 - 1e-12))


def test_the_noise_of_a_force_grows_with_its_size(small):
    window, motion, _ = small
    sizes = MEDIANS.copy()
    sizes[1] = np.log(0.01)
    variance = covariances(window, motion, sizes).row_variance
    force = np.linalg.norm(window.readings[:, 3:], axis=1, keepdims=True)
    np.testing.assert_allclose(variance[:, 3:], window.noise[:, 3:] ** 2 + (0.01 * force) ** 2)
    np.testing.assert_allclose(variance[:, :3], window.noise[:, :3] ** 2)
