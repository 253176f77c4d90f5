"""Coning, sculling, lever arm, splitting, and the noise of what a sample hides."""

from itertools import pairwise

import numpy as np
import pytest
import twins
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.navigation import strapdown
from edl_filter.navigation.increments import (
    NOT_SHARED,
    edge_values,
    effective_samples,
    hidden_motion,
    lever_arm_acceleration,
)

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
    """The closed form itself, by the twin's integrator: else the test below would test nothing."""
    record, start, end = coning(1.0 / 4096, 0.5)
    q = start
    for dt, w in zip(record.interval, record.angular_rate, strict=True):
        q = rotations.multiply(q, rotations.from_rotation_vector(dt * w))
    assert twins.attitude_error(end, q) < 1e-8


def test_coning_drift_is_corrected_to_fourth_order():
    """Drift of raw and of corrected means against theory, with x = Ω Δt (0.75 at 8 Hz).

    The coning in a sample is ``θ² (x - sin x) / 2`` (Savage 1998, section IV: θ²x³/12 for small x). The correction,
    with the slope from the neighbours' means, makes ``θ² x²/12 sinc²(x/2) sin x`` of it: what is left is of order x⁵.
    """
    half_angle, speed, end = 0.02, 6.0, 60.0
    plain, corrected = [], []
    for dt in (0.125, 0.0625, 0.03125):
        record, start, stop = coning(dt, end, half_angle, speed)
        plain.append(twins.attitude_error(stop, integrate(raw(record), start)[1]))
        corrected.append(twins.attitude_error(stop, integrate(effective_samples(record), start)[1]))
        x = speed * dt
        missed = half_angle**2 * (x - np.sin(x)) / 2 * end / dt
        made = half_angle**2 * x**2 / 12 * np.sinc(x / 2 / np.pi) ** 2 * np.sin(x) * end / dt
        assert plain[-1] == pytest.approx(missed, rel=0.02)
        assert corrected[-1] == pytest.approx(missed - made, rel=0.05)
    assert np.log2(plain[1] / plain[2]) == pytest.approx(2.0, abs=0.1)
    assert np.log2(corrected[1] / corrected[2]) == pytest.approx(4.0, abs=0.2)
    assert corrected[1] < plain[1] / 30.0


def test_sculling_drift_is_corrected():
    """Rocking about x in phase with a force along y gives a mean force θB/2 along z, which raw means miss."""
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
        wanted = np.trapezoid(size * np.sin(speed * t) * np.sin(angle * np.sin(speed * t)), t)
        start = np.array([0, 0, 0, 1.0])
        plain.append(abs(integrate(raw(record), start)[0][2] - wanted))
        corrected.append(abs(integrate(effective_samples(record), start)[0][2] - wanted))
    assert np.log2(plain[0] / plain[1]) == pytest.approx(2.0, abs=0.15)
    assert np.log2(corrected[0] / corrected[1]) > 3.5
    assert corrected[1] < plain[1] / 25.0


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
    """A body that starts at rest, tumbles in free fall and stops; its IMU sits off the centre of mass."""
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
    left = []
    for dt in (0.125, 0.0625):
        record, _ = tumbling(dt)
        start = np.array([0, 0, 0, 1.0])
        left.append(np.linalg.norm(integrate(effective_samples(record), start)[0]))
        without = twins.record(np.append(0.0, record.time), record.specific_force, record.angular_rate)
        felt = np.max(np.abs(effective_samples(record).force))
        assert felt < 0.02 * np.max(np.abs(effective_samples(without).force))
    assert left[0] < 2e-3  # m/s after 30 s of up to 0.3 m/s² at the instrument
    assert left[0] / left[1] > 3.5


@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
@settings(max_examples=40, deadline=None)
def test_tangential_parts_telescope(seed, count):
    """Whatever the rates' noise, the tangential parts add up to what the ends say."""
    rng = np.random.default_rng(seed)
    interval, rate = rng.uniform(0.05, 0.9, count), rng.standard_normal((count, 3))
    position = np.tile(rng.standard_normal(3), (count, 1))
    acceleration = lever_arm_acceleration(interval, rate, position, np.zeros(count, int))
    inside = np.diff(edge_values(interval, rate), axis=0)
    squares = np.cross(rate, np.cross(rate, position)) + np.cross(inside, np.cross(inside, position)) / 12.0
    tangential = acceleration - squares
    np.testing.assert_allclose(interval @ tangential, np.cross(rate[-1] - rate[0], position[0]), atol=1e-13)


def test_tangential_part_of_a_steady_spin_up():
    """Rates that grow evenly over uneven samples: α × r exactly, but for the end samples' half edges."""
    edges = np.cumsum([0.0, 0.1, 0.3, 0.1, 0.2, 0.2, 0.5, 0.1])
    alpha, position = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -1.0])
    rate = 0.5 * (edges[1:] + edges[:-1])[:, None] * alpha
    interval = np.diff(edges)
    found = lever_arm_acceleration(interval, rate, np.tile(position, (7, 1)), np.zeros(7, int))
    wanted = np.cross(alpha, position) + np.cross(rate, np.cross(rate, position))
    wanted += np.cross(alpha, np.cross(alpha, position)) * interval[:, None] ** 2 / 12.0
    np.testing.assert_allclose(found[1:-1], wanted[1:-1], atol=1e-14)


@pytest.mark.parametrize("degree", range(8))
def test_edge_values_of_polynomials(degree):
    """Eighth order: exact to the seventh power, four samples from an end."""
    edges = np.linspace(-1.0, 1.0, 17)
    rising = edges ** (degree + 1) / (degree + 1)
    mean = np.tile((np.diff(rising) / np.diff(edges))[:, None], 3)
    found = edge_values(np.diff(edges), mean)[4:-4, 0]
    np.testing.assert_allclose(found, edges[4:-4] ** degree, atol=1e-13)


def test_edge_values_beside_an_uneven_sample():
    """Every edge has the order that the samples around it allow, and a longer sample spoils no other's."""
    interval = np.full(24, 0.125)
    interval[12] = 0.25
    edges = np.concatenate(([0.0], np.cumsum(interval)))
    mean = np.tile((-np.diff(np.cos(6.0 * edges)) / 6.0 / interval)[:, None], 3)
    off = np.abs(edge_values(interval, mean)[:, 0] - np.sin(6.0 * edges))
    assert max(np.max(off[4:9]), np.max(off[17:-4])) < 2e-4  # eighth order: 0.75**8 / 630
    assert off[9] < 1e-3 and off[10] < 1e-2  # sixth and fourth
    assert off[11] > 0.02  # second, next to the long one


def test_lever_arm_in_a_fast_oscillation():
    """Eight samples a second, an oscillation a second: a mean over a sample to a thousandth of itself."""
    dt, w, position = 0.125, 2.0 * np.pi, np.array([-0.8, 0.8, -0.6])
    edges = np.arange(0.0, 8.0 + 0.5 * dt, dt)
    swing = np.array([0.0, 0.2, 0.1])
    rate = np.outer(-np.diff(np.cos(w * edges)) / (w * dt), swing)
    found = lever_arm_acceleration(np.full(len(rate), dt), rate, np.tile(position, (len(rate), 1)), np.zeros(len(rate)))
    tangential = np.outer(np.diff(np.sin(w * edges)) / dt, np.cross(swing, position))
    squared = 0.5 - np.diff(np.sin(2.0 * w * edges)) / (4.0 * w * dt)
    wanted = tangential + np.outer(squared, np.cross(swing, np.cross(swing, position)))
    size = np.max(np.linalg.norm(wanted, axis=1))
    assert np.max(np.linalg.norm(found - wanted, axis=1)[4:-4]) < 1e-3 * size


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("what", ["unit", "position", "both"])
def test_an_instrument_change_does_not_mix_the_two(what, even):
    """Each side of a change is as if the other were not there: no spike from the gyros' difference."""
    rng = np.random.default_rng(11)
    n, change = 24, 11  # even intervals allow the highest order on both sides
    interval, rate = rng.uniform(0.1, 0.2, n), rng.standard_normal((n, 3))
    if even:
        interval[:] = 0.125
    position = np.tile([0.5, 0.1, -0.2], (n, 1))
    unit = np.zeros(n, int)
    if what != "unit":
        position[change:] = [-0.3, 0.6, 0.2]
    if what != "position":
        unit[change:] = 1
    together = lever_arm_acceleration(interval, rate, position, unit)
    sides = (slice(change), slice(change, n))
    apart = [lever_arm_acceleration(interval[p], rate[p], position[p], unit[p]) for p in sides]
    np.testing.assert_allclose(together, np.concatenate(apart), atol=1e-14)


def test_net_turns_and_gains_are_taken_as_they_are():
    """A turn between two attitudes has its coning in it, a register's gain its sculling."""
    rng = np.random.default_rng(4)
    edges = np.arange(0.0, 2.0, 0.125)
    force, rate = 5.0 * rng.standard_normal((2, len(edges) - 1, 3))
    plain = effective_samples(twins.record(edges, force, rate))
    assert np.all(np.any(plain.rate != rate, axis=1))
    assert np.all(np.any(plain.force != force, axis=1))
    turn = effective_samples(twins.record(edges, force, rate, net_turn=True))
    np.testing.assert_array_equal(turn.rate, rate)
    np.testing.assert_array_equal(turn.force, plain.force)
    gain = effective_samples(twins.record(edges, force, rate, net_gain=True))
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
    new = old.split(np.array(times))
    assert np.all(new.interval > 0.0)
    np.testing.assert_allclose(np.cumsum(new.interval), new.time, atol=1e-12)
    for t in times:
        inside = 0.0 < t < 3.0
        assert not inside or np.min(np.abs(np.append(new.time, 0.0) - t)) <= 1.0000001e-6
    assert set(old.time) <= set(new.time)
    group = np.searchsorted(old.time, new.time - 1e-9)
    np.testing.assert_array_equal(new.unit, old.unit[group])
    for a, b in ((old.force, new.force), (old.rate, new.rate)):
        np.testing.assert_array_equal(b, a[group])
    for name in ("force_noise", "rate_noise", "shared_rate_noise"):
        walk = np.bincount(group, (getattr(new, name) * new.interval) ** 2)  # random walk over the old sample
        np.testing.assert_allclose(walk, (getattr(old, name) * old.interval) ** 2, rtol=1e-9)


def test_parts_and_indices():
    s = twins.samples(np.full(8, 0.125), np.arange(24.0).reshape(8, 3), np.zeros((8, 3)))
    assert [s.index(t) for t in (0.0, 0.125, 0.1249995, 0.12, 0.25, 1.0)] == [0, 1, 1, 0, 2, 8]
    part = s.part(2, 5)
    np.testing.assert_array_equal(part.force, s.force[2:5])
    np.testing.assert_array_equal(part.time, s.time[2:5])


# What a sample hides


def test_steady_change_hides_nothing():
    t = np.arange(20.0)[:, None]
    force, rate = hidden_motion(np.full(20, 0.125), 3.0 + t * [1.0, 2.0, 3.0], 0.5 + t * [0.01, 0.02, 0.0])
    np.testing.assert_allclose(force, 0.0, atol=1e-12)
    np.testing.assert_allclose(rate, 0.0, atol=1e-12)


def test_a_blow_in_a_sample_hides_what_its_unknown_instant_and_direction_hide():
    """Monte Carlo of one blow while the body turns: its velocity is off by where in the turn it fell."""
    rng = np.random.default_rng(8)
    runs, dt = 20000, 0.125
    axis, blow = rng.standard_normal((2, runs, 3))
    turn = 0.2 * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    blow = 3.0 * blow / np.linalg.norm(blow, axis=1, keepdims=True)
    instant = rng.uniform(-0.5, 0.5, (runs, 1))
    miss = rotations.rotate(rotations.from_rotation_vector(instant * turn), blow) - blow
    force = np.zeros((5, 3))
    force[2] = blow[0] / dt
    hidden, _ = hidden_motion(np.full(5, dt), force, np.tile(turn[0] / dt, (5, 1)))
    assert hidden[2] * dt == pytest.approx(np.sqrt(np.mean(miss**2)), rel=0.02)


def test_hidden_rotation_is_shared_but_for_its_known_part():
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
    hidden = s.rate_noise**2 - 0.02**2
    assert hidden.max() > 0.02**2
    np.testing.assert_allclose(s.shared_rate_noise**2, 0.01**2 + (1 - NOT_SHARED**2) * hidden, rtol=1e-9)
    assert np.all(s.force_noise >= 0.1)
    assert s.force_noise.max() > 0.2
