"""Compiled rotations: of scalars, for other compiled functions, and loops over rows, for `rotations`.

Functions of scalars take components and return tuples; the compiler puts them in line. The functions of rows take
arrays that `rotations` has checked and shaped. Quaternions are scalar-last.
"""

import numpy as np
from numba import njit

COMPILED = njit(cache=True, error_model="numpy", nogil=True)

#: Half the length of a rotation vector (rad) below which ``sin(x) / x`` is ``1 - x² / 6``: the next term of the series,
#: x⁴ / 120 < 1e-18, is below the last bit of 1, and zero is not divided by zero.
_SMALL = 1e-4


@njit(cache=True, error_model="numpy", nogil=True, inline="always")  # with the fast-math flags of its caller
def product(p, q):
    """``p ⊗ q``.

    Parameters
    ----------
    p, q : (4,) arrays or tuples of four floats
        Quaternions, scalar last.

    Returns
    -------
    tuple of four floats
        The product, scalar last.
    """
    return (
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )


@COMPILED
def quaternion(x, y, z):
    """Quaternion of a rotation vector.

    Parameters
    ----------
    x, y, z : float
        Components of the rotation vector, rad.

    Returns
    -------
    tuple of four floats
        Unit quaternion, scalar last.
    """
    half = 0.5 * np.sqrt(x * x + y * y + z * z)
    factor = 0.5 * (np.sin(half) / half if half > _SMALL else 1.0 - half * half / 6.0)
    return factor * x, factor * y, factor * z, np.cos(half)


@COMPILED
def rotation_vector(x, y, z, w):
    """Rotation vector of a quaternion.

    Parameters
    ----------
    x, y, z, w : float
        Unit quaternion, of either sign.

    Returns
    -------
    tuple of three floats
        Rotation vector of at most half a turn, rad.
    """
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    s = np.sqrt(x * x + y * y + z * z)
    # angle / s tends to 2 / w as s tends to 0
    factor = 2.0 * np.arctan2(s, w) / s if s > 1e-12 else 2.0 / max(w, 0.5)
    return factor * x, factor * y, factor * z


@COMPILED
def direction_cosines(x, y, z, w):
    """Rotation matrix of a quaternion.

    Parameters
    ----------
    x, y, z, w : float
        Unit quaternion.

    Returns
    -------
    tuple of nine floats
        The matrix, row by row.
    """
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@COMPILED
def fill_matrix(q, out):
    """Rotation matrix of a quaternion, in place.

    Parameters
    ----------
    q : (4,) array or tuple of four floats
        Unit quaternion, scalar last.
    out : (3, 3) array
        The matrix.
    """
    (
        out[0, 0], out[0, 1], out[0, 2], out[1, 0], out[1, 1], out[1, 2], out[2, 0], out[2, 1], out[2, 2],
    ) = direction_cosines(q[0], q[1], q[2], q[3])  # fmt: skip


@COMPILED
def right_jacobian_coefficients(square):
    """``(1 - cos a) / a²`` and ``(a - sin a) / a³`` of an angle a.

    Parameters
    ----------
    square : float
        Square of the angle, rad².

    Returns
    -------
    first, second : float
        Both coefficients, by their series at small angles.
    """
    if square < 1e-3:
        return 0.5 - square / 24.0 * (1.0 - square / 30.0), 1.0 / 6.0 - square / 120.0 * (1.0 - square / 42.0)
    angle = np.sqrt(square)
    return (1.0 - np.cos(angle)) / square, (angle - np.sin(angle)) / (square * angle)


@COMPILED
def right_jacobian_elements(x, y, z):
    """Right Jacobian of the rotation group at a rotation vector; at the opposite vector it is the left one.

    Parameters
    ----------
    x, y, z : float
        Components of the rotation vector, rad.

    Returns
    -------
    tuple of nine floats
        The matrix, row by row.
    """
    square = x * x + y * y + z * z
    a, b = right_jacobian_coefficients(square)
    # J = 1 - a [phi]ₓ + b [phi]ₓ², with [phi]ₓ² = phi phiᵀ - |phi|² 1
    diagonal = 1.0 - b * square
    return (
        diagonal + b * x * x, b * x * y + a * z, b * x * z - a * y,
        b * x * y - a * z, diagonal + b * y * y, b * y * z + a * x,
        b * x * z + a * y, b * y * z - a * x, diagonal + b * z * z,
    )  # fmt: skip


# Rows


@njit(cache=True)
def cross(u, v, out):
    """Cross products of rows.

    Parameters
    ----------
    u, v : (N, 3) arrays
        Factors.
    out : (N, 3) array
        The products ``u × v``, in the product of their units.
    """
    for i in range(len(out)):
        ux, uy, uz = u[i, 0], u[i, 1], u[i, 2]
        vx, vy, vz = v[i, 0], v[i, 1], v[i, 2]
        out[i, 0] = uy * vz - uz * vy
        out[i, 1] = uz * vx - ux * vz
        out[i, 2] = ux * vy - uy * vx


@njit(cache=True)
def multiply(p, q, out):
    """Products of rows of quaternions.

    Parameters
    ----------
    p, q : (N, 4) arrays
        Quaternions, scalar last.
    out : (N, 4) array
        The products ``p ⊗ q``.
    """
    for i in range(len(out)):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = product(
            (p[i, 0], p[i, 1], p[i, 2], p[i, 3]), (q[i, 0], q[i, 1], q[i, 2], q[i, 3])
        )


@njit(cache=True)
def exponential(phi, out):
    """Quaternions of rotation vectors.

    Parameters
    ----------
    phi : (N, 3) array
        Rotation vectors, rad.
    out : (N, 4) array
        Unit quaternions, scalar last.
    """
    for i in range(len(out)):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = quaternion(phi[i, 0], phi[i, 1], phi[i, 2])


@njit(cache=True)
def logarithm(q, out):
    """Rotation vectors of quaternions.

    Parameters
    ----------
    q : (N, 4) array
        Unit quaternions, scalar last, of either sign.
    out : (N, 3) array
        Rotation vectors of at most half a turn, rad.
    """
    for i in range(len(out)):
        out[i, 0], out[i, 1], out[i, 2] = rotation_vector(q[i, 0], q[i, 1], q[i, 2], q[i, 3])


@njit(cache=True)
def matrix(q, out):
    """Rotation matrices of quaternions.

    Parameters
    ----------
    q : (N, 4) array
        Unit quaternions, scalar last.
    out : (N, 9) array
        Matrices, row by row.
    """
    for i in range(len(out)):
        (
            out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5], out[i, 6], out[i, 7], out[i, 8],
        ) = direction_cosines(q[i, 0], q[i, 1], q[i, 2], q[i, 3])  # fmt: skip


@njit(cache=True)
def right_jacobian(phi, out):
    """Right Jacobians at rotation vectors.

    Parameters
    ----------
    phi : (N, 3) array
        Rotation vectors, rad.
    out : (N, 9) array
        Jacobians, row by row.
    """
    for i in range(len(out)):
        (
            out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5], out[i, 6], out[i, 7], out[i, 8],
        ) = right_jacobian_elements(phi[i, 0], phi[i, 1], phi[i, 2])  # fmt: skip
