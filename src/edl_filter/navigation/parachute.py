"""Measurement model of the flow at parachute deployment: axial force or dynamic pressure, and Mach number.

All are compared as logarithms. The density falls exponentially with altitude, so that the logarithm of the dynamic
pressure is nearly linear in the state even where the altitude has a sigma of kilometres; and the errors (density, wind,
coefficient, mass, temperature) are relative ones. The wind's error is common to all components.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from edl_filter import rotations
from edl_filter.aero.conventions import total_angle
from edl_filter.aero.database import Database
from edl_filter.navigation.constraints import local_velocity
from edl_filter.navigation.layout import Layout
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import Gas
from edl_filter.types import Array


@dataclass(frozen=True)
class DeploymentFlow:
    """Flow about the vehicle at many states, as the constraints at parachute deployment need it.

    Attributes
    ----------
    altitude, speed, density, mach, knudsen, alpha_total : (S,) arrays
        m, m/s, kg/m³, -, -, rad.
    flight_path : (S,) array
        Air-relative, rad, positive up.
    """

    altitude: Array
    speed: Array
    density: Array
    mach: Array
    knudsen: Array
    alpha_total: Array
    flight_path: Array

    @property
    def dynamic_pressure(self) -> Array:
        """``ρ V² / 2`` ``(S,)``, Pa."""
        return 0.5 * self.density * self.speed**2


@dataclass(frozen=True)
class FlowModel:
    """Flow and axial coefficient of a state, with the preflight atmosphere.

    Attributes
    ----------
    planet : Planet
        Whose rotation the air follows.
    atmosphere : Atmosphere
    gas : Gas
    diameter : float
        Reference length, m.
    database : Database or None
        For CA; None where no component needs it.
    """

    planet: Planet
    atmosphere: Atmosphere
    gas: Gas
    diameter: float
    database: Database | None = None

    def at(self, time: float, nav: Array) -> DeploymentFlow:
        """Flow of the states `nav` (10 or 14, S) at `time` (s)."""
        altitude, velocity, enu = local_velocity(self.planet, time, nav, self.atmosphere)
        speed = np.linalg.norm(velocity, axis=1)
        body = rotations.rotate(rotations.conjugate(nav[6:10].T), np.einsum("sji,sj->si", enu, velocity))
        density = self.atmosphere.density(altitude)
        return DeploymentFlow(
            altitude=altitude,
            speed=speed,
            density=density,
            mach=self.gas.mach(speed, self.atmosphere.temperature_at(altitude)),
            knudsen=self.gas.knudsen(density, self.diameter),
            alpha_total=total_angle(body),
            flight_path=np.arcsin(velocity[:, 2] / speed),
        )

    def axial_coefficient(self, flow: DeploymentFlow) -> tuple[Array, Array]:
        """CA of the database and its sigma, a third of its 3 sigma, ``(S,)`` each."""
        assert self.database is not None
        entry = self.database.lookup(flow.mach, flow.knudsen, flow.alpha_total, flow.speed)
        return entry.ca, entry.three_sigma.ca / 3.0


def _log_axial_force(model: FlowModel, flow: DeploymentFlow) -> Array:
    """Logarithm of the axial force over the reference area, q CA in Pa."""
    return np.log(flow.dynamic_pressure * model.axial_coefficient(flow)[0])


#: Component → what a flow predicts for it.
PREDICTIONS: dict[str, Callable[[FlowModel, DeploymentFlow], Array]] = {
    "log axial force (1)": _log_axial_force,
    "log dynamic pressure (1)": lambda model, flow: np.log(flow.dynamic_pressure),
    "log Mach number (1)": lambda model, flow: np.log(flow.mach),
}
AXIAL_FORCE, DYNAMIC_PRESSURE, MACH = PREDICTIONS


@dataclass(frozen=True)
class ParachuteDeployment:
    """Logarithms of what was measured of the flow at parachute deployment.

    Attributes
    ----------
    time : float
        s.
    components : tuple of str
        Keys of `PREDICTIONS`: axial force over the reference area (Pa), dynamic pressure (Pa), Mach number.
    measured : (m,) array
        Their logarithms.
    noise : (m, m) array
        Covariance of those: measurements, preflight density and temperature, wind, mass and coefficient together.
    model : FlowModel
    source : str
    """

    name: ClassVar[str] = "parachute"
    time: float
    components: tuple[str, ...]
    measured: Array
    noise: Array
    model: FlowModel
    source: str

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Logarithms of the flow's quantities with the preflight atmosphere, ``(S, m)``."""
        flow = self.model.at(self.time, nav)
        return np.stack([PREDICTIONS[c](self.model, flow) for c in self.components], axis=1)
