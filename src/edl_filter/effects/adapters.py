"""Atmosphere and database of a mission with effects in them, for callers that know nothing of effects.

Constraints, air data and the post-flight layer look up an `Atmosphere` and a `Database`; the classes of this module
have the same interface and compose the effects by the functions of `edl_filter.effects.forward_model`. The forward
model itself takes the mission's own tables.

Built-in effects in CA, CN and Cm depend on Mach number and total angle only, as the database does, so the database with
effects serves look-up and inverse look-up. A user's effect may depend on anything along the flight, which is not
an argument of a database: it acts in predictions only, as do rolling moment, damping and further torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.database import Database
from edl_filter.aero.grid import Weights
from edl_filter.aero.transition import WeightedSum
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import compose_coefficients, compose_density, compose_wind
from edl_filter.effects.instances import lookup
from edl_filter.effects.registry import catalogue
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.types import Array


@dataclass(frozen=True)
class AtmosphereWithEffects(Atmosphere):
    """A preflight atmosphere with the densities and winds of effects.

    Attributes
    ----------
    effects : tuple of EffectInstance
    """

    effects: tuple[EffectInstance, ...] = ()

    def density(self, altitude: ArrayLike) -> Array:
        """Density with effects.

        Parameters
        ----------
        altitude : (...) array_like
            Areodetic, m.

        Returns
        -------
        (...) array
            kg/m³.
        """
        h = np.asarray(altitude, float)
        return compose_density(super().density(h).ravel(), self.effects, h.ravel()).reshape(h.shape)

    def wind_at(self, altitude: ArrayLike) -> Array:
        """Wind with effects.

        Parameters
        ----------
        altitude : array_like
            Areodetic, m, of any shape.

        Returns
        -------
        (..., 2) array
            Velocity of the air towards east and north, m/s.
        """
        return super().wind_at(altitude) + self.added_wind(altitude)

    def added_wind(self, altitude: ArrayLike) -> Array:
        """What the effects add to the table's wind.

        Parameters
        ----------
        altitude : array_like
            Areodetic, m, of any shape.

        Returns
        -------
        (..., 2) array
            Towards east and north, m/s.
        """
        h = np.asarray(altitude, float)
        return compose_wind(np.zeros((h.size, 2)), self.effects, h.ravel()).reshape((*h.shape, 2))


def atmosphere_with_effects(atmosphere: Atmosphere, effects: Sequence[EffectInstance]) -> Atmosphere:
    """`atmosphere` with the effects' densities and winds; the same object where no effect has any."""
    acting = tuple(a for a in effects if a.effect.acts("density") or a.effect.acts("wind"))
    if not acting:
        return atmosphere
    return AtmosphereWithEffects(**{f.name: getattr(atmosphere, f.name) for f in fields(Atmosphere)}, effects=acting)


#: Weights that select one coefficient of CA, CN and Cm.
_SINGLE: tuple[Weights, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class CurvesWithEffects(WeightedSum):
    """Curves over the angle of N samples with effects in them.

    Attributes
    ----------
    mach : (N,) array
        Of the flight; a table that is entered by speed has another one.
    effects : tuple of EffectInstance
    """

    mach: Array
    effects: tuple[EffectInstance, ...]

    def evaluate(self, alpha: Array) -> Array:
        """Coefficients of each curve at its own angle.

        Parameters
        ----------
        alpha : (N,) array
            rad.

        Returns
        -------
        (3, N) array
            CA, CN, Cm about the nose.
        """
        return self._with_effects(super().evaluate(alpha), self.mach, alpha)

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """Weighted sum of the coefficients of all curves at common angles.

        Parameters
        ----------
        alpha : (G,) array
            rad.
        weights : tuple of float
            Of CA, CN and Cm about the nose.

        Returns
        -------
        (N, G) array
        """
        single = [super(CurvesWithEffects, self).rows(alpha, weight) for weight in _SINGLE]
        shape = single[0].shape
        mach, angle = np.broadcast_to(self.mach[:, None], shape), np.broadcast_to(alpha, shape)
        coefficients = self._with_effects(np.stack([s.ravel() for s in single]), mach.ravel(), angle.ravel())
        return np.tensordot(np.asarray(weights, float), coefficients, 1).reshape(shape)

    def take(self, index: NDArray[np.intp]) -> CurvesWithEffects:
        """The curves of the samples with the indices `index`, ``(K,)``."""
        return CurvesWithEffects(super().take(index).terms, self.mach[index], self.effects)

    def _with_effects(self, coefficients: Array, mach: Array, alpha: Array) -> Array:
        """Coefficients ``(3, N)`` with the effects; what a database does not know of the flow is NaN."""
        unknown, zeros = np.full(len(mach), np.nan), np.zeros(len(mach))
        vectors = np.full((len(mach), 3), np.nan)
        flow = FlightCondition(
            unknown, unknown, vectors, vectors, unknown, unknown, mach, unknown, unknown, alpha_total=np.abs(alpha)
        )
        ca, cn, cm_nose = coefficients
        totals = compose_coefficients(AeroCoefficients(ca, cn, cm_nose, zeros, zeros), self.effects, flow)
        return np.stack((totals.ca, totals.cn, totals.cm_nose))


@dataclass(frozen=True, eq=False)
class DatabaseWithEffects(Database):
    """A database with effects in its coefficients.

    Attributes
    ----------
    effects : tuple of EffectInstance
    """

    effects: tuple[EffectInstance, ...] = ()

    def at(self, mach: ArrayLike, knudsen: ArrayLike, speed: ArrayLike | None = None) -> WeightedSum:
        """The curves over the angle of N samples.

        Parameters
        ----------
        mach, knudsen : (N,) array_like
            Mach number; Knudsen number on the diameter.
        speed : (N,) array_like, optional
            m/s.
        """
        flight_mach = np.broadcast_arrays(np.asarray(mach, float), np.asarray(knudsen, float))[0]
        return CurvesWithEffects(super().at(mach, knudsen, speed).terms, flight_mach, self.effects)


def database_with_effects(database: Database, effects: Sequence[EffectInstance]) -> Database:
    """`database` with the built-in effects on CA, CN or Cm; the same object where there is none."""
    built_in = catalogue()
    acting = tuple(a for a in effects if a.effect.acts("coefficients") and a.effect is lookup(built_in, a.name))
    if not acting:
        return database
    return DatabaseWithEffects(**{f.name: getattr(database, f.name) for f in fields(Database)}, effects=acting)
