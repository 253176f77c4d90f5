"""Process noise against a recursion forwards and against a Monte Carlo through the kernel."""

from dataclasses import replace

import numpy as np
import pytest
import twins
from compiled_cases import filled, uneven_samples

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import strapdown
from edl_filter.navigation.layout import Layout, attitude_errors
from edl_filter.navigation.noise import process_noise, process_noise_of_intervals

RUNS = 4096
BARE = Layout.of((SensorErrors(),), {})
ONBOARD = Layout.of((SensorErrors(),), {"onboard_attitude": 3})


def problem(count=40, seed=0):
    rng = np.random.default_rng(seed)
    s = twins.samples(
        rng.uniform(0.06, 0.2, count),
        [-30.0, 4.0, -6.0] + 5.0 * rng.standard_normal((count, 3)),
        [0.4, -0.2, 0.3] + 0.3 * rng.standard_normal((count, 3)),
        force_noise=rng.uniform(0.05, 0.2, (count, 3)),
        rate_noise=rng.uniform(2e-4, 1e-3, (count, 3)),
    )
    return s, rotations.normalise(rng.standard_normal(4))


def spread(s, attitude, force_noise, rate_noise):
    """States ``(10, RUNS)`` after samples whose force and rate carry the given errors ``(N, 3, RUNS)``."""
    state = np.repeat(np.concatenate(([3.5e6, 0, 0, 0, 3e3, 0], attitude))[:, None], RUNS, axis=1)
    force_map, rate_map = twins.no_maps(RUNS)
    p = twins.MARS
    for i in range(len(s.time)):
        force_map[9:], rate_map[3:] = force_noise[i], rate_noise[i]
        part = slice(i, i + 1)
        strapdown.propagate(
            state, force_map, rate_map, s.interval[part], s.force[part], s.rate[part], p.mu, p.j2, p.gravity_radius
        )
    return state


def errors_of(state, reference):
    return np.concatenate((state[:6] - reference[:6, None], attitude_errors(reference[6:], state[6:]).T))


def draw(rng, sigma):
    return sigma[:, :, None] * rng.standard_normal((len(sigma), 3, RUNS))


def whitened(sample, expected):
    """The sample covariance in units of the expected one: the unit matrix but for 1/√RUNS."""
    root = np.linalg.cholesky(expected)
    return np.linalg.solve(root, np.linalg.solve(root, sample).T)


def test_equals_a_recursion_forwards():
    """With an on-board attitude, which has the part of the rate noise that it does not share."""
    s, attitude = problem()
    s = replace(s, shared_rate_noise=np.linspace(0.0, 1.0, len(s.time))[:, None] * s.rate_noise)
    unshared = np.sqrt(s.rate_noise**2 - s.shared_rate_noise**2)
    common = twins.process_noise(replace(s, force_noise=np.zeros_like(unshared), rate_noise=unshared), attitude)
    expected = np.zeros((12, 12))
    expected[:9, :9] = twins.process_noise(s, attitude)
    expected[9:, :9], expected[:9, 9:], expected[9:, 9:] = common[6:], common[:, 6:], common[6:, 6:]
    scale = np.sqrt(np.diag(expected))
    for layout in (BARE, ONBOARD):
        block, sigma = expected[: layout.size, : layout.size], scale[: layout.size]
        noise = process_noise(layout, s, attitude)
        np.testing.assert_allclose(noise / np.outer(sigma, sigma), block / np.outer(sigma, sigma), rtol=0, atol=1e-12)


@pytest.mark.parametrize("layout", [BARE, ONBOARD])
def test_noise_of_each_interval_is_that_of_its_samples(layout):
    """Intervals of different length, one of them without samples; samples of all kinds."""
    rng = np.random.default_rng(4)
    s = filled(uneven_samples(rng, 60), rng, 0.3, 0.02)
    begins, ends = np.array([0, 4, 4, 5, 31]), np.array([4, 4, 5, 31, 60])
    attitudes = rotations.normalise(rng.standard_normal((len(begins), 4)))
    noise = process_noise_of_intervals(layout, s, attitudes, begins, ends)
    assert not noise[1].any()
    for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        np.testing.assert_array_equal(noise[k], process_noise(layout, s.part(begin, end), attitudes[k]))


@pytest.mark.parametrize("count", [8, 40])
def test_is_the_covariance_of_many_noisy_flights(count):
    s, attitude = problem(count, seed=count)
    rng = np.random.default_rng(1)
    state = spread(s, attitude, draw(rng, s.force_noise), draw(rng, s.rate_noise))
    reference = spread(s, attitude, np.zeros((count, 3, RUNS)), np.zeros((count, 3, RUNS)))[:, 0]
    noise = process_noise(BARE, s, attitude)
    ratio = whitened(np.cov(errors_of(state, reference)), noise)
    assert np.max(np.abs(ratio - np.eye(9))) < 5 * np.sqrt(2 / RUNS)  # 90 numbers, five sigmas


def test_the_onboard_attitude_shares_the_noise_of_unknown_readings():
    """Errors of the true motion and of the on-board attitude, both about this filter's references.

    The gyros' noise is in the readings, which on board and this filter have alike: it parts the true attitude from
    both. What this filter does not know of the readings (here all of a gap) moves the true and the on-board attitude.
    """
    s, attitude = problem(30, seed=5)
    shared = 0.8 * s.rate_noise
    shared[10:12] = 0.0  # a gap: only the filter lacks the readings
    s = twins.samples(s.interval, s.force, s.rate, s.force_noise, s.rate_noise, shared)
    rng = np.random.default_rng(2)
    gyros, unshared = draw(rng, shared), draw(rng, np.sqrt(s.rate_noise**2 - shared**2))
    nothing = np.zeros((30, 3, RUNS))
    true = spread(s, attitude, draw(rng, s.force_noise), gyros + unshared)
    onboard = spread(s, attitude, nothing, unshared)
    reference = spread(s, attitude, nothing, nothing)[:, 0]
    covariance = np.cov(np.concatenate((errors_of(true, reference), errors_of(onboard, reference)[6:])))
    ratio = whitened(covariance, process_noise(ONBOARD, s, attitude))
    assert np.max(np.abs(ratio - np.eye(12))) < 5 * np.sqrt(2 / RUNS)


def test_without_unknown_readings_the_onboard_attitude_has_no_noise():
    s, attitude = problem(20, seed=6)
    s = twins.samples(s.interval, s.force, s.rate, s.force_noise, s.rate_noise, s.rate_noise)
    noise = process_noise(ONBOARD, s, attitude)
    assert not noise[9:].any()
    np.testing.assert_allclose(noise[:9, :9], process_noise(BARE, s, attitude), rtol=1e-12)


def test_other_states_get_no_noise():
    layout = Layout.of((SensorErrors(1e-3, 1e-3, 1e-3, 1e-3, 1e-3),), {"entry_epoch": 1})
    s, attitude = problem(5)
    noise = process_noise(layout, s, attitude)
    assert not noise[9:].any()
    assert not noise[:, 9:].any()


def test_splitting_a_sample_changes_its_noise_to_second_order_only():
    s, attitude = problem(40, seed=3)
    cut = s.split(s.time - 0.3 * s.interval)
    uncut_noise = process_noise(BARE, s, attitude)
    parts = process_noise(BARE, cut, attitude)
    assert np.max(np.abs(whitened(parts, uncut_noise) - np.eye(9))) < 0.02


def test_filled_samples_add_the_noise_of_their_sigmas():
    """Against the noise of samples that are all as uncertain; along each axis by its own sigma."""
    s, attitude = problem(30, seed=8)
    nothing = np.zeros_like(s.force_noise)
    bare = replace(s, force_noise=nothing, rate_noise=nothing, shared_rate_noise=nothing)
    uncertain = replace(bare, force_noise=nothing + 0.02, rate_noise=nothing + 0.003)
    filled = replace(
        bare, force_fill_sigma=np.full((len(s.time), 3), 0.02), rate_fill_sigma=np.full((len(s.time), 3), 0.003)
    )
    uncertain_noise = process_noise(BARE, uncertain, attitude)
    assert np.max(np.abs(whitened(process_noise(BARE, filled, attitude), uncertain_noise) - np.eye(9))) < 0.05
    for axis in range(3):
        sigma = np.zeros((len(s.time), 3))
        sigma[-1, axis] = 0.01
        noise = process_noise(BARE, replace(bare, force_fill_sigma=sigma), attitude)
        variance = np.linalg.eigvalsh(noise[3:6, 3:6])
        np.testing.assert_allclose(variance, [0.0, 0.0, (0.01 * s.interval[-1]) ** 2], atol=1e-18)
