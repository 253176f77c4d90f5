"""Compiled loops over rows of quaternions, vectors and matrices; `rotations` checks and shapes their arguments."""

import numpy as np
from numba import njit

#: Half the length of a rotation vector (rad) below which its sine is computed from the series.
_SMALL = 1e-4


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
        px, py, pz, pw = p[i, 0], p[i, 1], p[i, 2], p[i, 3]
        qx, qy, qz, qw = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        out[i, 0] = pw * qx + px * qw + py * qz - pz * qy
        out[i, 1] = pw * qy - px * qz + py * qw + pz * qx
        out[i, 2] = pw * qz + px * qy - py * qx + pz * qw
        out[i, 3] = pw * qw - px * qx - py * qy - pz * qz


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
        x, y, z = phi[i, 0], phi[i, 1], phi[i, 2]
        half = 0.5 * np.sqrt(x * x + y * y + z * z)
        factor = 0.5 * (np.sin(half) / half if half > _SMALL else 1.0 - half * half / 6.0)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = factor * x, factor * y, factor * z, np.cos(half)


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
        sign = -1.0 if q[i, 3] < 0.0 else 1.0
        x, y, z, w = sign * q[i, 0], sign * q[i, 1], sign * q[i, 2], sign * q[i, 3]
        s = np.sqrt(x * x + y * y + z * z)
        # angle / s tends to 2 / w as s tends to 0
        factor = 2.0 * np.arctan2(s, w) / s if s > 1e-12 else 2.0 / max(w, 0.5)
        out[i, 0], out[i, 1], out[i, 2] = factor * x, factor * y, factor * z


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
        x, y, z, w = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        out[i, 0], out[i, 1], out[i, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)
        out[i, 3], out[i, 4], out[i, 5] = 2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)
        out[i, 6], out[i, 7], out[i, 8] = 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)


@njit(cache=True)
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
        x, y, z = phi[i, 0], phi[i, 1], phi[i, 2]
        square = x * x + y * y + z * z
        a, b = right_jacobian_coefficients(square)
        # J = 1 - a [phi]ₓ + b [phi]ₓ², with [phi]ₓ² = phi phiᵀ - |phi|² 1
        diagonal = 1.0 - b * square
        out[i, 0], out[i, 1], out[i, 2] = diagonal + b * x * x, b * x * y + a * z, b * x * z - a * y
        out[i, 3], out[i, 4], out[i, 5] = b * x * y - a * z, diagonal + b * y * y, b * y * z + a * x
        out[i, 6], out[i, 7], out[i, 8] = b * x * z + a * y, b * y * z - a * x, diagonal + b * z * z
