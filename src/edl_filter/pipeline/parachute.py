"""The constraint at parachute deployment, from a mission and its telemetry.

The axial force gives the dynamic pressure ``q = m a / (CA S)`` without the preflight atmosphere. That is information on
q, and through the preflight density on the speed: ``V = √(2 q / ρ)``, with half of the density's relative sigma. The
target of a trigger that computes q from the same deceleration adds nothing to it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from edl_filter.effects.adapters import database_with_effects
from edl_filter.effects.base import EffectInstance
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.estimation import ParachuteDeploymentConfig
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.parachute import (
    AXIAL_FORCE,
    DYNAMIC_PRESSURE,
    MACH,
    DeploymentFlow,
    FlowModel,
    ParachuteDeployment,
)
from edl_filter.navigation.trajectory import propagate_state
from edl_filter.pipeline.forward_model import body_before, database_of
from edl_filter.pipeline.load import event_time_sigma
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.record import InitialState, Telemetry
from edl_filter.types import Array

#: The line through the axial force ends so many sigmas of the event's time before it.
TIME_SIGMAS = 3.0


def parachute_deployment(
    mission: Mission,
    telemetry: Telemetry,
    samples: Samples,
    planet: Planet,
    air_planet: Planet,
    atmosphere: Atmosphere,
    initial: InitialState,
    time: float,
    effects: Sequence[EffectInstance],
) -> ParachuteDeployment:
    """The constraint of a mission that states what was measured at deployment.

    The size of relative errors (wind over speed, sigma of CA) is taken at the dead-reckoned state.

    Parameters
    ----------
    mission : Mission
        With `constraints.parachute` stated.
    telemetry : Telemetry
        Without the effects.
    samples : Samples
        Of the driving instrument.
    planet, air_planet : Planet
        For gravity, and for the rotation of the air.
    atmosphere : Atmosphere
        With the effects.
    initial : InitialState
        Entry state.
    time : float
        Of the deployment, s.
    effects : sequence of EffectInstance
        Whose vehicle and coefficients the constraint assumes.

    Raises
    ------
    InputError
        The samples do not contain the window of the axial force, or it is no deceleration.
    """
    stated = mission.constraints.parachute
    assert isinstance(stated, ParachuteDeploymentConfig)
    database = database_with_effects(database_of(mission), effects) if mission.aerodynamics is not None else None
    model = FlowModel(air_planet, atmosphere, atmosphere.gas, mission.vehicle.diameter, database)
    flow = model.at(time, _dead_reckoned(samples, initial, planet, time)[:, None])
    density = mission.atmosphere.density_sigma
    wind = mission.atmosphere.wind_sigma * float(np.cos(flow.flight_path[0]) / flow.speed[0])
    components: list[str] = []
    logs: list[float] = []
    common: list[tuple[float, float]] = []  # relative sigma of the density and of the wind in each component
    own: list[float] = []
    sources: list[str] = []

    def add(component: str, value: float, sigma: float, shared: tuple[float, float], source: str) -> None:
        components.append(component)
        logs.append(float(np.log(value)))
        own.append(sigma)
        common.append(shared)
        sources.append(source)

    if stated.axial_force_window_s is not None:
        force, sigma, source = _axial_force(mission, telemetry, samples, model, flow, time, effects)
        add(AXIAL_FORCE, force, sigma, (density, 2.0 * wind), source)
    if stated.dynamic_pressure is not None:
        assert stated.dynamic_pressure_sigma is not None
        sigma = stated.dynamic_pressure_sigma / stated.dynamic_pressure
        add(DYNAMIC_PRESSURE, stated.dynamic_pressure, sigma, (density, 2.0 * wind), "dynamic pressure at deployment")
    if stated.mach is not None:
        assert stated.mach_sigma is not None and stated.temperature_sigma is not None
        temperature = float(atmosphere.temperature_at(flow.altitude)[0])
        sigma = float(np.hypot(stated.mach_sigma / stated.mach, 0.5 * stated.temperature_sigma / temperature))
        add(MACH, stated.mach, sigma, (0.0, wind), "Mach number at deployment")
    loading = np.array(common)
    noise = np.diag(np.square(own)) + loading @ loading.T
    return ParachuteDeployment(time, tuple(components), np.array(logs), noise, model, "; ".join(sources))


def _dead_reckoned(samples: Samples, initial: InitialState, planet: Planet, time: float) -> Array:
    """State ``(10,)`` at `time` (s), from the stated entry state without sensor errors."""
    part = samples.part(samples.index(initial.time), samples.index(time))
    start = np.concatenate((initial.position, initial.velocity, initial.inertial_from_body))
    if not len(part.time):
        return start
    path = propagate_state(start, part.interval, part.force, part.rate, planet.mu, planet.j2, planet.gravity_radius)
    return np.asarray(path[-1])


def _axial_force(
    mission: Mission,
    telemetry: Telemetry,
    samples: Samples,
    model: FlowModel,
    flow: DeploymentFlow,
    time: float,
    effects: Sequence[EffectInstance],
) -> tuple[float, float, str]:
    """Axial force over the reference area, q CA (Pa), its relative sigma without that of the air, and its source.

    A line through the samples of the window before deployment, at the deployment: the dynamic pressure changes by a
    percent in a second. The mortar's recoil is not in it.
    """
    stated = mission.constraints.parachute
    assert isinstance(stated, ParachuteDeploymentConfig) and stated.axial_force_window_s is not None
    assert mission.aerodynamics is not None
    window = stated.axial_force_window_s
    last = samples.index(time - TIME_SIGMAS * event_time_sigma(mission, telemetry, "parachute_deploy"))
    first = samples.index(time - window)
    if last - first < 2:
        raise InputError(
            f"{mission.source}: constraints.parachute.axial_force_window_s: found {window:g} s, in which there are "
            f"{max(last - first, 0)} samples before {TIME_SIGMAS:g} sigmas of the event's time; at least 2 are needed."
        )
    part = samples.part(first, last)
    design = np.stack((np.ones(last - first), part.middle - time), axis=1)
    weights = np.linalg.pinv(design)[0]
    deceleration = -float(weights @ part.mean_force[:, 0])
    if deceleration <= 0.0:
        raise InputError(
            f"{mission.source}: constraints.parachute.axial_force_window_s: the axial specific force before "
            f"{time:g} s is {-deceleration:.3g} m/s^2; a deceleration is negative. Check the sign of the x axis of the "
            f"IMU '{telemetry.driving.name}' and the event's time; 'edl-filter validate' lists what its samples lack."
        )
    errors = telemetry.driving.errors[int(part.unit[-1])]
    noise = float(np.sqrt(weights**2 @ part.force_noise[:, 0] ** 2))
    vehicle = mission.vehicle
    force = body_before(mission, time, effects).mass * deceleration / vehicle.reference_area
    ca, ca_sigma = (float(value[0]) for value in model.axial_coefficient(flow))
    relative = (
        np.hypot(noise, errors.accelerometer_bias) / deceleration,
        errors.accelerometer_scale,
        vehicle.mass_sigma / vehicle.mass,
        mission.aerodynamics.coefficient_sigma * ca_sigma / ca,
    )
    sigma = float(np.linalg.norm(relative))
    pressure = force / ca
    source = (
        f"axial force: {deceleration:.2f} m/s^2, with CA {ca:.3f} a dynamic pressure of {pressure:.0f} ± "
        f"{sigma * pressure:.0f} Pa"
    )
    return force, sigma, source
