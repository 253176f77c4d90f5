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
    px, py, pz, pw = np.moveaxis(p, -1, 0)
    qx, qy, qz, qw = np.moveaxis(q, -1, 0)
    return np.stack(
        (
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ),
        axis=-1,
    )


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
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def from_rotation_vector(phi: ArrayLike) -> Array:
    """Quaternion ``exp(phi)`` of a rotation by ``|phi|`` radians about `phi`."""
    phi = np.asarray(phi, float)
    half = 0.5 * np.linalg.norm(phi, axis=-1, keepdims=True)
    return np.concatenate((0.5 * np.sinc(half / np.pi) * phi, np.cos(half)), axis=-1)


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
    columns = [rotate(q, e) for e in np.eye(3)]
    return np.stack(columns, axis=-1)


def cross_matrix(v: ArrayLike) -> Array:
    """Matrices ``(..., 3, 3)`` with ``cross_matrix(v) @ u = v × u``."""
    v = np.asarray(v, float)
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack(
        (np.stack((o, -z, y), -1), np.stack((z, o, -x), -1), np.stack((-y, x, o), -1)), axis=-2
    )
