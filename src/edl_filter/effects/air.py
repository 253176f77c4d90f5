"""The mission's air with effects in it, for what asks an atmosphere and a planet and knows nothing of effects.

`edl_filter.effects.world.World` has the effects itself and is given the mission's own atmosphere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.effects.effect import Active
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChangedAtmosphere(Atmosphere):
    """A preflight atmosphere with the densities and winds of effects.

    Attributes
    ----------
    effects : tuple of Active
    """

    effects: tuple[Active, ...] = ()

    def density(self, altitude: ArrayLike) -> Array:
        """kg/m³ at areodetic altitudes in m."""
        h = np.asarray(altitude, float)
        density = super().density(h)
        for a in self.effects:
            if a.effect.acts("density"):
                density = density * a.effect.density(a.values, h.ravel()).reshape(h.shape)
        return density

    def wind_at(self, altitude: ArrayLike) -> Array:
        """Velocity of the air towards east and north, ``(..., 2)``, m/s."""
        return super().wind_at(altitude) + self.added_wind(altitude)

    def added_wind(self, altitude: ArrayLike) -> Array:
        """What the effects add to the table's wind, ``(..., 2)``, m/s."""
        h = np.asarray(altitude, float)
        wind = np.zeros((*h.shape, 2))
        for a in self.effects:
            if a.effect.acts("wind"):
                wind = wind + a.effect.wind(a.values, h.ravel()).reshape(wind.shape)
        return wind


def changed_atmosphere(atmosphere: Atmosphere, effects: Sequence[Active]) -> Atmosphere:
    """`atmosphere` with the effects' densities and winds; itself where none has any."""
    acting = tuple(a for a in effects if a.effect.acts("density") or a.effect.acts("wind"))
    if not acting:
        return atmosphere
    return ChangedAtmosphere(**{f.name: getattr(atmosphere, f.name) for f in fields(Atmosphere)}, effects=acting)


def air_planet(planet: Planet, effects: Sequence[Active]) -> Planet:
    """A planet that turns as the air does: right for velocities against the air, not for longitudes."""
    rates = [a.effect.atmosphere_rate(a.values) for a in effects if a.effect.acts("atmosphere_rate")]
    return replace(planet, rotation_rate=planet.rotation_rate * float(np.prod(rates))) if rates else planet


def gravity_planet(planet: Planet, effects: Sequence[Active]) -> Planet:
    """The planet with the effects' gravity."""
    for a in effects:
        planet = a.effect.gravity(a.values, planet)
    return planet
