"""Process noise of an interval, from the noise of the IMU's samples.

The attitude error is expressed in inertial axes in this module, where it is constant. A sample's rate noise turns all
specific force that follows in the interval, so it adds to position and velocity ``ψ × (path and velocity
that the specific force gives from there to the end)``; a sample's force noise adds to velocity at once and to
position over the remaining time. Gravity's gradient over one interval (1e-6 s⁻² over seconds) is neglected.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from edl_filter import rotations
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout
from edl_filter.rotation_kernels import product, quaternion
from edl_filter.types import Array

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def process_noise(layout: Layout, samples: Samples, attitude: Array) -> Array:
    """Process noise over `samples` in the filter's vector.

    The attitude that was computed on board is the sum of the same readings, including their noise, so the
    gyros' noise is not noise of it. What the filter does not know of the readings themselves (those in a gap, or the
    difference between two integrations of them) is noise of it and of the true attitude alike.

    A filled stretch of samples has errors of its own along each body axis, which are correlated in time. They enter as
    independent errors of the samples with the same variance of the sum over the stretch: velocity and attitude at its
    end have the right variance, that of the position is up to a third too large.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    samples : Samples
        Of the driving instrument.
    attitude : (4,) array
        inertial_from_body at the samples' beginning.

    Returns
    -------
    (n, n) array
        Covariance, in the units of `layout.UNITS`.
    """
    middle, end = sample_attitudes(samples.interval, samples.rate, attitude)
    to_end = np.eye(9)
    to_end[6:, 6:] = rotations.to_matrix(end).T
    args = samples.interval, rotations.rotate(middle, samples.force), samples.force_noise
    noise = np.zeros((layout.size, layout.size))
    covariance = _accumulate(*args, samples.rate_noise)
    fill = None
    if samples.filled.any():
        fill = _fill_noise(samples, middle, args[1])
        covariance = covariance + fill
    noise[:9, :9] = to_end @ covariance @ to_end.T
    if ONBOARD in layout:
        block = layout[ONBOARD]
        unshared = np.sqrt(samples.rate_noise**2 - samples.shared_rate_noise**2)
        covariance = _accumulate(*args, unshared)
        common = to_end @ (covariance if fill is None else covariance + fill) @ to_end.T
        noise[block, :9], noise[:9, block] = common[6:], common[:, 6:]
        noise[block, block] = common[6:, 6:]
    return noise


def _fill_noise(samples: Samples, middle: Array, force: Array) -> Array:
    """Covariance ``(9, 9)`` of position, velocity and attitude error in inertial axes by the errors of filled samples.

    `middle` (N, 4) are the attitudes at mid-sample, and `force` (N, 3) is the specific force, m/s², inertial axes.
    """
    dt = samples.interval
    rest = np.cumsum(dt[::-1])[::-1] - dt  # time from the sample's end on
    remaining = rest + 0.5 * dt
    gain, path = force * dt[:, None], force * (dt * remaining)[:, None]
    # velocity and path that the force gives from mid-sample to the end
    after = np.cumsum(gain[::-1], axis=0)[::-1] - 0.5 * gain
    later = np.cumsum(path[::-1], axis=0)[::-1] - path + force * (0.5 * dt * rest + 0.125 * dt**2)[:, None]
    covariance = np.zeros((9, 9))
    for i in np.flatnonzero(samples.filled):
        axes = rotations.to_matrix(middle[i]) * dt[i]
        by_force, by_rate = np.zeros((9, 3)), np.zeros((9, 3))
        error = axes * samples.force_fill_sigma[i]
        by_force[:3], by_force[3:6] = remaining[i] * error, error
        error = axes * samples.rate_fill_sigma[i]
        by_rate[:3] = -rotations.cross_matrix(later[i]) @ error
        by_rate[3:6] = -rotations.cross_matrix(after[i]) @ error
        by_rate[6:] = error
        covariance += by_force @ by_force.T + by_rate @ by_rate.T
    return covariance


def net_rotation(samples: Samples) -> Array:
    """Rotation over all `samples` as it is computed on board from the gyros, as a quaternion ``(4,)``."""
    return sample_attitudes(samples.interval, samples.onboard_rate, IDENTITY)[1]


def onboard_rotation(samples: Samples) -> tuple[Array, Array]:
    """Rotation of an on-board attitude that is due to other rates and another mounting than the gyro samples'.

    On board ``ω + ω × m - b`` is integrated where the samples read ω, with a mounting that differs by the small
    rotation m and a rate correction b. This holds only where gyros were read: a rate that is coning-corrected was taken
    from the on-board attitude.

    Returns
    -------
    rate_jacobian, mounting_jacobian : (3, 3) arrays
        Rotation vector (rad) in the body axes of the end, per rate (rad/s) and per mounting (rad): minus the integral
        of C, and the integral of C [ω]ₓ, with C from the axes of each sample to those of the end.
    """
    middle, end = sample_attitudes(samples.interval, samples.rate, IDENTITY)
    weight = np.where(samples.coning_corrected, 0.0, samples.interval)
    to_end = rotations.to_matrix(rotations.multiply(rotations.conjugate(end), middle)) * weight[:, None, None]
    return -to_end.sum(axis=0), np.einsum("nij,njk->ik", to_end, rotations.cross_matrix(samples.rate))


@njit(cache=True, error_model="numpy")
def sample_attitudes(interval, rate, attitude):
    """Attitudes over samples, from the rates alone.

    Parameters
    ----------
    interval : (N,) array
        s.
    rate : (N, 3) array
        rad/s, body axes.
    attitude : (4,) array
        inertial_from_body at the beginning.

    Returns
    -------
    middle : (N, 4) array
        At the middle of each sample.
    end : (4,) array
        At the end of the last one.
    """
    middle = np.empty((interval.size, 4))
    qx, qy, qz, qw = attitude
    for i in range(interval.size):
        half = 0.5 * interval[i]
        turn = quaternion(half * rate[i, 0], half * rate[i, 1], half * rate[i, 2])
        mx, my, mz, mw = product((qx, qy, qz, qw), turn)
        middle[i, 0], middle[i, 1], middle[i, 2], middle[i, 3] = mx, my, mz, mw
        twice = 2.0 * turn[3]  # the same half turn again: q(2t) = 2 cos(t) q(t) - q(0)
        qx, qy, qz, qw = twice * mx - qx, twice * my - qy, twice * mz - qz, twice * mw - qw
    return middle, np.array([qx, qy, qz, qw])


@njit(cache=True, error_model="numpy")
def _accumulate(interval, force, force_noise, rate_noise):
    """Covariance ``(9, 9)`` of position, velocity and attitude error in inertial axes, from the end backwards."""
    cov = np.zeros((9, 9))
    gain = np.zeros(3)  # velocity that the force gives from the current time to the end
    path = np.zeros(3)  # and path: the integral of force times the remaining time
    remaining = 0.0  # time to the end
    turn = np.zeros((9, 3))
    for k in range(3):
        turn[6 + k, k] = 1.0
    for i in range(interval.size - 1, -1, -1):
        dt = interval[i]
        # a sample's noise acts at its middle: half of its own force comes after
        half_remaining = remaining + 0.5 * dt
        half_gain = gain + 0.5 * dt * force[i]
        half_path = path + (0.5 * dt * remaining + 0.125 * dt * dt) * force[i]
        b = (force_noise[i] * dt) ** 2
        for k in range(3):
            cov[k, k] += b * half_remaining * half_remaining
            cov[k, 3 + k] += b * half_remaining
            cov[3 + k, k] += b * half_remaining
            cov[3 + k, 3 + k] += b
        for o, v in ((0, half_path), (3, half_gain)):  # ψ × v = -[v]× ψ
            turn[o, 1], turn[o, 2] = v[2], -v[1]
            turn[o + 1, 0], turn[o + 1, 2] = -v[2], v[0]
            turn[o + 2, 0], turn[o + 2, 1] = v[1], -v[0]
        cov += (rate_noise[i] * dt) ** 2 * (turn @ turn.T)
        path = path + (dt * remaining + 0.5 * dt * dt) * force[i]
        gain = gain + dt * force[i]
        remaining = remaining + dt
    return cov
