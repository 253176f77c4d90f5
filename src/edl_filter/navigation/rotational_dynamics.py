"""Rotational dynamics of an entry vehicle along a known path, and its linearisation: Euler's equations, compiled.

Where readings are lost, moments and forces of an aerodynamic database predict how the vehicle moves on. Input: the
air-relative velocity along a path and the coefficients there against the total angle of attack. The state has 20
elements: inertial_from_body (0:4, scalar last), body rates (4:7, rad/s), and disturbances of the coefficients (7:20,
`DISTURBANCES`). Its error has 19: a rotation vector in body axes (rad), and differences of all others. Output: the
state after each sample, what an IMU at the centre of mass reads over it, and the derivatives of both.

Equations
---------
- ``q' = q ⊗ (w, 0) / 2`` (Shuster 1993, eq. 305), ``I w' = M - w × I w`` (Euler).
- Total coefficients split by the lateral flow, moments moved from the axis to the centre of mass, damping
  ``Cmq (rate D / 2V)``: those of `edl_filter.effects.forward_model`.
- Fixed-step Runge-Kutta method of order 4; Jacobians by central differences.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from edl_filter.rotation_kernels import direction_cosines, product, quaternion, rotation_vector
from edl_filter.types import Array

#: Disturbances of the coefficients: relative change of the pitching moment; rolling, pitching and yawing moment, fixed
#: to the body; relative changes of axial and normal force; side force and force along +z, fixed to the body; relative
#: change of the pitching moment at `CURVATURE_ANGLE`, which grows with the square of the angle; addition to
#: Cmq; wind, m/s, inertial axes, which changes the direction of the flow and not its dynamic pressure.
DISTURBANCES = (
    "moment_scale", "cl", "cm", "cn", "axial_scale", "normal_scale", "cy", "cz", "moment_curvature", "damping",
    "wind_x", "wind_y", "wind_z",
)  # fmt: skip
#: Angle of attack at which the disturbance of the moment's curvature is defined, rad.
CURVATURE_ANGLE = 0.1
#: Number of elements of a state and of its error.
SIZE, ERROR_SIZE = 7 + len(DISTURBANCES), 6 + len(DISTURBANCES)
#: Steps of the central differences: rad, rad/s, and disturbances.
_STEPS = np.array([1e-4] * 3 + [1e-4] * 3 + [1e-2] + [1e-5] * 3 + [1e-2] * 2 + [1e-4] * 2 + [1e-2] * 2 + [1.0] * 3)


class PathLoads(NamedTuple):
    """What acts on the vehicle at M = 2 K T + 1 nodes: begin and middle of K steps in each of T samples, and the end.

    Attributes
    ----------
    air : (M, 3) array
        Air-relative velocity, m/s, inertial axes.
    pressure_area : (M,) array
        Dynamic pressure times reference area, N.
    coefficients : (M, A, 3) array
        CA, CN, and Cm about the projection of the centre of mass on the axis, at A angles from zero on; held beyond the
        last.
    angle_step : float
        Between two of these angles, rad.
    cmq, rate_scale : (M,) arrays
        Damping coefficient, and D / 2V, s.
    diameter, mass : float
        m, kg.
    offset : (3,) array
        Centre of mass relative to its projection on the axis, m, body axes.
    inertia, inverse : (3, 3) arrays
        About the centre of mass, kg m², and its inverse.
    """

    air: Array
    pressure_area: Array
    coefficients: Array
    angle_step: float
    cmq: Array
    rate_scale: Array
    diameter: float
    mass: float
    offset: Array
    inertia: Array
    inverse: Array


@njit(cache=True, error_model="numpy")
def _derivative(s, loads, node, d, force):
    """Time derivatives of attitude and rates (7,), and the specific force (3,), of a state (20,) at a node."""
    c = direction_cosines(s[0], s[1], s[2], s[3])
    ax, ay, az = loads.air[node, 0] - s[17], loads.air[node, 1] - s[18], loads.air[node, 2] - s[19]
    u = c[0] * ax + c[3] * ay + c[6] * az
    v = c[1] * ax + c[4] * ay + c[7] * az
    w = c[2] * ax + c[5] * ay + c[8] * az
    lateral = np.sqrt(v * v + w * w)
    sine, cosine = (v / lateral, w / lateral) if lateral > 0.0 else (0.0, 1.0)
    table = loads.coefficients[node]
    place = min(np.arctan2(lateral, u) / loads.angle_step, table.shape[0] - 1.0)
    i = min(int(place), table.shape[0] - 2)
    fraction = place - i
    ca = table[i, 0] + fraction * (table[i + 1, 0] - table[i, 0])
    cn = table[i, 1] + fraction * (table[i + 1, 1] - table[i, 1])
    cm = table[i, 2] + fraction * (table[i + 1, 2] - table[i, 2])
    relative = place * loads.angle_step / CURVATURE_ANGLE
    cm, ca, cn = cm * (1.0 + s[7] + s[15] * relative * relative), ca * (1.0 + s[11]), cn * (1.0 + s[12])
    push, size = loads.pressure_area[node], loads.diameter
    damping = (loads.cmq[node] + s[16]) * loads.rate_scale[node]
    fx, fy, fz = -push * ca, push * (s[13] - cn * sine), push * (s[14] - cn * cosine)
    p, q, r = s[4], s[5], s[6]
    ox, oy, oz = loads.offset
    mx = push * size * s[8] - (oy * fz - oz * fy)
    my = push * size * (cm * cosine + s[9] + damping * q) - (oz * fx - ox * fz)
    mz = push * size * (-cm * sine + s[10] + damping * r) - (ox * fy - oy * fx)
    tensor, inverse = loads.inertia, loads.inverse
    hx = tensor[0, 0] * p + tensor[0, 1] * q + tensor[0, 2] * r
    hy = tensor[1, 0] * p + tensor[1, 1] * q + tensor[1, 2] * r
    hz = tensor[2, 0] * p + tensor[2, 1] * q + tensor[2, 2] * r
    mx, my, mz = mx - (q * hz - r * hy), my - (r * hx - p * hz), mz - (p * hy - q * hx)
    d[0] = 0.5 * (s[3] * p + s[1] * r - s[2] * q)
    d[1] = 0.5 * (s[3] * q - s[0] * r + s[2] * p)
    d[2] = 0.5 * (s[3] * r + s[0] * q - s[1] * p)
    d[3] = -0.5 * (s[0] * p + s[1] * q + s[2] * r)
    for k in range(3):
        d[4 + k] = inverse[k, 0] * mx + inverse[k, 1] * my + inverse[k, 2] * mz
    force[0], force[1], force[2] = fx / loads.mass, fy / loads.mass, fz / loads.mass


@njit(cache=True, error_model="numpy")
def _advance(start, loads, first, steps, interval, end, reading):
    """State (20,) after one sample, and its readings (6,): mean rates and mean specific force by Simpson's rule."""
    slope, force, y = np.empty((4, 7)), np.empty((4, 3)), np.empty((4, SIZE))
    h = interval / steps
    end[:] = start
    reading[:] = 0.0
    for n in range(steps):
        for stage in range(4):
            y[stage] = end
            ahead = h if stage == 3 else 0.5 * h
            for k in range(7):
                if stage > 0:
                    y[stage, k] += ahead * slope[stage - 1, k]
            _derivative(y[stage], loads, first + 2 * n + (stage + 1) // 2, slope[stage], force[stage])
        for k in range(3):
            reading[k] += (y[0, 4 + k] + 2.0 * (y[1, 4 + k] + y[2, 4 + k]) + y[3, 4 + k]) / (6.0 * steps)
            reading[3 + k] += (force[0, k] + 2.0 * (force[1, k] + force[2, k]) + force[3, k]) / (6.0 * steps)
        for k in range(7):
            end[k] += h / 6.0 * (slope[0, k] + 2.0 * (slope[1, k] + slope[2, k]) + slope[3, k])
        norm = np.sqrt(end[0] ** 2 + end[1] ** 2 + end[2] ** 2 + end[3] ** 2)
        for k in range(4):
            end[k] /= norm


@njit(cache=True, error_model="numpy")
def _add(state, error, out):
    """State (20,) with an error (19,) added."""
    out[0], out[1], out[2], out[3] = product(
        (state[0], state[1], state[2], state[3]), quaternion(error[0], error[1], error[2])
    )
    for k in range(4, SIZE):
        out[k] = state[k] + error[k - 1]


@njit(cache=True, error_model="numpy")
def _difference(state, reference, out):
    """Error (19,) that, added to the reference, gives the state."""
    q = product((-reference[0], -reference[1], -reference[2], reference[3]), (state[0], state[1], state[2], state[3]))
    out[0], out[1], out[2] = rotation_vector(q[0], q[1], q[2], q[3])
    for k in range(4, SIZE):
        out[k - 1] = state[k] - reference[k]


@njit(cache=True, error_model="numpy")
def add_errors(states, errors):
    """States with errors added.

    Parameters
    ----------
    states : (T, 20) array
        As in the module's description.
    errors : (T, 19) array
        rad, rad/s, disturbances.

    Returns
    -------
    (T, 20) array
    """
    out = np.empty_like(states)
    for t in range(len(states)):
        _add(states[t], errors[t], out[t])
    return out


@njit(cache=True, error_model="numpy")
def state_differences(states, references):
    """Errors that, added to the references, give the states.

    Parameters
    ----------
    states, references : (T, 20) arrays
        As in the module's description.

    Returns
    -------
    (T, 19) array
        rad, rad/s, disturbances.
    """
    out = np.empty((len(states), ERROR_SIZE))
    for t in range(len(states)):
        _difference(states[t], references[t], out[t])
    return out


@njit(cache=True, error_model="numpy")
def linearise(states, loads, interval, steps):
    """Linearise each sample about the state at its beginning.

    Parameters
    ----------
    states : (T, 20) array
        At the beginning of each sample; they need not follow from each other.
    loads : PathLoads
        Of these samples.
    interval : (T,) array
        Length of each sample, s.
    steps : int
        Steps in each sample.

    Returns
    -------
    ends : (T, 20) array
        States at the samples' ends; disturbances are constant within a sample.
    readings : (T, 6) array
        Mean rates (rad/s) and mean specific force (m/s²), body axes, at the centre of mass.
    transition : (T, 19, 19) array
        Derivatives of the error at the end with respect to that at the beginning.
    design : (T, 6, 19) array
        Derivatives of the readings.
    """
    count = len(interval)
    ends, readings = np.empty((count, SIZE)), np.empty((count, 6))
    transition, design = np.empty((count, ERROR_SIZE, ERROR_SIZE)), np.empty((count, 6, ERROR_SIZE))
    error, shifted, change = np.zeros(ERROR_SIZE), np.empty(SIZE), np.empty(ERROR_SIZE)
    above, below, high, low = np.empty(SIZE), np.empty(SIZE), np.empty(6), np.empty(6)
    for t in range(count):
        first = 2 * steps * t
        _advance(states[t], loads, first, steps, interval[t], ends[t], readings[t])
        for j in range(ERROR_SIZE):
            error[j] = _STEPS[j]
            _add(states[t], error, shifted)
            _advance(shifted, loads, first, steps, interval[t], above, high)
            error[j] = -_STEPS[j]
            _add(states[t], error, shifted)
            _advance(shifted, loads, first, steps, interval[t], below, low)
            error[j] = 0.0
            _difference(above, below, change)
            transition[t, :, j] = change / (2.0 * _STEPS[j])
            design[t, :, j] = (high - low) / (2.0 * _STEPS[j])
    return ends, readings, transition, design
