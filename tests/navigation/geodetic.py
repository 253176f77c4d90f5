"""Positions at areodetic coordinates of a planet."""

import numpy as np


def fixed_position(planet, latitude, longitude, altitude):
    """Planet-fixed positions ``(..., 3)``, m, at latitudes and longitudes (rad) and altitudes (m)."""
    latitude, longitude, altitude = np.broadcast_arrays(latitude, longitude, altitude)
    s, c = np.sin(latitude), np.cos(latitude)
    ratio = (1.0 - planet.flattening) ** 2
    normal_radius = planet.equatorial_radius / np.sqrt(c * c + ratio * s * s)
    p = (normal_radius + altitude) * c
    return np.stack((p * np.cos(longitude), p * np.sin(longitude), (ratio * normal_radius + altitude) * s), axis=-1)
