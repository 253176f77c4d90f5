"""Coning and sculling: what means over a sample lack where the body turns and the force changes inside it.

The rotation over a sample is ``Δθ + ½ ∫ α × ω dt``, and the velocity gained, in axes turned by half of it, is
``Δv + ½ ∫ (α × f + v × ω) dt + Δθ × (Δθ × Δv) / 24``, with the angle α and the velocity v since the beginning of the
sample (Savage, J. Guidance 21 (1998) 19 and 208). The integrals need the course of rate and force inside the sample. In
post-flight form the samples on both sides are known: the sums of the readings are exact integrals of rate and force up
to the samples' edges, and quintic splines through them give the course in between. The integrands are polynomials, so
that five nodes of Gauss and Legendre integrate them exactly.

Error: of classical coning with ν radians per sample, whose exact coefficient is ``(ν - sin ν) / (4 (1 - cos ν))``, the
spline misses a part of 1.5e-5 at ν = 0.43 (an oscillation of 0.55 Hz at 8 Hz) and of 4 % at ν = 2 (a swinging under a
parachute of which three samples cover a period). Linear interpolation by the difference of the two neighbours misses
3 % and 61 %. Terms of third order in the angle of one sample are neglected, a part ``Δθ²`` of the coning.
What remains is in the noise of `unresolved.unresolved_motion`.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from edl_filter import rotations
from edl_filter.estimation.interpolating_spline import InterpolatingSpline
from edl_filter.types import Array

#: Degree of the splines through the integrals.
DEGREE = 5


def integral_spline(edges: Array, interval: Array, mean: Array, degree: int = DEGREE) -> InterpolatingSpline:
    """Spline through the integral of a quantity at the edges of the samples.

    Parameters
    ----------
    edges : (N + 1,) array
        s.
    interval : (N,) array
        s.
    mean : (N, m) array
        Means over the intervals, of any unit.
    degree : int
        Odd. With fewer edges than the degree needs, the largest odd degree that they allow.

    Returns
    -------
    InterpolatingSpline
        Of the integral ``(m,)``, in the unit of `mean` times s; zero at the first edge. Its derivative has the means
        that were measured.
    """
    integral = np.zeros((len(edges), mean.shape[1]))
    np.cumsum(mean * interval[:, None], axis=0, out=integral[1:])
    largest = len(interval) if len(interval) % 2 else len(interval) - 1
    return InterpolatingSpline.through(edges, integral, min(degree, largest))


def sample_edges(time: Array, interval: Array) -> Array:
    """Edges ``(N + 1,)`` of adjoining samples, s."""
    return np.concatenate((time[:1] - interval[:1], time))


@cache
def nodes(count: int) -> tuple[Array, Array]:
    """Nodes and weights of Gauss and Legendre on 0 to 1, ``(count,)`` each."""
    x, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * weights


def rotation_corrections(time: Array, interval: Array, force: Array, rate: Array) -> tuple[Array, Array]:
    """Corrections of the means for the rotation within the sample.

    Parameters
    ----------
    time, interval : (N,) arrays
        s; end and length of adjoining intervals.
    force, rate : (N, 3) arrays
        Means, m/s² and rad/s, body axes.

    Returns
    -------
    to_force, to_rate : (N, 3) arrays
        To be added: sculling and rotation, m/s²; coning, rad/s.
    """
    edges = sample_edges(time, interval)
    both = integral_spline(edges, interval, np.hstack((rate, force)))
    slope = both.derivative()
    start = both(edges[:-1])
    to_force = rotations.cross(rate, rotations.cross(rate, force)) * (interval**2 / 24.0)[:, None]
    to_rate = np.zeros_like(rate)
    for x, weight in zip(*nodes(5), strict=True):
        t = edges[:-1] + x * interval
        gained, current = both(t) - start, slope(t)
        angle, velocity, w, f = gained[:, :3], gained[:, 3:], current[:, :3], current[:, 3:]
        to_rate += 0.5 * weight * rotations.cross(angle, w)
        to_force += 0.5 * weight * (rotations.cross(angle, f) + rotations.cross(velocity, w))
    return to_force, to_rate
