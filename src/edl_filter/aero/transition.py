"""Between continuum and free-molecular flow: what is joined there, and how.

A database is a weighted sum of curves over the angle, with weights that depend on the Knudsen number; this
module finds the weights. The three joins:

``continuous``
    The rarefied end is reached from the continuum curve *of the current Mach number*, so nothing jumps. With
    free-molecular panels, ``C = Cc(M) + (Cfm − Cc(M)) bridge(Kn)``. With a rarefied table, which starts on one
    continuum curve of its own, ``C = Cr(Kn) + (Cc(M) − Cr(limit)) (1 − bridge(Kn))``, the same thing where the
    table itself was made with the bridge.
``switch``
    The continuum table up to the limit, the rarefied one above it.
``blend``
    From one to the other over a decade of Knudsen number around the limit, linear in its logarithm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from edl_filter.aero.body import SphereCone, sphere_cone
from edl_filter.aero.bridge import FREE_MOLECULAR_KNUDSEN, bridge
from edl_filter.aero.free_molecular import free_molecular_coefficients
from edl_filter.aero.grid import Array, Bools, GridSlice, GridTable, Slice, Weights, within

Join = Literal["switch", "blend", "continuous"]

#: Angles at which the panels are summed once, rad.
_ANGLES = np.radians(np.arange(0.0, 30.5, 0.5))


@dataclass(frozen=True, eq=False)
class FreeMolecularBridge:
    """The free-molecular end of a body, to be bridged to from any continuum curve.

    Attributes
    ----------
    end : GridTable
        One row: the free-molecular coefficients over the angle.
    """

    end: GridTable

    @classmethod
    def of(cls, body: str | SphereCone) -> FreeMolecularBridge:
        """The end of a body, or of a vehicle known by name, from Schaaf and Chambré's panels."""
        return _named_end(body) if isinstance(body, str) else cls(_end(body))

    def at(self, count: int) -> GridSlice:
        """The one curve, for a number of samples; it is outside nowhere, for the bridge says how much it counts."""
        first = np.zeros(count, np.intp)
        return GridSlice(self.end, first, first, np.zeros(count), np.zeros(count, bool))


@lru_cache(maxsize=16)
def _named_end(name: str) -> FreeMolecularBridge:
    return FreeMolecularBridge(_end(sphere_cone(name)))


def _end(body: SphereCone) -> GridTable:
    ca, cn, cm = (np.atleast_2d(c) for c in free_molecular_coefficients(body, _ANGLES))
    nodes = np.array([FREE_MOLECULAR_KNUDSEN])
    return GridTable("knudsen", nodes, _ANGLES, ca, cn, cm, "pchip", "free-molecular panels")


@dataclass(frozen=True, eq=False)
class Sum:
    """A weighted sum of slices (a `edl_filter.aero.grid.Slice` itself).

    Attributes
    ----------
    terms : sequence of (weight, slice)
        Weights (N,). A term counts as outside only where its weight is not zero.
    """

    terms: Sequence[tuple[Array, Slice]]

    @property
    def outside(self) -> Bools:
        """(N,) samples that use a term outside its table."""
        return np.any([(w != 0.0) & s.outside for w, s in self.terms], axis=0)

    def outside_at(self, alpha: Array) -> Bools:
        """(N,) as `outside`, or the angle lies outside a table that is used."""
        return np.any([(w != 0.0) & (s.outside | ~within(alpha, s.alpha_nodes)) for w, s in self.terms], axis=0)

    @property
    def alpha_nodes(self) -> Array:
        """Every term's angles in the range that all terms cover, rad."""
        low = max(s.alpha_nodes[0] for _, s in self.terms)
        high = min(s.alpha_nodes[-1] for _, s in self.terms)
        nodes = np.unique(np.concatenate([s.alpha_nodes for _, s in self.terms]))
        return nodes[(nodes >= low) & (nodes <= high)]

    def evaluate(self, alpha: Array) -> Array:
        """(3, N) CA, CN, Cm_nose, each curve at its own angle."""
        total = np.zeros((3, len(alpha)))
        for weight, cut in self.terms:
            if np.any(weight):
                total += weight * cut.evaluate(alpha)
        return total

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """(N, G) weighted sum of the coefficients at common angles (G,)."""
        total = np.zeros((len(self.terms[0][0]), len(alpha)))
        for weight, cut in self.terms:
            if np.any(weight):
                total += weight[:, None] * cut.rows(alpha, weights)
        return total

    def take(self, index: NDArray[np.intp]) -> Sum:
        """The sum for some of the samples."""
        return Sum([(w[index], s.take(index)) for w, s in self.terms])


def join_regimes(
    continuum: Slice, rarefied: GridTable | FreeMolecularBridge, knudsen: Array, limit: float, join: Join
) -> Sum:
    """Weighted curves of N samples, by their Knudsen numbers.

    Parameters
    ----------
    continuum : Slice
        At the samples' Mach numbers.
    rarefied : GridTable or FreeMolecularBridge
    knudsen : (N,) array
        On the diameter.
    limit : float
        Knudsen number up to which the flow is a continuum.
    join : "switch", "blend" or "continuous"
    """
    share = _share(knudsen, limit, join)
    if isinstance(rarefied, FreeMolecularBridge):
        if join != "continuous":
            share = share * bridge(knudsen)
        return Sum([(1.0 - share, continuum), (share, rarefied.at(len(knudsen)))])
    if join != "continuous":
        return Sum([(1.0 - share, continuum), (share, rarefied.at(knudsen))])
    thin = np.where(knudsen > limit, 1.0, 0.0)
    at_limit = rarefied.at(np.full(len(knudsen), limit))
    return Sum([(1.0 - share, continuum), (thin, rarefied.at(knudsen)), (-thin * (1.0 - share), at_limit)])


def _share(knudsen: Array, limit: float, join: Join) -> Array:
    """Share of the rarefied side, 0 to 1."""
    if join == "switch":
        return np.where(knudsen > limit, 1.0, 0.0)
    if join == "blend":
        return np.clip(0.5 + np.log10(np.clip(knudsen / limit, 1e-3, 1e3)), 0.0, 1.0)
    # The bridge begins at 1e-3; with a higher limit what it has passed by then is taken off, so nothing jumps
    start = float(bridge(limit))
    return np.clip((bridge(knudsen) - start) / (1.0 - start), 0.0, 1.0)
