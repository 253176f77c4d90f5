"""Process noise of intervals, from the noise of the IMU's samples; attitudes over samples.

A flight that is linearised from bin to bin has thousands of short intervals, in which the arrangement of one interval
costs a hundred times its arithmetic. Therefore one compiled call computes all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from edl_filter.navigation.compiled_noise import COMPILED, in_body_axes, noise_of_samples
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout
from edl_filter.rotation_kernels import product, quaternion
from edl_filter.types import Array, IntArray

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
    begin, end = np.array([0]), np.array([len(samples.time)])
    return process_noise_of_intervals(layout, samples, attitude[None], begin, end)[0]


def process_noise_of_intervals(
    layout: Layout, samples: Samples, attitudes: Array, begins: IntArray, ends: IntArray
) -> Array:
    """`process_noise` of K intervals.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    samples : Samples
        Of the driving instrument, all intervals.
    attitudes : (K, 4) array
        inertial_from_body at the intervals' beginnings.
    begins, ends : (K,) arrays of int
        First sample of each interval, and the one after its last.

    Returns
    -------
    (K, n, n) array
        Covariances, in the units of `layout.UNITS`.
    """
    covariance, common = _covariances(
        begins, ends, attitudes, samples.interval, samples.rate, samples.force, *increment_variances(samples)
    )
    noise = np.zeros((len(begins), layout.size, layout.size))
    noise[:, :9, :9] = covariance
    if ONBOARD in layout:
        block = layout[ONBOARD]
        noise[:, block, :9], noise[:, :9, block] = common[:, 6:], common[:, :, 6:]
        noise[:, block, block] = common[:, 6:, 6:]
    return noise


class IncrementVariances(NamedTuple):
    """Variances of the increments of samples, with those of filled values.

    Attributes
    ----------
    velocity, rotation : (N, 3) arrays
        (m/s)² and rad², body axes.
    unshared : (N, 3) array
        Part of `rotation` by errors of the filter's copy of the readings, which the flight computer does not have: an
        error of the true attitude and of the propagated on-board attitude alike.
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


@COMPILED
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


@COMPILED
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


@COMPILED
def _covariances(
    begins, ends, attitudes, interval, rate, force, velocity_variance, rotation_variance, unshared_variance
):
    """Covariances ``(K, 9, 9)`` by all noise, and by that of the filter's copy of the readings (`unshared`)."""
    covariance = np.empty((begins.size, 9, 9))
    common = np.empty((begins.size, 9, 9))
    for k in range(begins.size):
        a, b = begins[k], ends[k]
        middle, end = sample_attitudes(interval[a:b], rate[a:b], attitudes[k])
        every, unshared = noise_of_samples(
            interval[a:b], middle, force[a:b], velocity_variance[a:b], rotation_variance[a:b], unshared_variance[a:b]
        )
        covariance[k] = in_body_axes(every, end)
        common[k] = in_body_axes(unshared, end)
    return covariance, common
