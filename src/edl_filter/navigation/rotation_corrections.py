"""Coning and sculling: what means over a sample lack where the body turns and the force changes inside it.

The rotation over a sample is ``Δθ + ½ ∫ α × ω dt``, and the velocity gained, in axes turned by half of it, is
``Δv + ½ ∫ (α × f + v × ω) dt + Δθ × (Δθ × Δv) / 24``, with the angle α and the velocity v since the beginning of the
sample (Savage, J. Guidance 21 (1998) 19 and 208). The integrals need the course of rate and force inside the sample. In
post-flight form the samples on both sides are known: the sums of the readings are exact integrals of rate and force up
to the samples' edges, and quintic splines through them give the course in between. With α and v as polynomials of the
time in the sample, ``Σ a_j t^j`` and ``Σ v_k t^k``, the integrals over its length h have the closed form
``∫ α × ω dt = Σ_j<k a_j × a_k (k - j) / (j + k) h^(j+k)`` and
``∫ (α × f + v × ω) dt = Σ_jk a_j × v_k (k - j) / (j + k) h^(j+k)``.

Error: of classical coning with ν radians per sample, whose exact coefficient is ``(ν - sin ν) / (4 (1 - cos ν))``, the
spline misses a part of 1.5e-5 at ν = 0.43 (an oscillation of 0.55 Hz at 8 Hz) and of 4 % at ν = 2 (a swinging under a
parachute of which three samples cover a period). Linear interpolation by the difference of the two neighbours misses
3 % and 61 %. Terms of third order in the angle of one sample are neglected, a part ``Δθ²`` of the coning.
What remains is in the noise of `unresolved.unresolved_motion`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit

from edl_filter import rotations
from edl_filter.estimation.interpolating_spline import integral_spline
from edl_filter.telemetry.record import sample_edges
from edl_filter.types import Array


@cache
def gauss_legendre(count: int) -> tuple[Array, Array]:
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
    powers = integral_spline(edges, interval, np.hstack((rate, force))).powers(edges[:-1])
    coning, sculling = _integrals(powers, interval)
    to_force = rotations.cross(rate, rotations.cross(rate, force)) * (interval**2 / 24.0)[:, None]
    return to_force + 0.5 * sculling / interval[:, None], 0.5 * coning / interval[:, None]


@njit(cache=True, error_model="numpy")
def _integrals(powers, interval):
    """``∫ α × ω dt`` and ``∫ (α × f + v × ω) dt`` over each interval, from the powers ``(d + 1, N, 6)`` of α and v."""
    coning, sculling = np.zeros((len(interval), 3)), np.zeros((len(interval), 3))
    power_of_interval = np.ones(2 * len(powers))
    for i in range(len(interval)):
        for k in range(1, len(power_of_interval)):
            power_of_interval[k] = power_of_interval[k - 1] * interval[i]
        for j in range(1, len(powers)):
            for k in range(1, len(powers)):
                if k == j:
                    continue
                weight = (k - j) / (j + k) * power_of_interval[j + k]
                a, b = powers[j, i], powers[k, i]
                for axis in range(3):
                    y, z = (axis + 1) % 3, (axis + 2) % 3
                    sculling[i, axis] += weight * (a[y] * b[3 + z] - a[z] * b[3 + y])
                    if j < k:
                        coning[i, axis] += weight * (a[y] * b[z] - a[z] * b[y])
    return coning, sculling
