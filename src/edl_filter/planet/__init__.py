"""The planet: gravity, shape, rotation, atmosphere and gas.

In: numbers of a mission (`Planet`, `Gas`) and a table of the preflight atmosphere (CSV, `Atmosphere`). Out: gravity,
areodetic coordinates, ground- and air-relative velocity, local axes, density, temperature, wind and the numbers of the
gas, for arrays of positions (m, inertial or planet-fixed) and times (s since the epoch). Nothing depends on a vehicle.

Read in this order: `gravity`, `ellipsoid` and `rotation` (the formulas), this file (`Planet`, which passes a planet's
numbers to them), `gas`, `atmosphere`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.planet import ellipsoid
from edl_filter.planet.gravity import gravity_vector, potential
from edl_filter.planet.rotation import Rotation
from edl_filter.types import Array

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
        """Rotation of the ground, and of the air without wind."""
        return Rotation(self.rotation_rate, self.prime_meridian_at_epoch)

    def gravity(self, position: ArrayLike) -> Array:
        """Gravitational acceleration.

        Parameters
        ----------
        position : (..., 3) array
            Inertial or planet-fixed, m.

        Returns
        -------
        (..., 3) array
            m/s², in the axes of `position`.
        """
        return gravity_vector(position, self.mu, self.j2, self.gravity_radius)

    def potential(self, position: ArrayLike) -> Array:
        """Gravitational potential, whose gradient is `gravity`.

        Parameters
        ----------
        position : (..., 3) array
            Inertial or planet-fixed, m.

        Returns
        -------
        (...) array
            m²/s².
        """
        return potential(position, self.mu, self.j2, self.gravity_radius)

    def apparent_gravity(self, position: ArrayLike) -> Array:
        """Gravity in the rotating frame: gravitation and the centrifugal acceleration.

        It is the weight of what rotates with the planet: of the ground, of a vehicle at rest, of air without wind.

        Parameters
        ----------
        position : (..., 3) array
            Inertial or planet-fixed, m.

        Returns
        -------
        (..., 3) array
            m/s², in the axes of `position`.
        """
        position = np.asarray(position, float)
        centrifugal = position * np.array([1.0, 1.0, 0.0]) * self.rotation_rate**2
        return self.gravity(position) + centrifugal

    def geopotential(self, position: ArrayLike) -> Array:
        """Potential energy per mass in the rotating frame, whose gradient is minus `apparent_gravity`.

        Surfaces of equal pressure of air that rotates with the planet are surfaces of equal geopotential, so that
        ``dp = -ρ dW`` along any path (the hydrostatic equation).

        Parameters
        ----------
        position : (..., 3) array
            Inertial or planet-fixed, m.

        Returns
        -------
        (...) array
            m²/s², growing upwards.
        """
        x, y, _ = np.moveaxis(np.asarray(position, float), -1, 0)
        return -(self.potential(position) + 0.5 * self.rotation_rate**2 * (x * x + y * y))

    def geodetic(self, time: ArrayLike, position: ArrayLike) -> tuple[Array, Array, Array]:
        """Areodetic coordinates of inertial positions.

        Parameters
        ----------
        time : (...) array
            s since the epoch.
        position : (..., 3) array
            Inertial, m.

        Returns
        -------
        latitude, longitude : (...) arrays
            rad.
        altitude : (...) array
            m.
        """
        fixed = self.rotation.to_fixed(time, position)
        return ellipsoid.geodetic_from_fixed(fixed, self.equatorial_radius, self.flattening)

    def geodetic_from_fixed(self, position: ArrayLike) -> tuple[Array, Array, Array]:
        """Areodetic coordinates of planet-fixed positions.

        Parameters
        ----------
        position : (..., 3) array
            Planet-fixed, m.

        Returns
        -------
        latitude, longitude : (...) arrays
            rad.
        altitude : (...) array
            m.
        """
        return ellipsoid.geodetic_from_fixed(position, self.equatorial_radius, self.flattening)

    def velocity_relative(self, position: ArrayLike, velocity: ArrayLike) -> Array:
        """Velocity relative to the ground and to the air without wind.

        Parameters
        ----------
        position, velocity : (..., 3) arrays
            Inertial, m and m/s.

        Returns
        -------
        (..., 3) array
            m/s, in inertial axes.
        """
        return self.rotation.velocity_relative(position, velocity)

    def enu_from_inertial(self, time: ArrayLike, position: ArrayLike) -> Array:
        """Matrices that take inertial components to east, north, up.

        Parameters
        ----------
        time : (...) array
            s since the epoch.
        position : (..., 3) array
            Inertial, m.

        Returns
        -------
        (..., 3, 3) array
        """
        latitude, longitude, _ = self.geodetic(time, position)
        return self.enu_at(time, latitude, longitude)

    def enu_at(self, time: ArrayLike, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """Matrices ``(..., 3, 3)`` of `enu_from_inertial`, from the latitude and longitude (rad) of the position."""
        # A longitude measured from the inertial x axis gives the local axes in inertial components
        return ellipsoid.enu_from_fixed(latitude, np.asarray(longitude, float) + self.rotation.angle(time))
