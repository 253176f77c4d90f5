"""The planet: shape, rotation and gravity in one object.

The formulas are in `ellipsoid`, `rotation` and `gravity`; `Planet` only carries the numbers to them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.planet import ellipsoid
from edl_filter.planet.gravity import gravity_vector, potential
from edl_filter.planet.rotation import Rotation

Array = NDArray[np.float64]

__all__ = ["Planet", "Rotation"]


@dataclass(frozen=True)
class Planet:
    """Numbers that describe a planet; every one comes from the mission.

    Attributes
    ----------
    name : str
    mu : float
        Gravitational parameter, m³/s².
    j2 : float
        Second zonal coefficient, unnormalised; 0 is a point mass.
    gravity_radius : float
        Radius that `j2` refers to, m.
    equatorial_radius, flattening : float
        Ellipsoid of areodetic coordinates: m, and (equatorial - polar) / equatorial radius.
    rotation_rate : float
        rad/s.
    prime_meridian_at_epoch : float
        Angle from the inertial x axis to the prime meridian at time 0, rad.
    """

    name: str
    mu: float
    j2: float
    gravity_radius: float
    equatorial_radius: float
    flattening: float
    rotation_rate: float
    prime_meridian_at_epoch: float

    @property
    def rotation(self) -> Rotation:
        """Rotation of the ground and of the air at rest on it."""
        return Rotation(self.rotation_rate, self.prime_meridian_at_epoch)

    def gravity(self, position: ArrayLike) -> Array:
        """Gravitational acceleration ``(..., 3)``, m/s², at inertial or fixed positions ``(..., 3)``, m."""
        return gravity_vector(position, self.mu, self.j2, self.gravity_radius)

    def potential(self, position: ArrayLike) -> Array:
        """Gravitational potential, m²/s², whose gradient is `gravity`."""
        return potential(position, self.mu, self.j2, self.gravity_radius)

    def geodetic(self, time: ArrayLike, position: ArrayLike) -> tuple[Array, Array, Array]:
        """Areodetic latitude, longitude (rad) and altitude (m) of inertial positions at `time` (s)."""
        fixed = self.rotation.to_fixed(time, position)
        return ellipsoid.geodetic_from_fixed(fixed, self.equatorial_radius, self.flattening)

    def geodetic_from_fixed(self, position: ArrayLike) -> tuple[Array, Array, Array]:
        """Areodetic latitude, longitude (rad) and altitude (m) of planet-fixed positions ``(..., 3)``, m."""
        return ellipsoid.geodetic_from_fixed(position, self.equatorial_radius, self.flattening)

    def fixed_from_geodetic(self, latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike) -> Array:
        """Planet-fixed positions ``(..., 3)``, m, of areodetic coordinates (rad, rad, m)."""
        return ellipsoid.fixed_from_geodetic(latitude, longitude, altitude, self.equatorial_radius, self.flattening)

    def velocity_relative(self, position: ArrayLike, velocity: ArrayLike) -> Array:
        """Velocity against the ground and the still air, m/s, from an inertial state, in inertial axes."""
        return self.rotation.velocity_relative(position, velocity)

    def enu_from_inertial(self, time: ArrayLike, position: ArrayLike) -> Array:
        """Matrices ``(..., 3, 3)`` that take inertial components to east, north, up at inertial positions."""
        latitude, longitude, _ = self.geodetic(time, position)
        # Longitude measured from the inertial x axis turns the local axes straight into inertial ones
        return ellipsoid.enu_from_fixed(latitude, longitude + self.rotation.angle(time))
