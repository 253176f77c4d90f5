"""Process noise of an interval, from the noise of the IMU's samples.

The attitude error is expressed in inertial axes in this module, where it is constant. A sample's rate noise turns all
specific force that follows in the interval, so it adds to position and velocity ``ψ × (path and velocity
that the specific force gives from there to the end)``; a sample's force noise adds to velocity at once and to
position over the remaining time. Gravity's gradient over one interval (1e-6 s⁻² over seconds) is neglected.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from edl_filter import rotations
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout
from edl_filter.rotation_kernels import fill_matrix, product, quaternion
from edl_filter.types import Array

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def process_noise(layout: Layout, samples: Samples, attitude: Array) -> Array:
    """Process noise over `samples` in the filter's vector.

    The attitude that was computed on board is the sum of the same readings, including their noise, so the
    gyros' noise is not noise of it. What the filter does not know of the readings themselves (those in a gap, or the
    difference between two integrations of them) is noise of it and of the true attitude alike.

    A filled stretch of samples has further errors along each body axis, which are correlated in time. They enter as
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
    variances = increment_variances(samples)
    noise = np.zeros((layout.size, layout.size))
    args = samples.interval, middle, samples.force, variances.velocity
    noise[:9, :9] = to_end @ _accumulate(*args, variances.rotation) @ to_end.T
    if ONBOARD in layout:
        block = layout[ONBOARD]
        common = to_end @ _accumulate(*args, variances.unshared) @ to_end.T
        noise[block, :9], noise[:9, block] = common[6:], common[:, 6:]
        noise[block, block] = common[6:, 6:]
    return noise


class IncrementVariances(NamedTuple):
    """Variances of the increments of samples, with those of filled values.

    Attributes
    ----------
    velocity, rotation : (N, 3) arrays
        (m/s)² and rad², body axes.
    unshared : (N, 3) array
        Part of `rotation` that an attitude computed on board has too: the readings that only the filter lacks.
    """

    velocity: Array
    rotation: Array
    unshared: Array


def increment_variances(samples: Samples) -> IncrementVariances:
    """Variances of the increments of `samples`."""
    s = samples
    return IncrementVariances(
        *variances_of_increments(
            s.interval, s.force_noise, s.force_fill_sigma, s.rate_noise, s.rate_fill_sigma, s.shared_rate_noise
        )
    )


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
def variances_of_increments(interval, force_noise, force_fill_sigma, rate_noise, rate_fill_sigma, shared_rate_noise):
    """`increment_variances` of the arrays of samples, compiled.

    Parameters
    ----------
    interval : (N,) array
        s.
    force_noise, force_fill_sigma : (N, 3) arrays
        As of `Samples`, m/s².
    rate_noise, rate_fill_sigma, shared_rate_noise : (N, 3) arrays
        As of `Samples`, rad/s.

    Returns
    -------
    velocity, rotation, unshared : (N, 3) arrays
        As of `IncrementVariances`.
    """
    velocity, rotation, unshared = np.empty_like(rate_noise), np.empty_like(rate_noise), np.empty_like(rate_noise)
    for i in range(interval.size):
        square = interval[i] ** 2
        for j in range(3):
            rate = rate_noise[i, j] ** 2 + rate_fill_sigma[i, j] ** 2
            velocity[i, j] = square * (force_noise[i, j] ** 2 + force_fill_sigma[i, j] ** 2)
            rotation[i, j] = square * rate
            unshared[i, j] = square * max(rate - shared_rate_noise[i, j] ** 2, 0.0)
    return velocity, rotation, unshared


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
def _accumulate(interval, middle, force, velocity_variance, rotation_variance):
    """Covariance ``(9, 9)`` of position, velocity and attitude error in inertial axes, from the end backwards."""
    cov = np.zeros((9, 9))
    gain = np.zeros(3)  # velocity that the force gives from the current time to the end
    path = np.zeros(3)  # and path: the integral of force times the remaining time
    remaining = 0.0  # time to the end
    axes = np.empty((3, 3))
    by_force, by_rate = np.zeros((9, 3)), np.zeros((9, 3))
    for i in range(interval.size - 1, -1, -1):
        dt = interval[i]
        fill_matrix(middle[i], axes)
        inertial = axes @ force[i]
        # a sample's noise acts at its middle: half of its own force comes after
        half_remaining = remaining + 0.5 * dt
        half_gain = gain + 0.5 * dt * inertial
        half_path = path + (0.5 * dt * remaining + 0.125 * dt * dt) * inertial
        for axis in range(3):
            error = axes[:, axis] * np.sqrt(velocity_variance[i, axis])
            by_force[:3, axis] = half_remaining * error
            by_force[3:6, axis] = error
            error = axes[:, axis] * np.sqrt(rotation_variance[i, axis])
            by_rate[:3, axis] = np.cross(error, half_path)
            by_rate[3:6, axis] = np.cross(error, half_gain)
            by_rate[6:, axis] = error
        cov += by_force @ by_force.T + by_rate @ by_rate.T
        path = path + (dt * remaining + 0.5 * dt * dt) * inertial
        gain = gain + dt * inertial
        remaining = remaining + dt
    return cov
