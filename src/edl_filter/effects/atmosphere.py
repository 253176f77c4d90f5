"""Effects in the atmosphere: density, winds, and the rotation of the air with the planet."""

from __future__ import annotations

import numpy as np

from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.types import Array

#: Height over which a wind layer begins and ends, m.
_SHEAR = 2e3


class DensityScale(Effect):
    """``rho (1 + k)``."""

    name = "density_scale"
    family = "atmosphere"
    summary = "relative change of the density at all altitudes: rho (1 + k)"
    shows = "All forces and moments, and the dynamic pressure at the parachute, differ by one factor at all altitudes."
    source = "season and dust against a preflight model; Withers and Smith (2006)"
    parameters = (Parameter("k", "", "relative change of the density", 0.1, low=-0.9, high=4.0),)

    def density(self, p: Values, altitude: Array) -> Array:
        """The same factor at all altitudes."""
        return np.full(len(altitude), 1.0 + p["k"])


class DensityWave(Effect):
    """``rho (1 + A sin(2 pi h / L + phase))``."""

    name = "density_wave"
    family = "atmosphere"
    summary = "wave in the density: rho (1 + A sin(2 pi h/L + phase))"
    shows = (
        "Axial force, lateral forces and moments oscillate together about the model with altitude, two to six times "
        "between 80 and 10 km."
    )
    source = "thermal tides and gravity waves in entry profiles; Withers and Smith (2006)"
    parameters = (
        Parameter("A", "", "amplitude, relative", 0.1, low=-0.9, high=0.9),
        Parameter("L", "m", "vertical wavelength", kind="length", low=8e3, high=25e3, scan=28, default=14e3),
        Parameter("phase", "rad", "phase at altitude zero", kind="phase", low=0.0, high=2.0 * np.pi, scan=8),
    )
    half_turn = ("A",)

    def density(self, p: Values, altitude: Array) -> Array:
        """Factor of the wave."""
        return 1.0 + p["A"] * np.sin(2.0 * np.pi * altitude / p["L"] + p["phase"])


class Wind(Effect):
    """A layer of wind with the profile ``½[tanh((h − h_lo)/s) − tanh((h − h_hi)/s)]``, s = 2 km."""

    name = "wind"
    family = "atmosphere"
    summary = "layer of wind between two altitudes, with edges 2 km wide"
    shows = (
        "Within the layer the direction of the air-relative velocity differs: lateral forces and moments as of an "
        "angle of attack whose direction is fixed to the ground; largest where the flight is slow."
    )
    region = "one layer; below and above it the mission's own winds"
    source = "general circulation models of Mars: tens of m/s, more in jets"
    parameters = (
        Parameter("east", "m/s", "velocity of the air towards east", 40.0, low=-300.0, high=300.0),
        Parameter("north", "m/s", "velocity of the air towards north", 40.0, low=-300.0, high=300.0),
        Parameter("h_lo", "m", "lower edge", kind="altitude", low=-5e3, high=60e3, scan=24, default=5e3),
        Parameter("h_hi", "m", "upper edge", kind="altitude", low=5e3, high=100e3, scan=24, default=25e3),
    )

    def wind(self, p: Values, altitude: Array) -> Array:
        """Wind of the layer, ``(N, 2)``, m/s, at altitudes ``(N,)``, m."""
        inside = 0.5 * (np.tanh((altitude - p["h_lo"]) / _SHEAR) - np.tanh((altitude - p["h_hi"]) / _SHEAR))
        return inside[:, None] * np.array([p["east"], p["north"]])


class AtmosphereRotation(Effect):
    """The air rotates at (1 − k) of the planet's rate."""

    name = "atmosphere_rotation"
    family = "atmosphere"
    summary = "the air rotates at (1 - k) of the planet's rate"
    shows = (
        "A wind from the east of up to 240 m/s at the equator, at all altitudes: residuals of lateral forces and "
        "moments that grow as the vehicle decelerates, and of the dynamic pressure at the parachute."
    )
    source = "Thomas (2011), section 3.3 and eq. 3.6 assume rigid rotation; k = 1 is air at rest in inertial space"
    parameters = (Parameter("k", "", "part of the rotation that is missing", 1.0, low=-2.0, high=3.0),)

    def atmosphere_rate(self, p: Values) -> float:
        """Factor 1 − k."""
        return 1.0 - p["k"]


EFFECTS = (DensityScale, DensityWave, Wind, AtmosphereRotation)
