"""Positions at areodetic coordinates of a planet."""

from edl_filter.planet import ellipsoid


def fixed_position(planet, latitude, longitude, altitude):
    """Planet-fixed positions ``(..., 3)``, m, at latitudes and longitudes (rad) and altitudes (m)."""
    return ellipsoid.fixed_from_geodetic(latitude, longitude, altitude, planet.equatorial_radius, planet.flattening)
