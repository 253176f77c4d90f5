"""Quaternions and rotation vectors, vectorised over the leading axes.

Quaternions are scalar-last ``[x, y, z, w]``. ``rotate(a_from_b, v)`` takes components in b to components in a, and
``multiply(a_from_b, b_from_c)`` is ``a_from_c``. The last axis holds the components of a quaternion or of a vector;
the leading axes broadcast as in numpy. (Shuster 1993, J. Astronaut. Sci. 41, 439, with the product in Hamilton's
order.)

The functions that are called thousands of times per second are compiled: on small arrays with strided components the
overhead of numpy's calls would make them ten times slower.
"""

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from edl_filter.types import Array

#: Half the length of a rotation vector (rad) below which its sine is computed from the series.
_SMALL = 1e-4


def multiply(p: ArrayLike, q: ArrayLike) -> Array:
    """Hamilton product ``p ⊗ q``: the rotation by q followed by the rotation by p.

    Parameters
    ----------
    p, q : (..., 4) arrays
        Quaternions; their leading axes broadcast.

    Returns
    -------
    (..., 4) array

    Raises
    ------
    ValueError
        A last axis is not of length 4.
    """
    return _apply_to_pairs(_multiply, p, q, 4)


def conjugate(q: ArrayLike) -> Array:
    """Inverse of unit quaternions.

    Parameters
    ----------
    q : (..., 4) array
        Unit quaternions.

    Returns
    -------
    (..., 4) array
    """
    return np.asarray(q, float) * np.array([-1.0, -1.0, -1.0, 1.0])


def normalise(q: ArrayLike) -> Array:
    """Unit quaternions in the direction of `q`.

    Parameters
    ----------
    q : (..., 4) array
        Not zero.

    Returns
    -------
    (..., 4) array
    """
    q = np.asarray(q, float)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def rotate(a_from_b: ArrayLike, v: ArrayLike) -> Array:
    """Components in a of vectors whose components in b are `v`.

    Parameters
    ----------
    a_from_b : (..., 4) array
        Unit quaternions.
    v : (..., 3) array
        Any unit; the leading axes broadcast against those of `a_from_b`.

    Returns
    -------
    (..., 3) array
        In the unit of `v`.
    """
    q, v = np.asarray(a_from_b, float), np.asarray(v, float)
    u, w = q[..., :3], q[..., 3:]
    t = 2.0 * cross(u, v)
    return v + w * t + cross(u, t)


def cross(u: ArrayLike, v: ArrayLike) -> Array:
    """Vector product ``u × v``; on small arrays `numpy.cross` takes ten times as long.

    Parameters
    ----------
    u, v : (..., 3) arrays
        Any units; their leading axes broadcast.

    Returns
    -------
    (..., 3) array
        In the product of the two units.

    Raises
    ------
    ValueError
        A last axis is not of length 3.
    """
    return _apply_to_pairs(_cross, u, v, 3)


def from_rotation_vector(phi: ArrayLike) -> Array:
    """Quaternions ``exp(phi)`` of rotations by the angle ``|phi|`` about the axis `phi`.

    Parameters
    ----------
    phi : (..., 3) array
        rad.

    Returns
    -------
    (..., 4) array

    Raises
    ------
    ValueError
        The last axis is not of length 3.
    """
    return _apply_to_rows(_exponential, phi, 3, 4)


def to_rotation_vector(q: ArrayLike) -> Array:
    """Rotation vectors of quaternions: the inverse of `from_rotation_vector`.

    Parameters
    ----------
    q : (..., 4) array
        Unit quaternions of either sign.

    Returns
    -------
    (..., 3) array
        rad, at most pi long.

    Raises
    ------
    ValueError
        The last axis is not of length 4.
    """
    return _apply_to_rows(_logarithm, q, 4, 3)


def rotation_vector_between(reference_from_a: ArrayLike, reference_from_b: ArrayLike) -> Array:
    """Rotation vectors of ``a_from_b``, the rotation from the first attitude to the second, in the axes of a.

    Parameters
    ----------
    reference_from_a, reference_from_b : (..., 4) arrays
        Unit quaternions; their leading axes broadcast.

    Returns
    -------
    (..., 3) array
        rad, at most pi long.
    """
    return to_rotation_vector(multiply(conjugate(reference_from_a), reference_from_b))


def from_matrix(a_from_b: ArrayLike) -> Array:
    """Quaternion of one direction-cosine matrix.

    It is the eigenvector of the largest eigenvalue of the symmetric matrix K that is formed from the elements
    (Bar-Itzhack 2000, J. Guidance, Control, and Dynamics 23, 1085, without the common factor 1/3).

    Parameters
    ----------
    a_from_b : (3, 3) array
        Assumed orthonormal to rounding.

    Returns
    -------
    (4,) array
    """
    m = np.asarray(a_from_b, float)
    k = np.empty((4, 4))
    k[:3, :3] = m + m.T - np.trace(m) * np.eye(3)
    k[3, :3] = k[:3, 3] = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
    k[3, 3] = np.trace(m)
    return np.linalg.eigh(k)[1][:, -1]


def to_matrix(a_from_b: ArrayLike) -> Array:
    """Direction-cosine matrices of quaternions.

    Parameters
    ----------
    a_from_b : (..., 4) array
        Unit quaternions.

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    ValueError
        The last axis is not of length 4.
    """
    return _apply_to_rows(_matrix, a_from_b, 4, 9).reshape(*np.shape(a_from_b)[:-1], 3, 3)


def cross_matrix(v: ArrayLike) -> Array:
    """Matrices with ``cross_matrix(v) @ u = v × u``.

    Parameters
    ----------
    v : (..., 3) array
        Any unit.

    Returns
    -------
    (..., 3, 3) array
        In the unit of `v`.
    """
    v = np.asarray(v, float)
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1], out[..., 1, 2] = v[..., 0], -v[..., 0]
    out[..., 0, 2], out[..., 2, 0] = v[..., 1], -v[..., 1]
    out[..., 1, 0], out[..., 0, 1] = v[..., 2], -v[..., 2]
    return out


def right_jacobian(phi: ArrayLike) -> Array:
    """Right Jacobian of the rotation group: ``exp(phi + d) = exp(phi) ⊗ exp(J d)`` to first order in d.

    Solà, Deray & Atchuthan 2018, eq. 143.

    Parameters
    ----------
    phi : (..., 3) array
        Rotation vectors, rad.

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    ValueError
        The last axis is not of length 3.
    """
    return _apply_to_rows(_right_jacobian, phi, 3, 9).reshape(*np.shape(phi), 3)


def _apply_to_rows(kernel: Callable[[Array, Array], None], a: ArrayLike, width: int, width_out: int) -> Array:
    """Apply a kernel to the rows of `a`, from ``(..., width)`` to ``(..., width_out)``."""
    a = _checked(a, width)
    out = np.empty((*a.shape[:-1], width_out))
    kernel(_as_rows(a, a.shape), out.reshape(-1, width_out))
    return out


def _apply_to_pairs(kernel: Callable[[Array, Array, Array], None], a: ArrayLike, b: ArrayLike, width: int) -> Array:
    """Apply a kernel to pairs of rows of length `width`, broadcast as in numpy."""
    a, b = _checked(a, width), _checked(b, width)
    shape = a.shape if a.shape == b.shape else np.broadcast_shapes(a.shape, b.shape)
    out = np.empty(shape)
    kernel(_as_rows(a, shape), _as_rows(b, shape), out.reshape(-1, shape[-1]))
    return out


def _checked(a: ArrayLike, width: int) -> Array:
    """`a` as an array ``(..., width)``; compiled code would read past the end of a shorter last axis."""
    a = np.asarray(a, float)
    if a.shape[-1:] != (width,):
        raise ValueError(f"found shape {a.shape}; expected (..., {width})")
    return a


def _as_rows(a: Array, shape: tuple[int, ...]) -> Array:
    """`a`, broadcast to `shape`, as contiguous rows."""
    contiguous = np.ascontiguousarray(a) if a.shape == shape else np.array(np.broadcast_to(a, shape))
    return contiguous.reshape(-1, shape[-1])


@njit(cache=True)
def _cross(u, v, out):
    for i in range(len(out)):
        ux, uy, uz = u[i, 0], u[i, 1], u[i, 2]
        vx, vy, vz = v[i, 0], v[i, 1], v[i, 2]
        out[i, 0] = uy * vz - uz * vy
        out[i, 1] = uz * vx - ux * vz
        out[i, 2] = ux * vy - uy * vx


@njit(cache=True)
def _multiply(p, q, out):
    for i in range(len(out)):
        px, py, pz, pw = p[i, 0], p[i, 1], p[i, 2], p[i, 3]
        qx, qy, qz, qw = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        out[i, 0] = pw * qx + px * qw + py * qz - pz * qy
        out[i, 1] = pw * qy - px * qz + py * qw + pz * qx
        out[i, 2] = pw * qz + px * qy - py * qx + pz * qw
        out[i, 3] = pw * qw - px * qx - py * qy - pz * qz


@njit(cache=True)
def _exponential(phi, out):
    for i in range(len(out)):
        x, y, z = phi[i, 0], phi[i, 1], phi[i, 2]
        half = 0.5 * np.sqrt(x * x + y * y + z * z)
        factor = 0.5 * (np.sin(half) / half if half > _SMALL else 1.0 - half * half / 6.0)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = factor * x, factor * y, factor * z, np.cos(half)


@njit(cache=True)
def _logarithm(q, out):
    for i in range(len(out)):
        sign = -1.0 if q[i, 3] < 0.0 else 1.0
        x, y, z, w = sign * q[i, 0], sign * q[i, 1], sign * q[i, 2], sign * q[i, 3]
        s = np.sqrt(x * x + y * y + z * z)
        # angle / s tends to 2 / w as s tends to 0
        factor = 2.0 * np.arctan2(s, w) / s if s > 1e-12 else 2.0 / max(w, 0.5)
        out[i, 0], out[i, 1], out[i, 2] = factor * x, factor * y, factor * z


@njit(cache=True)
def _matrix(q, out):
    for i in range(len(out)):
        x, y, z, w = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        out[i, 0], out[i, 1], out[i, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)
        out[i, 3], out[i, 4], out[i, 5] = 2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)
        out[i, 6], out[i, 7], out[i, 8] = 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)


@njit(cache=True)
def right_jacobian_coefficients(square):
    """``(1 - cos a) / a²`` and ``(a - sin a) / a³`` of an angle a (rad) with the given square."""
    if square < 1e-3:
        return 0.5 - square / 24.0 * (1.0 - square / 30.0), 1.0 / 6.0 - square / 120.0 * (1.0 - square / 42.0)
    angle = np.sqrt(square)
    return (1.0 - np.cos(angle)) / square, (angle - np.sin(angle)) / (square * angle)


@njit(cache=True)
def _right_jacobian(phi, out):
    for i in range(len(out)):
        x, y, z = phi[i, 0], phi[i, 1], phi[i, 2]
        square = x * x + y * y + z * z
        a, b = right_jacobian_coefficients(square)
        # J = 1 - a [phi]ₓ + b [phi]ₓ², with [phi]ₓ² = phi phiᵀ - |phi|² 1
        diagonal = 1.0 - b * square
        out[i, 0], out[i, 1], out[i, 2] = diagonal + b * x * x, b * x * y + a * z, b * x * z - a * y
        out[i, 3], out[i, 4], out[i, 5] = b * x * y - a * z, diagonal + b * y * y, b * y * z + a * x
        out[i, 6], out[i, 7], out[i, 8] = b * x * z + a * y, b * y * z - a * x, diagonal + b * z * z
