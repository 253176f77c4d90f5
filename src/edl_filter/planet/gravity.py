"""Gravity of a point mass with oblateness J2 (thesis eq. 3.5).

Input: positions, and the planet's gravitational parameter, J2 and reference radius. Output: acceleration, potential.
`gravity` is the compiled kernel, for loops over sigma points; `gravity_vector` is the same arithmetic on arrays. The z
axis is the rotation axis, so that the formulas hold in inertial and in planet-fixed components.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from edl_filter.types import Array


def _gravity(x, y, z, mu, j2, re):
    """Gravitational acceleration at one point, without the centrifugal part.

    The arithmetic has no branches: inlined in a loop over sigma points it becomes SIMD code.

    Parameters
    ----------
    x, y, z : float
        Position from the planet's centre, m, z along the rotation axis.
    mu : float
        Gravitational parameter, m³/s².
    j2 : float
        Second zonal coefficient, unnormalised; 0 is a point mass.
    re : float
        Radius that `j2` refers to, m.

    Returns
    -------
    gx, gy, gz : float
        m/s².
    """
    inverse_r2 = 1.0 / (x * x + y * y + z * z)
    central = -mu * inverse_r2 * np.sqrt(inverse_r2)
    oblate = 1.5 * j2 * re * re * inverse_r2
    polar = 5.0 * z * z * inverse_r2
    lateral = central * (1.0 + oblate * (1.0 - polar))
    return lateral * x, lateral * y, central * (1.0 + oblate * (3.0 - polar)) * z


# With numpy's error model there is no check for division by zero, whose branch would prevent SIMD
gravity = njit(error_model="numpy", cache=True)(_gravity)


def gravity_vector(position: ArrayLike, mu: float, j2: float, re: float) -> Array:
    """Gravitational acceleration (thesis eq. 3.5), the gradient of `potential`.

    Parameters
    ----------
    position : (..., 3) array
        m from the planet's centre, z along the rotation axis.
    mu : float
        Gravitational parameter, m³/s².
    j2 : float
        Second zonal coefficient, unnormalised; 0 is a point mass.
    re : float
        Radius that `j2` refers to, m.

    Returns
    -------
    (..., 3) array
        m/s².
    """
    x, y, z = np.moveaxis(np.asarray(position, float), -1, 0)
    return np.stack(_gravity(x, y, z, mu, j2, re), axis=-1)


def potential(position: ArrayLike, mu: float, j2: float, re: float) -> Array:
    """Gravitational potential with positive sign: the acceleration is its gradient.

    Parameters
    ----------
    position : (..., 3) array
        m from the planet's centre, z along the rotation axis.
    mu, j2, re : float
        Gravitational parameter (m³/s²), second zonal coefficient, radius that it refers to (m).

    Returns
    -------
    (...) array
        ``mu/r (1 - j2 (re/r)² (3 sin²(latitude) - 1)/2)``, m²/s².
    """
    x, y, z = np.moveaxis(np.asarray(position, float), -1, 0)
    r2 = x * x + y * y + z * z
    legendre = 0.5 * (3.0 * z * z / r2 - 1.0)
    return mu / np.sqrt(r2) * (1.0 - j2 * re * re / r2 * legendre)
