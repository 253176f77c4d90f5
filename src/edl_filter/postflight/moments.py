"""Moments about the centre of mass by Euler's equations with the full tensor (thesis eqs. 6.6 to 6.8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.types import Array

#: Elements of the tensor that are minus the products xy, xz and yz.
_PRODUCTS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class Moments:
    """Moments along the flight, N m.

    Attributes
    ----------
    moment : (N, 3) array
        About body x, y, z.
    sigma : (N, 3) array
        One sigma due to the noise of rates and angular acceleration.
    systematic : (N, 3) array
        One sigma due to those of the inertia, as a whole and of its products; common to the flight.
    rolling : dict
        The terms of the rolling moment by name, ``(N,)`` each; their sum is ``moment[:, 0]``. ``spin`` is the measured
        torque on an axisymmetric body, ``difference`` is due to unequal lateral moments of inertia, ``xy``, ``xz`` and
        ``yz`` to the off-diagonal elements of the tensor.
    """

    moment: Array
    sigma: Array
    systematic: Array
    rolling: dict[str, Array]


def euler(
    rate: Array,
    acceleration: Array,
    inertia: Array,
    rate_sigma: Array | float = 0.0,
    acceleration_sigma: Array | float = 0.0,
    inertia_relative: float = 0.0,
    product_sigma: ArrayLike = 0.0,
) -> Moments:
    """Moments by Euler's equations, ``M = I α + ω × (I ω)``.

    Parameters
    ----------
    rate, acceleration : (N, 3) arrays
        rad/s and rad/s², body axes.
    inertia : (3, 3) or (N, 3, 3) array
        Tensor about the centre of mass, kg m²; off-diagonal elements are minus the products of inertia.
    rate_sigma, acceleration_sigma : float or (N,) array
        One sigma of each component, rad/s and rad/s²; taken as independent.
    inertia_relative : float
        Relative one sigma of the tensor as a whole: the moments scale with it.
    product_sigma : float or (3,) array
        One sigma of the products of inertia xy, xz and yz, independent of each other, kg m².

    Returns
    -------
    Moments

    Raises
    ------
    InputError
        The tensor is not that of a physical body.
    """
    check_inertia(inertia)
    momentum = tensor_product(inertia, rate)
    moment = tensor_product(inertia, acceleration) + np.cross(rate, momentum)
    # dM/dω = [ω×] I − [(I ω)×]
    by_rate = rotations.cross_matrix(rate) @ inertia - rotations.cross_matrix(momentum)
    spread = np.sqrt(np.sum(inertia**2, axis=-1))
    sigma_rate = np.broadcast_to(np.asarray(rate_sigma, float), rate.shape[:1])[:, None]
    sigma_acceleration = np.broadcast_to(np.asarray(acceleration_sigma, float), rate.shape[:1])[:, None]
    sigma = np.hypot(sigma_acceleration * spread, sigma_rate * np.linalg.norm(by_rate, axis=2))
    variance = (moment * inertia_relative) ** 2
    for (row, column), product in zip(_PRODUCTS, np.broadcast_to(np.asarray(product_sigma, float), (3,)), strict=True):
        if product > 0.0:
            change = np.zeros((3, 3))
            change[row, column] = change[column, row] = product
            variance += (acceleration @ change + np.cross(rate, rate @ change)) ** 2
    return Moments(moment, sigma, np.sqrt(variance), rolling_terms(rate, acceleration, inertia))


def tensor_product(tensor: Array, vectors: Array) -> Array:
    """Product of a tensor ``(3, 3)``, or of one for each row ``(N, 3, 3)``, with the rows of ``(N, 3)``."""
    return vectors @ tensor.T if tensor.ndim == 2 else np.einsum("nij,nj->ni", tensor, vectors)


def rolling_terms(rate: Array, acceleration: Array, inertia: Array) -> dict[str, Array]:
    """Terms of the rolling moment (eq. 6.6).

    Parameters
    ----------
    rate, acceleration : (N, 3) arrays
        rad/s and rad/s², body axes.
    inertia : (3, 3) or (N, 3, 3) array
        kg m².

    Returns
    -------
    dict
        Name → ``(N,)`` array, N m; the names are those of `Moments`.
    """
    p, q, r = rate.T
    roll, pitch, yaw = acceleration.T
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = np.moveaxis(inertia, (-2, -1), (0, 1))
    return {
        "spin": ixx * roll,
        "difference": (izz - iyy) * q * r,
        "xy": ixy * (pitch - p * r),
        "xz": ixz * (yaw + p * q),
        "yz": iyz * (q**2 - r**2),
    }


def check_inertia(inertia: Array) -> None:
    """Raise InputError where the tensor is not that of a physical body.

    Parameters
    ----------
    inertia : (3, 3) or (N, 3, 3) array
        kg m².

    Raises
    ------
    InputError
        It is not symmetric, not positive definite, or one principal moment exceeds the sum of the other two.
    """
    if inertia.shape[1:] == (3, 3):
        for tensor in np.unique(inertia, axis=0):
            check_inertia(tensor)
        return
    if inertia.shape != (3, 3) or not np.all(np.isfinite(inertia)) or not np.allclose(inertia, inertia.T):
        raise InputError(f"Inertia must be a finite symmetric (3, 3) tensor in kg m^2; found {inertia.tolist()}.")
    least, _, most = np.linalg.eigvalsh(inertia)
    if least <= 0.0:
        raise InputError(f"Inertia is not positive definite: its least principal moment is {least:.4g} kg m^2.")
    if most > (np.trace(inertia) - most) * (1.0 + 1e-9):
        raise InputError(
            f"Inertia: the principal moment {most:.4g} kg m^2 exceeds the sum of the other two; no body has that."
        )
