"""Noise of unresolved motion: the course of rate and force inside a sample that the samples around do not show.

To first order the error of a sample's rotation is ``Δθ × m``, with the error m of the first moment of the rate inside
the sample, ``∫ t ω dt / h`` with time from mid-sample; that of its velocity is ``Δθ × m_f + m × Δv`` with the moment m_f
of the force. The samples determine the moments up to motion that is faster than the sampling, whose statistics follow
from mechanics:

- In flight the moment of all forces is finite and changes at unknown instants (gusts, a canopy that snatches). So the
  angular acceleration jumps; jumps of independent size have the covariance of a Wiener process, and the rate is the
  integral of one. The specific force jumps itself: it is a Wiener process.
- At an impact on the ground velocity and rate jump: the rate is a Wiener process, the force white noise.

A process of order q (1: Wiener, 2: its integral) of intensity s² has, given the means over the samples, a moment with
sigma ``c s h^(q - 1/2)``; `moment_sigma` has the closed form of c. The intensity is that of the readings themselves: the
spline of degree 2 q + 1 through the integral of the readings minimises ``∫ (d^(q+1)/dt^(q+1))² dt``, whose expectation is
s² for each sample, since the spline is the projection of white noise on one dimension a sample (Wahba 1990, chapter 1).

Where force and rate run smoothly the sigma is far below the noise of an instrument. It is cautious for an oscillation of
which few samples cover a period: samples of a pendulum under a parachute with three samples a period are equally those
of faster motions, but the true error, that of the interpolation in `rotation_corrections`, is a few times smaller.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.interpolate import PPoly

from edl_filter.navigation.rotation_corrections import DEGREE, integral_spline, nodes, sample_edges
from edl_filter.types import Array

#: Number of samples, odd, by which the response of a spline to one sample has vanished.
_SUPPORT = 41


@cache
def moment_weights(degree: int) -> Array:
    """Weights ``(41,)`` of the means around, by which a spline of the integral gives the first moment of the middle one."""
    edges = np.arange(_SUPPORT + 1.0)
    impulse = np.zeros((_SUPPORT, 1))
    impulse[_SUPPORT // 2] = 1.0
    rate = integral_spline(edges, np.ones(_SUPPORT), impulse, degree).derivative()
    x, weights = nodes(4)
    moment = sum(w * (t - 0.5) * rate(edges[:-1] + t)[:, 0] for t, w in zip(x, weights, strict=True))
    return np.asarray(moment[::-1], np.float64)


@cache
def moment_sigma(order: int, degree: int = DEGREE) -> float:
    """Sigma of a first moment's error for unit intensity and samples of unit length.

    The process is white noise, integrated `order` times, so the variance of a functional is the integral of the
    square of its density, integrated as often; the density is that of the moment minus that of its interpolation.

    Parameters
    ----------
    order : int
        0: white noise, 1: Wiener process, 2: its integral.
    degree : int
        Of the spline that interpolates the integral of the readings.
    """
    by_readings = moment_weights(degree)
    slope = np.zeros(_SUPPORT)
    slope[_SUPPORT // 2] = 1.0
    density = PPoly(np.vstack((slope, -0.5 * slope - by_readings)), np.arange(_SUPPORT + 1.0))
    response = density.antiderivative(order) if order else density
    x, weights = nodes(order + 2)
    start = np.arange(float(_SUPPORT))
    return float(np.sqrt(sum(w * np.sum(response(start + t) ** 2) for t, w in zip(x, weights, strict=True))))


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
    (N,) array
        Root mean square over the components, in the unit of `mean` times s^(1/2 - order).
    """
    if len(interval) < 2 * order + 2:
        return np.zeros(len(interval))
    highest = integral_spline(edges, interval, mean, 2 * order + 1).derivative(order + 1)
    square = sum(
        w * np.mean(highest(edges[:-1] + t * interval) ** 2, axis=1) for t, w in zip(*nodes(order + 1), strict=True)
    )
    return np.asarray(np.sqrt(square * interval), np.float64)


def unresolved_motion(
    time: Array, interval: Array, force: Array, rate: Array, impacts_from: float = np.inf
) -> tuple[Array, Array]:
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
    force_sigma, rate_sigma : (N,) arrays
        One sigma per axis, m/s² and rad/s. The angle between rate and moment is unknown: 2/3 of the product of the
        squares of two vectors is the mean square of a component of their vector product.
    """
    edges = sample_edges(time, interval)
    impact = time > impacts_from
    moment = moment_sigma(2) * intensity_sigma(edges, interval, rate, 2) * interval**1.5
    force_moment = moment_sigma(1) * intensity_sigma(edges, interval, force, 1) * interval**0.5
    if impact.any():
        jumps = moment_sigma(1) * intensity_sigma(edges, interval, rate, 1) * interval**0.5
        moment = np.where(impact, jumps, moment)
        # white noise: the difference from the mean of both neighbours has 3/2 of its variance
        irregular = np.sqrt(np.mean(second_difference(force) ** 2, axis=1) / 1.5)
        force_moment = np.where(impact, moment_sigma(0) * irregular, force_moment)
    turn, gain = _length(rate) * interval, _length(force) * interval
    factor = np.sqrt(2.0 / 3.0)
    return factor * np.hypot(turn * force_moment, moment * gain), factor * turn * moment


def second_difference(mean: Array) -> Array:
    """Each sample of ``(N, 3)`` minus the mean of its two neighbours; zero at the ends."""
    out = np.zeros_like(mean)
    out[1:-1] = mean[1:-1] - 0.5 * (mean[:-2] + mean[2:])
    return out


def _length(vectors: Array) -> Array:
    """Length of each row."""
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z), np.float64)
