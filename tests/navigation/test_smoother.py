"""The smoother against Rauch, Tung and Striebel's, and both against least squares over all epochs at once."""

from dataclasses import replace

import numpy as np
import pytest
import twins

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.constraints import RestGravity, RestVelocity
from edl_filter.navigation.filter import EntryErrors, Settings, build_problem, run_filter
from edl_filter.navigation.smoother import smooth
from edl_filter.telemetry.record import InitialState


def compare(smoothed, means, covariances, tolerance):
    for state, smoothed_covariance, mean, covariance in zip(
        smoothed.states, smoothed.covariance, means, covariances, strict=True
    ):
        sigma = np.sqrt(np.diag(covariance))
        assert np.max(np.abs(twins.linear_vector(state) - mean) / sigma) < tolerance
        assert np.max(np.abs(twins.linear_block(smoothed_covariance) - covariance) / np.outer(sigma, sigma)) < tolerance


every_smoother = pytest.mark.parametrize(
    ("method", "engine"), [("ukf", "compiled"), ("ukf", "filterpy"), ("ekf", "compiled"), ("ekf", "filterpy")]
)


def linear_pass(seed, method, engine):
    """A linear problem, and its filter pass, which `engine` smooths: the readable recursion or the compiled one."""
    case = twins.linear(seed, Settings(longest_interval=1.5, gate_probability=1.0, method=method))
    return case, replace(run_filter(case.problem), engine=engine)


@every_smoother
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_the_textbook_on_a_linear_problem(seed, method, engine):
    case, filter_pass = linear_pass(seed, method, engine)
    smoothed = smooth(filter_pass)
    means, covariances, _ = twins.kalman(case.mean, case.covariance, case.steps)
    compare(smoothed, *twins.rauch_tung_striebel(means, covariances, case.steps), 1e-9)


@every_smoother
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_least_squares_over_all_epochs(seed, method, engine):
    case, filter_pass = linear_pass(seed, method, engine)
    smoothed = smooth(filter_pass)
    compare(smoothed, *twins.least_squares(case.mean, case.covariance, case.steps), 1e-9)


def test_ends_at_the_filters_estimate_and_has_smaller_covariances_before():
    filter_pass = run_filter(twins.linear().problem)
    smoothed = smooth(filter_pass)
    np.testing.assert_array_equal(smoothed.covariance[-1], filter_pass.nodes[-1].covariance)
    np.testing.assert_array_equal(smoothed.states[-1].nav, filter_pass.nodes[-1].state.nav)
    np.testing.assert_array_equal(smoothed.time, [n.time for n in filter_pass.nodes])
    first = twins.linear_block(filter_pass.nodes[0].covariance) - twins.linear_block(smoothed.covariance[0])
    assert np.all(np.linalg.eigvalsh(first) > 0.0)


def test_the_estimates_do_not_depend_on_the_references_of_a_linear_problem():
    """Errors about other reference states than the filter's estimates give the same smoothed states."""
    filter_pass = run_filter(twins.linear().problem)
    rng = np.random.default_rng(6)
    sigma = [np.sqrt(np.diag(n.covariance)) for n in filter_pass.nodes]
    turned = np.arange(len(sigma[0])) // 3 == 2  # the composition of rotations is not linear
    references = [
        n.state.plus(np.where(turned, 0.0, 0.5 * s * rng.standard_normal(len(s))))
        for n, s in zip(filter_pass.nodes, sigma, strict=True)
    ]
    expected, smoothed = smooth(filter_pass), smooth(replace(filter_pass, references=references))
    means = [twins.linear_vector(state) for state in expected.states]
    compare(smoothed, means, [twins.linear_block(c) for c in expected.covariance], 1e-6)


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_the_gains_are_those_of_the_covariances_from_node_to_node(engine):
    """``P_s = P + G (P_s⁺ - P⁻) Gᵀ`` with the gain, covariances and transition of each node (Särkkä 2013, eq. 8.6)."""
    filter_pass = replace(run_filter(twins.linear().problem), engine=engine)
    smoothed, nodes = smooth(filter_pass), filter_pass.nodes
    assert smoothed.gain.shape == (len(nodes) - 1, *nodes[0].covariance.shape)
    for k, gain in enumerate(smoothed.gain):
        change = smoothed.covariance[k + 1] - nodes[k + 1].transition.covariance
        expected = twins.linear_block(nodes[k].covariance + gain @ change @ gain.T)
        sigma = np.sqrt(np.diag(expected))
        error = twins.linear_block(smoothed.covariance[k]) - expected
        assert np.max(np.abs(error) / np.outer(sigma, sigma)) < 1e-9


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_a_single_node_is_its_own_smoothed_state(engine):
    filter_pass = replace(run_filter(twins.linear().problem), engine=engine)
    last = len(filter_pass.nodes) - 1
    smoothed = smooth(filter_pass, last)
    size = len(filter_pass.nodes[-1].covariance)
    assert smoothed.gain.shape == (0, size, size)
    np.testing.assert_array_equal(smoothed.covariance, [filter_pass.nodes[-1].covariance])


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_may_stop_at_a_later_node(engine):
    filter_pass = replace(run_filter(twins.linear().problem), engine=engine)
    complete, part = smooth(filter_pass), smooth(filter_pass, 4)
    np.testing.assert_array_equal(part.covariance, complete.covariance[4:])
    np.testing.assert_array_equal(part.time, complete.time[4:])
    np.testing.assert_array_equal(part.states[0].nav, complete.states[4].nav)


@pytest.mark.parametrize("method", ["ukf", "ekf"])
def test_velocity_at_rest_is_a_brownian_bridge(method):
    """Zero at both ends of the window, and an unknown bias of the accelerometers: variance ``q t (1 - t/T)``."""
    count, interval, noise, planet = 160, 0.125, 0.003, twins.MARS
    position = np.array([3.39e6, 2e5, -3e5])
    velocity = np.cross([0.0, 0.0, planet.rotation_rate], position)
    covariance = np.diag(np.square(np.repeat([1.0, 1.0, 1e-7], 3)))
    start = InitialState(0.0, position, velocity, np.array([0.0, 0.0, 0.0, 1.0]), covariance)
    rate = np.array([0.0, 0.0, planet.rotation_rate])
    turns = [rotations.from_rotation_vector((k + 0.5) * interval * rate) for k in range(count)]
    support = -planet.apparent_gravity(position)
    force = np.array([rotations.rotate(rotations.conjugate(turn), rotations.rotate(turn, support)) for turn in turns])
    samples = twins.samples(np.full(count, interval), force, np.tile(rate, (count, 1)), force_noise=noise)
    length = count * interval
    constraints = [RestVelocity(interval, 1e-5, planet), RestGravity(length, length - interval, 1e-6, planet)]
    problem = build_problem(
        samples, start, EntryErrors(), (SensorErrors(accelerometer_bias=0.1),), constraints, planet,
        Settings(longest_interval=2.5, method=method),
    )  # fmt: skip
    smoothed = smooth(run_filter(problem))
    for time, state, block in zip(smoothed.time, smoothed.states, smoothed.covariance, strict=True):
        since = time - interval
        if not 1.0 < since < length - 1.0:
            continue
        expected = noise**2 * interval * since * (1.0 - since / (length - interval))
        np.testing.assert_allclose(np.diag(block)[3:6], expected, rtol=0.02)
        relative = planet.velocity_relative(state.nav[:3], state.nav[3:6])
        assert np.max(np.abs(relative)) < 0.1 * np.sqrt(expected)
