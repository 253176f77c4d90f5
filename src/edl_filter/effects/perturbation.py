"""By how much one flight's air, tables and vehicle were off what the mission states, as the flight itself has told.

The mission states a preflight atmosphere, a database and a vehicle with their uncertainties; where the flight lay
within them is no effect, but it multiplies everything else: one percent of density times half a degree of attitude is
far more than what the moments resolve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.effects.effect import Body, Totals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CoefficientUnits:
    """What one of a coefficient's deviation is, against time: the database's sigma swings with the angle.

    Attributes
    ----------
    time : (N,) array
        s.
    ca, cn, cm : (N,) arrays
        Of the coefficient itself.
    """

    time: Array
    ca: Array
    cn: Array
    cm: Array


@dataclass(frozen=True)
class Deviation:
    """Deviations against time; linear between the times and held at the ends.

    Attributes
    ----------
    time : (M,) array
        s.
    density : (M,) array
        Of its logarithm.
    wind : (M, 2) array
        Towards east and north, m/s.
    ca, cn, cm : (M,) arrays
        Of the coefficients, in `units`.
    units : CoefficientUnits
    mass, inertia : float
        Relative.
    """

    time: Array
    density: Array
    wind: Array
    ca: Array
    cn: Array
    cm: Array
    units: CoefficientUnits
    mass: float = 0.0
    inertia: float = 0.0

    @classmethod
    def none(cls, units: CoefficientUnits) -> Deviation:
        """Nothing is off."""
        still = np.zeros(1)
        return cls(units.time[:1], still, np.zeros((1, 2)), still, still, still, units=units)

    def thinned(self, time: Array, density: Array) -> Array:
        """Density ``(N,)`` with the deviation."""
        return density * np.exp(np.interp(time, self.time, self.density))

    def blown(self, time: Array, wind: Array) -> Array:
        """Winds ``(N, 2)`` with the deviation."""
        return wind + np.column_stack([np.interp(time, self.time, w) for w in self.wind.T])

    def coefficients(self, time: Array, totals: Totals) -> Totals:
        """Coefficients with the deviation."""
        off, u = (self.ca, self.cn, self.cm), self.units
        ca, cn, cm = (
            np.interp(time, self.time, c) * np.interp(time, u.time, unit)
            for c, unit in zip(off, (u.ca, u.cn, u.cm), strict=True)
        )
        return replace(totals, ca=totals.ca + ca, cn=totals.cn + cn, cm_nose=totals.cm_nose + cm)

    def body(self, body: Body) -> Body:
        """Vehicle with the deviation."""
        return replace(body, mass=body.mass * (1.0 + self.mass), inertia=body.inertia * (1.0 + self.inertia))
