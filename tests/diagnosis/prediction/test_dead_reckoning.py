"""The dead-reckoned path against the filter's propagation, and its nodes against a motion in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from edl_filter import rotations
from edl_filter.diagnosis.prediction.dead_reckoning import (
    NODES_PER_BIN,
    DeadReckonedPath,
    dead_reckon,
    displace_nodes,
    node_rates,
    node_times,
    path_deviation,
    path_nodes,
)
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import strapdown
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import Layout

MARS = SimpleNamespace(mu=4.2828e13, j2=1.96e-3, gravity_radius=3.397e6)
SIGMA = SensorErrors(1e-2, 1e-3, 1e-2, 1e-4, 1e-3)
RATE = 8


def random_samples(seed=0, n=200, units=1):
    """Random readings of several instruments in turn, and a state above Mars."""
    rng = np.random.default_rng(seed)
    force = rng.normal(size=(n, 3)) + np.array([-20.0, 0.0, 0.0])
    rate = 0.2 * rng.normal(size=(n, 3))
    zero = np.zeros(n)
    samples = Samples(
        time=10.0 + np.arange(1, n + 1) / RATE,
        interval=np.full(n, 1.0 / RATE),
        force=force,
        rate=rate,
        mean_force=force + 0.01,
        mean_rate=rate - 0.01,
        force_noise=zero,
        rate_noise=zero,
        shared_rate_noise=zero,
        coning_corrected=np.zeros(n, bool),
        unit=(np.arange(n) * units // n).astype(np.int64),
    )
    attitude = rotations.normalise(rng.normal(size=4))
    return samples, np.concatenate(([3.4e6, 2e5, 6e5], [-500.0, 4000.0, 900.0], attitude))


def problem_of(samples, layout):
    return SimpleNamespace(samples=samples, planet=MARS, layout=layout)


def propagated(samples, start):
    """State after all samples, by one call of the filter's kernel without sensor errors."""
    states = np.repeat(start[:, None], strapdown.LANES, axis=1)
    force_map = np.zeros((12, strapdown.LANES))
    force_map[[0, 4, 8]] = 1.0
    rate_map = np.zeros((6, strapdown.LANES))
    rate_map[:3] = 1.0
    strapdown.propagate(
        states, force_map, rate_map, samples.interval, samples.force, samples.rate, MARS.mu, MARS.j2,
        MARS.gravity_radius,
    )  # fmt: skip
    return states[:, 0]


def test_without_sensor_errors_the_path_is_the_filters_propagation():
    samples, start = random_samples()
    layout = Layout.of((SensorErrors(),), {})
    path = dead_reckon(problem_of(samples, layout), start, np.zeros((1, layout.size)))
    assert path.nav.shape == (201, 10)
    np.testing.assert_array_equal(path.nav[0], start)
    np.testing.assert_allclose(path.nav[-1], propagated(samples, start), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(path.nav[80], propagated(samples.part(0, 80), start), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(path.time, np.concatenate(([10.0], samples.time)))
    np.testing.assert_array_equal(path.force, samples.mean_force)
    np.testing.assert_array_equal(path.rate, samples.mean_rate)


def test_each_instruments_errors_are_removed_from_its_own_samples():
    """The readings of two erroneous instruments give the true path if their errors are those of the linear model."""
    true, start = random_samples(units=2)
    layout = Layout.of((SIGMA,), {})
    rng = np.random.default_rng(4)
    errors = np.zeros((2, layout.size))
    readings = {n: getattr(true, n).copy() for n in ("force", "mean_force", "rate", "mean_rate")}
    for unit in range(2):
        error = {n: getattr(SIGMA, n) * rng.normal(size=3) for n in vars(SIGMA)}
        for name, value in error.items():
            errors[unit, layout[name]] = value
        misalignment = rotations.from_rotation_vector(error["accelerometer_misalignment"])
        own = true.unit == unit
        for n in ("force", "mean_force"):
            rotated = rotations.rotate(misalignment, readings[n][own])
            readings[n][own] = (1.0 + error["accelerometer_scale"]) * rotated + error["accelerometer_bias"]
        for n in ("rate", "mean_rate"):
            readings[n][own] = (1.0 + error["gyro_scale"]) * readings[n][own] + error["gyro_bias"]
    samples = Samples(**(vars(true) | readings))
    path = dead_reckon(problem_of(samples, layout), start, errors)
    np.testing.assert_allclose(path.force, true.mean_force, atol=1e-12)
    np.testing.assert_allclose(path.rate, true.mean_rate, atol=1e-12)
    np.testing.assert_allclose(path.nav[-1], propagated(true, start), rtol=1e-12, atol=1e-10)
    exchanged = dead_reckon(problem_of(samples, layout), start, errors[::-1].copy())
    assert np.linalg.norm(exchanged.nav[-1, :3] - path.nav[-1, :3]) > 1.0


#: Coning: a precession and a spin of 1 Hz, whose sum is a slow roll and a lateral rate that rotates once a second.
ROLL, LATERAL, NUTATION = 0.1, 0.1, 2.0 * np.pi


def coning(t):
    """Attitude and rate of ``exp(a t h) ⊗ exp(b t x)``, whose body rate is ``b x + R(-b t x) a h``."""
    a_h = np.array([ROLL - NUTATION, LATERAL, 0.0])
    spin_angle = np.zeros((len(t), 3))
    spin_angle[:, 0] = NUTATION * t
    spin = rotations.from_rotation_vector(spin_angle)
    attitude = rotations.multiply(rotations.from_rotation_vector(t[:, None] * a_h), spin)
    rate = rotations.rotate(rotations.conjugate(spin), a_h) + np.array([NUTATION, 0.0, 0.0])
    return attitude, rate


def mean_rates(edges):
    """Mean rates between edges, in closed form."""
    s, c = np.sin(NUTATION * edges) / NUTATION, np.cos(NUTATION * edges) / NUTATION
    integral = np.stack((ROLL * edges, LATERAL * s, LATERAL * c), axis=1)
    return np.diff(integral, axis=0) / np.diff(edges)[:, None]


@pytest.fixture(scope="module")
def coning_nodes():
    """Nodes of ten seconds of coning with a position that is a cubic of time; and the path."""
    edges = np.arange(81) / RATE
    t = edges[:, None]
    nav = np.concatenate((t**3 + [0.0, 1.0, 2.0], 3.0 * t**2 + [0.0, 1.0, 2.0], coning(edges)[0]), axis=1)
    path = DeadReckonedPath(edges, nav, np.zeros((80, 3)), mean_rates(edges))
    bins = TimeBins(edges, np.ones(80, bool))
    return path_nodes(path, bins, path.rate), path


def test_the_closed_form_is_consistent():
    """A small rotation by the rate leads from one attitude to the next; the mean rates are the rate's integrals."""
    t, h = np.linspace(0.0, 3.0, 50), 1e-4
    attitude, rate = coning(t)
    after = rotations.multiply(attitude, rotations.from_rotation_vector(h * coning(t + 0.5 * h)[1]))
    difference = rotations.multiply(rotations.conjugate(coning(t + h)[0]), after)
    assert np.abs(rotations.to_rotation_vector(difference)).max() < 1e-9
    fine = np.linspace(0.0, 0.125, 2001)
    np.testing.assert_allclose(
        np.trapezoid(coning(fine)[1], fine, axis=0) / 0.125, mean_rates(np.array([0.0, 0.125]))[0], atol=1e-8
    )
    assert np.ptp(rate[:, 1]) == pytest.approx(2.0 * LATERAL, rel=1e-2)


def test_attitude_and_rate_between_samples(coning_nodes):
    nodes, _ = coning_nodes
    assert len(nodes.time) == 80 * NODES_PER_BIN + 1
    attitude, rate = coning(nodes.time)
    inside = (nodes.time > 0.5) & (nodes.time < 9.5)
    error = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(attitude), nodes.nav[:, 6:]))
    assert np.linalg.norm(error, axis=1)[inside].max() < 1e-5
    assert np.abs(nodes.rate - rate)[inside].max() < 2e-3 * LATERAL


#: A swinging capsule that rolls: roll rate and amplitude of the lateral rates, rad/s, and their frequency, rad/s.
SWING_ROLL, SWING_RATE, SWING_FREQUENCY = 0.2, 0.1, 3.4


def swinging_rate(t):
    angle = SWING_FREQUENCY * np.asarray(t)
    return np.stack((SWING_ROLL + 0.0 * angle, SWING_RATE * np.cos(angle), SWING_RATE * np.sin(angle)), axis=-1)


def integral_of_swinging_rate(t):
    angle, radius = SWING_FREQUENCY * t, SWING_RATE / SWING_FREQUENCY
    return np.stack((SWING_ROLL * t, radius * np.sin(angle), -radius * np.cos(angle)), axis=-1)


def swinging_attitude(times):
    """Attitudes at the times, by another integrator."""

    def slope(t, attitude):
        return 0.5 * rotations.multiply(attitude, np.append(swinging_rate(t), 0.0))

    start = np.array([0.0, 0.0, 0.0, 1.0])
    solution = solve_ivp(slope, times[[0, -1]], start, "DOP853", times, rtol=1e-13, atol=1e-14)
    return rotations.normalise(solution.y.T)


def test_attitudes_inside_a_bin_contain_the_coning():
    """The integral of the rate alone is wrong inside a bin by 5 µrad, the coning up to the node."""
    edges = np.arange(81) / RATE
    bins = TimeBins(edges, np.ones(80, bool))
    mean_rate = np.diff(integral_of_swinging_rate(edges), axis=0) * RATE
    attitude = swinging_attitude(node_times(bins))
    at_edges = attitude[::NODES_PER_BIN]
    nav = np.concatenate((np.zeros((81, 6)), at_edges), axis=1)
    nodes = path_nodes(DeadReckonedPath(edges, nav, np.zeros((80, 3)), mean_rate), bins, mean_rate)
    inside = (nodes.time > 1.0) & (nodes.time < 9.0)

    def largest_error(q):
        error = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(attitude), q))
        return np.linalg.norm(error, axis=1)[inside].max()

    assert largest_error(nodes.nav[:, 6:]) < 5e-8

    last_edge = np.minimum(np.arange(len(nodes.time)) // NODES_PER_BIN, 80)
    alpha = integral_of_swinging_rate(nodes.time) - integral_of_swinging_rate(edges[last_edge])
    without = rotations.multiply(at_edges[last_edge], rotations.from_rotation_vector(alpha))
    assert largest_error(without) > 1e-6


def test_at_the_edges_the_nodes_are_on_the_path(coning_nodes):
    nodes, path = coning_nodes
    np.testing.assert_allclose(nodes.nav[::NODES_PER_BIN], path.nav, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(nodes.time[::NODES_PER_BIN], path.time, atol=1e-12)
    np.testing.assert_array_equal(node_times(TimeBins(path.time, np.ones(80, bool))), nodes.time)


def test_position_and_velocity_between_samples_are_cubics(coning_nodes):
    nodes, _ = coning_nodes
    np.testing.assert_allclose(nodes.nav[:, 0], nodes.time**3, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(nodes.nav[:, 4], 3.0 * nodes.time**2 + 1.0, rtol=1e-10, atol=1e-9)


def test_displaced_nodes_deviate_as_stated(coning_nodes):
    """At the edges by the stated values, by rotations of another package; linear in between."""
    nodes, path = coning_nodes
    deviation = np.random.default_rng(8).normal(0.0, np.repeat([50.0, 0.5, 1e-3], 3), (81, 9))
    displaced = displace_nodes(nodes, path.time, deviation)
    at_edges, nav = displaced.nav[::NODES_PER_BIN], path.nav
    np.testing.assert_allclose(at_edges[:, :6] - nav[:, :6], deviation[:, :6], rtol=0.0, atol=1e-9)
    attitude = Rotation.from_quat(nav[:, 6:]) * Rotation.from_rotvec(deviation[:, 6:])
    assert (attitude.inv() * Rotation.from_quat(at_edges[:, 6:])).magnitude().max() < 1e-12
    np.testing.assert_allclose(path_deviation(at_edges, nav), deviation, rtol=0.0, atol=1e-9)
    middle = path_deviation(displaced.nav, nodes.nav)[NODES_PER_BIN // 2 :: NODES_PER_BIN]
    np.testing.assert_allclose(middle, 0.5 * (deviation[1:] + deviation[:-1]), rtol=0.0, atol=1e-9)
    assert displaced.time is nodes.time and displaced.rate is nodes.rate


def test_a_bin_without_rates_affects_only_its_neighbourhood():
    edges = np.arange(81) / RATE
    nav = np.concatenate((np.zeros((81, 6)), coning(edges)[0]), axis=1)
    path = DeadReckonedPath(edges, nav, np.zeros((80, 3)), mean_rates(edges))
    rates, bins = path.rate.copy(), TimeBins(edges, np.ones(80, bool))
    rates[10] = np.nan
    nodes = path_nodes(path, bins, rates)
    assert np.isfinite(nodes.nav).all() and np.isfinite(nodes.rate).all()
    np.testing.assert_array_equal(node_rates(bins, rates), nodes.rate)
    later = (nodes.time > 5.0) & (nodes.time < 9.5)
    assert np.abs(nodes.rate - coning(nodes.time)[1])[later].max() < 2e-3 * LATERAL
