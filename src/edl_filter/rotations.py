"""Quaternions and rotation vectors, vectorised over the first axes.

Scalar-last ``[x, y, z, w]``; ``rotate(a_from_b, v)`` takes components in b to components in a, and
``multiply(a_from_b, b_from_c)`` is ``a_from_c``. Shapes broadcast like numpy's; the last axis is the
quaternion's or the vector's. (Shuster 1993, J. Astronaut. Sci. 41, 439, with the product in
Hamilton's order.)
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def multiply(p: ArrayLike, q: ArrayLike) -> Array:
    """Hamilton product ``p ⊗ q``: first q, then p."""
    p, q = np.asarray(p, float), np.asarray(q, float)
    px, py, pz, pw = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    qx, qy, qz, qw = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty(np.broadcast_shapes(p.shape, q.shape))
    out[..., 0] = pw * qx + px * qw + py * qz - pz * qy
    out[..., 1] = pw * qy - px * qz + py * qw + pz * qx
    out[..., 2] = pw * qz + px * qy - py * qx + pz * qw
    out[..., 3] = pw * qw - px * qx - py * qy - pz * qz
    return out


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
    u, v = np.asarray(u, float), np.asarray(v, float)
    ux, uy, uz = u[..., 0], u[..., 1], u[..., 2]
    vx, vy, vz = v[..., 0], v[..., 1], v[..., 2]
    out = np.empty(np.broadcast_shapes(u.shape, v.shape))
    out[..., 0] = uy * vz - uz * vy
    out[..., 1] = uz * vx - ux * vz
    out[..., 2] = ux * vy - uy * vx
    return out


def from_rotation_vector(phi: ArrayLike) -> Array:
    """Quaternion ``exp(phi)`` of a rotation by ``|phi|`` radians about `phi`."""
    phi = np.asarray(phi, float)
    half = 0.5 * np.linalg.norm(phi, axis=-1, keepdims=True)
    out = np.empty((*phi.shape[:-1], 4))
    out[..., :3] = 0.5 * np.sinc(half / np.pi) * phi
    out[..., 3:] = np.cos(half)
    return out


def to_rotation_vector(q: ArrayLike) -> Array:
    """Rotation vector of `q`, at most pi long: the inverse of `from_rotation_vector`."""
    q = np.asarray(q, float)
    q = np.where(q[..., 3:] < 0.0, -q, q)
    s = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(s, q[..., 3:])
    # angle / s tends to 2 / w as s tends to 0
    factor = np.divide(angle, s, out=2.0 / np.maximum(np.abs(q[..., 3:]), 0.5), where=s > 1e-12)
    return factor * q[..., :3]


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
    q = np.asarray(a_from_b, float)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[..., 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    out[..., 0, 1], out[..., 1, 0] = 2.0 * (x * y - z * w), 2.0 * (x * y + z * w)
    out[..., 0, 2], out[..., 2, 0] = 2.0 * (x * z + y * w), 2.0 * (x * z - y * w)
    out[..., 1, 2], out[..., 2, 1] = 2.0 * (y * z - x * w), 2.0 * (y * z + x * w)
    return out


def cross_matrix(v: ArrayLike) -> Array:
    """Matrices ``(..., 3, 3)`` with ``cross_matrix(v) @ u = v × u``."""
    v = np.asarray(v, float)
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1], out[..., 1, 2] = v[..., 0], -v[..., 0]
    out[..., 0, 2], out[..., 2, 0] = v[..., 1], -v[..., 1]
    out[..., 1, 0], out[..., 0, 1] = v[..., 2], -v[..., 2]
    return out
