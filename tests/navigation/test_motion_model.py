"""The stochastic model of the rotational motion: its marginal likelihood, linearisation and covariances."""

import numpy as np
import pytest
from motion_windows import ARM, NOISE, OBLIQUE, a_window, dense, partly_read, small_window, uneven_window
from scipy.stats import multivariate_normal

from edl_filter.navigation.motion_model import (
    MEDIANS,
    WIDTHS,
    covariances,
    linearise_window,
    log_posterior,
    propagated_states,
)
from edl_filter.navigation.rotational_dynamics import (
    DISTURBANCES,
    ERROR_SIZE,
    add_errors,
    state_differences,
)

DISTURBED = np.arange(ERROR_SIZE - len(DISTURBANCES), ERROR_SIZE)


@pytest.fixture(scope="module")
def small():
    return small_window()


@pytest.fixture(scope="module")
def uneven():
    """Bins of different lengths, the true states, and the window linearised about other states."""
    window, states = uneven_window()
    states = states[:-1]
    moved = add_errors(states, 1e-3 * np.random.default_rng(0).standard_normal((len(states), ERROR_SIZE)))
    return window, states, linearise_window(window, moved)


@pytest.fixture(scope="module")
def part_read(uneven):
    """The window with readings within the stretch, linearised about the same states."""
    window, truth = uneven_window()
    window = partly_read(window, truth[:, 4:7])
    return window, linearise_window(window, uneven[2].states)


@pytest.mark.parametrize("bins", ["equal", "different", "partly read"])
def test_the_marginal_likelihood_is_that_of_a_dense_normal_distribution(small, uneven, part_read, bins):
    window, motion = small[:2] if bins == "equal" else (uneven[0], uneven[2])
    if bins == "partly read":
        window, motion = part_read
    values = []
    for shift in (0.0, 0.7):
        log_sizes = MEDIANS + shift * WIDTHS
        c = covariances(window, motion, log_sizes)
        mean, covariance, design = dense(window, motion, c)
        rows = window.observed.ravel()
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


@pytest.mark.parametrize("within", [False, True])
def test_a_motion_in_bins_of_different_lengths_is_explained_to_second_order(within):
    """As above, with loads and disturbances that change, and oblique axes and a lever arm: states and readings."""
    window, truth = uneven_window()
    window, truth = partly_read(window, truth[:, 4:7]) if within else window, truth[:-1]
    directions = np.random.default_rng(1).standard_normal((len(truth), ERROR_SIZE))
    directions *= np.array([1.0] * 6 + [3.0] + [1.0] * 3 + [3.0] * 2 + [1.0] * 2 + [3.0] * 2 + [1e3] * 3)
    remaining = []
    for size in (2e-3, 1e-3):
        moved = add_errors(truth, size * directions)
        motion = linearise_window(window, moved)
        change = state_differences(truth, moved)
        assert np.all(motion.offset[0] == 0.0)
        error, rest, unexplained = change[0], [], []
        for t in range(len(truth)):
            rest.append(
                np.concatenate((change[t] - motion.offset[t] - error, motion.residual[t] - motion.design[t] @ error))
            )
            unexplained.append(np.concatenate((change[t], motion.residual[t] + motion.design[t] @ motion.offset[t])))
            error = motion.transition[t] @ error
        np.testing.assert_allclose(np.array(rest)[:, DISTURBED], 0.0, atol=1e-12)
        parts = (slice(0, 3), slice(3, 6), slice(19, 22), slice(22, 25))
        remaining.append([np.linalg.norm(np.array(rest)[:, p]) for p in parts])
        for part, left in zip(parts, remaining[-1], strict=True):
            assert left < 0.1 * np.linalg.norm(np.array(unexplained)[:, part])
    assert np.all(np.array(remaining[1]) < 0.35 * np.array(remaining[0]))


def test_states_of_the_stretch_are_propagated_from_its_first_bin():
    """Of the true motion without disturbances, from a truth that has none."""
    window, _ = a_window(12, 4, 9)
    states = propagated_states(window, window.states)
    np.testing.assert_array_equal(states[:5], window.states[:5])
    np.testing.assert_array_equal(states[9:], window.states[9:])
    exact = a_window(12, 11, 12)[0].states  # true states of all bins but the last
    moved = np.concatenate((exact[:5], window.states[5:]))
    np.testing.assert_allclose(propagated_states(window, moved)[4:9], exact[4:9], atol=1e-12)


def test_the_first_error_leads_to_the_approximate_motion(uneven):
    window, _, motion = uneven
    np.testing.assert_allclose(add_errors(motion.states[:1], motion.initial[None]), window.states[:1], atol=1e-12)


def test_disturbances_are_correlated_for_longer_than_a_stretch_whatever_the_bins(uneven):
    window, _, motion = uneven
    decay = np.diagonal(motion.transition, axis1=1, axis2=2)[:, DISTURBED]
    per_second = decay ** (1.0 / window.interval[:, None])
    np.testing.assert_allclose(per_second, np.tile(per_second[0], (len(decay), 1)), rtol=1e-8)
    assert np.all((per_second > 0.9) & (per_second < 1.0))


def test_noise_of_the_moments_is_that_of_a_response_to_a_moment(uneven):
    """White noise of spectral density one gives ``r rᵀ / h`` after a time h, with r the response to a constant one."""
    window, _, motion = uneven
    places = 6 + np.array([DISTURBANCES.index(name) for name in ("cl", "cm", "cn")])
    for t, interval in enumerate(window.interval):
        response = motion.transition[t][3:6, places]
        expected = response @ response.T / interval
        size = np.sqrt(np.diag(expected))
        np.testing.assert_allclose((motion.moment_noise[t] - expected) / np.outer(size, size), 0.0, atol=0.15)


def test_white_moments_accelerate_the_place_of_an_imu(part_read):
    """Variance of ``δω × r / dt`` along the axes of the force, with the rates' covariance by these moments."""
    window, motion = part_read
    random, sizes = np.random.default_rng(3), MEDIANS.copy()
    sizes[0] = 0.0
    more, less = (covariances(window, motion, s).row_variance for s in (sizes, MEDIANS))
    for t in range(len(window.interval)):
        rates = random.multivariate_normal(np.zeros(3), motion.moment_noise[t], 20000)
        read = np.cross(rates, ARM) @ OBLIQUE[3:, 3:].T / window.interval[t]
        expected = np.var(read, axis=0) if window.first <= t < window.last else np.zeros(3)
        added = (more - less)[t] / (1.0 - np.exp(2.0 * MEDIANS[0]))
        np.testing.assert_allclose(added[3:], expected, rtol=0.05)
        np.testing.assert_array_equal(added[:3], 0.0)


def test_each_process_noise_has_its_hyperparameter(uneven):
    window, _, motion = uneven
    base = covariances(window, motion, MEDIANS).process_noise
    larger = MEDIANS.copy()
    larger[0] += np.log(10.0)
    noise = covariances(window, motion, larger).process_noise
    np.testing.assert_allclose(noise[:, 3:6, 3:6], 100.0 * base[:, 3:6, 3:6])
    np.testing.assert_allclose(base[:, 3:6, 3:6], np.exp(MEDIANS[0]) ** 2 * motion.moment_noise)
    rest = np.ones((ERROR_SIZE, ERROR_SIZE), bool)
    rest[3:6, 3:6] = False
    np.testing.assert_array_equal(noise[:, rest], base[:, rest])
    attitude = base[:, :3, :3]  # keeps covariances regular, and is far less than that of a rate's integral
    assert np.all(np.linalg.eigvalsh(attitude) > 0.0)
    assert np.all(attitude < 1e-2 * (NOISE[0] * window.interval[:, None, None]) ** 2)


def test_the_first_sigma_is_the_larger_of_the_process_and_the_least_one(uneven):
    window, _, motion = uneven
    first = {}
    for shift in (-3.0, -1.5, 3.0):
        c = covariances(window, motion, MEDIANS + shift * WIDTHS)
        decay = np.diagonal(motion.transition[0])[DISTURBED]
        process = np.diagonal(c.process_noise[0])[DISTURBED] / (1.0 - decay**2)
        first[shift] = np.diag(c.initial)
        if shift > 0.0:
            np.testing.assert_allclose(first[shift][DISTURBED], process, rtol=1e-6)
        else:
            assert np.all(first[shift][DISTURBED] > process)
    np.testing.assert_array_equal(first[-3.0], first[-1.5])
    # the attitude relative to the air and the rates of the readings are known to some degrees at first
    assert np.all(np.sqrt(first[-3.0][:6]) < np.radians(5.0))
    np.testing.assert_array_equal(first[-3.0][:6], first[3.0][:6])


def test_without_noise_and_with_it_the_disturbances_are_stationary_processes(small):
    """Variance after a bin: decayed variance plus process noise is the variance before, whatever the size."""
    window, motion, _ = small
    for shift in (-1.0, 1.0):
        c = covariances(window, motion, MEDIANS + shift * WIDTHS)
        decay = motion.transition[0][DISTURBED, DISTURBED]
        noise = c.process_noise[0][DISTURBED, DISTURBED]
        sigma = np.sqrt(noise / (1.0 - decay**2))
        medians = np.exp(MEDIANS + shift * WIDTHS)
        np.testing.assert_allclose(sigma[[0, 4, 10]], medians[[2, 5, 10]], rtol=1e-9)
        assert np.all(np.diag(c.initial)[DISTURBED] >= sigma**2 * (1.0 - 1e-12))


def test_the_noise_of_a_force_grows_with_its_size(small):
    window, motion, _ = small
    sizes = MEDIANS.copy()
    sizes[1] = np.log(0.01)
    variance = covariances(window, motion, sizes).row_variance
    force = np.linalg.norm(window.readings[:, 3:], axis=1, keepdims=True)
    np.testing.assert_allclose(variance[:, 3:], window.noise[:, 3:] ** 2 + (0.01 * force) ** 2)
    np.testing.assert_allclose(variance[:, :3], window.noise[:, :3] ** 2)
