"""Quaternions and rotation vectors, vectorised over the leading axes.

Quaternions are scalar-last ``[x, y, z, w]``. ``rotate(a_from_b, v)`` takes components in b to components in a, and
``multiply(a_from_b, b_from_c)`` is ``a_from_c``. The last axis holds the components of a quaternion or of a vector;
the leading axes broadcast as in numpy. (Shuster 1993, J. Astronaut. Sci. 41, 439, with the product in Hamilton's
order.)

The functions that are called thousands of times per second are compiled: on small arrays with strided components the
overhead of numpy's calls would make them ten times slower. Their loops are in `rotation_kernels`, which is imported
when the first of them is called: a process that only draws needs no numba.
"""

from functools import cache
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.types import Array


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
    return _apply_to_pairs("multiply", p, q, 4)


def product_matrix(p: ArrayLike) -> Array:
    """Matrix of a product with the left factor `p`: ``multiply(p, q)`` is ``product_matrix(p) @ q``.

    Parameters
    ----------
    p : (4,) array
        Quaternion.

    Returns
    -------
    (4, 4) array
    """
    x, y, z, w = np.asarray(p, float)
    return np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])


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
    return _apply_to_pairs("cross", u, v, 3)


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
    return _apply_to_rows("exponential", phi, 3, 4)


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
    return _apply_to_rows("logarithm", q, 4, 3)


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
    return _apply_to_rows("matrix", a_from_b, 4, 9).reshape(*np.shape(a_from_b)[:-1], 3, 3)


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
    return _apply_to_rows("right_jacobian", phi, 3, 9).reshape(*np.shape(phi), 3)


@cache
def _kernels() -> ModuleType:
    from edl_filter import rotation_kernels

    return rotation_kernels


def _apply_to_rows(kernel: str, a: ArrayLike, width: int, width_out: int) -> Array:
    """Apply a function of `rotation_kernels` to the rows of `a`, from ``(..., width)`` to ``(..., width_out)``."""
    a = _checked(a, width)
    out = np.empty((*a.shape[:-1], width_out))
    getattr(_kernels(), kernel)(_as_rows(a, a.shape), out.reshape(-1, width_out))
    return out


def _apply_to_pairs(kernel: str, a: ArrayLike, b: ArrayLike, width: int) -> Array:
    """Apply a function of `rotation_kernels` to pairs of rows of length `width`, broadcast as in numpy."""
    a, b = _checked(a, width), _checked(b, width)
    shape = a.shape if a.shape == b.shape else np.broadcast_shapes(a.shape, b.shape)
    out = np.empty(shape)
    getattr(_kernels(), kernel)(_as_rows(a, shape), _as_rows(b, shape), out.reshape(-1, shape[-1]))
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
