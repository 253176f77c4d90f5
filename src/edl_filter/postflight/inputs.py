"""What the post-flight layer needs, on arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.aero.database import Database
from edl_filter.errors import InputError
from edl_filter.postflight.gas import Gas
from edl_filter.postflight.rates import BATCH
from edl_filter.postflight.windows import Window

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DeriveInputs:
    """All that the layer needs. Arrays run over the samples' middles (`at_middles`).

    Attributes
    ----------
    time : (N,) array
        Middles of the samples' intervals, s.
    altitude, speed, gravity : (N,) arrays
        m; air-relative, m/s; along the vertical, m/s².
    velocity_body : (N, 3) array
        Air-relative, m/s.
    alpha, beta, alpha_total : (N,) arrays
        rad.
    speed_sigma, angle_sigma : (N,) arrays
        One sigma: of the speed, from the smoother, m/s; of the air's direction in a plane, wind included, rad.
    altitude_sigma, sink_sigma, wind_sigma : float or (N,) arrays
        One sigma of the altitude, m; of the vertical velocity; and of what the wind adds to the speed, m/s. Each is one
        error common to the flight.
    specific_force, angular_rate : (N, 3) arrays
        Means over the samples at the centre of mass, sensor errors taken off: m/s², rad/s.
    force_noise, rate_noise : (N,) arrays
        One sigma of one sample.
    bias_sigma : (3,) array
        What is left of the accelerometers' bias, m/s².
    alignment_sigma : float
        What is left of the accelerometers' alignment, rad.
    mass : float or (N,) array
        kg.
    mass_sigma : float
        kg.
    diameter, x_over_d : float
        m; centre of mass behind the nose, diameters.
    offset : tuple of float
        Centre of mass right of the axis (+y) and below it (+z), diameters.
    inertia : (3, 3) array
        kg m².
    inertia_relative : float
        Relative one sigma of it.
    gas : Gas
    database : Database
    preflight_density, preflight_temperature : (N,) arrays
        Of the table at the flight's altitudes.
    preflight_sigma : float
        Relative one sigma of that density.
    parachute : float
        Last time to be used, s: the parachute, or a little before it.
    top_temperature, top_temperature_sigma : float, optional
        K: isothermal above the first valid sample; None begins with no pressure there, as the thesis does.
    batch : float
        Length of the smoothing batch, s.
    windows : sequence of Window, optional
        Instead of those found from the flight.
    """

    time: Array
    altitude: Array
    speed: Array
    gravity: Array
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
    x_over_d: float
    inertia: Array
    gas: Gas
    database: Database
    preflight_density: Array
    preflight_temperature: Array
    parachute: float
    preflight_sigma: float = 0.0
    alignment_sigma: float = 0.0
    mass_sigma: float = 0.0
    inertia_relative: float = 0.0
    top_temperature: float | None = None
    top_temperature_sigma: float = 0.0
    batch: float = BATCH
    windows: Sequence[Window] | None = None
    offset: tuple[float, float] = (0.0, 0.0)
    altitude_sigma: Array | float = 0.0
    sink_sigma: Array | float = 0.0
    wind_sigma: Array | float = 0.0

    def until_parachute(self) -> DeriveInputs:
        """The samples up to the parachute."""
        keep, n = self.time <= self.parachute, len(self.time)
        if keep.sum() < 2:
            raise InputError(f"Post-flight: no samples before the parachute at {self.parachute:.6g} s.")

        def cut(name: str) -> Any:
            value = getattr(self, name)
            along = isinstance(value, np.ndarray) and value.shape[:1] == (n,) and name not in ("inertia", "bias_sigma")
            return value[keep] if along else value

        return DeriveInputs(**{f.name: cut(f.name) for f in fields(self)})
