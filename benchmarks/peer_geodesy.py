"""Geodetic coordinates of many points over the WGS84 ellipsoid: pymap3d, astropy and the package."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from edl_filter.planet import ellipsoid
from edl_filter.types import Array

RADIUS, FLATTENING = 6378137.0, 1.0 / 298.257223563
COUNT = 100_000

Coordinates = tuple[Array, Array, Array]


def positions(seed: int = 0) -> Array:
    """Points ``(N, 3)`` from the ground to 200 km, m."""
    rng = np.random.default_rng(seed)
    sine, longitude = rng.uniform(-1.0, 1.0, COUNT), rng.uniform(-np.pi, np.pi, COUNT)
    altitude, axis_ratio_squared = rng.uniform(0.0, 2e5, COUNT), (1.0 - FLATTENING) ** 2
    normal_radius = RADIUS / np.sqrt(1.0 - (1.0 - axis_ratio_squared) * sine**2)
    p = (normal_radius + altitude) * np.sqrt(1.0 - sine**2)
    z = (axis_ratio_squared * normal_radius + altitude) * sine
    return np.stack((p * np.cos(longitude), p * np.sin(longitude), z), axis=1)


def ours(points: Array) -> Callable[[], Coordinates]:
    """The package."""
    return lambda: ellipsoid.geodetic_from_fixed(points, RADIUS, FLATTENING)


def pymap3d(points: Array) -> Callable[[], Coordinates]:
    """pymap3d, rad and m."""
    import pymap3d as peer

    x, y, z = (np.ascontiguousarray(c) for c in points.T)
    return lambda: peer.ecef2geodetic(x, y, z, ell=peer.Ellipsoid.from_name("wgs84"), deg=False)


def astropy(points: Array) -> Callable[[], Coordinates]:
    """astropy, rad and m."""
    from astropy import units
    from astropy.coordinates import EarthLocation

    x, y, z = (np.ascontiguousarray(c) for c in points.T)

    def coordinates() -> Coordinates:
        place = EarthLocation.from_geocentric(x, y, z, unit=units.m).to_geodetic("WGS84")
        return place.lat.to_value(units.rad), place.lon.to_value(units.rad), place.height.to_value(units.m)

    return coordinates


def largest_difference(a: Coordinates, b: Coordinates) -> float:
    """Largest distance between the same points of both, m."""
    longitude = np.remainder(a[1] - b[1] + np.pi, 2.0 * np.pi) - np.pi
    horizontal = RADIUS * np.maximum(np.abs(a[0] - b[0]), np.abs(longitude * np.cos(a[0])))
    return float(np.max(np.maximum(horizontal, np.abs(a[2] - b[2]))))
