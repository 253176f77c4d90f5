"""Increments of an aerodynamic database over the flow, as a flight gives them, with their covariance.

A diagnosis estimates them and writes ``database_update.nc`` (`edl_filter.results.database_update`); a mission can use
that file (`aerodynamics.increments`). Coefficients are in the order CA, CN, Cm, Cm about the nose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, DiscrepancyPrior
from edl_filter.types import Array, IntArray

#: Regimes of the flow, by the number over which the table of each is.
REGIMES = ("mach", "knudsen")
#: Coefficient → its symbol.
SYMBOLS = {"ca": "CA", "cn": "CN", "cm": "Cm"}


@dataclass(frozen=True)
class RegimeUpdate:
    """Increments in one regime: K Mach or Knudsen numbers and A angles; coefficients CA, CN, Cm about the nose.

    Attributes
    ----------
    regime : str
        ``mach`` in continuum flow, ``knudsen`` in rarefied flow.
    nodes : (K,) array
        Mach or Knudsen numbers, increasing.
    alpha : (A,) array
        Total angles of attack, rad.
    increment, sigma, prior_sigma : (3, K, A) arrays
        Posterior mean and standard deviation, and prior standard deviation, in units of the coefficients.
    bins : (K, A) array of int
        Number of time bins of the flight that are nearest to each knot.
    """

    regime: str
    nodes: Array
    alpha: Array
    increment: Array
    sigma: Array
    prior_sigma: Array
    bins: IntArray

    @property
    def share(self) -> Array:
        """Share of the prior variance that the data removed ``(3, K, A)``; 0 where there is none."""
        certain = self.prior_sigma == 0.0
        return np.where(certain, 0.0, 1.0 - (self.sigma / np.where(certain, 1.0, self.prior_sigma)) ** 2)

    @property
    def in_prior_sigmas(self) -> Array:
        """Increments over the database's sigma ``(3, K, A)``; 0 where that is zero."""
        certain = self.prior_sigma == 0.0
        return np.where(certain, 0.0, self.increment / np.where(certain, 1.0, self.prior_sigma))


@dataclass(frozen=True)
class LargestIncrement:
    """The largest increment of a coefficient, in sigmas of the database.

    Attributes
    ----------
    coefficient : str
        ``ca``, ``cn`` or ``cm``.
    sigmas : float
        Over the database's own sigma.
    increment, sigma : float
        With its posterior standard deviation, in units of the coefficient.
    regime : str
        As of `RegimeUpdate`.
    node, alpha : float
        Mach or Knudsen number, and total angle of attack (rad).
    """

    coefficient: str
    sigmas: float
    increment: float
    sigma: float
    regime: str
    node: float
    alpha: float


@dataclass(frozen=True)
class DatabaseUpdate:
    """Increments of a database that a flight gives.

    Attributes
    ----------
    family : str
        Vehicle family of the database's uncertainties.
    prior : DiscrepancyPrior
        Of the discrepancy.
    regimes : tuple of RegimeUpdate
        Those that the flight passes through.
    covariance : (N, N) array
        Of all increments, in the order of regime, coefficient, node, angle; in units of the coefficients.
    """

    family: str
    prior: DiscrepancyPrior
    regimes: tuple[RegimeUpdate, ...]
    covariance: Array

    @property
    def cells(self) -> int:
        """Number of pairs of a node and an angle."""
        return sum(r.bins.size for r in self.regimes)

    def largest(self) -> tuple[LargestIncrement, ...]:
        """The largest increment of each coefficient, in sigmas of the database."""
        out = []
        for c, name in enumerate(FIELD_COEFFICIENTS):
            candidates = []
            for r in self.regimes:
                k, a = np.unravel_index(np.argmax(np.abs(r.in_prior_sigmas[c])), r.bins.shape)
                candidates.append(
                    LargestIncrement(
                        coefficient=name,
                        sigmas=float(r.in_prior_sigmas[c, k, a]),
                        increment=float(r.increment[c, k, a]),
                        sigma=float(r.sigma[c, k, a]),
                        regime=r.regime,
                        node=float(r.nodes[k]),
                        alpha=float(r.alpha[a]),
                    )
                )
            out.append(max(candidates, key=lambda largest: abs(largest.sigmas)))
        return tuple(out)
