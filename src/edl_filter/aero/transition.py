"""Transition between continuum and free-molecular flow.

Input: continuum coefficients at the Mach numbers of the samples, rarefied coefficients, Knudsen numbers. Method: the
database is a weighted sum of curves over the angle; the weights depend on the Knudsen number, by one of three joins:

``continuous``
    The transition starts at the continuum curve *of the current Mach number*, so that the coefficients are continuous.
    With free-molecular panels, ``C = Cc(M) + (Cfm − Cc(M)) bridge(Kn)``. With a rarefied table, which starts at a
    continuum curve of its own, ``C = Cr(Kn) + (Cc(M) − Cr(limit)) (1 − bridge(Kn))``; this is the same formula if the
    table was computed with the bridge.
``switch``
    The continuum table up to the limit, the rarefied table above it.
``blend``
    A transition over one decade of Knudsen number around the limit, linear in its logarithm.

Output: a `WeightedSum`, which is a slice (`edl_filter.aero.grid.Slice`).

Source of the bridging function: R. G. Wilmoth, R. A. Mitcheltree and J. N. Moss, "Low-Density Aerodynamics of the
Stardust Sample Return Capsule", AIAA 97-2510, 1997.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.body import SphereCone, sphere_cone
from edl_filter.aero.free_molecular import free_molecular_coefficients
from edl_filter.aero.grid import GridSlice, GridTable, Slice, Weights, within
from edl_filter.aero.regimes import CONTINUUM_KNUDSEN, FREE_MOLECULAR_KNUDSEN
from edl_filter.types import Array, BoolArray

Join = Literal["switch", "blend", "continuous"]

#: Angles at which the panels are summed, rad.
_ANGLES = np.radians(np.arange(0.0, 30.5, 0.5))


def bridge(knudsen: ArrayLike) -> Array:
    """Weight of the free-molecular coefficient, sin²[π(3/8 + log₁₀(Kn)/8)].

    A coefficient between the regimes is ``continuum + (free_molecular − continuum) · bridge(knudsen)``. The weight and
    its slope are continuous at both ends.

    Parameters
    ----------
    knudsen : (...) array
        Knudsen number based on the diameter.

    Returns
    -------
    (...) array
        0 below Kn = 1e-3, 1 above 10, the formula in between; NaN where the Knudsen number is NaN.
    """
    inside = np.clip(np.asarray(knudsen, dtype=float), CONTINUUM_KNUDSEN, FREE_MOLECULAR_KNUDSEN)
    return np.sin(np.pi * (3.0 + np.log10(inside)) / 8.0) ** 2


@dataclass(frozen=True, eq=False)
class FreeMolecularBridge:
    """Free-molecular coefficients of a body, the upper end of the bridge from any continuum curve.

    Attributes
    ----------
    end : GridTable
        Table with one row: the coefficients over the angle.
    """

    end: GridTable

    @classmethod
    def of(cls, body: str | SphereCone) -> FreeMolecularBridge:
        """Compute the coefficients of a body, or of a vehicle by name, with Schaaf and Chambré's panels."""
        return _bridge_of_vehicle(body) if isinstance(body, str) else cls(_free_molecular_table(body))

    def at(self, count: int) -> GridSlice:
        """Slice of `count` samples; no sample is outside, since the bridge gives the weight of the curve."""
        first = np.zeros(count, np.intp)
        return GridSlice(self.end, first, first, np.zeros(count), np.zeros(count, bool))


@lru_cache(maxsize=16)
def _bridge_of_vehicle(name: str) -> FreeMolecularBridge:
    return FreeMolecularBridge(_free_molecular_table(sphere_cone(name)))


def _free_molecular_table(body: SphereCone) -> GridTable:
    ca, cn, cm = (np.atleast_2d(c) for c in free_molecular_coefficients(body, _ANGLES))
    nodes = np.array([FREE_MOLECULAR_KNUDSEN])
    return GridTable("knudsen", nodes, _ANGLES, ca, cn, cm, "pchip", "free-molecular panels")


@dataclass(frozen=True, eq=False)
class WeightedSum:
    """Weighted sum of slices, which is a slice too (`edl_filter.aero.grid.Slice`).

    Attributes
    ----------
    terms : sequence of (weight, slice)
        The weights are (N,) arrays. Samples with zero weight are not outside of a term's table.
    """

    terms: Sequence[tuple[Array, Slice]]

    @property
    def outside(self) -> BoolArray:
        """True (N,) for samples that use a term outside its table."""
        return np.any([(w != 0.0) & s.outside for w, s in self.terms], axis=0)

    def outside_at(self, alpha: Array) -> BoolArray:
        """As `outside` (N,), and true where the angle (N,), rad, is outside a table that is used."""
        return np.any([(w != 0.0) & (s.outside | ~within(alpha, s.alpha_nodes)) for w, s in self.terms], axis=0)

    @property
    def alpha_nodes(self) -> Array:
        """Angles of all terms (A,), rad, within the range that all terms cover."""
        low = max(s.alpha_nodes[0] for _, s in self.terms)
        high = min(s.alpha_nodes[-1] for _, s in self.terms)
        nodes = np.unique(np.concatenate([s.alpha_nodes for _, s in self.terms]))
        return nodes[(nodes >= low) & (nodes <= high)]

    def evaluate(self, alpha: Array) -> Array:
        """CA, CN, Cm_nose (3, N), each curve at its own angle (N,), rad."""
        total = np.zeros((3, len(alpha)))
        for weight, curves in self.terms:
            if np.any(weight):
                total += weight * curves.evaluate(alpha)
        return total

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """Weighted sum of the coefficients (N, G) at common angles (G,), rad."""
        total = np.zeros((len(self.terms[0][0]), len(alpha)))
        for weight, curves in self.terms:
            if np.any(weight):
                total += weight[:, None] * curves.rows(alpha, weights)
        return total

    def take(self, index: NDArray[np.intp]) -> WeightedSum:
        """Sum of the samples at the indices (S,)."""
        return WeightedSum([(w[index], s.take(index)) for w, s in self.terms])


def join_regimes(
    continuum: Slice, rarefied: GridTable | FreeMolecularBridge, knudsen: Array, limit: float, join: Join
) -> WeightedSum:
    """Join the continuum and the rarefied coefficients of N samples, by their Knudsen numbers.

    Parameters
    ----------
    continuum : Slice
        At the Mach numbers of the samples.
    rarefied : GridTable or FreeMolecularBridge
        Table over the Knudsen number, or free-molecular coefficients.
    knudsen : (N,) array
        Based on the diameter.
    limit : float
        Knudsen number up to which the flow is a continuum.
    join : "switch", "blend" or "continuous"
        Kind of the transition, see the module.

    Returns
    -------
    WeightedSum
        Slice of the N samples.
    """
    weight = _rarefied_weight(knudsen, limit, join)
    if isinstance(rarefied, FreeMolecularBridge):
        if join != "continuous":
            weight = weight * bridge(knudsen)
        return WeightedSum([(1.0 - weight, continuum), (weight, rarefied.at(len(knudsen)))])
    if join != "continuous":
        return WeightedSum([(1.0 - weight, continuum), (weight, rarefied.at(knudsen))])
    above_limit = np.where(knudsen > limit, 1.0, 0.0)
    at_limit = rarefied.at(np.full(len(knudsen), limit))
    return WeightedSum(
        [(1.0 - weight, continuum), (above_limit, rarefied.at(knudsen)), (-above_limit * (1.0 - weight), at_limit)]
    )


def _rarefied_weight(knudsen: Array, limit: float, join: Join) -> Array:
    """Weight (N,) of the rarefied coefficients, 0 to 1."""
    if join == "switch":
        return np.where(knudsen > limit, 1.0, 0.0)
    if join == "blend":
        return np.clip(0.5 + np.log10(np.clip(knudsen / limit, 1e-3, 1e3)), 0.0, 1.0)
    # The bridge starts at Kn = 1e-3; for a higher limit it is rescaled to start there, so that the weight is continuous
    start = float(bridge(limit))
    return np.clip((bridge(knudsen) - start) / (1.0 - start), 0.0, 1.0)
