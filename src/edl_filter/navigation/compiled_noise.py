"""Compiled process noise of an interval: the twin of `noise` for `compiled_ukf`.

Rate noise turns all force that follows in the interval. With p and v the path and the velocity that the force gives
from there to the end, its covariance has the blocks ``-[p]ₓ (-[v]ₓ)ᵀ = (p·v) 1 - v pᵀ``, which are written out here.
"""

import numpy as np
from numba import njit

from edl_filter.rotation_kernels import fill_matrix, product

COMPILED = njit(cache=True, error_model="numpy", nogil=True)


@COMPILED
def noise_of_samples(interval, middle, force, force_noise, rate_noise, unshared_noise, force_fill, rate_fill):
    """Covariances of position (m), velocity (m/s) and attitude error (rad) by the noise of samples, inertial axes.

    As `noise.process_noise` before the rotation to body axes.

    Parameters
    ----------
    interval : (N,) array
        s.
    middle : (N, 4) array
        inertial_from_body at the middle of the samples.
    force : (N, 3) array
        Specific force, m/s², body axes.
    force_noise, rate_noise : (N,) arrays
        One sigma of the random walks in a sample, m/s² and rad/s.
    unshared_noise : (N,) array
        Part of `rate_noise` that an on-board attitude does not share, rad/s.
    force_fill, rate_fill : (N, 3) arrays
        One sigma of filled samples, m/s² and rad/s, body axes; zero where samples were read.

    Returns
    -------
    covariance, unshared : (9, 9) arrays
        By all rate noise, and by `unshared_noise` only.
    """
    cov, unshared = np.zeros((9, 9)), np.zeros((9, 9))
    gain, path, axes = np.zeros(3), np.zeros(3), np.empty((3, 3))
    by_force, by_rate = np.zeros((9, 3)), np.zeros((9, 3))
    inertial, half_gain, half_path = np.empty(3), np.empty(3), np.empty(3)
    remaining = 0.0
    for i in range(interval.size - 1, -1, -1):
        dt = interval[i]
        fill_matrix(middle[i], axes)
        for k in range(3):
            inertial[k] = axes[k, 0] * force[i, 0] + axes[k, 1] * force[i, 1] + axes[k, 2] * force[i, 2]
        half_remaining = remaining + 0.5 * dt
        moment = 0.5 * dt * remaining + 0.125 * dt * dt
        for k in range(3):
            half_gain[k] = gain[k] + 0.5 * dt * inertial[k]
            half_path[k] = path[k] + moment * inertial[k]
        b = (force_noise[i] * dt) ** 2
        _add_force_noise(cov, b, half_remaining)
        _add_force_noise(unshared, b, half_remaining)
        _add_rate_noise(cov, (rate_noise[i] * dt) ** 2, half_path, half_gain)
        _add_rate_noise(unshared, (unshared_noise[i] * dt) ** 2, half_path, half_gain)
        filled = False
        for k in range(3):
            filled = filled or force_fill[i, k] > 0.0 or rate_fill[i, k] > 0.0
        if filled:
            for c in range(3):
                for k in range(3):
                    error = axes[k, c] * dt
                    by_force[3 + k, c] = error * force_fill[i, c]
                    by_force[k, c] = half_remaining * by_force[3 + k, c]
                    by_rate[6 + k, c] = error * rate_fill[i, c]
                for row, v in ((0, half_path), (3, half_gain)):  # -v × error
                    by_rate[row, c] = v[2] * by_rate[7, c] - v[1] * by_rate[8, c]
                    by_rate[row + 1, c] = v[0] * by_rate[8, c] - v[2] * by_rate[6, c]
                    by_rate[row + 2, c] = v[1] * by_rate[6, c] - v[0] * by_rate[7, c]
            for r in range(9):
                for c in range(9):
                    value = 0.0
                    for k in range(3):
                        value += by_force[r, k] * by_force[c, k] + by_rate[r, k] * by_rate[c, k]
                    cov[r, c] += value
                    unshared[r, c] += value
        for k in range(3):
            path[k] += (dt * remaining + 0.5 * dt * dt) * inertial[k]
            gain[k] += dt * inertial[k]
        remaining += dt
    return cov, unshared


@COMPILED
def _add_force_noise(cov, variance, remaining):
    """Variance of a velocity increment, ``(m/s)²`` per axis, with the time that remains, s."""
    for k in range(3):
        cov[k, k] += variance * remaining * remaining
        cov[k, 3 + k] += variance * remaining
        cov[3 + k, k] += variance * remaining
        cov[3 + k, 3 + k] += variance


@COMPILED
def _add_rate_noise(cov, variance, path, gain):
    """Variance of a turn, rad² per axis, with the path and velocity that the force gives from there to the end."""
    if variance == 0.0:
        return
    for i in range(3):
        for j in range(3):
            cov[i, j] -= variance * path[i] * path[j]
            cov[i, 3 + j] -= variance * gain[i] * path[j]
            cov[3 + i, j] -= variance * path[i] * gain[j]
            cov[3 + i, 3 + j] -= variance * gain[i] * gain[j]
        cov[i, i] += variance * (path[0] * path[0] + path[1] * path[1] + path[2] * path[2])
        both = variance * (path[0] * gain[0] + path[1] * gain[1] + path[2] * gain[2])
        cov[i, 3 + i] += both
        cov[3 + i, i] += both
        cov[3 + i, 3 + i] += variance * (gain[0] * gain[0] + gain[1] * gain[1] + gain[2] * gain[2])
        cov[6 + i, 6 + i] += variance
    for row, v in ((0, path), (3, gain)):  # -[v]ₓ
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            cov[row + i, 6 + j] += variance * v[k]
            cov[row + i, 6 + k] -= variance * v[j]
            cov[6 + j, row + i] += variance * v[k]
            cov[6 + k, row + i] -= variance * v[j]


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
    """Derivatives of the rotation computed on board, as `noise.onboard_rotation`.

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
