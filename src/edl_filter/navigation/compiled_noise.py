"""Process noise of an interval, and derivatives of the attitude that was computed on board; compiled.

The attitude error is expressed in inertial axes, where it is constant, until `in_body_axes`. A sample's force noise
adds to velocity at once and to position over the remaining time. A rotation error ψ turns all force that follows in the
interval: it adds ``ψ × p`` to the position and ``ψ × v`` to the velocity, with the position p and the velocity v that
the force gives from there to the end. With the covariance W of ψ, the blocks of the covariance are ``[p]ₓ W [p]ₓᵀ``,
``[p]ₓ W [v]ₓᵀ`` and so on. Gravity's gradient over one interval (1e-6 s⁻² over seconds) is neglected.
"""

import numpy as np
from numba import njit

from edl_filter.rotation_kernels import fill_matrix, product

COMPILED = njit(cache=True, error_model="numpy", nogil=True)


@COMPILED
def noise_of_samples(interval, middle, force, velocity_variance, rotation_variance, unshared_variance):
    """Covariances of position (m), velocity (m/s) and attitude error (rad) by the noise of samples, inertial axes.

    Parameters
    ----------
    interval : (N,) array
        s.
    middle : (N, 4) array
        inertial_from_body at the middle of the samples.
    force : (N, 3) array
        Specific force, m/s², body axes.
    velocity_variance, rotation_variance, unshared_variance : (N, 3) arrays
        As `noise.IncrementVariances`, (m/s)² and rad², body axes.

    Returns
    -------
    covariance, unshared : (9, 9) arrays
        By all errors of the rotation, and by those of the filter's copy of the readings.
    """
    cov, unshared, moments = np.zeros((9, 9)), np.zeros((9, 9)), np.zeros((3, 3, 3))
    velocity, position, axes = np.zeros(3), np.zeros(3), np.empty((3, 3))
    inertial, half_velocity, half_position = np.empty(3), np.empty(3), np.empty(3)
    square, by_position, by_velocity = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    remaining = 0.0
    for i in range(interval.size - 1, -1, -1):
        dt = interval[i]
        fill_matrix(middle[i], axes)
        for k in range(3):
            inertial[k] = axes[k, 0] * force[i, 0] + axes[k, 1] * force[i, 1] + axes[k, 2] * force[i, 2]
        half_remaining = remaining + 0.5 * dt
        moment = 0.5 * dt * remaining + 0.125 * dt * dt
        for k in range(3):
            half_velocity[k] = velocity[k] + 0.5 * dt * inertial[k]
            half_position[k] = position[k] + moment * inertial[k]
        _in_inertial_axes(axes, velocity_variance[i], square)
        for r in range(3):
            for c in range(r, 3):
                moments[0, r, c] += square[r, c]
                moments[1, r, c] += square[r, c] * half_remaining
                moments[2, r, c] += square[r, c] * half_remaining * half_remaining
        _in_inertial_axes(axes, rotation_variance[i], square)
        _add_rotation_noise(cov, square, half_position, half_velocity, by_position, by_velocity)
        if unshared_variance[i, 0] + unshared_variance[i, 1] + unshared_variance[i, 2] > 0.0:
            _in_inertial_axes(axes, unshared_variance[i], square)
            _add_rotation_noise(unshared, square, half_position, half_velocity, by_position, by_velocity)
        for k in range(3):
            position[k] += (dt * remaining + 0.5 * dt * dt) * inertial[k]
            velocity[k] += dt * inertial[k]
        remaining += dt
    _complete(cov, moments)
    _complete(unshared, moments)
    return cov, unshared


@COMPILED
def _in_inertial_axes(axes, variance, square):
    """Covariance ``square`` of independent errors along the body `axes`."""
    for r in range(3):
        for c in range(r + 1):
            value = 0.0
            for k in range(3):
                value += axes[r, k] * axes[c, k] * variance[k]
            square[r, c] = value
            square[c, r] = value


@COMPILED
def _add_rotation_noise(cov, square, position, velocity, by_position, by_velocity):
    """Upper triangle of the covariance of a rotation, rad², with position and velocity that the force gives after it.

    `by_position` and `by_velocity`, ``(3, 3)``, are overwritten: its covariances with the position and the velocity.
    """
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        for c in range(3):  # ψ × v, component r: ψ_j v_k - ψ_k v_j
            by_position[r, c] = square[j, c] * position[k] - square[k, c] * position[j]
            by_velocity[r, c] = square[j, c] * velocity[k] - square[k, c] * velocity[j]
            cov[r, 6 + c] += by_position[r, c]
            cov[3 + r, 6 + c] += by_velocity[r, c]
    for r in range(3):
        for c in range(3):
            j, k = (c + 1) % 3, (c + 2) % 3
            cov[r, 3 + c] += by_position[r, j] * velocity[k] - by_position[r, k] * velocity[j]
            if c >= r:
                cov[6 + r, 6 + c] += square[r, c]
                cov[r, c] += by_position[r, j] * position[k] - by_position[r, k] * position[j]
                cov[3 + r, 3 + c] += by_velocity[r, j] * velocity[k] - by_velocity[r, k] * velocity[j]


@COMPILED
def _complete(cov, moments):
    """Add the noise of velocity increments, and the lower triangle.

    Parameters
    ----------
    cov : (9, 9) array, changed in place
        With its upper triangle.
    moments : (3, 3, 3) array
        Sums of the increments' covariances, (m/s)², times the power 0, 1 and 2 of the time that remains, s; upper
        triangles.
    """
    for r in range(3):
        for c in range(3):
            a, b = min(r, c), max(r, c)
            cov[r, 3 + c] += moments[1, a, b]
            if c >= r:
                cov[r, c] += moments[2, r, c]
                cov[3 + r, 3 + c] += moments[0, r, c]
    for r in range(9):
        for c in range(r):
            cov[r, c] = cov[c, r]


@COMPILED
def in_body_axes(cov, end):
    """A covariance with the attitude error in body axes.

    Parameters
    ----------
    cov : (9, 9) array
        Of position (m), velocity (m/s) and attitude error (rad), inertial axes.
    end : (4,) array
        inertial_from_body.

    Returns
    -------
    (9, 9) array
        The attitude error in the body axes of `end`.
    """
    matrix, out = np.empty((3, 3)), cov.copy()
    fill_matrix(end, matrix)
    for r in range(9):
        for c in range(3):
            out[r, 6 + c] = cov[r, 6] * matrix[0, c] + cov[r, 7] * matrix[1, c] + cov[r, 8] * matrix[2, c]
    rows = out[6:].copy()
    for r in range(3):
        for c in range(9):
            out[6 + r, c] = matrix[0, r] * rows[0, c] + matrix[1, r] * rows[1, c] + matrix[2, r] * rows[2, c]
    return out


@COMPILED
def onboard_rotation_jacobians(interval, rate, coning_corrected, middle, end):
    """Derivatives of the rotation that is computed on board with other rates and another mounting than the samples'.

    On board ``ω + ω × m - b`` is integrated where the samples read ω, with a mounting that differs by the small
    rotation m and a rate correction b. This holds only where gyros were read: a rate that is coning-corrected was taken
    from the on-board attitude. With C from the axes of each sample to those of the end, the derivative by b is minus
    the integral of C, and that by m the integral of C [ω]ₓ.

    Parameters
    ----------
    interval : (N,) array
        s.
    rate : (N, 3) array
        rad/s, body axes.
    coning_corrected : (N,) array of bool
        Samples that were taken from the on-board attitude.
    middle : (N, 4) array
        Attitudes at the middle of the samples.
    end : (4,) array
        Attitude at their end.

    Returns
    -------
    by_rate, by_mounting : (3, 3) arrays
        Rotation vector (rad) in the body axes of the end, per rate (rad/s) and per mounting (rad).
    """
    by_rate, by_mounting, axes = np.zeros((3, 3)), np.zeros((3, 3)), np.empty((3, 3))
    for i in range(interval.size):
        if coning_corrected[i]:
            continue
        fill_matrix(product((-end[0], -end[1], -end[2], end[3]), middle[i]), axes)
        wx, wy, wz = rate[i, 0], rate[i, 1], rate[i, 2]
        for r in range(3):
            x, y, z = interval[i] * axes[r, 0], interval[i] * axes[r, 1], interval[i] * axes[r, 2]
            by_rate[r, 0] -= x
            by_rate[r, 1] -= y
            by_rate[r, 2] -= z
            by_mounting[r, 0] += y * wz - z * wy
            by_mounting[r, 1] += z * wx - x * wz
            by_mounting[r, 2] += x * wy - y * wx
    return by_rate, by_mounting
