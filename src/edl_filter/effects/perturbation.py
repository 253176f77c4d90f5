"""Differences of one flight's air, aerodynamic coefficients and vehicle from what the mission states.

The mission states a preflight atmosphere, a database and a vehicle with their uncertainties. The values that a flight
has within these uncertainties are estimated from its telemetry. They are no effects, but they multiply everything else:
one percent of density times half a degree of attitude is far more than the resolution of the moments.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.effects.types import AeroCoefficients, Body
from edl_filter.types import Array


@dataclass(frozen=True)
class CoefficientUnits:
    """The size of one unit of a coefficient's perturbation, against time: the database's sigma varies with the angle.

    Attributes
    ----------
    time : (N,) array
        s.
    ca, cn, cm : (N,) arrays
        In units of the coefficient itself.
    """

    time: Array
    ca: Array
    cn: Array
    cm: Array


@dataclass(frozen=True)
class Perturbation:
    """Perturbations against time; linear between the times and held at the ends.

    Attributes
    ----------
    time : (M,) array
        s.
    density : (M,) array
        Added to the density's logarithm.
    wind : (M, 2) array
        Added wind towards east and north, m/s.
    ca, cn, cm : (M,) arrays
        Added to the coefficients, in `units`.
    units : CoefficientUnits
    mass, inertia : float
        Relative change.
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
    def zero(cls, units: CoefficientUnits) -> Perturbation:
        """The perturbation that changes nothing."""
        zeros = np.zeros(1)
        return cls(units.time[:1], zeros, np.zeros((1, 2)), zeros, zeros, zeros, units=units)

    def perturb_density(self, time: Array, density: Array) -> Array:
        """Density with the perturbation.

        Parameters
        ----------
        time : (N,) array
            s.
        density : (N,) array
            kg/m³.

        Returns
        -------
        (N,) array
            kg/m³.
        """
        return density * np.exp(np.interp(time, self.time, self.density))

    def perturb_wind(self, time: Array, wind: Array) -> Array:
        """Wind with the perturbation.

        Parameters
        ----------
        time : (N,) array
            s.
        wind : (N, 2) array
            Towards east and north, m/s.

        Returns
        -------
        (N, 2) array
            m/s.
        """
        return wind + np.column_stack([np.interp(time, self.time, w) for w in self.wind.T])

    def perturb_coefficients(self, time: Array, totals: AeroCoefficients) -> AeroCoefficients:
        """Total coefficients with the perturbation.

        Parameters
        ----------
        time : (N,) array
            s.
        totals : AeroCoefficients
            Without the perturbation, ``(N,)`` each.
        """
        changes, u = (self.ca, self.cn, self.cm), self.units
        ca, cn, cm = (
            np.interp(time, self.time, change) * np.interp(time, u.time, unit)
            for change, unit in zip(changes, (u.ca, u.cn, u.cm), strict=True)
        )
        return replace(totals, ca=totals.ca + ca, cn=totals.cn + cn, cm_nose=totals.cm_nose + cm)

    def perturb_body(self, body: Body) -> Body:
        """The rigid body with the perturbation."""
        return replace(body, mass=body.mass * (1.0 + self.mass), inertia=body.inertia * (1.0 + self.inertia))
