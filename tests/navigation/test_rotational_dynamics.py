"""Rotational dynamics along a path: against another integrator, closed forms, and finite perturbations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from edl_filter.aero.planes import split
from edl_filter.navigation.rotational_dynamics import (
    CURVATURE_ANGLE,
    DISTURBANCES,
    ERROR_SIZE,
    SIZE,
    PathLoads,
    _advance,
    _derivative,
    add_errors,
    linearise,
    state_differences,
)

ANGLES = np.radians(np.arange(0.0, 61.0))
INERTIA = np.array([[270.0, 3.0, -2.0], [3.0, 210.0, 5.0], [-2.0, 5.0, 190.0]])
#: Angles of the table of `varying_loads`, whose step is neither one degree nor one radian.
WIDE_ANGLES = np.radians(4.0 * np.arange(0.0, 8.0))
#: Edges of samples of different lengths, s, and steps of the integration in each.
EDGES, STEPS = np.array([0.0, 0.03, 0.08, 0.1]), 4


def loads_of(count, steps, pressure_area=5000.0):
    """Constant flow at all nodes."""
    nodes = 2 * steps * count + 1
    table = np.stack((1.6 * np.cos(ANGLES), 0.3 * np.sin(ANGLES), -0.12 * np.sin(ANGLES)), axis=1)
    return PathLoads(
        air=np.tile([4000.0, 150.0, -80.0], (nodes, 1)),
        pressure_area=np.full(nodes, pressure_area),
        coefficients=np.tile(table, (nodes, 1, 1)),
        angle_step=float(ANGLES[1]),
        cmq=np.full(nodes, -0.2),
        rate_scale=np.full(nodes, 2.65 / 8000.0),
        diameter=2.65,
        mass=830.0,
        offset=np.array([0.0, 0.002, -0.004]),
        inertia=INERTIA,
        inverse=np.linalg.inv(INERTIA),
    )


def varying_loads(time):
    """Loads at given times (M,), all of which change by several per cent within 0.1 s."""
    time = np.atleast_1d(time)

    def wave(mean, amplitude, phase):
        return mean + amplitude * np.sin(4.0 * time + phase)

    table = np.stack((1.6 * np.cos(WIDE_ANGLES), 0.1 + 0.9 * WIDE_ANGLES, 0.02 - 0.4 * WIDE_ANGLES**2), axis=1)
    growth = np.stack([wave(1.0, a, p) for a, p in ((0.3, 0.0), (0.4, 1.0), (0.5, 2.0))], axis=1)
    return PathLoads(
        air=np.stack((wave(4000.0, 400.0, 0.5), wave(150.0, 300.0, 1.5), wave(-80.0, 200.0, 4.0)), axis=1),
        pressure_area=wave(5000.0, 2000.0, 0.2),
        coefficients=growth[:, None, :] * table,
        angle_step=float(WIDE_ANGLES[1]),
        cmq=wave(-4.0, 2.0, 0.3),
        rate_scale=2.65 / wave(8000.0, 3000.0, 2.5),
        diameter=2.65,
        mass=830.0,
        offset=np.array([0.03, 0.02, -0.04]),
        inertia=INERTIA,
        inverse=np.linalg.inv(INERTIA),
    )


def node_times(edges, steps):
    """Times of the nodes (M,) of samples with given edges."""
    return np.interp(np.arange(2 * steps * (len(edges) - 1) + 1), 2 * steps * np.arange(len(edges)), edges)


def a_state(disturbances=(), rotation=(0.3, -0.02, 0.06), rates=(0.2, 0.05, -0.03)):
    state = np.zeros(SIZE)
    state[:4] = Rotation.from_rotvec(rotation).as_quat()
    state[4:7] = rates
    state[7 : 7 + len(disturbances)] = disturbances
    return state


def advanced(state, loads, interval, steps):
    """State at the end of the first sample, and its readings."""
    end, reading = np.empty(SIZE), np.empty(6)
    _advance(state, loads, 0, steps, interval, end, reading)
    return end, reading


def derivative(state, loads):
    """Readable twin: derivative of attitude and rates, and the specific force, by vectors and scipy's rotations."""
    scale, cl, cm0, cn0, axial, normal, cy, cz, curvature, damping, *wind = state[7:]
    attitude, rate = Rotation.from_quat(state[:4]), state[4:7]
    u, v, w = attitude.inv().apply(loads.air[0] - wind)
    angles = loads.angle_step * np.arange(len(loads.coefficients[0]))
    angle = min(np.arctan2(np.hypot(v, w), u), angles[-1])
    ca, cn, cm = (np.interp(angle, angles, c) for c in loads.coefficients[0].T)
    cm *= 1.0 + scale + curvature * (angle / CURVATURE_ANGLE) ** 2
    cn_pitch, cy_yaw, cm_pitch, cn_yaw = split(cn * (1.0 + normal), cm, v, w)
    push, size = loads.pressure_area[0], loads.diameter
    force = push * np.array([-ca * (1.0 + axial), cy + cy_yaw, cz - cn_pitch])
    moment = push * size * np.array([cl, cm0 + cm_pitch, cn0 + cn_yaw])
    moment[1:] += push * size * (loads.cmq[0] + damping) * loads.rate_scale[0] * rate[1:]
    moment -= np.cross(loads.offset, force)
    acceleration = np.linalg.solve(loads.inertia, moment - np.cross(rate, loads.inertia @ rate))
    x, y, z, s = state[:4]
    matrix = 0.5 * np.array([[s, -z, y], [z, s, -x], [-y, x, s], [-x, -y, -z]])
    return np.concatenate((matrix @ rate, acceleration)), force / loads.mass


def integrated(start, loads_at, begin, end):
    """Attitude and rates (7,) at the end of a sample and its mean rates and specific force (6,), by scipy."""

    def slope(time, y):
        rates, force = derivative(np.concatenate((y[:7], start[7:])), loads_at(time))
        return np.concatenate((rates, y[4:7], force))

    y = solve_ivp(slope, (begin, end), np.concatenate((start[:7], np.zeros(6))), rtol=1e-10, atol=1e-12).y[:, -1]
    return y[:7], y[7:] / (end - begin)


DISTURBED = (0.1, 2e-5, 3e-4, -2e-4, 0.03, -0.1, 1e-3, -2e-3, 0.2, 0.1, 8.0, -5.0, 3.0)
#: Disturbances of which each changes the motion by much more than the error of an integration.
LARGE = (0.3, 0.01, 0.02, -0.03, 0.2, -0.3, 0.05, -0.04, 0.6, 3.0, 80.0, -90.0, 70.0)


@pytest.fixture(scope="module")
def samples():
    """Samples whose loads and lengths differ, and their linearisation."""
    states = np.array([
        a_state(LARGE, (0.3, 0.17, 0.06), (0.7, -0.4, 0.5)),
        a_state(-0.8 * np.array(LARGE), (-1.2, 0.22, 0.12), (-0.5, 0.6, 0.4)),
        a_state(0.5 * np.array(LARGE), (2.0, -0.1, 0.3), (0.4, 0.5, -0.8)),
    ])  # fmt: skip
    loads = varying_loads(node_times(EDGES, STEPS))
    return states, loads, linearise(states, loads, np.diff(EDGES), STEPS)


def test_samples_of_varying_loads_are_those_of_another_integrator(samples):
    states, _, (ends, readings, _, _) = samples
    for t, state in enumerate(states):
        expected, mean = integrated(state, varying_loads, EDGES[t], EDGES[t + 1])
        np.testing.assert_allclose(ends[t, :7], expected, atol=3e-7)
        np.testing.assert_allclose(readings[t], mean, atol=6e-7)
        np.testing.assert_array_equal(ends[t, 7:], state[7:])


def test_the_derivatives_are_those_of_finite_changes_of_each_element(samples):
    """Five-point differences, whose steps are larger and whose error is of fourth order."""
    states, _, (_, _, transition, design) = samples
    steps = np.array([1e-3] * 6 + [0.05] + [1e-3] * 3 + [0.05] * 2 + [1e-3] * 2 + [0.05] * 2 + [4.0] * 3)
    for t, state in enumerate(states):
        loads, interval = varying_loads(node_times(EDGES[t : t + 2], STEPS)), EDGES[t + 1] - EDGES[t]
        for j, step in enumerate(steps):
            slope = np.zeros(ERROR_SIZE + 6)
            for places, weight in ((1.0, 8.0), (2.0, -1.0)):
                error = places * step * np.eye(ERROR_SIZE)[j : j + 1]
                (above, high), (below, low) = (
                    advanced(add_errors(state[None], e)[0], loads, interval, STEPS) for e in (error, -error)
                )
                change = state_differences(above[None], below[None])[0]
                slope += weight / (12.0 * step) * np.concatenate((change, high - low))
            column = np.concatenate((transition[t, :, j], design[t, :, j]))
            for part in (slice(0, 3), slice(3, 6), slice(6, 19), slice(19, 22), slice(22, 25)):
                size = np.linalg.norm(slope[part])
                np.testing.assert_allclose(column[part], slope[part], atol=1e-5 * size + 1e-9)


def flow_at_an_angle(angle, direction=0.7):
    """Loads whose flow has a given total angle of attack for a vehicle whose axes are the inertial ones."""
    lateral = np.sin(angle) * np.array([np.sin(direction), np.cos(direction)])
    return varying_loads(0.1)._replace(air=4000.0 * np.array([[np.cos(angle), *lateral]]))


@pytest.mark.parametrize(
    "angle", [0.0, 1e-4, 0.5 * WIDE_ANGLES[1], 1.5 * WIDE_ANGLES[1], WIDE_ANGLES[-1] - 1e-3, WIDE_ANGLES[-1],
              WIDE_ANGLES[-1] + 1e-3, 2.0, np.pi],
)  # fmt: skip
def test_forces_and_moments_at_special_angles(angle):
    """Without lateral flow, about the last angle of the table, and backwards."""
    loads = flow_at_an_angle(angle)
    state = a_state(LARGE[:10], (0.0, 0.0, 0.0), (0.7, -0.4, 0.5))
    change, force = np.empty(7), np.empty(3)
    _derivative(state, loads, 0, change, force)
    expected, mean = derivative(state, loads)
    np.testing.assert_allclose(change, expected, rtol=1e-11)
    np.testing.assert_allclose(force, mean, rtol=1e-11)


@pytest.mark.parametrize("disturbances", [(), DISTURBED])
def test_a_sample_is_that_of_another_integrator(disturbances):
    assert len(DISTURBED) == len(DISTURBANCES)
    loads, start = loads_of(1, 5), a_state(disturbances)
    end, mean = advanced(start, loads, 0.125, 5)
    expected, reading = integrated(start, lambda _: loads, 0.0, 0.125)
    np.testing.assert_allclose(end[:7], expected, atol=2e-8)
    np.testing.assert_array_equal(end[7:], start[7:])
    np.testing.assert_allclose(mean * 0.125, reading * 0.125, atol=3e-8)


def test_a_free_symmetric_body_precesses_at_the_known_rate():
    """Closed form (Goldstein, Classical Mechanics, section 5.6): lateral rates turn at (Ixx - Iyy) / Iyy times p."""
    axial, lateral = 270.0, 200.0
    loads = loads_of(1, 5, pressure_area=0.0)._replace(
        inertia=np.diag([axial, lateral, lateral]), inverse=np.diag(1.0 / np.array([axial, lateral, lateral]))
    )
    state = a_state()
    for t in range(80):
        state, _ = advanced(state, loads, 0.125, 5)
        angle = (axial - lateral) / lateral * 0.2 * 0.125 * (t + 1)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        np.testing.assert_allclose(state[5:7], turn @ [0.05, -0.03], atol=1e-9)
        assert state[4] == pytest.approx(0.2, abs=1e-12)


def test_an_attitude_remains_a_unit_quaternion():
    """Of a free body with equal moments of inertia, also where a step turns so far that its own error is large."""
    start = a_state(rates=(30.0, -40.0, 20.0))
    loads = loads_of(1, 5, pressure_area=0.0)._replace(inertia=200.0 * np.eye(3), inverse=np.eye(3) / 200.0)
    end, reading = advanced(start, loads, 0.125, 5)
    assert np.linalg.norm(end[:4]) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(end[4:7], start[4:7], rtol=1e-15)
    np.testing.assert_allclose(reading, [*start[4:7], 0.0, 0.0, 0.0], rtol=1e-14)


def test_the_derivatives_predict_a_finite_change_to_second_order():
    loads, start = loads_of(1, 5), a_state(DISTURBED)[None]
    random = np.random.default_rng(0)
    sizes = np.array([1e-2] * 6 + [0.1, 1e-5, 1e-4, 1e-4, 0.1, 0.1, 1e-3, 1e-3, 0.1, 0.1] + [10.0] * 3)
    ends, readings, transition, design = linearise(start, loads, np.array([0.125]), 5)
    for direction in random.standard_normal((6, ERROR_SIZE)) * sizes:
        errors = []
        for size in (0.2, 0.1):
            moved = add_errors(start, size * direction[None])
            end, reading = advanced(moved[0], loads, 0.125, 5)
            predicted = np.concatenate((transition[0], design[0])) @ (size * direction)
            exact = np.concatenate((state_differences(end[None], ends)[0], reading - readings[0]))
            errors.append(np.abs(exact - predicted))
            assert np.linalg.norm(exact[:6] - predicted[:6]) < 0.1 * np.linalg.norm(exact[:6])
        assert np.linalg.norm(errors[1][:6]) < 0.35 * np.linalg.norm(errors[0][:6]) + 1e-12


@given(arrays(float, (2, ERROR_SIZE), elements=st.floats(-1.5, 1.5)))
def test_a_difference_is_the_error_that_was_added(errors):
    states = np.array([a_state(DISTURBED), a_state((), (1.0, -2.0, 0.4))])
    moved = add_errors(states, errors)
    np.testing.assert_allclose(state_differences(moved, states), errors, atol=1e-9)
    turned = Rotation.from_quat(states[:, :4]) * Rotation.from_rotvec(errors[:, :3])  # in body axes
    np.testing.assert_allclose(Rotation.from_quat(moved[:, :4]).as_matrix(), turned.as_matrix(), atol=1e-12)


def test_coefficients_are_held_beyond_the_last_angle():
    loads, backwards = loads_of(1, 5), a_state()
    backwards[:4] = Rotation.from_rotvec([0.0, 2.5, 0.0]).as_quat()
    _, readings, _, _ = linearise(backwards[None], loads, np.array([1e-6]), 5)
    ca = loads.coefficients[0, -1, 0]
    assert readings[0, 3] == pytest.approx(-ca * loads.pressure_area[0] / loads.mass, rel=1e-6)
