"""The kernel against a scalar twin, an accurate integrator, and the laws that it must keep."""

import numpy as np
import pytest
import twins
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.navigation import strapdown

MARS, LANES = twins.MARS, strapdown.LANES


def random_problem(seed, columns, count):
    """States about Mars, samples and sensor maps; no two columns alike."""
    rng = np.random.default_rng(seed)
    state = np.empty((10, columns))
    direction = rng.standard_normal((3, columns))
    state[:3] = direction / np.linalg.norm(direction, axis=0) * rng.uniform(3.4e6, 3.6e6, columns)
    state[3:6] = 3000.0 * rng.standard_normal((3, columns))
    state[6:] = rotations.normalise(rng.standard_normal((columns, 4))).T
    force_map, rate_map = twins.no_maps(columns)
    force_map += 0.05 * rng.standard_normal(force_map.shape)
    rate_map += 0.05 * rng.standard_normal(rate_map.shape)
    interval = rng.uniform(0.02, 0.25, count)
    force, rate = 40.0 * rng.standard_normal((count, 3)), 1.5 * rng.standard_normal((count, 3))
    return state, force_map, rate_map, interval, force, rate


def run(state, force_map, rate_map, interval, force, rate, planet, j2=None):
    out = state.copy()
    j2 = planet.j2 if j2 is None else j2
    strapdown.propagate(out, force_map, rate_map, interval, force, rate, planet.mu, j2, planet.gravity_radius)
    return out


def propagate_single(nav, interval, force, rate, planet, j2=None):
    """One state without sensor errors."""
    state = np.repeat(nav[:, None], LANES, axis=1)
    return run(state, *twins.no_maps(LANES), interval, force, rate, planet, j2)[:, 0]


def free_fall(nav, dt, count, planet, j2=None, rate=None):
    rate = np.zeros((count, 3)) if rate is None else rate
    return propagate_single(nav, np.full(count, dt), np.zeros((count, 3)), rate, planet, j2)


@pytest.mark.parametrize("columns", [LANES, 4 * LANES])
@pytest.mark.parametrize("j2", [0.0, MARS.j2, 0.1])
def test_every_sigma_point_equals_the_scalar_twin(columns, j2):
    state, *rest = random_problem(columns, columns, 60)
    out = run(state, *rest, MARS, j2)
    force_map, rate_map, *samples = rest
    for s in range(columns):
        twin = twins.propagate(state[:, s], force_map[:, s], rate_map[:, s], *samples, MARS.mu, j2, MARS.gravity_radius)
        for part in (slice(0, 3), slice(3, 6), slice(6, 10)):
            np.testing.assert_allclose(out[part, s], twin[part], rtol=0, atol=1e-12 * np.linalg.norm(twin[part]))


def test_maps_and_samples_are_not_changed():
    problem = random_problem(1, LANES, 5)
    before = [a.copy() for a in problem]
    run(*problem, MARS)
    for now, then in zip(problem, before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_no_samples_change_nothing():
    state, force_map, rate_map, *_ = random_problem(2, LANES, 1)
    out = run(state, force_map, rate_map, np.empty(0), np.empty((0, 3)), np.empty((0, 3)), MARS)
    np.testing.assert_array_equal(out, state)


@pytest.mark.parametrize(("count", "expected"), [(1, LANES), (LANES, LANES), (LANES + 1, 2 * LANES)])
def test_padding_goes_up_to_whole_blocks(count, expected):
    assert strapdown.padded(count) == expected


def test_second_order_against_an_accurate_integrator():
    """Halving the step divides the error of position, velocity and attitude by four."""
    rng = np.random.default_rng(5)
    force = twins.Waves.draw(rng, (), 20.0, 10.0, 2.0)
    rate = twins.Waves.draw(rng, (), 0.3, 0.2, 2.0)
    start = random_problem(5, 1, 1)[0][:, 0]
    end = 16.0
    truth = twins.integrate(start, force, rate, [0.0, end], MARS)[-1]
    errors = []
    for dt in (0.125, 0.0625, 0.03125):
        edges = np.arange(0.0, end + dt / 2, dt)
        out = propagate_single(start, np.diff(edges), force.means(edges), rate.means(edges), MARS)
        errors.append(
            (
                np.linalg.norm(out[:3] - truth[:3]),
                np.linalg.norm(out[3:6] - truth[3:6]),
                twins.attitude_error(truth[6:], out[6:]),
            )
        )
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(np.abs(order - 2.0) < 0.1), order


def test_constant_turn_is_exact():
    """A constant rate is turned exactly however long the samples, here 1 rad each."""
    rate = np.array([0.3, -0.5, 0.81])
    rate = rate / np.linalg.norm(rate) * 4.0
    nav = np.array([3.5e6, 0.0, 0.0, 0.0, 3000.0, 0.0, 0.1, 0.2, 0.3, np.sqrt(0.86)])
    out = free_fall(nav, 0.25, 40, MARS, rate=np.tile(rate, (40, 1)))
    expected = rotations.multiply(nav[6:], rotations.from_rotation_vector(10.0 * rate))
    assert twins.attitude_error(expected, out[6:]) < 40 * 1e-12


unit = st.floats(-1.0, 1.0)
directions = (
    st.tuples(unit, unit, unit)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)


@given(directions, st.floats(0.0, 8.0), st.floats(0.01, 0.125), st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_quaternion_norm_stays_one(axis, speed, dt, seed):
    rng = np.random.default_rng(seed)
    rate = speed * (axis + 0.1 * rng.uniform(-1, 1, (300, 3))) / 1.2
    nav = np.concatenate(([3.5e6, 0, 0, 0, 3000.0, 0], rotations.normalise(rng.standard_normal(4))))
    out = free_fall(nav, dt, 300, MARS, rate=rate)
    assert abs(np.linalg.norm(out[6:]) - 1.0) < 1e-14


def test_quaternion_norm_is_pulled_to_one():
    """A wrong norm is corrected: one Newton step a sample."""
    nav = np.array([3.5e6, 0, 0, 0, 3000.0, 0, 0, 0, 0, 1.0 + 1e-5])
    assert abs(np.linalg.norm(free_fall(nav, 0.1, 1, MARS)[6:]) - 1.0) < 1e-9
    assert abs(np.linalg.norm(free_fall(nav, 0.1, 2, MARS)[6:]) - 1.0) < 1e-15


@given(directions, directions, st.floats(3.4e6, 6e6), st.floats(1000.0, 6000.0), st.floats(0.01, 2.0))
@settings(max_examples=40, deadline=None)
def test_free_fall_in_a_point_mass_keeps_angular_momentum(up, along, radius, speed, dt):
    nav = np.concatenate((radius * up, speed * along, [0, 0, 0, 1.0]))
    out = free_fall(nav, dt, 200, MARS, j2=0.0)
    size = radius * speed
    np.testing.assert_allclose(np.cross(out[:3], out[3:6]), np.cross(nav[:3], nav[3:6]), rtol=0, atol=1e-13 * size)


@given(directions, directions, st.floats(3.4e6, 6e6), st.floats(1000.0, 6000.0), st.floats(0.01, 2.0))
@settings(max_examples=40, deadline=None)
def test_free_fall_about_an_oblate_planet_keeps_angular_momentum_about_its_axis(up, along, radius, speed, dt):
    nav = np.concatenate((radius * up, speed * along, [0, 0, 0, 1.0]))
    out = free_fall(nav, dt, 200, MARS)
    turned = np.cross(out[:3], out[3:6]) - np.cross(nav[:3], nav[3:6])
    assert abs(turned[2]) < 1e-13 * radius * speed


def test_oblateness_turns_the_orbit_by_its_known_rate():
    """The node of a circular orbit regresses by 3/2 n J2 (R/a)² cos i (Kaula 1966, eq. 3.74), to second order."""
    a, inclination = 3.8e6, 0.6
    n = np.sqrt(MARS.mu / a**3)
    speed = n * a
    nav = np.array([a, 0, 0, 0, speed * np.cos(inclination), speed * np.sin(inclination), 0, 0, 0, 1.0])
    count = round(2 * np.pi / n * 10 / 2.0)
    out = free_fall(nav, 2.0, count, MARS)
    h = np.cross(out[:3], out[3:6])
    node = np.arctan2(h[0], -h[1])
    expected = -1.5 * n * MARS.j2 * (MARS.gravity_radius / a) ** 2 * np.cos(inclination) * 2.0 * count
    assert node == pytest.approx(expected, rel=5e-3)


@given(st.floats(0.0, 0.3), st.floats(1.0, 10.0))
@settings(max_examples=15, deadline=None)
def test_free_fall_keeps_energy_within_bounds(eccentricity, dt):
    """A symplectic step has an energy error of second order that does not grow: three orbits."""
    radius = 3.6e6  # periapsis
    speed = np.sqrt(MARS.mu / radius * (1.0 + eccentricity))
    nav = np.array([radius, 0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0, 1.0])
    period = 2 * np.pi * np.sqrt((radius / (1.0 - eccentricity)) ** 3 / MARS.mu)
    chunk = max(1, round(period / 50 / dt))

    def energy(nav):
        return 0.5 * nav[3:6] @ nav[3:6] - MARS.mu / np.linalg.norm(nav[:3])

    first = energy(nav)
    errors = []
    for _ in range(150):
        nav = free_fall(nav, dt, chunk, MARS, j2=0.0)
        errors.append(energy(nav) / first - 1.0)
    errors = np.abs(errors)
    bound = (speed / radius * dt) ** 2
    assert errors.max() < bound
    assert errors[100:].max() < 1.2 * errors[:60].max() + 1e-12


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_time_runs_back_to_the_start(seed):
    """The step is symmetric: the same samples in reverse with negative intervals undo it.

    Up to half a radian per sample the truncated series of the rotation are exact to rounding; beyond, they are not
    symmetric to it.
    """
    state, force_map, rate_map, interval, force, rate = random_problem(seed, LANES, 100)
    rate /= np.maximum(1.0, 2.0 * np.linalg.norm(rate, axis=1) * interval)[:, None]
    end = run(state, force_map, rate_map, interval, force, rate, MARS)
    back = run(end, force_map, rate_map, -interval[::-1], force[::-1], rate[::-1], MARS)
    assert np.max(np.abs(end[:3] - state[:3])) > 1e3
    for part in (slice(0, 3), slice(3, 6), slice(6, 10)):
        scale = np.linalg.norm(state[part], axis=0)
        np.testing.assert_allclose(back[part] / scale, state[part] / scale, rtol=0, atol=1e-12)
