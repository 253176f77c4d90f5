"""The kernel against its slow twin, closed solutions, and its order."""

from dataclasses import replace

import numpy as np
import pytest
import slow_flight as slow
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import interp1d

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.planet import ellipsoid
from edl_filter.simulation import dynamics
from edl_filter.simulation.increments import NOTHING
from edl_filter.simulation.parachute import Parachute
from edl_filter.simulation.tables import tabulate

CHUTE = Parachute(15.0)
NO_STOP = np.zeros(7)


def march(forward_model, start, step, steps, phase=dynamics.ENTRY, stop=NO_STOP):
    tables = tabulate(forward_model, CHUTE)
    state, slope = np.zeros((steps + 1, dynamics.SIZE)), np.zeros((steps + 1, dynamics.SIZE))
    state[0, :13] = start
    done, event, _ = dynamics.march(0.0, step, state, slope, phase, tables, stop, NOTHING, 1, 1e9, False)
    assert done == steps and not event
    return state


@pytest.fixture(scope="module")
def nominal_tables(nominal):
    return tabulate(nominal, CHUTE)


def random_states(forward_model, count, seed=1):
    """States between 5 and 110 km altitude, nose first, with the angles and rates of a flight."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        up = rotations.normalise(random.standard_normal(3))
        position = up * (3.38e6 + random.uniform(20e3, 110e3))
        velocity = random.uniform(200.0, 5500.0) * rotations.normalise(random.standard_normal(3) - up)
        velocity += np.cross([0.0, 0.0, forward_model.planet.rotation_rate], position)
        air = forward_model.planet.velocity_relative(position, velocity)
        attitude = slow.turned_into(air, *random.uniform(-0.25, 0.25, 2))
        yield np.concatenate((position, velocity, attitude, random.normal(0.0, 0.2, 3)))


def effects():
    values = {
        "wind": {"east": 40.0, "north": -25.0, "h_lo": 5e3, "h_hi": 60e3},
        "density_wave": {"A": 0.1, "L": 12e3, "phase": 1.0},
        "atmosphere_rotation": {"k": 0.7},
        "mass": {"k": 0.05},
        "com_offset": {"dx": 0.01, "dy": 0.005, "dz": -0.004},
        "products_of_inertia": {"a": 5.0, "b": -8.0, "c": 3.0},
        "gravity_oblateness": {"J2": 1e-3},
    }
    return tuple(EffectInstance(find_effect(name), v) for name, v in values.items())


@pytest.mark.parametrize("phase", [dynamics.ENTRY, dynamics.DESCENT])
def test_derivative_is_its_twin(nominal, phase):
    """Nominal loads, wind, density, air's turning, mass properties and gravity, in continuum and rarefied flow."""
    forward_model = nominal.with_effects(effects())
    tables = tabulate(forward_model, CHUTE)
    tables.parachute[3] = 9.8
    d = np.zeros(dynamics.SIZE)
    for start in random_states(forward_model, 60):
        state = np.concatenate((start, np.zeros(12)))
        dynamics.derivative(10.0, state, d, phase, tables, NO_STOP, NOTHING[0])
        twin = slow.derivative(forward_model, 10.0, start, CHUTE if phase == dynamics.DESCENT else None, 0.2)
        for part in (slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)):
            # the air's table is linear between its nodes: 1e-6 of the wave
            np.testing.assert_allclose(d[:13][part], twin[part], rtol=0.0, atol=3e-6 * np.abs(twin[part]).max())
        np.testing.assert_allclose(
            rotations.rotate(start[6:10], d[13:16]), d[3:6] - gravity(forward_model, start), atol=1e-9
        )
        np.testing.assert_allclose(d[16:19], start[10:])


def gravity(forward_model, state):
    return forward_model.gravity_planet.gravity(state[:3])


def test_place_is_the_ellipsoids():
    random = np.random.default_rng(2)
    for _ in range(100):
        point = rotations.normalise(random.standard_normal(3)) * random.uniform(3.37e6, 3.6e6)
        altitude, sine, cosine = dynamics.locate(*point, 3396190.0, 5.886e-3)
        latitude, _, height = ellipsoid.geodetic_from_fixed(point, 3396190.0, 5.886e-3)
        assert altitude == pytest.approx(height, abs=1e-8)
        assert (sine, cosine) == pytest.approx((np.sin(latitude), np.cos(latitude)), abs=1e-12)


@pytest.mark.slow
def test_a_free_symmetric_body_precesses():
    """w_y + i w_z rotates at (Ixx - Iyy) / Iyy of the spin (Goldstein, Poole & Safko 2002, eq. 5.47)."""
    forward_model = slow.empty(slow.smooth_world(inertia=np.diag([300.0, 200.0, 200.0])))
    start = slow.START.copy()
    start[10:] = [0.8, 0.1, 0.0]
    end = march(forward_model, start, 0.01, 6000)[-1]
    turned = (300.0 - 200.0) / 200.0 * 0.8 * 60.0
    np.testing.assert_allclose(end[10:13], [0.8, 0.1 * np.cos(turned), 0.1 * np.sin(turned)], atol=1e-9)


def test_a_free_body_keeps_its_angular_momentum():
    forward_model = slow.empty(slow.smooth_world())
    start = slow.START.copy()
    start[10:] = [0.5, -0.7, 0.3]
    states = march(forward_model, start, 0.01, 3000)
    momentum = rotations.rotate(states[:, 6:10], states[:, 10:13] @ slow.INERTIA)
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (len(momentum), 1)), atol=1e-7)


def test_an_orbit_keeps_energy_and_its_momentum_about_the_pole():
    forward_model = slow.empty(slow.smooth_world())
    start = slow.START.copy()
    start[:6] = [3.6e6, 0.0, 5e5, 100.0, 3000.0, 1800.0]
    s = march(forward_model, start, 0.5, 4000)
    energy = 0.5 * np.sum(s[:, 3:6] ** 2, axis=1) - forward_model.planet.potential(s[:, :3])
    about = s[:, 0] * s[:, 4] - s[:, 1] * s[:, 3]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)
    np.testing.assert_allclose(about, about[0], rtol=1e-11)
    assert np.ptp(np.linalg.norm(s[:, :3], axis=1)) > 1e5


def test_constant_drag_slows_as_the_inverse_of_the_distance_in_time():
    """Without gravity in even air: v = v0 / (1 + k v0 t), distance = log(1 + k v0 t) / k."""
    planet = replace(slow.MARS, mu=0.0, rotation_rate=0.0)
    forward_model = slow.smooth_world(planet, density=1e-3, scale_height=1e15)
    start = slow.START.copy()
    start[:6] = [3.45e6, 0.0, 0.0, 0.0, 4000.0, 0.0]
    start[6:10], start[10:] = slow.turned_into(start[3:6], 0.0), 0.0
    end = march(forward_model, start, 0.02, 3000)[-1]
    k = 0.5 * 1e-3 * 1.6 * forward_model.area / 832.0
    grown = 1.0 + k * 4000.0 * 60.0
    assert end[4] == pytest.approx(4000.0 / grown, rel=1e-9)
    assert end[1] == pytest.approx(np.log(grown) / k, rel=1e-9)
    assert end[13] == pytest.approx(4000.0 / grown - 4000.0, rel=1e-9)


def test_order_is_four():
    """Each halving of the step leaves a sixteenth of the error, in everything that is integrated."""
    forward_model = slow.smooth_world()
    start = slow.entering(forward_model)
    ends = [march(forward_model, start, 8.0 / n, n)[-1] for n in (200, 400, 800, 6400)]
    errors = np.array([[np.linalg.norm((e - ends[-1])[p]) for p in PARTS] for e in ends[:-1]])
    order = np.log2(errors[:-1] / errors[1:])
    assert np.all(np.abs(order - 4.0) < 0.25), order


PARTS = (slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), slice(13, 16), slice(16, 19), slice(19, 25))


def test_touchdown_brings_the_vehicle_to_rest():
    """Velocity relative to the ground and rate relative to the planet's end at zero, and stay zero."""
    forward_model = slow.smooth_world()
    start = slow.START.copy()
    ground = np.array([0.0, 0.0, forward_model.planet.rotation_rate])
    start[3:6] = np.array([-60.0, 20.0, 5.0]) + np.cross(ground, start[:3])
    rate = start[10:] - rotations.rotate(rotations.conjugate(start[6:10]), ground)
    stop = np.concatenate(([0.0], [60.0 / 0.5, -20.0 / 0.5, -5.0 / 0.5], -rate / 0.5))
    rest = march(forward_model, start, 0.0125, 40, dynamics.STOP, stop)[-1]
    later = march(forward_model, rest[:13], 0.0125, 800, dynamics.REST)[-1]
    for s, time in ((rest, 0.5), (later, 10.0)):
        assert np.linalg.norm(forward_model.planet.velocity_relative(s[:3], s[3:6])) < 1e-6, time
        np.testing.assert_allclose(rotations.rotate(s[6:10], s[10:13]), ground, atol=1e-12)
    # what accelerometers gain at rest is minus gravity, and the centrifugal part
    felt = rotations.rotate(later[6:10], later[13:16] / 10.0)
    push = -forward_model.planet.gravity(later[:3]) - ground[2] ** 2 * later[:3] * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(felt, push, atol=1e-3 * np.linalg.norm(push))


# Twins of the parts


nodes_and_points = given(st.integers(0, 2**32 - 1), st.integers(1, 8))


@nodes_and_points
def test_linear_interpolation_is_numpys(seed, count):
    """Held at the edges; also at the nodes themselves."""
    random = np.random.default_rng(seed)
    nodes, values = np.cumsum(random.uniform(0.1, 2.0, count)), random.standard_normal(count)
    for x in (*nodes, *random.uniform(nodes[0] - 1.0, nodes[-1] + 1.0, 20)):
        assert dynamics.linear(nodes, values, x) == pytest.approx(np.interp(x, nodes, values), abs=1e-14)


@nodes_and_points
def test_bilinear_interpolation_is_that_of_rows_then_columns(seed, count):
    random = np.random.default_rng(seed)
    rows, columns = (np.cumsum(random.uniform(0.1, 2.0, n)) for n in (count, 1 + count))
    values = random.standard_normal((count, 1 + count, 3))
    for _ in range(20):
        x, y = (random.uniform(n[0] - 1.0, n[-1] + 1.0) for n in (rows, columns))
        for k in range(3):
            along_rows = [np.interp(y, columns, values[i, :, k]) for i in range(count)]
            expected = np.interp(x, rows, along_rows)
            assert dynamics.bilinear(rows, columns, values, x, y, k) == pytest.approx(expected, abs=1e-14)


@given(st.integers(0, 2**32 - 1))
def test_air_is_interpolated_between_the_altitudes_of_the_table(nominal_tables, seed):
    """Logarithm of the density, also beyond the ends; square of the speed of sound and wind, held there."""
    random, t = np.random.default_rng(seed), nominal_tables
    heights = t.air_start + t.air_step * np.arange(len(t.air))
    log_density = interp1d(heights, t.air[:, 0], fill_value="extrapolate")
    for h in random.uniform(heights[0] - 5e3, heights[-1] + 5e3, 20):
        square, east, north = (np.interp(h, heights, t.air[:, k]) for k in (1, 2, 3))
        expected = (np.exp(log_density(h)), np.sqrt(square), east, north)
        assert dynamics.air_at(t, h) == pytest.approx(expected, rel=1e-11, abs=1e-11)


def march_twin(start, step, first, steps, phase, tables, more, every, limit):
    """Classical Runge–Kutta steps (Hairer, Nørsett & Wanner 1993, II.1): states, and whether an event ended them."""

    def slope(time, state, row):
        d = np.zeros(dynamics.SIZE)
        increments = more[0] if len(more) == 1 else more[row]
        return d, dynamics.derivative(time, state, d, phase, tables, NO_STOP, increments)

    states, armed = [first], False
    for i in range(steps + 1):
        state, time = states[-1], start + i * step
        k1, pressure = slope(time, state, 2 * i)
        armed = armed or pressure > limit
        low = np.linalg.norm(state[:3]) <= limit
        if i > 0 and i % every == 0 and (low if phase == dynamics.DESCENT else armed and pressure <= limit):
            return np.array(states), True
        if i < steps:
            k2, _ = slope(time + 0.5 * step, state + 0.5 * step * k1, 2 * i + 1)
            k3, _ = slope(time + 0.5 * step, state + 0.5 * step * k2, 2 * i + 1)
            k4, _ = slope(time + step, state + step * k3, 2 * i + 2)
            end = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            end[6:10] = rotations.normalise(end[6:10])
            states.append(end)
    return np.array(states), False


@pytest.mark.parametrize("with_increments", [False, True])
@pytest.mark.parametrize("event", [False, True])
@pytest.mark.parametrize("phase", [dynamics.ENTRY, dynamics.DESCENT])
def test_steps_and_events_are_those_of_the_twin(phase, event, with_increments):
    """Entry through thick air, where the dynamic pressure falls below nine tenths; descent by 1.5 km."""
    forward_model = slow.smooth_world(density=0.5 if phase == dynamics.ENTRY else 1.5e-2)
    tables = tabulate(forward_model, CHUTE)
    tables.parachute[3] = 4.0
    start, step, steps, every = 4.0, 0.0125, 400, 3
    more = NOTHING
    if with_increments:
        more = np.random.default_rng(5).normal(0.0, 1e-3, (2 * steps + 1, dynamics.INCREMENTS))
        more[:, 10:16] *= 1e4  # N and N m
    state, slope = (np.zeros((steps + 1, dynamics.SIZE)) for _ in range(2))
    state[0, :13] = slow.entering(forward_model)
    first = state[0].copy()
    pressure = dynamics.derivative(start, first, np.empty(dynamics.SIZE), phase, tables, NO_STOP, more[0])
    limit = 0.9 * pressure if phase == dynamics.ENTRY else np.linalg.norm(first[:3]) - 1500.0
    if not event:
        limit = 0.1 * limit
    count, ended, _ = dynamics.march(start, step, state, slope, phase, tables, NO_STOP, more, every, limit, False)
    expected, expected_end = march_twin(start, step, first, steps, phase, tables, more, every, limit)
    assert (ended, expected_end, count) == (event, event, len(expected) - 1)
    assert count % every == 0 and 0 < count < steps if event else count == steps
    for part in (slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), slice(13, 25)):
        scale = np.max(np.abs(expected[:, part]))
        np.testing.assert_allclose(state[: count + 1, part], expected[:, part], rtol=0.0, atol=1e-11 * scale)
