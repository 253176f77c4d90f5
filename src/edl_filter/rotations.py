"""Quaternions and rotation vectors, vectorised over the first axes.

Scalar-last ``[x, y, z, w]``; ``rotate(a_from_b, v)`` takes components in b to components in a, and
``multiply(a_from_b, b_from_c)`` is ``a_from_c``. Shapes broadcast like numpy's; the last axis is the
quaternion's or the vector's. (Shuster 1993, J. Astronaut. Sci. 41, 439, with the product in
Hamilton's order.)

What is asked thousands of times a second is compiled: between numpy's calls on strided components it would be ten
times slower.
"""

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Length of a rotation vector's half below which its sine is a series.
_SMALL = 1e-4


def multiply(p: ArrayLike, q: ArrayLike) -> Array:
    """Hamilton product ``p ⊗ q``: first q, then p."""
    return _pairwise(_multiply, p, q, 4)


def conjugate(q: ArrayLike) -> Array:
    """Inverse of a unit quaternion."""
    return np.asarray(q, float) * np.array([-1.0, -1.0, -1.0, 1.0])


def normalise(q: ArrayLike) -> Array:
    """Unit quaternion along `q`."""
    q = np.asarray(q, float)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def rotate(a_from_b: ArrayLike, v: ArrayLike) -> Array:
    """Components in a of the vector with components `v` in b."""
    q, v = np.asarray(a_from_b, float), np.asarray(v, float)
    u, w = q[..., :3], q[..., 3:]
    t = 2.0 * cross(u, v)
    return v + w * t + cross(u, t)


def cross(u: ArrayLike, v: ArrayLike) -> Array:
    """Vector product; `numpy.cross` costs ten times as much on small arrays."""
    return _pairwise(_cross, u, v, 3)


def from_rotation_vector(phi: ArrayLike) -> Array:
    """Quaternion ``exp(phi)`` of a rotation by ``|phi|`` radians about `phi`."""
    return _each(_exponential, phi, 4, of=3)


def to_rotation_vector(q: ArrayLike) -> Array:
    """Rotation vector of `q`, at most pi long: the inverse of `from_rotation_vector`."""
    return _each(_logarithm, q, 3)


def from_matrix(a_from_b: ArrayLike) -> Array:
    """Quaternion of one 3 x 3 direction-cosine matrix, by the largest-element method.

    Shepperd 1978; the matrix is assumed orthonormal to rounding.
    """
    m = np.asarray(a_from_b, float)
    k = np.empty((4, 4))
    k[:3, :3] = m + m.T - np.trace(m) * np.eye(3)
    k[3, :3] = k[:3, 3] = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
    k[3, 3] = np.trace(m)
    return np.linalg.eigh(k)[1][:, -1]


def to_matrix(a_from_b: ArrayLike) -> Array:
    """Direction-cosine matrices ``(..., 3, 3)``."""
    return _each(_matrix, a_from_b, 9).reshape(*np.shape(a_from_b)[:-1], 3, 3)


def cross_matrix(v: ArrayLike) -> Array:
    """Matrices ``(..., 3, 3)`` with ``cross_matrix(v) @ u = v × u``."""
    v = np.asarray(v, float)
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1], out[..., 1, 2] = v[..., 0], -v[..., 0]
    out[..., 0, 2], out[..., 2, 0] = v[..., 1], -v[..., 1]
    out[..., 1, 0], out[..., 0, 1] = v[..., 2], -v[..., 2]
    return out


def _each(kernel: Callable[[Array, Array], None], a: ArrayLike, width: int, of: int = 4) -> Array:
    """A kernel over the rows of `a`, which are `of` wide."""
    a = _wide(a, of)
    out = np.empty((*a.shape[:-1], width))
    kernel(_rows(a, a.shape), out.reshape(-1, width))
    return out


def _wide(a: ArrayLike, width: int) -> Array:
    """As an array; compiled code would read past the end of a narrower one."""
    a = np.asarray(a, float)
    if a.shape[-1:] != (width,):
        raise ValueError(f"found shape {a.shape}; expected (..., {width})")
    return a


def _pairwise(kernel: Callable[[Array, Array, Array], None], a: ArrayLike, b: ArrayLike, of: int) -> Array:
    """A kernel over pairs of rows `of` wide, as numpy broadcasts them."""
    a, b = _wide(a, of), _wide(b, of)
    shape = a.shape if a.shape == b.shape else np.broadcast_shapes(a.shape, b.shape)
    out = np.empty(shape)
    kernel(_rows(a, shape), _rows(b, shape), out.reshape(-1, shape[-1]))
    return out


def _rows(a: Array, shape: tuple[int, ...]) -> Array:
    """`a` as rows, repeated to a shape."""
    whole = np.ascontiguousarray(a) if a.shape == shape else np.array(np.broadcast_to(a, shape))
    return whole.reshape(-1, shape[-1])


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
