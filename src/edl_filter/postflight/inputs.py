"""Inputs of the post-flight layer as arrays, and quantities at the middles of the samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from edl_filter.aero.database import Database
from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.errors import InputError
from edl_filter.estimation.interpolating_spline import InterpolatingSpline
from edl_filter.planet.gas import Gas
from edl_filter.postflight.rates import BATCH
from edl_filter.postflight.windows import Window
from edl_filter.types import Array, BoolArray


@dataclass(frozen=True)
class PostflightInputs:
    """All inputs of the post-flight layer. Arrays run over the middles of the samples (`at_middles`).

    Attributes
    ----------
    time : (N,) array
        Middles of the samples' intervals, s.
    altitude, speed, gravity : (N,) arrays
        m; air-relative, m/s; apparent gravity (with the centrifugal acceleration) along the vertical, m/s².
    geopotential : (N,) array
        Potential of the apparent gravity, m²/s², growing upwards.
    velocity_body : (N, 3) array
        Air-relative, m/s.
    alpha, beta, alpha_total : (N,) arrays
        rad.
    speed_sigma, angle_sigma : (N,) arrays
        One sigma: of the speed, from the smoother, m/s; of the direction of the air-relative velocity in a plane, wind
        included, rad.
    altitude_sigma, sink_sigma, wind_sigma : float or (N,) arrays
        One sigma of the altitude, m; of the vertical velocity, m/s; and of the wind's component along the speed, m/s.
        Each is one error common to the flight.
    specific_force, angular_rate : (N, 3) arrays
        Means over the samples at the centre of mass without sensor errors: m/s², rad/s.
    force_noise, rate_noise : (N,) arrays
        One sigma of one sample, m/s² and rad/s.
    bias_sigma : (3,) array
        One sigma of the accelerometers' remaining bias, m/s².
    alignment_sigma : float
        One sigma of the accelerometers' remaining misalignment, rad.
    mass : float or (N,) array
        kg.
    mass_sigma : float
        One sigma of the mass, kg.
    diameter : float
        m.
    x_over_d : float or (N,) array
        Centre of mass behind the nose, diameters.
    offset : tuple of float or of (N,) array
        Centre of mass to the right of the axis (+y) and below it (+z), diameters.
    inertia : (3, 3) or (N, 3, 3) array
        kg m². It has a value for each sample, as mass and centre of mass have, where an event changes the vehicle.
    inertia_relative : float
        Relative one sigma of the inertia.
    product_sigma : tuple of float
        One sigma of the products of inertia xy, xz and yz, kg m².
    gas : Gas
    database : Database
    discrepancy : DiscrepancyPrior
        Correlation of the error of CA over the flow.
    preflight_density, preflight_temperature : (N,) arrays
        Of the preflight table at the flight's altitudes, kg/m³ and K.
    preflight_sigma : float
        Relative one sigma of that density.
    parachute : float
        Last time that is used, s: the parachute, or a little before it.
    top_temperature, top_temperature_sigma : float, optional
        K: isothermal above the first valid sample; with None the pressure is zero there, as in the thesis.
    batch : float
        Length of the smoothing batch, s.
    low_pass_hz : float, optional
        Half-power frequency of one pass of a low-pass of forces and rates before the batches, Hz.
    windows : sequence of Window, optional
        Instead of those that are determined from the flight.
    force_read, rate_read : (N, 3) boolean arrays, optional
        Whether an IMU has read the specific force along, and the rate about, each axis; by default all.
    """

    time: Array
    altitude: Array
    speed: Array
    gravity: Array
    geopotential: Array
    velocity_body: Array
    alpha: Array
    beta: Array
    alpha_total: Array
    speed_sigma: Array
    angle_sigma: Array
    specific_force: Array
    angular_rate: Array
    force_noise: Array
    rate_noise: Array
    bias_sigma: Array
    mass: Array | float
    diameter: float
    x_over_d: Array | float
    inertia: Array
    gas: Gas
    database: Database
    discrepancy: DiscrepancyPrior
    preflight_density: Array
    preflight_temperature: Array
    parachute: float
    preflight_sigma: float = 0.0
    alignment_sigma: float = 0.0
    mass_sigma: float = 0.0
    inertia_relative: float = 0.0
    product_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    top_temperature: float | None = None
    top_temperature_sigma: float = 0.0
    batch: float = BATCH
    low_pass_hz: float | None = None
    windows: Sequence[Window] | None = None
    offset: tuple[Array | float, Array | float] = (0.0, 0.0)
    altitude_sigma: Array | float = 0.0
    sink_sigma: Array | float = 0.0
    wind_sigma: Array | float = 0.0
    force_read: BoolArray | None = None
    rate_read: BoolArray | None = None

    def until_parachute(self) -> PostflightInputs:
        """The samples up to the parachute."""
        before, n = self.time <= self.parachute, len(self.time)
        if before.sum() < 2:
            raise InputError(f"Post-flight: no samples before the parachute at {self.parachute:.6g} s.")

        def cut(name: str, value: Any) -> Any:
            if name == "offset":
                return tuple(cut("", component) for component in value)
            along = isinstance(value, np.ndarray) and value.shape[:1] == (n,) and name != "bias_sigma"
            return value[before] if along and not (name == "inertia" and value.ndim == 2) else value

        return PostflightInputs(**{f.name: cut(f.name, getattr(self, f.name)) for f in fields(self)})


def at_middles(time: Array, values: Array) -> Array:
    """Values of a smooth quantity at the middles of its intervals, by cubic splines.

    Parameters
    ----------
    time : (N,) array
        Ends of the intervals, s.
    values : (N, ...) array
        At those times, in any unit.

    Returns
    -------
    (N - 1, ...) array
        In the unit of `values`.
    """
    degree = 3 if len(time) > 3 else 1
    at = InterpolatingSpline.through(time, values.reshape(len(time), -1), degree)(0.5 * (time[1:] + time[:-1]))
    return at.reshape(-1, *values.shape[1:])
