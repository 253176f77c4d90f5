"""Moments about the centre of mass by Euler's equations with the full tensor (thesis eqs. 6.6 to 6.8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Moments:
    """Moments along the flight, N m.

    Attributes
    ----------
    moment : (N, 3) array
        About body x, y, z.
    sigma : (N, 3) array
        One sigma, from the noise of rates and angular acceleration.
    systematic : (N, 3) array
        One sigma, from the inertia's relative sigma; common to the flight.
    rolling : dict
        The terms of the rolling moment by name, ``(N,)`` each; they add up to ``moment[:, 0]``. ``spin`` is the
        measured torque on an axisymmetric body, ``difference`` is due to unequal lateral moments, ``xy``, ``xz`` and
        ``yz`` to the tensor's elements off the diagonal.
    """

    moment: Array
    sigma: Array
    systematic: Array
    rolling: dict[str, Array]

    @property
    def inertia_coupling(self) -> Array:
        """All terms of the rolling moment but ``spin``, N m."""
        return np.sum([v for k, v in self.rolling.items() if k != "spin"], axis=0)


def euler(
    rate: Array,
    acceleration: Array,
    inertia: Array,
    rate_sigma: Array | float = 0.0,
    acceleration_sigma: Array | float = 0.0,
    inertia_relative: float = 0.0,
) -> Moments:
    """``M = I α + ω × (I ω)``.

    Parameters
    ----------
    rate, acceleration : (N, 3) arrays
        rad/s and rad/s², body axes.
    inertia : (3, 3) array
        Tensor about the centre of mass, kg m²; elements off its diagonal are minus the products.
    rate_sigma, acceleration_sigma : float or (N,) array
        One sigma of each component, taken as independent.
    inertia_relative : float
        Relative one sigma of the tensor as a whole: the moments scale with it.

    Raises
    ------
    InputError
        The tensor is not that of a body.
    """
    check_inertia(inertia)
    momentum = rate @ inertia.T
    moment = acceleration @ inertia.T + np.cross(rate, momentum)
    # dM/dω = [ω×] I − [(I ω)×]
    by_rate = _cross(rate) @ inertia - _cross(momentum)
    spread = np.sqrt(np.sum(inertia**2, axis=1))
    s_rate = np.broadcast_to(np.asarray(rate_sigma, float), rate.shape[:1])[:, None]
    s_turn = np.broadcast_to(np.asarray(acceleration_sigma, float), rate.shape[:1])[:, None]
    sigma = np.hypot(s_turn * spread, s_rate * np.linalg.norm(by_rate, axis=2))
    return Moments(moment, sigma, np.abs(moment) * inertia_relative, rolling_terms(rate, acceleration, inertia))


def rolling_terms(rate: Array, acceleration: Array, inertia: Array) -> dict[str, Array]:
    """The rolling moment (eq. 6.6), term by term, N m."""
    p, q, r = rate.T
    roll, pitch, yaw = acceleration.T
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = inertia
    return {
        "spin": ixx * roll,
        "difference": (izz - iyy) * q * r,
        "xy": ixy * (pitch - p * r),
        "xz": ixz * (yaw + p * q),
        "yz": iyz * (q**2 - r**2),
    }


def check_inertia(inertia: Array) -> None:
    """Refuse a tensor that no body has."""
    if inertia.shape != (3, 3) or not np.all(np.isfinite(inertia)) or not np.allclose(inertia, inertia.T):
        raise InputError(f"Inertia must be a finite symmetric (3, 3) tensor in kg m^2; found {inertia.tolist()}.")
    least, _, most = np.linalg.eigvalsh(inertia)
    if least <= 0.0:
        raise InputError(f"Inertia is not positive definite: its least principal moment is {least:.4g} kg m^2.")
    if most > (np.trace(inertia) - most) * (1.0 + 1e-9):
        raise InputError(
            f"Inertia: the principal moment {most:.4g} kg m^2 exceeds the sum of the other two; no body has that."
        )


def _cross(v: Array) -> Array:
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.stack((zero, -z, y, z, zero, -x, -y, x, zero), axis=1).reshape(-1, 3, 3)
