"""The atmosphere along the flight, and the one expected before it (thesis chapter 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.database import Database
from edl_filter.errors import InputError
from edl_filter.postflight.gas import Gas

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class FlightAtmosphere:
    """Atmosphere along the flight; arrays ``(N,)``, NaN where not valid.

    Attributes
    ----------
    time, altitude : arrays
        s and m.
    density, pressure, temperature : arrays
        kg/m³, Pa, K.
    mach, knudsen, ca, ca_sigma : arrays
        The Knudsen number on the diameter; the database's CA and its one sigma, a third of its 3 sigma.
    iterations : int
        Until the density changed by less than 1e-8 of itself; 0 for a table.
    valid : array of bool
    density_sigma, pressure_sigma, temperature_sigma : arrays
        One sigma.
    density_noise : array
        The part of `density_sigma` that changes from batch to batch of samples, kg/m³; the rest is common to the
        flight.
    force_scale, moment_scale : (N, 2) arrays
        Relative one sigma of m/q and of 1/q, q the dynamic pressure, with these densities: noise, then the common part.
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
    valid: Bools
    density_sigma: Array
    pressure_sigma: Array
    temperature_sigma: Array
    density_noise: Array
    force_scale: Array
    moment_scale: Array

    @property
    def from_drag(self) -> bool:
        """Whether the density was made from the axial force with the database's CA."""
        return self.iterations > 0


def preflight(
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
) -> FlightAtmosphere:
    """The same quantities from the density and temperature of a table at the flight's altitudes.

    Parameters
    ----------
    density_sigma : float
        Relative one sigma of the table's density, common to all altitudes; that of its pressure is the same (a
        hydrostatic table scaled as a whole), and its temperature has none.
    mass_relative : float or (N,) array
        Relative one sigma of the mass, for the coefficients.
    altitude_sigma : float or (N,) array
        m: the table is entered with an altitude that is off by as much.
    gravity : float or (N,) array
        m/s²: with the temperature it gives the scale height, over which the density at a wrong altitude is off.
    others
        As for `flight_extracted`; arrays ``(N,)``.

    Raises
    ------
    InputError
        The density does not decrease with altitude, or is not positive.
    """
    check_decreasing(altitude, density)
    mach, knudsen = gas.mach(speed, temperature), gas.knudsen(density, diameter)
    pressure = density * gas.constant * temperature
    fast = 2.0 * np.broadcast_to(np.asarray(speed_sigma, float), time.shape) / speed
    high = np.broadcast_to(altitude_sigma, time.shape) * np.asarray(gravity, float) / (gas.constant * temperature)
    density_relative = np.hypot(density_sigma, high)
    common = np.hypot(density_relative, fast)
    none = np.zeros(len(time))
    found = database.lookup(mach, knudsen, alpha_total, speed)
    return FlightAtmosphere(
        time=time,
        altitude=altitude,
        density=density,
        pressure=pressure,
        temperature=temperature,
        mach=mach,
        knudsen=knudsen,
        ca=found.ca,
        ca_sigma=found.three_sigma.ca / 3.0,
        iterations=0,
        valid=np.ones(len(time), bool),
        density_sigma=density * density_relative,
        pressure_sigma=pressure * density_relative,
        temperature_sigma=none,
        density_noise=none,
        force_scale=np.stack((none, np.hypot(common, np.broadcast_to(mass_relative, time.shape))), axis=1),
        moment_scale=np.stack((none, common), axis=1),
    )


def check_decreasing(altitude: Array, density: Array) -> None:
    """Refuse densities that are not positive or that rise with altitude."""
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
