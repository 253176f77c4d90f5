"""Gravity of a point mass with oblateness J2 (thesis eq. 3.5).

`gravity` is the kernel, for loops over sigma points; `gravity_vector` is the same arithmetic over
arrays. The z axis is the rotation axis, so the components hold in the inertial and in the fixed frame.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _gravity(x, y, z, mu, j2, re):
    """Gravitational acceleration at one point, without the centrifugal part.

    Straight-line arithmetic: inlined in a loop over sigma points it becomes SIMD code.

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


# The numpy error model leaves out the check for division by zero, whose branch would forbid SIMD
gravity = njit(error_model="numpy", cache=True)(_gravity)


def gravity_vector(position: ArrayLike, mu: float, j2: float, re: float) -> Array:
    """Gravitational acceleration ``(..., 3)``, m/s², at positions ``(..., 3)``, m (thesis eq. 3.5).

    See `potential` for the parameters; the acceleration is its gradient.
    """
    x, y, z = np.moveaxis(np.asarray(position, float), -1, 0)
    return np.stack(_gravity(x, y, z, mu, j2, re), axis=-1)


def potential(position: ArrayLike, mu: float, j2: float, re: float) -> Array:
    """Gravitational potential, m²/s², positive: the acceleration is its gradient.

    Parameters
    ----------
    position : (..., 3) array
        m from the planet's centre, z along the rotation axis.
    mu, j2, re : float
        Gravitational parameter (m³/s²), second zonal coefficient, radius that it refers to (m).

    Returns
    -------
    (...) array
        ``mu/r (1 - j2 (re/r)² (3 sin²(latitude) - 1)/2)``.
    """
    x, y, z = np.moveaxis(np.asarray(position, float), -1, 0)
    r2 = x * x + y * y + z * z
    legendre = 0.5 * (3.0 * z * z / r2 - 1.0)
    return mu / np.sqrt(r2) * (1.0 - j2 * re * re / r2 * legendre)
