"""Noise of unresolved motion: the course of rate and force inside a sample that the samples around do not show.

To first order the error of a sample's rotation is ``Δθ × m``, with the error m of the first moment of the rate inside
the sample, ``∫ t ω dt / h`` with time from mid-sample; that of its velocity is ``Δθ × m_f + m × Δv`` with the moment
m_f of the force. The samples determine the moments up to motion that is faster than the sampling, whose statistics
follow from mechanics:

- In flight the moment of all forces is finite and changes at unknown instants (gusts, a canopy that opens abruptly). So
  the angular acceleration jumps; jumps of independent size have the covariance of a Wiener process, and the rate is the
  integral of one. The specific force jumps itself: it is a Wiener process.
- At an impact on the ground velocity and rate jump: the rate is a Wiener process, the force white noise.

A process of order q (0: white noise, 1: Wiener process, 2: its integral) of intensity s² has, given the means over
the samples, moments with the covariance ``s² h^(2q+1) C_k`` between two that are k samples apart
(`moment_covariance`, in closed form). Neighbours are negatively correlated, because what is faster than the sampling
has alternating signs in the samples. So the errors of a slow rotation cancel from sample to sample, and those of an
oscillation near the sampling frequency add up. A sample gets the sigma of independent errors whose sum over a stretch
has the variance of the correlated ones: with the root g of C (``g * g = C``), that of ``(Σ_k g_k Δθ_{i+k}) × n``,
where the components of n are independent and have the sigmas ``s h^(q+1/2)`` of their axes. The sigma differs between
the axes of the body: the coning of a pendulum that swings about the transverse axes has its errors about the axis of
symmetry. At an impact, which is one jump inside one sample, nothing is known of the axes that do not jump: there the
moment has any direction, with one sigma for all of its axes.

The intensity is that of the readings themselves, for each axis: the spline of degree 2q + 1 through their integral
minimises the integral of the square of its derivative of order q + 1, whose expectation is s² a sample, since the
spline is the projection of white noise on one dimension a sample (Wahba 1990, chapter 1). It is averaged over nine
samples.

Where force and rate run smoothly the sigma is far below the noise of an instrument. It is cautious for an oscillation
of which few samples cover a period: samples of a pendulum under a parachute with three samples a period are equally
those of faster motions.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from edl_filter.estimation.interpolating_spline import DEGREE, integral_spline
from edl_filter.estimation.series import moving_mean
from edl_filter.navigation.rotation_corrections import gauss_legendre
from edl_filter.telemetry.record import sample_edges
from edl_filter.types import Array

#: Number of samples, odd, by which the response of a spline to one sample has vanished.
_SUPPORT = 41
#: Number of samples on each side by which the root of their moments' covariance has fallen below a thousandth.
_ROOT_REACH = 12
#: Number of samples on each side over which an intensity is averaged: half a second at 8 Hz.
_AVERAGED = 4
#: Root mean square of a component of the vector product of two vectors of unit length, the angle between them unknown.
_ANGLE_UNKNOWN = np.sqrt(2.0 / 3.0)


class UnresolvedMotion(NamedTuple):
    """Noise of the means that is due to motion within a sample which the means do not show.

    Attributes
    ----------
    force_sigma, rate_sigma : (N, 3) arrays
        One sigma, m/s² and rad/s, body axes, of independent errors whose sums have the variance of the true ones.
    sample_rate_sigma : (N,) array
        One sigma per axis of the rate's error in this sample alone, rad/s, for a moment of any direction.
    """

    force_sigma: Array
    rate_sigma: Array
    sample_rate_sigma: Array


@cache
def moment_weights(degree: int) -> Array:
    """Weights ``(41,)`` of the means by which a spline of the integral gives the first moment of the middle one."""
    edges = np.arange(_SUPPORT + 1.0)
    impulse = np.zeros((_SUPPORT, 1))
    impulse[_SUPPORT // 2] = 1.0
    rate = integral_spline(edges, np.ones(_SUPPORT), impulse, degree).derivative()
    x, weights = gauss_legendre(4)
    moment = sum(w * (t - 0.5) * rate(edges[:-1] + t)[:, 0] for t, w in zip(x, weights, strict=True))
    return np.asarray(moment[::-1], np.float64)


@cache
def moment_covariance(order: int, degree: int = DEGREE) -> Array:
    """Covariance of the errors of first moments, for unit intensity and samples of unit length.

    The process is white noise, integrated `order` times, so the covariance of two functionals is the integral of the
    product of their densities, integrated as often; the density is that of the moment minus that of its interpolation.

    Parameters
    ----------
    order : int
        0: white noise, 1: Wiener process, 2: its integral.
    degree : int
        Of the spline that interpolates the integral of the readings.

    Returns
    -------
    (41,) array
        By the distance of the two samples.
    """
    slope = np.zeros(_SUPPORT)
    slope[_SUPPORT // 2] = 1.0
    response = np.vstack((slope, -0.5 * slope - moment_weights(degree)))
    for _ in range(order):
        response = _antiderivative(response)
    x, weights = gauss_legendre(order + 2)
    at_nodes = np.array([np.polyval(response, t) for t in x])
    return np.array([weights @ np.sum(at_nodes[:, k:] * at_nodes[:, : _SUPPORT - k], axis=1) for k in range(_SUPPORT)])


def _antiderivative(pieces: Array) -> Array:
    """Continuous antiderivative of a function that is a polynomial on each interval of unit length.

    Parameters
    ----------
    pieces : (d, N) array
        Coefficients of the powers of the time since each interval's beginning, the highest first.

    Returns
    -------
    (d + 1, N) array
    """
    terms = pieces / np.arange(len(pieces), 0, -1)[:, None]
    integral = np.concatenate(([0.0], np.cumsum(terms.sum(axis=0))[:-1]))
    return np.vstack((terms, integral))


@cache
def covariance_root(order: int) -> Array:
    """Symmetric sequence ``(2 K + 1,)`` whose convolution with itself is `moment_covariance`, by its spectrum."""
    covariance = moment_covariance(order)
    both = np.concatenate((covariance, covariance[:0:-1]))
    root = np.fft.irfft(np.sqrt(np.maximum(np.fft.rfft(both).real, 0.0)), len(both))
    return np.concatenate((root[-_ROOT_REACH:], root[: _ROOT_REACH + 1]))


def intensity_sigma(edges: Array, interval: Array, mean: Array, order: int) -> Array:
    """Root of the intensity of a process, from the means over each sample.

    Parameters
    ----------
    edges : (N + 1,) array
        s.
    interval : (N,) array
        s.
    mean : (N, m) array
        Of any unit.
    order : int
        1: Wiener process, 2: its integral.

    Returns
    -------
    (N, m) array
        In the unit of `mean` times s^(1/2 - order).
    """
    if len(interval) < 2 * order + 2:
        return np.zeros_like(mean)
    highest = integral_spline(edges, interval, mean, 2 * order + 1).derivative(order + 1)
    square = sum(w * highest(edges[:-1] + t * interval) ** 2 for t, w in zip(*gauss_legendre(order + 1), strict=True))
    return np.sqrt(moving_mean(np.asarray(square * interval[:, None], np.float64), _AVERAGED))


def unresolved_motion(
    time: Array, interval: Array, force: Array, rate: Array, impacts_from: float = np.inf
) -> UnresolvedMotion:
    """Noise of the means that is due to motion within a sample which the means do not show.

    Parameters
    ----------
    time, interval : (N,) arrays
        s; end and length of adjoining intervals.
    force, rate : (N, 3) arrays
        Means, m/s² and rad/s, body axes.
    impacts_from : float
        Time from which the vehicle hits the ground, s.

    Returns
    -------
    UnresolvedMotion
    """
    edges, dt = sample_edges(time, interval), interval[:, None]
    angle_increment, velocity_increment = rate * dt, force * dt
    jerk = intensity_sigma(edges, interval, rate, 2) * dt**2.5
    force_jumps = intensity_sigma(edges, interval, force, 1) * dt**1.5
    by_force = _product_sigma(_summed(angle_increment, 1), force_jumps)
    of_velocity, of_angle = (
        _product_sigma(_summed(velocity_increment, 2), jerk),
        _product_sigma(_summed(angle_increment, 2), jerk),
    )
    in_sample = _length(angle_increment) * np.sqrt(moment_covariance(2)[0]) * _mean_sigma(jerk)
    impact = time > impacts_from
    if impact.any():
        jumps = _mean_sigma(intensity_sigma(edges, interval, rate, 1) * dt**1.5)
        # white noise: the difference from the mean of both neighbours has 3/2 of its variance
        impacts = _mean_sigma(np.sqrt(moving_mean(second_difference(velocity_increment) ** 2 / 1.5, _AVERAGED)))
        rows = impact[:, None]
        by_force = np.where(rows, _product_sigma(_summed(angle_increment, 0), _any_direction(impacts)), by_force)
        of_velocity = np.where(rows, _product_sigma(_summed(velocity_increment, 1), _any_direction(jumps)), of_velocity)
        of_angle = np.where(rows, _product_sigma(_summed(angle_increment, 1), _any_direction(jumps)), of_angle)
        in_sample = np.where(impact, _length(angle_increment) * np.sqrt(moment_covariance(1)[0]) * jumps, in_sample)
    return UnresolvedMotion(np.hypot(by_force, of_velocity) / dt, of_angle / dt, _ANGLE_UNKNOWN * in_sample / interval)


def _summed(vectors: Array, order: int) -> Array:
    """``Σ_k g_k x_{i+k}``, ``(N, 3)``, with the root g of the moments' covariance."""
    padded = np.pad(vectors, ((_ROOT_REACH, _ROOT_REACH), (0, 0)))
    return np.stack([np.convolve(column, covariance_root(order), mode="valid") for column in padded.T], axis=1)


def _product_sigma(vectors: Array, sigma: Array) -> Array:
    """One sigma by axis of ``x × m``, ``(N, 3)``, for independent components of m with sigmas ``(N, 3)``."""
    (x, y, z), (a, b, c) = (vectors**2).T, (sigma**2).T
    return np.sqrt(np.stack((y * c + z * b, z * a + x * c, x * b + y * a), axis=1))


def _any_direction(sigma: Array) -> Array:
    """Sigmas ``(N, 3)`` of a vector with the same one for each axis ``(N,)``."""
    return np.repeat(sigma[:, None], 3, axis=1)


def _mean_sigma(sigma: Array) -> Array:
    """Root mean square ``(N,)`` over the axes ``(N, 3)``."""
    return np.asarray(np.sqrt(np.mean(sigma**2, axis=1)), np.float64)


def second_difference(mean: Array) -> Array:
    """Each sample of ``(N, 3)`` minus the mean of its two neighbours; zero at the ends."""
    out = np.zeros_like(mean)
    out[1:-1] = mean[1:-1] - 0.5 * (mean[:-2] + mean[2:])
    return out


def _length(vectors: Array) -> Array:
    """Length of each row."""
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z), np.float64)
