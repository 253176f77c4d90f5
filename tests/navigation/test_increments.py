"""Coning, sculling, lever arm, splitting, and the noise of unresolved motion."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import twins
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from edl_filter import rotations
from edl_filter.navigation import strapdown
from edl_filter.navigation.increments import (
    INTEGRATION_DIFFERENCE,
    effective_samples,
    onboard_rates,
    unresolved_motion_of,
)
from edl_filter.navigation.unresolved import unresolved_motion

LANES = strapdown.LANES


def integrate(samples, attitude):
    """Velocity and attitude after `samples` from rest in empty space."""
    state = np.zeros((10, LANES))
    state[0], state[6:] = 1.0, attitude[:, None]  # off the centre, where gravity's 0/0 would be
    maps = twins.no_maps(LANES)
    strapdown.propagate(state, *maps, samples.interval, samples.force, samples.rate, 0.0, 0.0, 1.0)
    return state[3:6, 0], state[6:, 0]


def raw(record):
    """The measured means as they are."""
    return twins.samples(record.interval, record.specific_force, record.angular_rate)


def coning(dt, end, half_angle=0.02, speed=6.0):
    """Classical coning (Savage 1998, section IV): the body's x axis draws a cone, known in closed form."""
    edges = np.linspace(0.0, end, round(end / dt) + 1)
    a, b = edges[:-1], edges[1:]
    c, s = np.cos(speed * edges), np.sin(speed * edges)
    rate = np.empty((len(a), 3))
    rate[:, 0] = -2.0 * speed * np.sin(half_angle / 2) ** 2
    rate[:, 1] = np.sin(half_angle) * np.diff(c) / (b - a)
    rate[:, 2] = np.sin(half_angle) * np.diff(s) / (b - a)

    def attitude(t):
        return rotations.from_rotation_vector(half_angle * np.array([0.0, np.cos(speed * t), np.sin(speed * t)]))

    return twins.record(edges, np.zeros((len(a), 3)), rate), attitude(0.0), attitude(end)


def test_coning_rate_is_the_derivative_of_coning_attitude():
    """The closed form itself, by the twin's integrator: a condition for the next test."""
    record, start, end = coning(1.0 / 4096, 0.5)
    q = start
    for dt, w in zip(record.interval, record.angular_rate, strict=True):
        q = rotations.multiply(q, rotations.from_rotation_vector(dt * w))
    assert twins.attitude_error(end, q) < 1e-8


def test_coning_drift_is_corrected_to_sixth_order():
    """Drift of raw and of corrected means against theory, with x = Ω Δt (0.75 at 8 Hz).

    The coning in a sample is ``θ² (x - sin x) / 2`` (Savage 1998, section IV: θ²x³/12 for small x). A quintic spline
    misses a part of it of order x⁶; terms of third order in the angle are smaller.
    """
    half_angle, speed, end = 0.02, 6.0, 60.0
    plain, corrected = [], []
    for dt in (0.25, 0.125, 0.0625):
        record, start, stop = coning(dt, end, half_angle, speed)
        plain.append(twins.attitude_error(stop, integrate(raw(record), start)[1]))
        corrected.append(twins.attitude_error(stop, integrate(effective_samples(record), start)[1]))
        x = speed * dt
        assert plain[-1] == pytest.approx(half_angle**2 * (x - np.sin(x)) / 2 * end / dt, rel=0.02)
    assert np.log2(plain[1] / plain[2]) == pytest.approx(2.0, abs=0.1)
    assert np.log2(corrected[0] / corrected[1]) > 5.5
    assert corrected[1] < plain[1] / 500.0


def test_sculling_drift_is_corrected():
    """Rocking about x in phase with a force along y gives a mean force θB/2 along z, which raw means do not contain."""
    angle, size, speed, end = 0.05, 5.0, 6.0, 60.0
    plain, corrected = [], []
    for dt in (0.125, 0.0625):
        edges = np.linspace(0.0, end, round(end / dt) + 1)
        rate, force = np.zeros((len(edges) - 1, 3)), np.zeros((len(edges) - 1, 3))
        rate[:, 0] = angle * np.diff(np.sin(speed * edges)) / dt  # of the angle θ sin Ωt
        force[:, 1] = size * np.diff(-np.cos(speed * edges)) / speed / dt  # B sin Ωt
        record = twins.record(edges, force, rate)
        # exactly: ∫ B sin Ωt sin(θ sin Ωt) dt
        t = np.linspace(0.0, end, 600001)
        expected = np.trapezoid(size * np.sin(speed * t) * np.sin(angle * np.sin(speed * t)), t)
        start = np.array([0, 0, 0, 1.0])
        plain.append(abs(integrate(raw(record), start)[0][2] - expected))
        corrected.append(abs(integrate(effective_samples(record), start)[0][2] - expected))
    assert np.log2(plain[0] / plain[1]) == pytest.approx(2.0, abs=0.15)
    assert np.log2(corrected[0] / corrected[1]) > 5.0
    assert corrected[1] < plain[1] / 200.0


def test_any_smooth_motion_gains_two_orders():
    """Velocity and attitude of a tumbling body under a turning force, all terms at once."""
    rng = np.random.default_rng(3)
    force = twins.Waves.draw(rng, (), 10.0, 10.0, 2.0)
    rate = twins.Waves.draw(rng, (), 0.4, 0.3, 2.0)
    start = np.concatenate(([1.0, 0, 0, 0, 0, 0], rotations.normalise(rng.standard_normal(4))))
    truth = twins.integrate(start, force, rate, [0.0, 20.0], twins.VOID)[-1]
    errors = []
    for dt in (0.125, 0.0625):
        edges = np.arange(0.0, 20.0 + dt / 2, dt)
        record = twins.record(edges, force.means(edges), rate.means(edges))
        for samples in (raw(record), effective_samples(record)):
            velocity, attitude = integrate(samples, start[6:])
            errors.append((np.linalg.norm(velocity - truth[3:6]), twins.attitude_error(truth[6:], attitude)))
    plain, corrected = np.array(errors[::2]), np.array(errors[1::2])
    np.testing.assert_allclose(np.log2(plain[0] / plain[1]), 2.0, atol=0.2)
    assert np.all(np.log2(corrected[0] / corrected[1]) > 3.3)
    assert np.all(corrected[0] < plain[0] / 20.0)


def tumbling(dt, end=30.0):
    """A body that starts at rest, tumbles in free fall and stops; its IMU is not at the centre of mass."""
    position = np.array([0.4, -0.3, 0.2])

    def rate(t):
        envelope = np.sin(np.pi * t / end) ** 2
        return envelope * np.array([0.5 * np.cos(t), 0.4 * np.sin(0.7 * t), 0.6])

    def felt(t):
        alpha = (rate(t + 1e-5) - rate(t - 1e-5)) / 2e-5
        return np.cross(alpha, position) + np.cross(rate(t), np.cross(rate(t), position))

    edges = np.linspace(0.0, end, round(end / dt) + 1)
    nodes, weights = np.polynomial.legendre.leggauss(5)
    force, turn = np.zeros((len(edges) - 1, 3)), np.zeros((len(edges) - 1, 3))
    for i, (a, b) in enumerate(pairwise(edges)):
        for x, w in zip(nodes, weights, strict=True):
            t = 0.5 * (a + b) + 0.5 * (b - a) * x
            force[i] += 0.5 * w * felt(t)
            turn[i] += 0.5 * w * rate(t)
    return twins.record(edges, force, turn, position=position), position


def test_lever_arm_leaves_nothing_in_free_fall():
    velocities = []
    for dt in (0.125, 0.0625):
        record, _ = tumbling(dt)
        start = np.array([0, 0, 0, 1.0])
        velocities.append(np.linalg.norm(integrate(effective_samples(record), start)[0]))
        without = twins.record(np.append(0.0, record.time), record.specific_force, record.angular_rate)
        felt = np.max(np.abs(effective_samples(record).force))
        assert felt < 0.02 * np.max(np.abs(effective_samples(without).force))
    assert velocities[0] < 2e-3  # m/s after 30 s of up to 0.3 m/s² at the instrument
    assert velocities[0] / velocities[1] > 3.5


def test_net_turns_and_gains_are_not_corrected():
    """A turn between two attitudes contains the coning, a register's gain the sculling."""
    rng = np.random.default_rng(4)
    edges = np.arange(0.0, 2.0, 0.125)
    force, rate = 5.0 * rng.standard_normal((2, len(edges) - 1, 3))
    plain = effective_samples(twins.record(edges, force, rate))
    assert np.all(np.any(plain.rate != rate, axis=1))
    assert np.all(np.any(plain.force != force, axis=1))
    turn = effective_samples(twins.record(edges, force, rate, coning_corrected=True))
    np.testing.assert_array_equal(turn.rate, rate)
    np.testing.assert_array_equal(turn.force, plain.force)
    gain = effective_samples(twins.record(edges, force, rate, sculling_corrected=True))
    np.testing.assert_array_equal(gain.force, force)
    np.testing.assert_array_equal(gain.rate, plain.rate)


# Splitting


@given(st.lists(st.floats(-0.5, 3.5), max_size=12), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_splitting_keeps_motion_and_noise(times, seed):
    rng = np.random.default_rng(seed)
    interval = rng.uniform(0.05, 0.25, 20)
    interval *= 3.0 / interval.sum()
    unit = (np.arange(20) > 12).astype(int)
    force, rate = rng.standard_normal((20, 3)), rng.standard_normal((20, 3))
    old = twins.samples(interval, force, rate, rng.uniform(0.1, 1, 20), rng.uniform(0.1, 1, 20), 0.1, unit)
    old = replace(old, force_fill_sigma=rng.uniform(0.1, 1, (20, 3)), rate_fill_sigma=rng.uniform(0.1, 1, (20, 3)))
    new = old.split(np.array(times))
    assert np.all(new.interval > 0.0)
    np.testing.assert_allclose(np.cumsum(new.interval), new.time, atol=1e-12)
    for t in times:
        inside = 0.0 < t < 3.0
        assert not inside or np.min(np.abs(np.append(new.time, 0.0) - t)) <= 1.0000001e-6
    assert set(old.time) <= set(new.time)
    group = np.searchsorted(old.time, new.time - 1e-9)
    np.testing.assert_array_equal(new.unit, old.unit[group])
    whole = np.bincount(group) == 1
    for name in ("force", "rate", "onboard_rate"):
        np.testing.assert_array_equal(getattr(new, name)[whole[group]], getattr(old, name)[whole])
    for name in ("mean_force", "mean_rate"):
        np.testing.assert_array_equal(getattr(new, name), getattr(old, name)[group])
    start = rng.standard_normal(4)
    for name in ("rate", "onboard_rate"):
        velocity, attitude = integrate(replace(old, rate=getattr(old, name)), start / np.linalg.norm(start))
        same_velocity, same_attitude = integrate(replace(new, rate=getattr(new, name)), start / np.linalg.norm(start))
        np.testing.assert_allclose(same_attitude, attitude, atol=1e-11)
        if name == "rate":
            np.testing.assert_allclose(same_velocity, velocity, atol=1e-11)
    sigmas = ("force_noise", "rate_noise", "shared_rate_noise", "force_fill_sigma", "rate_fill_sigma")
    for name in sigmas:  # random walk over the old sample
        for axis in range(3):
            walk = np.bincount(group, (getattr(new, name)[:, axis] * new.interval) ** 2)
            np.testing.assert_allclose(walk, (getattr(old, name)[:, axis] * old.interval) ** 2, rtol=1e-9)


def test_an_edge_is_not_repeated_within_rounding():
    """Times half a microsecond before and after an edge add none; ten microseconds from it they do."""
    old = twins.samples(np.full(8, 0.125), np.zeros((8, 3)), np.zeros((8, 3)))
    near, far = np.array([-5e-7, 5e-7]), np.array([-1e-5, 1e-5])
    np.testing.assert_array_equal(old.split(0.5 + near).time, old.time)
    np.testing.assert_allclose(old.split(0.5 + far).time, np.sort(np.append(old.time, 0.5 + far)), rtol=1e-15)


def polynomial(edges, coefficients):
    """Means (N, 3) of polynomials of the time, ``(3, d + 1)`` coefficients, the highest first."""
    integral = np.array([np.polyval(np.polyint(c), edges) for c in coefficients])
    return (np.diff(integral, axis=1) / np.diff(edges)).T


@given(st.lists(st.floats(0.001, 2.999), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_parts_of_samples_have_the_course_of_the_samples_around(times, seed):
    """Exact where force and rate are polynomials of fourth degree and do not turn, also in a part of microseconds."""
    coefficients = np.random.default_rng(seed).standard_normal((2, 1, 5)) * np.array([[[1.0]], [[0.02]]])
    axis = np.array([[1.0], [-2.0], [0.5]])
    edges = np.linspace(0.0, 3.0, 25)
    old = twins.samples(np.diff(edges), *(polynomial(edges, axis * c) for c in coefficients))
    added = 0.3 * axis[:, 0], 0.01 * axis[:, 0]  # sculling and coning, divided in proportion to time
    old = replace(old, force=old.force + added[0], rate=old.rate + added[1], onboard_rate=old.rate + 2.0 * added[1])
    new = old.split(np.array(times))
    values = (new.force, new.rate, new.onboard_rate)
    sums = zip(values, (0, 1, 1), (added[0], added[1], 2.0 * added[1]), strict=True)
    for mean, which, constant in sums:
        rounding = 1e-12 / new.interval[:, None]
        exact = polynomial(new.edges, axis * coefficients[which]) + constant
        assert np.all(np.abs(mean - exact) < 1e-8 + rounding)


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_the_attitude_inside_a_sample_is_that_of_the_coning_motion(share):
    """A quarter of a radian per sample: with a constant rate in the sample it is 500 times as far off."""
    record, start, _ = coning(1.0 / 24.0, 2.0)
    time = 1.0 + share / 24.0
    angle = 0.02 * np.array([0.0, np.cos(6.0 * time), np.sin(6.0 * time)])
    samples = effective_samples(record)

    def error(halves):
        _, attitude = integrate(halves.part(0, halves.index(time)), start)
        return rotations.rotation_vector_between(rotations.from_rotation_vector(angle), attitude)

    constant = samples.split(np.array([time]))
    k = constant.index(time) - 1
    constant.rate[k] = samples.rate[k]
    assert np.max(np.abs(error(samples.split(np.array([time]))))) < 2e-7
    assert np.max(np.abs(error(constant))) > 500.0 * np.max(np.abs(error(samples.split(np.array([time])))))


def test_no_course_reaches_across_a_short_sample():
    """The impulse of a part of a sample, here 1e4 m/s² for a tenth of a millisecond, does not change its neighbours."""
    interval = np.full(20, 0.125)
    interval[9:11] = 1e-4, 0.1249
    force = np.ones((20, 3))
    force[9] = 1e4
    old = twins.samples(interval, force, np.zeros((20, 3)))
    new = old.split(np.array([old.time[7] + 0.06, old.time[9] + 0.06]))
    np.testing.assert_allclose(np.delete(new.force, 10, axis=0), 1.0, rtol=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.75])
@pytest.mark.parametrize("seed", range(3))
def test_until_a_parachute_pulls_the_course_is_that_of_the_samples_before(share, seed):
    rng = np.random.default_rng(seed)
    edges = np.linspace(0.0, 3.0, 25)
    opened = edges[15] + share * 0.125
    parts = np.sort(np.append(edges, opened))
    force = np.tile(rng.standard_normal(3), (25, 1))
    rate = np.outer(polynomial(parts, 0.02 * rng.standard_normal((1, 5))), [1.0, -2.0, 0.5])
    force[16:] += 80.0 * rng.standard_normal((9, 3))
    rate[16:] += 3.0 * rng.standard_normal((9, 3))
    true = twins.samples(np.diff(parts), force, rate)
    group = np.searchsorted(edges, true.time - 1e-9) - 1

    def mean(values):
        return np.column_stack([np.bincount(group, column * true.interval) for column in values.T]) / 0.125

    old = twins.samples(np.diff(edges), mean(force), mean(rate))
    new = old.opened_at(opened)
    np.testing.assert_allclose(new.time, true.time, rtol=1e-15)
    np.testing.assert_allclose(new.force[:16], force[:16], atol=1e-9)
    np.testing.assert_allclose(new.rate[:16], rate[:16], atol=1e-8)
    start = np.array([0.0, 0.0, 0.0, 1.0])
    for kept, whole in zip(integrate(new, start), integrate(old, start), strict=True):
        np.testing.assert_allclose(kept, whole, atol=1e-11)


def test_no_extrapolation_reaches_across_a_short_sample():
    """Three samples of a linear rate follow it; those before it and those behind the deployment have no part."""
    interval = np.full(20, 0.125)
    interval[8:10] = 1e-3, 0.124
    edges = np.concatenate(([0.0], np.cumsum(interval)))
    rate = np.outer(polynomial(edges, np.array([[0.2, 0.1]])), [1.0, -2.0, 0.5])
    rate[:9] = [3.0, 0.0, 1.0]
    rate[13:] = [0.0, -4.0, 2.0]
    old = twins.samples(interval, np.ones((20, 3)), rate)
    parts = np.append(edges[12], edges[12] + np.array([0.06]))
    new = old.opened_at(parts[1])
    np.testing.assert_allclose(new.rate[12], polynomial(parts, np.outer([1.0, -2.0, 0.5], [0.2, 0.1]))[0], atol=1e-9)


@pytest.mark.parametrize("short", [1e-3, 0.125])
def test_the_force_before_a_deployment_is_that_of_the_last_sample(short):
    """So is the rate behind a short sample, whatever came before it."""
    interval = np.full(20, 0.125)
    interval[11] = short
    rng = np.random.default_rng(3)
    old = twins.samples(interval, rng.standard_normal((20, 3)), 0.1 * rng.standard_normal((20, 3)))
    new = old.opened_at(old.edges[12] + 0.06)
    np.testing.assert_allclose(new.force[12], old.force[11], atol=1e-12)
    if short < 0.1:
        np.testing.assert_allclose(new.rate[12], old.rate[11], atol=1e-9)


def test_a_parachute_that_pulls_at_the_end_of_a_sample_or_outside_changes_nothing():
    old = twins.samples(np.full(8, 0.125), np.ones((8, 3)), np.zeros((8, 3)))
    assert len(old.opened_at(0.18).time) == 9  # one sample before it is sufficient
    for time in (-0.1, 0.0, 0.06, 0.5, 0.5 + 5e-7, 0.6, 1.0, 1.1):  # no sample is before the first; 0.2 is behind 0.6
        assert old.opened_at(time) is old
    assert len(old.opened_at(0.55).time) == 9


@given(stop=st.floats(0.0, 3.0), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_an_impact_is_over_where_the_vehicle_stops(stop, seed):
    """Whatever the part of its sample that lies behind the stop, which is at rest: both increments have one sum."""
    rng = np.random.default_rng(seed)
    interval = rng.uniform(0.05, 0.25, 30)
    interval *= 4.0 / interval.sum()
    force, rate = rng.standard_normal((2, 30, 3))
    k = int(np.searchsorted(np.cumsum(interval), stop + 1e-6))
    force[k], rate[k] = [600.0, -200.0, 90.0], [3.0, -1.0, 2.0]
    force[k + 1 :] = [3.7, 0.1, -0.2] + 0.01 * force[k + 1 :]
    rate[k + 1 :] = [1e-5, 2e-5, -6e-5] + 1e-5 * rate[k + 1 :]
    old = twins.samples(interval, force, rate, rng.uniform(0.1, 1, 30), rng.uniform(0.1, 1, 30), 0.1)
    old = replace(old, force_fill_sigma=rng.uniform(0.1, 1, (30, 3)), rate_fill_sigma=rng.uniform(0.1, 1, (30, 3)))
    new = old.stopped_at(stop)
    begin, end = old.edges[k], old.edges[k + 1]
    if min(stop - begin, end - stop) < 1e-6:
        assert new is old
        return
    assert new.time[k] == stop and len(new.time) == 31
    np.testing.assert_array_equal(np.delete(new.time, k), old.time)
    for name in ("force", "rate", "mean_force", "mean_rate", "onboard_rate"):
        before, after = getattr(new, name)[k : k + 2]
        np.testing.assert_array_equal(after, np.median(getattr(old, name)[k + 1 :], axis=0))
        total = before * new.interval[k] + after * new.interval[k + 1]
        np.testing.assert_allclose(total, getattr(old, name)[k] * old.interval[k], rtol=1e-9, atol=1e-12)
    for name in ("force_noise", "rate_noise", "shared_rate_noise"):
        walk = getattr(new, name) * np.sqrt(new.interval)[:, None]
        at_rest = np.median((getattr(old, name) * np.sqrt(old.interval)[:, None])[k + 1 :], axis=0)
        assert walk[k + 1] == pytest.approx(at_rest)
        assert getattr(new, name)[k] * new.interval[k] == pytest.approx(getattr(old, name)[k] * old.interval[k])
    for name in ("force_fill_sigma", "rate_fill_sigma"):
        before, after = getattr(new, name)[k : k + 2]
        np.testing.assert_allclose(before * new.interval[k], getattr(old, name)[k] * old.interval[k])
        assert not after.any()


def test_a_stop_outside_the_samples_or_at_their_end_changes_nothing():
    old = twins.samples(np.full(8, 0.125), np.ones((8, 3)), np.zeros((8, 3)))
    for stop in (-0.1, 0.0, 0.5 - 5e-7, 0.5, 0.5 + 5e-7, 0.9, 1.0, 1.1):  # nothing at rest follows the last sample
        assert old.stopped_at(stop) is old
    assert len(old.stopped_at(0.8).time) == 9


def test_filled_samples_are_those_of_which_a_value_was_filled():
    """Of the force or of the rate, on any axis; without a statement none was."""
    s = twins.samples(np.full(4, 0.125), np.zeros((4, 3)), np.zeros((4, 3)))
    assert s.force_fill_sigma.shape == s.rate_fill_sigma.shape == (4, 3)
    np.testing.assert_array_equal(s.filled, [False] * 4)
    force, rate = np.zeros((4, 3)), np.zeros((4, 3))
    force[1, 2], rate[3, 0] = 0.1, 1e-3
    s = replace(s, force_fill_sigma=force, rate_fill_sigma=rate)
    np.testing.assert_array_equal(s.filled, [False, True, False, True])


def test_parts_and_indices():
    s = twins.samples(np.full(8, 0.125), np.arange(24.0).reshape(8, 3), np.zeros((8, 3)))
    times = [0.0, 0.125, 0.1249995, 0.12, 0.25, 1.0]
    assert [s.index(t) for t in times] == [0, 1, 1, 0, 2, 8] == s.indices(times).tolist()
    part = s.part(2, 5)
    np.testing.assert_array_equal(part.force, s.force[2:5])
    np.testing.assert_array_equal(part.time, s.time[2:5])


# What is known of the noise on board


def test_unresolved_rotation_is_shared_except_for_the_difference_of_integrations():
    rng = np.random.default_rng(9)
    edges = np.arange(0.0, 5.0, 0.125)
    n = len(edges) - 1
    record = twins.record(
        edges,
        30 * rng.standard_normal((n, 3)),
        2 * rng.standard_normal((n, 3)),
        force_noise=0.1,
        rate_noise=0.02,
        shared=0.01,
    )
    s = effective_samples(record)
    _, hidden, in_sample = unresolved_motion(record.time, record.interval, s.mean_force, s.mean_rate)
    difference = INTEGRATION_DIFFERENCE * in_sample[:, None]
    total = np.maximum(hidden, difference)
    np.testing.assert_allclose(s.rate_noise**2, 0.02**2 + total**2, rtol=1e-9)
    unshared = s.rate_noise**2 - s.shared_rate_noise**2
    np.testing.assert_allclose(unshared, np.broadcast_to(0.02**2 - 0.01**2 + difference**2, unshared.shape), rtol=1e-9)
    assert np.all(s.force_noise >= 0.1)
    assert s.force_noise.max() > 0.2


@pytest.mark.parametrize(("begin", "end"), [(252.0, 300.0), (344.0, 360.0)], ids=["parachute", "bounces"])
def test_spirits_quaternions_differ_from_the_integral_of_her_samples_by_a_part_of_the_motion_within(begin, end, spirit):
    """The stated part is not less than the measured one, and not twice as much."""
    record, onboard = spirit.telemetry.driving, spirit.telemetry.attitude
    rate = onboard_rates(record.interval, record.angular_rate, record.coning_corrected)
    unresolved = unresolved_motion_of(record, spirit.event_times["landing"])

    def differences(first, last):
        """Of the rotation between two quaternions and that of the sample between them, rad, and the rows."""
        k = np.flatnonzero((onboard.time[1:] > first) & (onboard.time[1:] <= last)) + 1
        rows = np.searchsorted(record.time, onboard.time[k] - 1e-3)
        edges = np.stack((record.time[rows] - record.interval[rows], record.time[rows]), axis=1)
        same = np.all(np.abs(edges - np.stack((onboard.time[k - 1], onboard.time[k]), axis=1)) < 1e-3, axis=1)
        k, rows = k[same], rows[same]
        before, after = (Rotation.from_quat(onboard.inertial_from_body[i]) for i in (k - 1, k))
        integral = Rotation.from_rotvec(rate[rows] * record.interval[rows, None])
        return (integral.inv() * before.inv() * after).as_rotvec(), rows

    rounding, _ = differences(302.0, 340.0)  # without fast motion: the quaternions' own rounding
    error, rows = differences(begin, end)
    assert len(rows) > 100
    within = np.mean((unresolved.sample_rate_sigma[rows] * record.interval[rows]) ** 2)
    measured = np.sqrt((np.mean(error**2) - np.mean(rounding**2)) / within)
    assert measured < INTEGRATION_DIFFERENCE < 2.0 * measured


def test_onboard_rates_are_those_of_the_samples_so_far():
    """``Δθ + Δθ_before × Δθ / 12`` over each sample; net turns contain the coning."""
    rng = np.random.default_rng(10)
    interval, rate = rng.uniform(0.1, 0.15, 6), rng.standard_normal((6, 3))
    net = np.arange(6) == 4
    turn = onboard_rates(interval, rate, net) * interval[:, None]
    angle = rate * interval[:, None]
    np.testing.assert_array_equal(turn[[0, 4]], angle[[0, 4]])
    for i in (1, 2, 3, 5):
        np.testing.assert_allclose(turn[i], angle[i] + np.cross(angle[i - 1], angle[i]) / 12.0, rtol=1e-12)


def test_onboard_rates_of_coning_reach_fourth_order():
    """Coefficient 1/12 for a sample and the one before: ``x² sin x`` in place of the exact ``6 (x - sin x)``."""
    half_angle, speed, end, dt = 0.02, 6.0, 60.0, 0.125
    record, start, stop = coning(dt, end, half_angle, speed)
    s = effective_samples(record)
    onboard = twins.samples(record.interval, record.specific_force, s.onboard_rate)
    x = speed * dt
    missed = half_angle**2 * (x - np.sin(x)) / 2 * end / dt
    accounted = half_angle**2 * x**2 / 12 * np.sinc(x / 2 / np.pi) ** 2 * np.sin(x) * end / dt
    error = twins.attitude_error(stop, integrate(onboard, start)[1])
    assert error == pytest.approx(missed - accounted, rel=0.1)


def test_impacts_are_noisier_than_flight():
    rng = np.random.default_rng(11)
    edges = np.arange(0.0, 5.0, 0.125)
    record = twins.record(edges, *rng.standard_normal((2, len(edges) - 1, 3)))
    flight, impact = effective_samples(record), effective_samples(record, 2.0)
    before = record.time <= 2.0
    np.testing.assert_array_equal(flight.rate_noise[before], impact.rate_noise[before])
    assert np.mean(impact.rate_noise[~before] > flight.rate_noise[~before]) > 0.7
    np.testing.assert_array_equal(flight.rate, impact.rate)
