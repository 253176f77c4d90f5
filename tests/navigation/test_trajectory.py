"""The smoothed trajectory at every sample: at the nodes, and between them."""

from dataclasses import replace

import numpy as np
import pytest
import twins
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.constraints import LandingSite, RestVelocity
from edl_filter.navigation.filter import EntryErrors, Settings, build_problem, run_filter
from edl_filter.navigation.layout import State
from edl_filter.navigation.smoother import Smoothed, smooth
from edl_filter.navigation.trajectory import (
    Trajectory,
    distribute_correction,
    inertial_covariance,
    propagate_state,
    random_walk_share,
    smoothed_trajectory,
)
from edl_filter.telemetry.record import InitialState

ERRORS = SensorErrors(0.05, 1e-3, 1e-3, 1e-3, 1e-3)
MARS = twins.MARS
NAV = np.array([3.4e6, 1e5, -2e5, -300.0, 900.0, 100.0, 0.2, -0.1, 0.3, 0.9])
NAV[6:] = rotations.normalise(NAV[6:])


def problem(constraints=(), count=80):
    rng = np.random.default_rng(3)
    s = twins.samples(
        np.full(count, 0.125),
        np.array([-20.0, 1.0, -2.0]) + rng.standard_normal((count, 3)),
        [0.3, 0.1, -0.2] + 0.1 * rng.standard_normal((count, 3)),
        force_noise=0.1,
        rate_noise=2e-3,
    )
    covariance = np.diag(np.repeat([100.0, 2.0, 0.01], 3) ** 2)
    start = InitialState(0.0, NAV[:3], NAV[3:6], NAV[6:], covariance)
    return build_problem(s, start, EntryErrors(), (ERRORS,), list(constraints), MARS, Settings(longest_interval=2.0))


def dead_reckoning(start):
    """The scalar twin's states at every sample ``(N + 1, 10)``, without sensor errors."""
    s, path = problem().samples, [start]
    maps = np.concatenate((np.eye(3).ravel(), np.zeros(3))), np.array([1.0, 1, 1, 0, 0, 0])
    for i in range(len(s.time)):
        part = slice(i, i + 1)
        args = s.interval[part], s.force[part], s.rate[part], MARS.mu, MARS.j2, MARS.gravity_radius
        path.append(twins.propagate(path[-1], *maps, *args))
    return np.array(path)


@given(st.integers(0, 2**32 - 1), st.integers(0, 20), st.sampled_from([0.0, MARS.j2]))
def test_every_step_of_one_state_equals_the_scalar_twin(seed, count, j2):
    rng = np.random.default_rng(seed)
    interval, rate = rng.uniform(0.02, 0.125, count), rng.standard_normal((count, 3))
    force, gravity = 40.0 * rng.standard_normal((count, 3)), (MARS.mu, j2, MARS.gravity_radius)
    states = propagate_state(NAV, interval, force, rate, *gravity)
    assert states.shape == (count, 10)
    maps, expected = [m[:, 0] for m in twins.no_maps(1)], NAV
    for i in range(count):
        part = slice(i, i + 1)
        expected = twins.propagate(expected, *maps, interval[part], force[part], rate[part], *gravity)
        for block in (slice(0, 3), slice(3, 6), slice(6, 10)):
            scale = np.linalg.norm(expected[block])
            np.testing.assert_allclose(states[i, block], expected[block], rtol=0, atol=1e-12 * scale)


def two_constraints():
    end = dead_reckoning(NAV)[-1, :3] + [100.0, -80.0, 120.0]
    site = LandingSite(10.0, MARS.rotation.to_fixed(10.0, end), 5.0**2 * np.eye(3), MARS)
    return [RestVelocity(4.0, 500.0, MARS), site]


def test_equals_the_smoothed_state_at_every_node():
    p = problem(two_constraints())
    filter_pass = run_filter(p)
    smoothed = smooth(filter_pass)
    path = smoothed_trajectory(p, smoothed, filter_pass.layout)
    assert len(path.time) == len(p.samples.time) + 1
    for t, state, covariance in zip(smoothed.time, smoothed.states, smoothed.covariance, strict=True):
        i = int(np.argmin(np.abs(path.time - t)))
        np.testing.assert_allclose(path.position[i], state.nav[:3], atol=1e-8)
        np.testing.assert_allclose(path.velocity[i], state.nav[3:6], atol=1e-10)
        assert twins.attitude_error(path.inertial_from_body[i], state.nav[6:10]) < 1e-12
        np.testing.assert_allclose(np.diag(path.covariance[i])[:6], np.diag(covariance)[:6], rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(path.inertial_from_body, axis=1), 1.0, atol=1e-13)


def test_without_noise_and_errors_is_dead_reckoning():
    """Nodes of a propagation without updates and negligible priors of the errors: the scalar twin at every sample."""
    p = problem()
    s, reckoned, stops = p.samples, dead_reckoning(NAV), [0, 21, 51, 80]
    states, time = [State(reckoned[i], np.zeros(24)) for i in stops], [0.125 * i for i in stops]
    smoothed = Smoothed(np.array(time), np.zeros(4, int), states, np.tile(np.eye(24), (4, 1, 1)), np.zeros((3, 24, 24)))
    path = smoothed_trajectory(p, smoothed, p.layout)
    states = np.concatenate((path.position, path.velocity, path.inertial_from_body), axis=1)
    np.testing.assert_allclose(states, reckoned, rtol=1e-11, atol=1e-11)
    np.testing.assert_array_equal(path.specific_force[1:], s.force)
    np.testing.assert_array_equal(path.angular_rate[0], s.rate[0])


def test_force_and_rate_are_corrected():
    p = problem(two_constraints())
    filter_pass = run_filter(p)
    smoothed = smooth(filter_pass)
    path = smoothed_trajectory(p, smoothed, filter_pass.layout)
    e = smoothed.states[1].errors
    assert np.all(np.abs(e[9:]) > 1e-8)
    i = p.samples.index(smoothed.time[1]) + 1  # the first sample after the second node
    turn = rotations.from_rotation_vector(e[filter_pass.layout["accelerometer_misalignment"]])
    scale, bias = e[filter_pass.layout["accelerometer_scale"]], e[filter_pass.layout["accelerometer_bias"]]
    read = (1 + scale) * rotations.rotate(turn, path.specific_force[i]) + bias
    np.testing.assert_allclose(read, p.samples.force[i - 1], rtol=1e-12)
    read = (1 + e[filter_pass.layout["gyro_scale"]]) * path.angular_rate[i] + e[filter_pass.layout["gyro_bias"]]
    np.testing.assert_allclose(read, p.samples.rate[i - 1], rtol=1e-12)


def test_between_the_nodes_the_corrected_readings_are_propagated():
    """Nodes that are the scalar twin's own states with gyro errors: no correction is left to distribute."""
    p = problem()
    s, layout = p.samples, p.layout
    errors = np.zeros(layout.size)
    errors[layout["gyro_bias"]], errors[layout["gyro_scale"]] = [2e-3, -1e-3, 3e-3], [0.02, -0.01, 0.03]
    errors[layout["accelerometer_bias"]] = [0.05, -0.02, 0.04]
    rate = (s.rate - errors[layout["gyro_bias"]]) / (1.0 + errors[layout["gyro_scale"]])
    force = s.force - errors[layout["accelerometer_bias"]]
    path = propagate_state(NAV, s.interval, force, rate, MARS.mu, MARS.j2, MARS.gravity_radius)
    stops = [0, 21, 80]
    states = [State(nav, errors) for nav in (NAV, path[20], path[79])]
    zeros = np.zeros((2, layout.size, layout.size))
    covariance = np.tile(np.eye(layout.size), (3, 1, 1))
    smoothed = Smoothed(0.125 * np.array(stops), np.zeros(3, int), states, covariance, zeros)
    trajectory = smoothed_trajectory(p, smoothed, layout)
    actual = np.concatenate((trajectory.position, trajectory.velocity, trajectory.inertial_from_body), axis=1)
    np.testing.assert_allclose(actual[1:], path, rtol=1e-10, atol=1e-10)


def test_a_filled_sample_takes_more_of_the_correction():
    """Its variance is that of its noise and the mean of its fill's variances over the axes."""
    p = problem()
    s, layout = p.samples, p.layout
    fill = np.zeros_like(s.force_fill_sigma)
    fill[10] = [0.3, 0.6, 0.9]
    p = replace(p, samples=replace(s, force_fill_sigma=fill))
    reckoned, moved = dead_reckoning(NAV), np.array([40.0, -30.0, 20.0])
    states = [State(reckoned[i].copy(), np.zeros(layout.size)) for i in (0, 80)]
    states[1].nav[:3] += moved
    zeros = np.zeros((1, layout.size, layout.size))
    covariance = np.tile(np.eye(layout.size), (2, 1, 1))
    smoothed = Smoothed(np.array([0.0, 10.0]), np.zeros(2, int), states, covariance, zeros)
    trajectory = smoothed_trajectory(p, smoothed, layout)
    share = (trajectory.position - reckoned[:, :3]) @ moved / (moved @ moved)
    variance = np.full(80, 0.1**2)
    variance[10] += (0.3**2 + 0.6**2 + 0.9**2) / 3.0
    np.testing.assert_allclose(share[1:], np.cumsum(variance) / variance.sum(), rtol=1e-6)


def test_an_attitude_that_was_computed_on_board_is_no_part_of_the_trajectory():
    onboard = rotations.normalise([0.3, 0.1, 0.2, 0.9])
    path = np.tile(NAV, (3, 1))
    target = State(np.concatenate((NAV, onboard)), np.zeros(12)).plus(np.array([5.0, *np.zeros(11)]))
    out = distribute_correction(path, target, np.array([0.2, 0.6, 1.0]), np.ones(3))
    np.testing.assert_allclose(out[:, 0] - NAV[0], [1.0, 3.0, 5.0], rtol=1e-9)
    np.testing.assert_allclose(out[:, 1:], path[:, 1:], rtol=1e-12)


def test_shares_are_those_of_the_random_walk():
    share = random_walk_share(np.array([1.0, 1.0, 2.0, 1.0]), np.array([1.0, 1.0, 3.0, 0.0]))
    np.testing.assert_allclose(share, np.array([1.0, 2.0, 38.0, 38.0]) / 38.0)


def test_a_correction_is_distributed_along_the_path():
    rng = np.random.default_rng(0)
    path = rng.standard_normal((5, 10))
    path[:, 6:] = rotations.normalise(path[:, 6:])
    correction = np.array([1.0, -2.0, 3.0, 0.1, 0.2, 0.3, 0.05, -0.02, 0.03])
    target = State(path[-1], np.zeros(9)).plus(correction)
    moved, turned = np.array([0.1, 0.2, 0.3, 0.9, 1.0]), np.array([0.0, 0.5, 0.5, 0.5, 1.0])
    out = distribute_correction(path, target, moved, turned)
    np.testing.assert_allclose(out[:, :6] - path[:, :6], moved[:, None] * correction[:6], atol=1e-14)
    assert twins.attitude_error(out[-1, 6:], target.nav[6:]) < 1e-14
    np.testing.assert_allclose(out[0, 6:], path[0, 6:], atol=1e-15)
    # half the turn, about the same inertial axis, everywhere in between
    axis = rotations.rotate(path[-1, 6:], 0.5 * correction[6:])
    for i in (1, 2, 3):
        turn = rotations.to_rotation_vector(rotations.multiply(out[i, 6:], rotations.conjugate(path[i, 6:])))
        np.testing.assert_allclose(turn, axis, atol=1e-14)


def test_covariances_are_in_inertial_axes_and_even_between_nodes():
    rng = np.random.default_rng(1)
    states = [
        State(np.concatenate((np.zeros(6), rotations.normalise(rng.standard_normal(4)))), np.zeros(9)) for _ in "abc"
    ]
    nodes = np.array([twins.random_covariance(rng, rng.uniform(1, 2, 9)) for _ in "abc"])
    smoothed = Smoothed(np.array([0.0, 2.0, 6.0]), np.zeros(3, int), states, nodes, np.zeros((2, *nodes.shape[1:])))
    times, empty = np.array([0.0, 1.0, 2.0, 5.0, 6.0]), np.zeros((5, 3))
    path = Trajectory(times, empty, empty, np.zeros((5, 4)), smoothed.time, inertial_covariance(smoothed), empty, empty)

    def inertial(k):
        # errors drawn in body axes, turned one by one
        x = np.linalg.cholesky(nodes[k])
        x[6:] = np.array([rotations.rotate(states[k].nav[6:], e) for e in x[6:].T]).T
        return x @ x.T

    a, b, c = (inertial(k) for k in range(3))
    for got, expected in zip(path.covariance, (a, (a + b) / 2, b, b / 4 + 3 * c / 4, c), strict=True):
        np.testing.assert_allclose(got, expected, atol=1e-13)


def test_smoothed_trajectory_is_closer_to_the_truth_than_dead_reckoning():
    """A wrong start is corrected everywhere: the error is within three of its own sigmas at every sample."""
    start = NAV.copy()
    start[:6] += [80.0, -120.0, 60.0, 1.5, -2.0, 1.0]
    true = dead_reckoning(start)
    fixes = [
        LandingSite(t, MARS.rotation.to_fixed(t, true[round(8 * t), :3]), 1.0 * np.eye(3), MARS) for t in (3.0, 9.0)
    ]
    p = problem(fixes)
    filter_pass = run_filter(p)
    path = smoothed_trajectory(p, smooth(filter_pass), filter_pass.layout)
    sigma = np.sqrt(np.array([np.diag(c) for c in path.covariance]))
    assert np.max(np.abs(path.position - true[:, :3]) / sigma[:, :3]) < 3.0
    assert np.max(np.abs(path.position - true[:, :3])) < 10.0
    assert np.max(np.abs(path.velocity - true[:, 3:6])) == pytest.approx(0.0, abs=1.0)


def test_without_noise_a_correction_is_distributed_over_time():
    interval = np.array([0.1, 0.3, 0.6])
    np.testing.assert_allclose(random_walk_share(interval, np.zeros(3)), [0.1, 0.4, 1.0])
    np.testing.assert_allclose(random_walk_share(interval, np.array([1.0, 0.0, 0.0])), [1.0, 1.0, 1.0])
