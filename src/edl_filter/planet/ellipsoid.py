"""Areodetic and areocentric coordinates and local axes on an ellipsoid of revolution.

Areodetic latitude is the angle between the equator and the ellipsoid's normal, areocentric latitude that between the
equator and the radius vector; both are positive to the north, longitude is positive to the east in ``(-pi, pi]``. On a
sphere the two latitudes agree. Input and output are arrays of planet-fixed positions (m) or coordinates (rad, m).
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from edl_filter.types import Array

# Each iteration reduces the error by a factor of about flattening squared or smaller (Mars: 3e-5); after five the error
# is below rounding for every flattening below 0.1 at every altitude of a vehicle.
_ITERATIONS = 5


def geodetic_from_fixed(position: ArrayLike, equatorial_radius: float, flattening: float) -> tuple[Array, Array, Array]:
    """Areodetic latitude, longitude and altitude of planet-fixed points.

    Bowring's formula is iterated on the sine and cosine of the parametric latitude, which avoids a division by zero
    at the poles and at the equator.

    Parameters
    ----------
    position : (..., 3) array
        m. Valid outside the ellipsoid's evolute, that is farther from the centre than about
        2 * flattening * radius.
    equatorial_radius : float
        m.
    flattening : float
        (equatorial - polar radius) / equatorial radius, 0 for a sphere.

    Returns
    -------
    latitude, longitude : (...) arrays
        rad.
    altitude : (...) array
        Height above the ellipsoid along its normal, m, to 1e-9 m.

    References
    ----------
    Bowring 1976, Survey Review 23, 323; Bowring 1985, ibid. 28, 202 (altitude).
    """
    points = np.asarray(position, float)
    flat = np.ascontiguousarray(points.reshape(-1, 3))
    latitude, longitude, altitude = _geodetic(flat, equatorial_radius, flattening).reshape(3, *points.shape[:-1])
    return latitude, longitude, altitude


@njit(error_model="numpy", cache=True)
def _geodetic(points, a, flattening):
    out = np.empty((3, len(points)))
    b = a * (1.0 - flattening)
    e2 = flattening * (2.0 - flattening)
    for i in range(len(points)):
        x, y, z = points[i]
        p = np.hypot(x, y)
        # tan(parametric latitude) = a z / (b p) is exact on the surface and the initial value elsewhere
        s, c = a * z, b * p
        normal_z, normal_p = z, p
        for _ in range(_ITERATIONS):
            norm = np.hypot(s, c)
            s, c = s / norm, c / norm
            normal_z = z + e2 * a * a / b * s**3
            normal_p = p - e2 * a * c**3
            s, c = (1.0 - flattening) * normal_z, normal_p
        latitude = np.arctan2(normal_z, normal_p)
        norm = np.hypot(s, c)
        s, c = s / norm, c / norm
        # Distance to the foot point (a c, b s) along the normal: the large radii are subtracted before any product
        out[0, i], out[1, i] = latitude, np.arctan2(y, x)
        out[2, i] = (p - a * c) * np.cos(latitude) + (z - b * s) * np.sin(latitude)
    return out


def areocentric_from_fixed(position: ArrayLike) -> tuple[Array, Array, Array]:
    """Areocentric coordinates of planet-fixed points.

    Parameters
    ----------
    position : (..., 3) array
        m.

    Returns
    -------
    latitude, longitude : (...) arrays
        rad.
    radius : (...) array
        m.
    """
    x, y, z = np.moveaxis(np.asarray(position, float), -1, 0)
    p = np.hypot(x, y)
    return np.arctan2(z, p), np.arctan2(y, x), np.hypot(p, z)


def fixed_from_areocentric(latitude: ArrayLike, longitude: ArrayLike, radius: ArrayLike) -> Array:
    """Planet-fixed positions of areocentric coordinates.

    Parameters
    ----------
    latitude, longitude : (...) arrays
        rad.
    radius : (...) array
        m.

    Returns
    -------
    (..., 3) array
        m.
    """
    latitude, longitude, radius = (np.asarray(v, float) for v in (latitude, longitude, radius))
    p = radius * np.cos(latitude)
    return _stack(p * np.cos(longitude), p * np.sin(longitude), radius * np.sin(latitude))


def enu_from_fixed(latitude: ArrayLike, longitude: ArrayLike) -> Array:
    """Matrices whose rows are the east, north and up axes at a point.

    Parameters
    ----------
    latitude, longitude : (...) arrays
        rad. With an areodetic latitude, up is along the ellipsoid's normal; with an areocentric one, along the
        radius. At the poles the longitude determines east and north.

    Returns
    -------
    (..., 3, 3) array
        ``matrix @ v_fixed`` has the components east, north, up.
    """
    latitude, longitude = np.broadcast_arrays(np.asarray(latitude, float), np.asarray(longitude, float))
    s, c = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    east = _stack(-sl, cl, np.zeros_like(sl))
    north = _stack(-s * cl, -s * sl, c)
    up = _stack(c * cl, c * sl, s)
    return np.stack((east, north, up), axis=-2)


def _stack(x: Array, y: Array, z: Array) -> Array:
    """Vectors (..., 3) of three components that broadcast."""
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
