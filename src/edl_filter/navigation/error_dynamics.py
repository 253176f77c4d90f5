"""Linear error dynamics of the strapdown propagation: state and transition matrix over an interval, in one call.

The error-state model of inertial navigation in inertial axes (Groves 2013, section 14.2; Savage 2000, chapter 12). With
C from body to inertial axes, the attitude error ψ in inertial axes and the errors of corrected force and rate δf, δω::

    δr' = δv          δv' = ψ × (C f) + C δf + Γ δr          ψ' = C δω

where Γ is the gradient of gravity. The sensors' corrections ``f = A f_m + c`` and ``ω = a ∘ ω_m + c`` have, for errors
of bias, scale and misalignment, the errors (`imu_model.sensor_errors`)::

    δf = -A δb - A diag(R f) δs + [f]ₓ J(m) δm          δω = -a ∘ δb_g - a ∘ ω ∘ δs_g

The model is accumulated step by step with the same leapfrog as `strapdown`, so that the result is the derivative of
that propagation itself: the rotation over a sample enters through the Jacobian of the rotation group and is not
approximated to first order in the interval.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from edl_filter.navigation.strapdown import step
from edl_filter.rotation_kernels import fill_matrix, product, quaternion, right_jacobian_elements

#: Errors whose columns the transition has: position, velocity, attitude, then `SENSOR_STATES`, three each.
COLUMNS = 24


@njit(cache=True, error_model="numpy", nogil=True)
def propagate_linearized(
    start, force_map, rate_map, alignment, alignment_jacobian, interval, force, rate, mu, j2, radius
):
    """Propagate one state over samples, and differentiate its end with respect to its start and the sensor errors.

    Parameters
    ----------
    start : (10,) array
        Inertial position (m) and velocity (m/s), and inertial_from_body (scalar last).
    force_map : (12,) array
        Corrects the accelerometers' errors: true = A measured + c; A row by row (9), then c (3), m/s².
    rate_map : (6,) array
        Corrects the gyros' errors: true = a ∘ measured + c; a (3), then c (3), rad/s.
    alignment, alignment_jacobian : (3, 3) arrays
        R(m) of the accelerometers' misalignment m, and the right Jacobian of the rotation group at m.
    interval : (N,) array
        s.
    force, rate : (N, 3) arrays
        Effective specific force (m/s²) and rate (rad/s) as measured, body axes.
    mu, j2, radius : float
        Gravity: m³/s², second zonal harmonic, and its reference radius, m.

    Returns
    -------
    end : (10,) array
        State after the samples.
    transition : (9, 24) array
        Derivatives of the errors of position, velocity and attitude (body axes of the end) by the errors of position,
        velocity, attitude (body axes of the start) and of bias, scale and misalignment of the accelerometers and bias
        and scale of the gyros. Units: m, m/s, rad and those of `layout.UNITS`.
    """
    x, y, z, vx, vy, vz, qx, qy, qz, qw = start
    j = 1.5 * j2 * radius * radius
    turn, middle = np.empty((3, 3)), np.empty((3, 3))
    position, velocity, attitude = np.zeros((3, COLUMNS)), np.zeros((3, COLUMNS)), np.zeros((3, COLUMNS))
    acceleration, force_errors = np.zeros((3, COLUMNS)), np.zeros((3, 9))
    gradient, rate_jacobian, half_jacobian = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    rate_errors, gyro = np.empty(6), np.empty((3, 6))
    fill_matrix((qx, qy, qz, qw), turn)
    for k in range(3):
        position[k, k] = 1.0
        velocity[k, 3 + k] = 1.0
        for c in range(3):
            attitude[k, 6 + c] = turn[k, c]
    for i in range(interval.size):
        dt = interval[i]
        half = 0.5 * dt
        fx = force_map[0] * force[i, 0] + force_map[1] * force[i, 1] + force_map[2] * force[i, 2] + force_map[9]
        fy = force_map[3] * force[i, 0] + force_map[4] * force[i, 1] + force_map[5] * force[i, 2] + force_map[10]
        fz = force_map[6] * force[i, 0] + force_map[7] * force[i, 1] + force_map[8] * force[i, 2] + force_map[11]
        wx = rate_map[0] * rate[i, 0] + rate_map[3]
        wy = rate_map[1] * rate[i, 1] + rate_map[4]
        wz = rate_map[2] * rate[i, 2] + rate_map[5]
        # errors of the corrected force and rate
        _force_error_jacobian(force_errors, force_map, alignment, alignment_jacobian, fx, fy, fz)
        rate_errors[0], rate_errors[1], rate_errors[2] = -rate_map[0], -rate_map[1], -rate_map[2]
        rate_errors[3], rate_errors[4], rate_errors[5] = -rate_map[0] * wx, -rate_map[1] * wy, -rate_map[2] * wz
        # attitude error at mid-sample: half of the sample's rate error acts before
        _left_jacobian(half_jacobian, half * wx, half * wy, half * wz)
        _left_jacobian(rate_jacobian, dt * wx, dt * wy, dt * wz)
        for row in range(3):
            for c in range(6):
                value = 0.0
                for k in range(3):
                    value += turn[row, k] * half_jacobian[k, c % 3]
                gyro[row, c] = attitude[row, 18 + c] + half * value * rate_errors[c]
        # specific force in inertial axes at mid-sample
        fill_matrix(product((qx, qy, qz, qw), quaternion(half * wx, half * wy, half * wz)), middle)
        gx = middle[0, 0] * fx + middle[0, 1] * fy + middle[0, 2] * fz
        gy = middle[1, 0] * fx + middle[1, 1] * fy + middle[1, 2] * fz
        gz = middle[2, 0] * fx + middle[2, 1] * fy + middle[2, 2] * fz
        for c in range(3):  # ψ × (C f) of the attitude at the start
            ax, ay, az = attitude[0, 6 + c], attitude[1, 6 + c], attitude[2, 6 + c]
            acceleration[0, 6 + c] = ay * gz - az * gy
            acceleration[1, 6 + c] = az * gx - ax * gz
            acceleration[2, 6 + c] = ax * gy - ay * gx
        for c in range(9):  # C δf
            for row in range(3):
                value = 0.0
                for k in range(3):
                    value += middle[row, k] * force_errors[k, c]
                acceleration[row, 9 + c] = value
        for c in range(6):  # ψ × (C f) of the gyros' errors
            ax, ay, az = gyro[0, c], gyro[1, c], gyro[2, c]
            acceleration[0, 18 + c] = ay * gz - az * gy
            acceleration[1, 18 + c] = az * gx - ax * gz
            acceleration[2, 18 + c] = ax * gy - ay * gx
        # drift, kick, drift
        gravity_gradient(gradient, x + half * vx, y + half * vy, z + half * vz, mu, j)
        for c in range(COLUMNS):
            px = position[0, c] + half * velocity[0, c]
            py = position[1, c] + half * velocity[1, c]
            pz = position[2, c] + half * velocity[2, c]
            ax = acceleration[0, c] + gradient[0, 0] * px + gradient[0, 1] * py + gradient[0, 2] * pz
            ay = acceleration[1, c] + gradient[1, 0] * px + gradient[1, 1] * py + gradient[1, 2] * pz
            az = acceleration[2, c] + gradient[2, 0] * px + gradient[2, 1] * py + gradient[2, 2] * pz
            ux = velocity[0, c] + dt * ax
            uy = velocity[1, c] + dt * ay
            uz = velocity[2, c] + dt * az
            velocity[0, c], velocity[1, c], velocity[2, c] = ux, uy, uz
            position[0, c], position[1, c], position[2, c] = px + half * ux, py + half * uy, pz + half * uz
        # attitude error at the end of the sample
        for row in range(3):
            for c in range(6):
                value = 0.0
                for k in range(3):
                    value += turn[row, k] * rate_jacobian[k, c % 3]
                attitude[row, 18 + c] += dt * value * rate_errors[c]
        x, y, z, vx, vy, vz, qx, qy, qz, qw = step(
            x, y, z, vx, vy, vz, qx, qy, qz, qw, dt, fx, fy, fz, wx, wy, wz, mu, j
        )
        fill_matrix((qx, qy, qz, qw), turn)
    transition = np.empty((9, COLUMNS))
    for row in range(3):
        for c in range(COLUMNS):
            transition[row, c], transition[3 + row, c] = position[row, c], velocity[row, c]
            value = 0.0  # back to body axes
            for k in range(3):
                value += turn[k, row] * attitude[k, c]
            transition[6 + row, c] = value
    return np.array([x, y, z, vx, vy, vz, qx, qy, qz, qw]), transition


@njit(cache=True, error_model="numpy", nogil=True)
def gravity_gradient(out, x, y, z, mu, j):
    """Fill `out` (3, 3) with the gradient of gravity, 1/s².

    Parameters
    ----------
    out : (3, 3) array, changed in place
        Derivatives of the components (rows) by the coordinates (columns).
    x, y, z : float
        Position from the planet's centre, m, z along the rotation axis.
    mu : float
        Gravitational parameter, m³/s².
    j : float
        3/2 J2 times the squared reference radius, m².
    """
    r2 = 1.0 / (x * x + y * y + z * z)
    a = -mu * r2 * np.sqrt(r2)
    h = j * r2
    d = 5.0 * z * z * r2
    p = (x, y, z)
    for row in range(3):
        c = 3.0 if row == 2 else 1.0  # g = a (1 + h (c - d)) p
        factor = 1.0 + h * (c - d)
        radial = -3.0 * factor - 2.0 * h * (c - d) + 2.0 * h * d
        for column in range(3):
            value = a * r2 * p[row] * p[column] * radial
            if column == 2:
                value -= 10.0 * a * r2 * h * p[row] * z
            if row == column:
                value += a * factor
            out[row, column] = value


@njit(cache=True, error_model="numpy", nogil=True)
def _force_error_jacobian(out, force_map, alignment, alignment_jacobian, fx, fy, fz):
    """Derivatives (3, 9) of corrected force by bias, scale and misalignment: ``-A``, ``-A diag(R f)``, ``[f]ₓ J``."""
    for c in range(3):
        scaled = alignment[c, 0] * fx + alignment[c, 1] * fy + alignment[c, 2] * fz
        for row in range(3):
            out[row, c] = -force_map[3 * row + c]
            out[row, 3 + c] = -force_map[3 * row + c] * scaled
        jx, jy, jz = alignment_jacobian[0, c], alignment_jacobian[1, c], alignment_jacobian[2, c]
        out[0, 6 + c] = fy * jz - fz * jy
        out[1, 6 + c] = fz * jx - fx * jz
        out[2, 6 + c] = fx * jy - fy * jx


@njit(cache=True, error_model="numpy", nogil=True)
def _left_jacobian(out, x, y, z):
    """Left Jacobian of the rotation group at a rotation vector: the right one at the opposite vector."""
    (
        out[0, 0], out[0, 1], out[0, 2], out[1, 0], out[1, 1], out[1, 2], out[2, 0], out[2, 1], out[2, 2],
    ) = right_jacobian_elements(-x, -y, -z)  # fmt: skip
