"""Atmosphere along the flight: the result type, and the preflight atmosphere as one (thesis chapter 4).

The atmosphere extracted from the flight is computed in `edl_filter.postflight.density`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.database import Database
from edl_filter.errors import InputError
from edl_filter.planet.gas import Gas
from edl_filter.types import Array, BoolArray


@dataclass(frozen=True)
class AtmosphereProfile:
    """Atmosphere along the flight; arrays ``(N,)``, NaN where not valid.

    Attributes
    ----------
    time, altitude : arrays
        s and m.
    density, pressure, temperature : arrays
        kg/m³, Pa, K.
    mach, knudsen, ca, ca_sigma : arrays
        Mach number; Knudsen number on the diameter; the database's CA and its one sigma, a third of its 3 sigma.
    iterations : int
        Number of iterations until the relative change of the density is below 1e-8; 0 for a table.
    valid : array of bool
        Samples at which the atmosphere is defined.
    density_sigma, pressure_sigma, temperature_sigma : arrays
        One sigma: kg/m³, Pa, K.
    density_noise : array
        The part of `density_sigma` that is independent from batch to batch of samples, kg/m³; the rest is common to the
        flight.
    force_scale, moment_scale : (N, 2) arrays
        Relative one sigma of m/q and of 1/q, q the dynamic pressure with this density: noise, then the common part.
        With the flight's density mass and speed cancel in m/q, and the speed in 1/q.
    """

    time: Array
    altitude: Array
    density: Array
    pressure: Array
    temperature: Array
    mach: Array
    knudsen: Array
    ca: Array
    ca_sigma: Array
    iterations: int
    valid: BoolArray
    density_sigma: Array
    pressure_sigma: Array
    temperature_sigma: Array
    density_noise: Array
    force_scale: Array
    moment_scale: Array

    @property
    def from_drag(self) -> bool:
        """Whether the density is computed from the axial force and the database's CA."""
        return self.iterations > 0


def preflight_atmosphere(
    time: Array,
    altitude: Array,
    speed: Array,
    alpha_total: Array,
    density: Array,
    temperature: Array,
    database: Database,
    gas: Gas,
    diameter: float,
    *,
    density_sigma: float = 0.0,
    mass_relative: ArrayLike = 0.0,
    speed_sigma: ArrayLike = 0.0,
    altitude_sigma: ArrayLike = 0.0,
    gravity: ArrayLike = 0.0,
) -> AtmosphereProfile:
    """Preflight atmosphere along the flight, from the density and temperature of a table.

    Parameters
    ----------
    time, altitude, speed, alpha_total : (N,) arrays
        s, m, air-relative speed in m/s, rad.
    density, temperature : (N,) arrays
        Of the table at those altitudes, kg/m³ and K.
    database : Database
        Its CA is looked up.
    gas : Gas
        Of the atmosphere.
    diameter : float
        m.
    density_sigma : float
        Relative one sigma of the table's density, common to all altitudes; that of its pressure is the same (a
        hydrostatic table scaled as a whole), and its temperature has none.
    mass_relative : float or (N,) array
        Relative one sigma of the mass, for the coefficients.
    speed_sigma : float or (N,) array
        One sigma of the speed, m/s.
    altitude_sigma : float or (N,) array
        One sigma of the altitude at which the table is evaluated, m.
    gravity : float or (N,) array
        m/s²: with the temperature it gives the scale height, and with that the density error of an altitude error.

    Returns
    -------
    AtmosphereProfile

    Raises
    ------
    InputError
        The density does not decrease with altitude, or is not positive.
    """
    check_decreasing(altitude, density)
    mach, knudsen = gas.mach(speed, temperature), gas.knudsen(density, diameter)
    pressure = density * gas.constant * temperature
    by_speed = 2.0 * np.broadcast_to(np.asarray(speed_sigma, float), time.shape) / speed
    by_altitude = (
        np.broadcast_to(altitude_sigma, time.shape) * np.asarray(gravity, float) / (gas.constant * temperature)
    )
    density_relative = np.hypot(density_sigma, by_altitude)
    common = np.hypot(density_relative, by_speed)
    zeros = np.zeros(len(time))
    entry = database.lookup(mach, knudsen, alpha_total, speed)
    return AtmosphereProfile(
        time=time,
        altitude=altitude,
        density=density,
        pressure=pressure,
        temperature=temperature,
        mach=mach,
        knudsen=knudsen,
        ca=entry.ca,
        ca_sigma=entry.three_sigma.ca / 3.0,
        iterations=0,
        valid=np.ones(len(time), bool),
        density_sigma=density * density_relative,
        pressure_sigma=pressure * density_relative,
        temperature_sigma=zeros,
        density_noise=zeros,
        force_scale=np.stack((zeros, np.hypot(common, np.broadcast_to(mass_relative, time.shape))), axis=1),
        moment_scale=np.stack((zeros, common), axis=1),
    )


def scatter(mask: BoolArray, values: NDArray, fill: float = np.nan) -> NDArray:
    """Values of some samples as an array over all samples.

    Parameters
    ----------
    mask : (N,) array of bool
        The samples, K of N.
    values : (K, ...) array
        In any unit.
    fill : float
        Value at all other samples.

    Returns
    -------
    (N, ...) array
        Of the type and unit of `values`.
    """
    out = np.full((len(mask), *values.shape[1:]), fill, dtype=values.dtype)
    out[mask] = values
    return out


def check_decreasing(altitude: Array, density: Array) -> None:
    """Raise InputError where densities ``(N,)`` are not positive or increase with altitude ``(N,)``, m."""
    order = np.argsort(altitude, kind="stable")
    h, rho = altitude[order], density[order]
    bad = np.flatnonzero(~(rho > 0.0))
    if bad.size:
        raise InputError(
            f"Atmosphere: the density at {h[bad[0]]:.6g} m is {rho[bad[0]]:.4g} kg/m^3; it must be positive."
        )
    rise = np.flatnonzero((np.diff(h) > 0.0) & (np.diff(rho) > 0.0))
    if rise.size:
        i = int(rise[0])
        raise InputError(
            f"Atmosphere: density must decrease with altitude, but {rho[i + 1]:.4g} kg/m^3 at {h[i + 1]:.6g} m "
            f"is above {rho[i]:.4g} kg/m^3 at {h[i]:.6g} m."
        )
