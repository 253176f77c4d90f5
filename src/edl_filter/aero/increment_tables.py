"""Increments of a database as tables that are added to its own.

Between the knots of a file the increments are linear in the logarithm of the Mach or Knudsen number and in the angle.
Beyond them the value at the edge decays with the discrepancy's correlation, as the expectation of a Gaussian process
does, and the prior's uncertainty returns (`IncrementTables.remainder`). A regime that the file does not have has none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.grid import GridSlice, GridTable, Kind
from edl_filter.aero.increments import DatabaseUpdate, RegimeUpdate
from edl_filter.estimation.matern import matern32_correlation
from edl_filter.estimation.random_fields import squared_exponential_correlation
from edl_filter.types import Array

#: Steps between two knots along the flow, and steps per correlation length beyond the edges.
_STEPS, _STEPS_BEYOND = 8, 6
#: Correlation lengths beyond the edges at which increments end.
_REACH = 4.0
#: Smallest variance of a Karhunen–Loève mode, in squares of one sigma of the database.
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, eq=False)
class IncrementTables:
    """Increments with their covariance as functions of the flow.

    Attributes
    ----------
    update : DatabaseUpdate
    """

    update: DatabaseUpdate

    @cached_property
    def mean(self) -> tuple[GridTable, ...]:
        """Tables of the mean increments, one for each regime of the file."""
        return tuple(self._table(r, r.increment) for r in self.update.regimes)

    @cached_property
    def modes(self) -> tuple[Array, ...]:
        """Karhunen–Loève modes of the covariance by regime ``(n, 3, K, A)``: amplitudes have unit variance."""
        scale = np.concatenate([r.prior_sigma.ravel() for r in self.update.regimes])
        divisor = np.where(scale > 0.0, scale, 1.0)
        variance, vectors = np.linalg.eigh(self.update.covariance / np.outer(divisor, divisor))
        significant = variance > _NEGLIGIBLE
        modes = (vectors[:, significant] * np.sqrt(variance[significant]) * scale[:, None]).T[::-1]
        out, start = [], 0
        for r in self.update.regimes:
            part = slice(start, start + r.increment.size)
            out.append(np.ascontiguousarray(modes[:, part]).reshape(-1, *r.increment.shape))
            start = part.stop
        return tuple(out)

    def of_amplitudes(self, amplitudes: Array) -> tuple[GridTable, ...]:
        """Tables of the increments by amplitudes of the modes ``(n,)``."""
        pairs = zip(self.update.regimes, self.modes, strict=True)
        return tuple(self._table(r, np.tensordot(amplitudes, modes, 1)) for r, modes in pairs)

    def remainder(self, mach: Array, knudsen: Array, alpha: Array, continuum_limit: float) -> Array:
        """Share of the prior's variance that the increments say nothing of, at points of the flow ``(N,)``.

        Beyond the knots it is one less the square of the correlation with the edge, between them the variance of the
        field less its linear interpolation and that of the modes that are left out; 1 in a regime without increments.
        The measurements resolve thousandths of the database's sigma, so that even one hundredth would not be small.
        """
        prior, out = self.update.prior, np.ones(len(mach))
        for r in self.update.regimes:
            inside = (knudsen > continuum_limit) == (r.regime == "knudsen")
            flow = _coordinate(r.regime, mach if r.regime == "mach" else knudsen)
            knots = _coordinate(r.regime, r.nodes)
            beyond = np.maximum(np.maximum(knots[0] - flow, flow - knots[-1]), 0.0) / _length(prior, r.regime)
            angle = np.maximum(alpha - r.alpha[-1], 0.0) / prior.angle_length
            correlation = matern32_correlation(beyond)[..., 0] * squared_exponential_correlation(angle)
            between = _interpolation_variance(
                (flow - knots[0]) / _length(prior, r.regime), _step(knots, prior, r.regime)
            )
            over_angle = _angle_variance(prior, r.alpha, np.clip(alpha, r.alpha[0], r.alpha[-1]))
            out = np.where(inside, np.minimum(1.0 - correlation**2 + between + over_angle + _NEGLIGIBLE, 1.0), out)
        return out

    def _table(self, regime: RegimeUpdate, values: Array) -> GridTable:
        """Table on a grid that extends beyond the knots, of values ``(3, K, A)`` at the knots."""
        prior, kind = self.update.prior, regime.regime
        knots, length = _coordinate(kind, regime.nodes), _length(prior, kind)
        steps = np.linspace(0.0, _REACH, int(_REACH * _STEPS_BEYOND) + 1)
        between = np.interp(np.arange(_STEPS * (len(knots) - 1) + 1) / _STEPS, np.arange(len(knots)), knots)
        flow = np.concatenate((knots[0] - length * steps[:0:-1], between, knots[-1] + length * steps[1:]))
        alpha = np.concatenate((regime.alpha, regime.alpha[-1] + prior.angle_length * steps[1:]))
        place = np.interp(flow, knots, np.arange(len(knots)))
        lower = np.minimum(place.astype(np.intp), len(knots) - 2)
        fraction = (place - lower)[:, None]
        along = (1.0 - fraction) * values[:, lower] + fraction * values[:, lower + 1]
        beyond = np.maximum(np.maximum(knots[0] - flow, flow - knots[-1]), 0.0) / length
        along = along * matern32_correlation(beyond)[:, 0][:, None]
        angle = squared_exponential_correlation(steps[1:])
        dense = np.concatenate((along, along[:, :, -1:] * angle), axis=2)
        dense[:, [0, -1]], dense[:, :, -1] = 0.0, 0.0
        # the last angle covers all that another table may have
        alpha, dense = np.append(alpha, np.pi), np.pad(dense, ((0, 0), (0, 0), (0, 1)))
        nodes = np.exp(flow) if kind == "mach" else 10.0**flow
        table_kind: Kind = "mach" if kind == "mach" else "knudsen"
        ca, cn, cm = dense
        return GridTable(table_kind, nodes, alpha, ca, cn, cm, source="increments")


def increment_terms(
    tables: tuple[GridTable, ...], mach: Array, knudsen: Array, continuum_limit: float
) -> list[tuple[Array, GridSlice]]:
    """Weights and slices of increments: each table in its regime; no sample is outside.

    Parameters
    ----------
    tables : tuple of GridTable
        Of `IncrementTables`, over Mach and Knudsen number.
    mach, knudsen : (N,) arrays
        Of the samples.
    continuum_limit : float
        Knudsen number above which the flow is rarefied.

    Returns
    -------
    list of ((N,) array, GridSlice)
        For each table: 1 in its regime and 0 outside, and its curves at the samples.
    """
    terms = []
    for table in tables:
        curves = table.at(mach if table.kind == "mach" else knudsen)
        weight = np.where((knudsen > continuum_limit) == (table.kind == "knudsen"), 1.0, 0.0)
        terms.append((weight, replace(curves, outside=np.zeros(len(weight), bool))))
    return terms


def _interpolation_variance(place: Array, step: float) -> Array:
    """Variance of a process of order 3/2 less its linear interpolation between knots; places from the first knot."""
    fraction = np.mod(np.maximum(place, 0.0), step) / step
    at_knot, low, high = (
        matern32_correlation(np.asarray(d))[..., 0] for d in (step, step * fraction, step * (1.0 - fraction))
    )
    return _variance_after_interpolation(fraction, at_knot, low, high)


def _angle_variance(prior: DiscrepancyPrior, knots: Array, angle: Array) -> Array:
    """Variance of the field over the angle less its linear interpolation between knots."""
    lower = np.minimum(np.searchsorted(knots, angle, side="right") - 1, len(knots) - 2)
    step = knots[lower + 1] - knots[lower]
    at_knot, to_low, to_high = (
        squared_exponential_correlation(d / prior.angle_length)
        for d in (step, angle - knots[lower], knots[lower + 1] - angle)
    )
    return _variance_after_interpolation((angle - knots[lower]) / step, at_knot, to_low, to_high)


def _variance_after_interpolation(high: Array, at_knot: Array, to_low: Array, to_high: Array) -> Array:
    """Variance of a process of unit variance less its linear interpolation between two knots.

    `high` is the weight of the upper knot; the others are the correlations between the knots and with each of them.
    """
    low = 1.0 - high
    variance = 1.0 + low**2 + high**2 + 2.0 * low * high * at_knot - 2.0 * (low * to_low + high * to_high)
    return np.asarray(np.maximum(variance, 0.0))


def _step(knots: Array, prior: DiscrepancyPrior, regime: str) -> float:
    """Mean distance of adjoining knots, in correlation lengths."""
    return float((knots[-1] - knots[0]) / (len(knots) - 1) / _length(prior, regime))


def _coordinate(regime: str, number: Array) -> Array:
    return np.log(number) if regime == "mach" else np.log10(number)


def _length(prior: DiscrepancyPrior, regime: str) -> float:
    return prior.log_mach_length if regime == "mach" else prior.log_knudsen_length
