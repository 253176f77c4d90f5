"""Differences of one flight's air, aerodynamic coefficients and vehicle from what the mission states.

The mission states a preflight atmosphere, a database and a vehicle with their uncertainties. The values that a flight
has within these uncertainties are estimated from its telemetry. They are no effects, but they multiply everything else:
one percent of density times half a degree of attitude is far more than the resolution of the moments.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.aero.discrepancy import ASYMMETRIES, FIELD_COEFFICIENTS, AngleModes
from edl_filter.effects.types import AeroCoefficients, Body, FlightCondition
from edl_filter.estimation.series import interpolate_columns
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

    def at(self, coefficient: str, time: Array) -> Array:
        """The unit of a coefficient (``ca``, ``cn``, ``cm``) at times ``(N,)``, s."""
        return np.asarray(np.interp(time, self.time, getattr(self, coefficient)), float)


@dataclass(frozen=True)
class FieldPerturbation:
    """A realisation of the database's discrepancy along a trajectory (`aero.discrepancy`).

    Attributes
    ----------
    time : (M,) array
        s.
    amplitudes : dict
        Coefficient or asymmetry → amplitudes of its modes ``(M, J)``, against time: the Mach number along the
        trajectory is a function of time.
    modes : dict
        Coefficient or asymmetry → `AngleModes`.
    units : CoefficientUnits
        One sigma of the database.
    asymmetry : CoefficientUnits or None
        One sigma of the coefficients that are fixed to the body; None where there are none.
    continuum_limit : float
        Knudsen number above which the rarefied table applies.
    """

    time: Array
    amplitudes: dict[str, Array]
    modes: dict[str, AngleModes]
    units: CoefficientUnits
    asymmetry: CoefficientUnits | None
    continuum_limit: float

    @classmethod
    def zero(
        cls,
        modes: dict[str, AngleModes],
        units: CoefficientUnits,
        asymmetry: CoefficientUnits | None,
        continuum_limit: float,
    ) -> FieldPerturbation:
        """No increments."""
        if asymmetry is not None:
            modes = modes | dict.fromkeys(ASYMMETRIES, AngleModes.constant())
        amplitudes = {name: np.zeros((1, m.count)) for name, m in modes.items()}
        return cls(units.time[:1], amplitudes, modes, units, asymmetry, continuum_limit)

    def shapes(self, coefficient: str, flow: FlightCondition) -> Array:
        """Values of the modes of a coefficient ``(N, J)`` in a flow of N samples, in sigmas of the database."""
        return self.modes[coefficient].at(flow.alpha_total, flow.knudsen > self.continuum_limit)

    def increments(self, flow: FlightCondition) -> dict[str, Array]:
        """Increments of the coefficients ``(N,)`` in a flow of N samples."""
        time = flow.time
        out = {}
        for name in FIELD_COEFFICIENTS:
            value = np.einsum("nj,nj->n", self._amplitudes_at(name, time), self.shapes(name, flow))
            out[name] = value * self.units.at(name, time)
        return out

    def body_fixed(self, flow: FlightCondition) -> dict[str, Array]:
        """Coefficients of the asymmetry ``(N,)`` in a flow of N samples; empty without one."""
        if self.asymmetry is None:
            return {}
        return {
            name: self._amplitudes_at(name, flow.time)[:, 0] * self.asymmetry.at(coefficient, flow.time)
            for name, coefficient in ASYMMETRIES.items()
        }

    def standardised(self, flow: FlightCondition) -> dict[str, Array]:
        """Increments and coefficients of the asymmetry ``(N,)``, over their prior sigma, in a flow of N samples.

        The standard deviation is that of the modes at the sample's angle, so that each value is standard normal under
        the prior; zero where a coefficient has no mode. Amplitudes of single modes are no measure of it: that of a mode
        with a hundredth of the variance is large where the increment is not.
        """
        out = {}
        for name in self.modes:
            shapes = self.shapes(name, flow)
            value = np.einsum("nj,nj->n", self._amplitudes_at(name, flow.time), shapes)
            deviation = np.sqrt(np.sum(shapes**2, axis=1))
            out[name] = np.divide(value, deviation, out=np.zeros_like(value), where=deviation > 0.0)
        return out

    def _amplitudes_at(self, coefficient: str, time: Array) -> Array:
        """Amplitudes of a coefficient's modes ``(N, J)`` at times ``(N,)``."""
        place = np.clip(np.interp(time, self.time, np.arange(len(self.time))), 0.0, len(self.time) - 1.0)
        index = np.minimum(place.astype(np.intp), max(len(self.time) - 2, 0))
        fraction = (place - index)[:, None]
        following = np.minimum(index + 1, len(self.time) - 1)
        amplitude = self.amplitudes[coefficient]
        return (1.0 - fraction) * amplitude[index] + fraction * amplitude[following]


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
        Added to the logarithm of the mass, and of a common factor of all moments and products of inertia: whatever the
        size of a perturbation, both stay positive.
    field : FieldPerturbation, optional
        Increments of the coefficients that are functions of the flow.
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
    field: FieldPerturbation | None = None

    @classmethod
    def zero(cls, units: CoefficientUnits) -> Perturbation:
        """The perturbation that changes nothing."""
        zeros = np.zeros(1)
        return cls(units.time[:1], zeros, np.zeros((1, 2)), zeros, zeros, zeros, units=units)

    def with_unit(self, coefficient: str) -> Perturbation:
        """The perturbation with one unit of a coefficient (``ca``, ``cn``, ``cm``) added."""
        ca, cn, cm = (getattr(self, n) + (n == coefficient) for n in FIELD_COEFFICIENTS)
        return replace(self, ca=ca, cn=cn, cm=cm)

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
        return wind + interpolate_columns(time, self.time, self.wind)

    def perturb_coefficients(self, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Total coefficients with the perturbation.

        Parameters
        ----------
        flow : FlightCondition
            Of the N samples.
        totals : AeroCoefficients
            Without the perturbation, ``(N,)`` each.
        """
        changes, u, time = (self.ca, self.cn, self.cm), self.units, flow.time
        ca, cn, cm = (
            np.interp(time, self.time, change) * np.interp(time, u.time, unit)
            for change, unit in zip(changes, (u.ca, u.cn, u.cm), strict=True)
        )
        if self.field is not None:
            increments = self.field.increments(flow)
            ca, cn, cm = ca + increments["ca"], cn + increments["cn"], cm + increments["cm"]
        return replace(totals, ca=totals.ca + ca, cn=totals.cn + cn, cm_nose=totals.cm_nose + cm)

    def body_fixed(self, flow: FlightCondition) -> dict[str, Array]:
        """Coefficients of the asymmetry ``(N,)`` in a flow of N samples; empty without one."""
        return {} if self.field is None else self.field.body_fixed(flow)

    def perturb_body(self, body: Body) -> Body:
        """The rigid body with the perturbation."""
        return replace(body, mass=body.mass * np.exp(self.mass), inertia=body.inertia * np.exp(self.inertia))
