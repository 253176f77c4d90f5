"""Points on and about an ellipsoid of revolution: areodetic, areocentric and local axes.

Areodetic latitude is the angle of the ellipsoid's normal, areocentric latitude that of the radius
vector; both are positive to the north, longitude to the east in ``(-pi, pi]``. On a sphere they agree.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Each step of the iteration shrinks the error by about flattening squared or better (Mars: 3e-5); five
# leave nothing for any flattening below 0.1 at any height that a vehicle can have.
_ITERATIONS = 5


def geodetic_from_fixed(position: ArrayLike, equatorial_radius: float, flattening: float) -> tuple[Array, Array, Array]:
    """Areodetic latitude, longitude and altitude of planet-fixed points.

    Bowring's formula, iterated on the sine and cosine of the parametric latitude, so that nothing is
    divided by zero at the poles or the equator.

    Parameters
    ----------
    position : (..., 3) array
        m. Valid outside the ellipsoid's evolute, that is anywhere but within some 2 * flattening *
        radius of the centre.
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
        # tan(parametric latitude) = a z / (b p) holds on the surface and starts the iteration above it
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
        # Distance to the foot point (a c, b s) along the normal: the large radii cancel before any product
        out[0, i], out[1, i] = latitude, np.arctan2(y, x)
        out[2, i] = (p - a * c) * np.cos(latitude) + (z - b * s) * np.sin(latitude)
    return out


def fixed_from_geodetic(
    latitude: ArrayLike,
    longitude: ArrayLike,
    altitude: ArrayLike,
    equatorial_radius: float,
    flattening: float,
) -> Array:
    """Planet-fixed position ``(..., 3)``, m, of areodetic coordinates (rad, rad, m)."""
    latitude, longitude, altitude = (np.asarray(v, float) for v in (latitude, longitude, altitude))
    s, c = np.sin(latitude), np.cos(latitude)
    squash = (1.0 - flattening) ** 2
    normal = equatorial_radius / np.sqrt(c * c + squash * s * s)  # prime vertical radius of curvature
    p = (normal + altitude) * c
    z = (squash * normal + altitude) * s
    return _stack(p * np.cos(longitude), p * np.sin(longitude), z)


def areocentric_from_fixed(position: ArrayLike) -> tuple[Array, Array, Array]:
    """Areocentric latitude and longitude, rad, and radius, m, of points ``(..., 3)``."""
    x, y, z = np.moveaxis(np.asarray(position, float), -1, 0)
    p = np.hypot(x, y)
    return np.arctan2(z, p), np.arctan2(y, x), np.hypot(p, z)


def fixed_from_areocentric(latitude: ArrayLike, longitude: ArrayLike, radius: ArrayLike) -> Array:
    """Planet-fixed position ``(..., 3)``, m, of areocentric coordinates (rad, rad, m)."""
    latitude, longitude, radius = (np.asarray(v, float) for v in (latitude, longitude, radius))
    p = radius * np.cos(latitude)
    return _stack(p * np.cos(longitude), p * np.sin(longitude), radius * np.sin(latitude))


def enu_from_fixed(latitude: ArrayLike, longitude: ArrayLike) -> Array:
    """Matrices ``(..., 3, 3)`` whose rows are the east, north and up axes at a point.

    Parameters
    ----------
    latitude, longitude : (...) arrays
        rad. An areodetic latitude gives up along the ellipsoid's normal, an areocentric one along the
        radius. At the poles east and north follow the longitude given.

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
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
