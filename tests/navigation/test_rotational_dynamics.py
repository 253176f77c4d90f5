"""Rotational dynamics along a path: against another integrator, closed forms, and finite perturbations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from edl_filter.navigation.rotational_dynamics import (
    CURVATURE_ANGLE,
    DISTURBANCES,
    ERROR_SIZE,
    SIZE,
    PathLoads,
    add_errors,
    linearise,
    state_differences,
)

ANGLES = np.radians(np.arange(0.0, 61.0))
INERTIA = np.array([[270.0, 3.0, -2.0], [3.0, 210.0, 5.0], [-2.0, 5.0, 190.0]])


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


def a_state(disturbances=()):
    state = np.zeros(SIZE)
    state[:4] = Rotation.from_rotvec([0.3, -0.02, 0.06]).as_quat()
    state[4:7] = 0.2, 0.05, -0.03
    state[7 : 7 + len(disturbances)] = disturbances
    return state


def derivative(state, loads):
    """Readable twin: derivative of attitude and rates, and the specific force, by vectors and scipy's rotations."""
    scale, cl, cm0, cn0, axial, normal, cy, cz, curvature, damping, *wind = state[7:]
    attitude, rate = Rotation.from_quat(state[:4]), state[4:7]
    u, v, w = attitude.inv().apply(loads.air[0] - wind)
    angle, lateral = np.arctan2(np.hypot(v, w), u), np.array([v, w]) / np.hypot(v, w)
    ca, cn, cm = (np.interp(angle, ANGLES, c) for c in loads.coefficients[0].T)
    cm *= 1.0 + scale + curvature * (angle / CURVATURE_ANGLE) ** 2
    ca, cn = ca * (1.0 + axial), cn * (1.0 + normal)
    push, size = loads.pressure_area[0], loads.diameter
    force = push * np.array([-ca, cy - cn * lateral[0], cz - cn * lateral[1]])
    moment = push * size * np.array([cl, cm0 + cm * lateral[1], cn0 - cm * lateral[0]])
    moment[1:] += push * size * (loads.cmq[0] + damping) * loads.rate_scale[0] * rate[1:]
    moment -= np.cross(loads.offset, force)
    acceleration = np.linalg.solve(loads.inertia, moment - np.cross(rate, loads.inertia @ rate))
    x, y, z, s = state[:4]
    matrix = 0.5 * np.array([[s, -z, y], [z, s, -x], [-y, x, s], [-x, -y, -z]])
    return np.concatenate((matrix @ rate, acceleration)), force / loads.mass


DISTURBED = (0.1, 2e-5, 3e-4, -2e-4, 0.03, -0.1, 1e-3, -2e-3, 0.2, 0.1, 8.0, -5.0, 3.0)


@pytest.mark.parametrize("disturbances", [(), DISTURBED])
def test_a_sample_is_that_of_another_integrator(disturbances):
    assert len(DISTURBED) == len(DISTURBANCES)
    loads, start = loads_of(1, 5), a_state(disturbances)

    def slope(_, y):
        state = np.concatenate((y[:7], start[7:]))
        rates, force = derivative(state, loads)
        return np.concatenate((rates, y[4:7], force))

    reference = solve_ivp(slope, (0.0, 0.125), np.concatenate((start[:7], np.zeros(6))), rtol=1e-11, atol=1e-13)
    ends, readings, _, _ = linearise(start[None], loads, np.array([0.125]), 5)
    expected = reference.y[:, -1]
    np.testing.assert_allclose(ends[0, :7], expected[:7], atol=2e-8)
    np.testing.assert_array_equal(ends[0, 7:], start[7:])
    np.testing.assert_allclose(readings[0] * 0.125, expected[7:], atol=3e-8)


def test_a_free_symmetric_body_precesses_at_the_known_rate():
    """Closed form (Goldstein, Classical Mechanics, section 5.6): lateral rates turn at (Ixx - Iyy) / Iyy times p."""
    axial, lateral = 270.0, 200.0
    loads = loads_of(80, 5, pressure_area=0.0)._replace(
        inertia=np.diag([axial, lateral, lateral]), inverse=np.diag(1.0 / np.array([axial, lateral, lateral]))
    )
    state = a_state()
    for t in range(80):
        part = loads._replace(
            air=loads.air[:11], pressure_area=loads.pressure_area[:11], coefficients=loads.coefficients[:11]
        )
        ends, _, _, _ = linearise(state[None], part, np.array([0.125]), 5)
        state = ends[0]
        angle = (axial - lateral) / lateral * 0.2 * 0.125 * (t + 1)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        np.testing.assert_allclose(state[5:7], turn @ [0.05, -0.03], atol=1e-9)
        assert state[4] == pytest.approx(0.2, abs=1e-12)


def test_the_derivatives_predict_a_finite_change_to_second_order():
    loads, start = loads_of(1, 5), a_state(DISTURBED)[None]
    random = np.random.default_rng(0)
    sizes = np.array([1e-2] * 6 + [0.1, 1e-5, 1e-4, 1e-4, 0.1, 0.1, 1e-3, 1e-3, 0.1, 0.1] + [10.0] * 3)
    ends, readings, transition, design = linearise(start, loads, np.array([0.125]), 5)
    for direction in random.standard_normal((6, ERROR_SIZE)) * sizes:
        errors = []
        for size in (0.2, 0.1):
            moved = add_errors(start, size * direction[None])
            end, reading, _, _ = linearise(moved, loads, np.array([0.125]), 5)
            predicted = np.concatenate((transition[0], design[0])) @ (size * direction)
            exact = np.concatenate((state_differences(end, ends)[0], reading[0] - readings[0]))
            errors.append(np.abs(exact - predicted))
            assert np.linalg.norm(exact[:6] - predicted[:6]) < 0.1 * np.linalg.norm(exact[:6])
        assert np.linalg.norm(errors[1][:6]) < 0.35 * np.linalg.norm(errors[0][:6]) + 1e-12


@given(arrays(float, ERROR_SIZE, elements=st.floats(-1.5, 1.5)))
def test_a_difference_is_the_error_that_was_added(error):
    state = a_state(DISTURBED)[None]
    np.testing.assert_allclose(state_differences(add_errors(state, error[None]), state), error[None], atol=1e-9)


def test_coefficients_are_held_beyond_the_last_angle():
    loads, backwards = loads_of(1, 5), a_state()
    backwards[:4] = Rotation.from_rotvec([0.0, 2.5, 0.0]).as_quat()
    _, readings, _, _ = linearise(backwards[None], loads, np.array([1e-6]), 5)
    ca = loads.coefficients[0, -1, 0]
    assert readings[0, 3] == pytest.approx(-ca * loads.pressure_area[0] / loads.mass, rel=1e-6)
