"""Flight coefficients from forces and moments (thesis eqs. 6.1 to 6.5), with bands.

CA acts along −x, CN along −z, CY along +y; Cl, Cm and Cn about x, y and z at the centre of mass; reference π D²/4 and
D. With the flight's density CA equals the database's, from which that density is computed; with another density it is a
measurement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.conventions import reference_area
from edl_filter.postflight.atmosphere import AtmosphereProfile
from edl_filter.postflight.moments import Moments
from edl_filter.types import Array, BoolArray

FORCES = ("CA", "CN", "CY")
MOMENTS = ("Cl", "Cm", "Cn")
NAMES = FORCES + MOMENTS


@dataclass(frozen=True)
class FlightCoefficients:
    """Coefficients by name (`NAMES`), ``(N,)`` each; NaN where the atmosphere is NaN, and where no IMU has read.

    Attributes
    ----------
    value : dict
    noise, systematic : dict
        One sigma of the part of the error that is independent from batch to batch of samples, and of the part that is
        common to the flight.
    dynamic_pressure : array
        Pa.
    """

    value: dict[str, Array]
    noise: dict[str, Array]
    systematic: dict[str, Array]
    dynamic_pressure: Array

    def sigma(self, name: str) -> Array:
        """One sigma ``(N,)`` of the coefficient called `name`, noise and common part together."""
        return np.hypot(self.noise[name], self.systematic[name])


def flight_coefficients(
    force: Array,
    force_noise: Array,
    bias_sigma: ArrayLike,
    moments: Moments,
    atmosphere: AtmosphereProfile,
    speed: Array,
    mass: ArrayLike,
    diameter: float,
    alignment_sigma: float = 0.0,
    force_read: BoolArray | None = None,
    rate_read: BoolArray | None = None,
) -> FlightCoefficients:
    """Coefficients with one of the atmospheres.

    Parameters
    ----------
    force : (N, 3) array
        Smoothed specific force at the centre of mass, m/s².
    force_noise : (N,) array
        Its one sigma per axis, m/s².
    bias_sigma : float or (3,) array
        m/s², per axis.
    moments : Moments
        About the centre of mass, N m.
    atmosphere : AtmosphereProfile
        Density along the flight.
    speed : (N,) array
        Air-relative, m/s.
    mass : float or (N,) array
        kg.
    diameter : float
        m.
    alignment_sigma : float
        One sigma of the rotation of the accelerometers' axes relative to the body's, rad: that fraction of the axial
        force is an error of the lateral ones.
    force_read, rate_read : (N, 3) boolean arrays, optional
        Whether an IMU has read the force along, and the rate about, each axis. Coefficients of axes that none has read
        are NaN.

    Returns
    -------
    FlightCoefficients

    Notes
    -----
    Linear bands: the force's own noise and bias, and the relative sigma of m/q or 1/q that the atmosphere states. CA
    with the flight's density has the database's sigma alone, because the force cancels in it.
    """
    area = reference_area(diameter)
    q = 0.5 * atmosphere.density * speed**2
    per_force, per_moment = np.asarray(mass, float) / (q * area), 1.0 / (q * area * diameter)
    bias = np.broadcast_to(np.asarray(bias_sigma, float), (3,))
    value: dict[str, Array] = {}
    noise: dict[str, Array] = {}
    systematic: dict[str, Array] = {}
    leakage = alignment_sigma * np.abs(force[:, 0])
    for name, axis, sign in (("CA", 0, -1.0), ("CN", 2, -1.0), ("CY", 1, 1.0)):
        value[name] = sign * per_force * force[:, axis]
        if axis == 0 and atmosphere.from_drag:
            noise[name], systematic[name] = np.where(np.isfinite(q), 0.0, np.nan), atmosphere.ca_sigma
            continue
        size, scale = np.abs(value[name]), atmosphere.force_scale
        misaligned = leakage if axis else 0.0
        noise[name] = np.hypot(per_force * force_noise, size * scale[:, 0])
        systematic[name] = np.hypot(per_force * np.hypot(bias[axis], misaligned), size * scale[:, 1])
    for axis, name in enumerate(MOMENTS):
        value[name] = per_moment * moments.moment[:, axis]
        size, scale = np.abs(value[name]), atmosphere.moment_scale
        noise[name] = np.hypot(per_moment * moments.sigma[:, axis], size * scale[:, 0])
        systematic[name] = np.hypot(per_moment * moments.systematic[:, axis], size * scale[:, 1])
    for axes, read in (({"CA": 0, "CY": 1, "CN": 2}, force_read), ({"Cl": 0, "Cm": 1, "Cn": 2}, rate_read)):
        if read is not None:
            for quantity in (value, noise, systematic):
                quantity |= {name: np.where(read[:, axis], quantity[name], np.nan) for name, axis in axes.items()}
    return FlightCoefficients(value, noise, systematic, q)
