"""The covariance of increments that a mission takes from another flight, as constant nuisance parameters.

The mean is added to the tables. What remains uncertain is a Gaussian field with the covariance of the file: its
Karhunen–Loève modes have constant amplitudes of unit variance a priori, which are marginalised as all that a mission
states (`stated_parameters`). Where the file says nothing, the stationary field of `aero.discrepancy` remains.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.aero.increment_tables import IncrementTables, increment_terms
from edl_filter.aero.transition import WeightedSum
from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.effects.types import AeroCoefficients, FlightCondition


class LearnedIncrements(Effect):
    """Increments of the coefficients by amplitudes of the modes of their covariance."""

    name = "database_increments"

    def __init__(self, tables: IncrementTables, continuum_limit: float) -> None:
        self._tables, self._continuum_limit = tables, continuum_limit
        count = len(tables.modes[0])
        # each file has modes of its own
        self.__dict__["parameters"] = tuple(Parameter(f"q{i}", "", f"amplitude of mode {i}", 1.0) for i in range(count))

    @property
    def sigma(self) -> dict[str, float]:
        """Prior standard deviation of each amplitude."""
        return {q.name: 1.0 for q in self.parameters}

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Coefficients with the increments."""
        amplitudes = np.array([p.get(q.name, 0.0) for q in self.parameters])
        if not np.any(amplitudes):
            return totals
        tables = self._tables.of_amplitudes(amplitudes)
        terms = increment_terms(tables, flow.mach, flow.knudsen, self._continuum_limit)
        ca, cn, cm = WeightedSum(terms).evaluate(flow.alpha_total)
        return replace(totals, ca=totals.ca + ca, cn=totals.cn + cn, cm_nose=totals.cm_nose + cm)
