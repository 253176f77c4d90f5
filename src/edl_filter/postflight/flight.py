"""Quantities derived from a reconstruction: air data, events, and the post-flight layer over both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.aero.conventions import attack_and_sideslip, total_angle
from edl_filter.effects.adapters import atmosphere_with_effects, database_with_effects
from edl_filter.effects.forward_model import compose_air_rotation, compose_body
from edl_filter.errors import InputError
from edl_filter.pipeline.forward_model import body_of, changed_bodies, database_of
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.postflight.airdata import AirData, air_data
from edl_filter.postflight.derive import PostflightResult, derive
from edl_filter.postflight.events import Event, events
from edl_filter.postflight.inputs import PostflightInputs, at_middles
from edl_filter.postflight.windows import Window
from edl_filter.telemetry.record import SAME_TIME
from edl_filter.telemetry.sample_filling import SHORTEST_BY_DYNAMICS
from edl_filter.telemetry.sample_repair import interpolated_stretches
from edl_filter.types import Array, BoolArray

#: Components of the air data that are interpolated to the middles of the samples.
_ALONG = (
    "altitude",
    "speed",
    "velocity_body",
    "flight_path_angle",
    "altitude_sigma",
    "speed_sigma",
    "flight_path_angle_sigma",
    "alpha_total_sigma",
)


@dataclass(frozen=True)
class DerivedQuantities:
    """Quantities derived from a reconstruction that are used more than once.

    Attributes
    ----------
    air : AirData
        Along the trajectory.
    events : dict
        Name → `Event`.
    postflight : PostflightResult or None
        Atmosphere and coefficients, where the mission names an aerodynamic database.
    """

    air: AirData
    events: dict[str, Event]
    postflight: PostflightResult | None


def derived_quantities(reconstruction: Reconstruction) -> DerivedQuantities:
    """Air data along the trajectory, events, atmosphere and coefficients."""
    r = reconstruction
    air = air_data(r.trajectory, r.planet, r.atmosphere, r.effects)
    return DerivedQuantities(air, events(r, air), derive_flight(r, air))


def derive_flight(reconstruction: Reconstruction, air: AirData) -> PostflightResult | None:
    """Atmosphere and coefficients of a reconstructed entry, up to the parachute.

    Parameters
    ----------
    reconstruction : Reconstruction
        With a mission that states the inertia.
    air : AirData
        Along its trajectory.

    Returns
    -------
    PostflightResult or None
        None where the mission names no aerodynamic database.

    Raises
    ------
    InputError
        The mission has no inertia, or a table cannot be used.
    """
    mission = reconstruction.mission
    if mission.aerodynamics is None:
        return None
    if mission.vehicle.inertia is None:
        raise InputError(f"{mission.source}: vehicle.inertia: found nothing; aerodynamics needs it for the moments.")
    return derive(postflight_inputs(reconstruction, air))


def postflight_inputs(reconstruction: Reconstruction, air: AirData) -> PostflightInputs:
    """All inputs of `derive`, at the middles of the samples.

    Force and rate of a sample are means over its interval and belong to its middle; the trajectory, which is defined at
    the ends of the intervals, is interpolated there by splines. Mass, inertia, air and centre of mass are those with
    the reconstruction's effects; so is the database, as far as effects change CA, CN and Cm. Rolling moment, damping
    and further torques are not in it.
    """
    mission, planet, trajectory = reconstruction.mission, reconstruction.problem.planet, reconstruction.trajectory
    vehicle, samples = mission.vehicle, reconstruction.problem.samples
    atmosphere = atmosphere_with_effects(reconstruction.atmosphere, reconstruction.effects)
    assert vehicle.inertia is not None and mission.aerodynamics is not None
    middle = {name: at_middles(air.time, getattr(air, name)) for name in _ALONG}
    speed = np.linalg.norm(middle["velocity_body"], axis=1)
    alpha, beta = attack_and_sideslip(middle["velocity_body"])
    position = at_middles(trajectory.time, trajectory.position)
    # the weight of the air is that in the frame in which it is at rest
    air_planet = compose_air_rotation(planet, reconstruction.effects)
    up = planet.enu_from_inertial(0.5 * (trajectory.time[1:] + trajectory.time[:-1]), position)[:, 2]
    parachute = reconstruction.event_times.get("parachute_deploy", float(trajectory.time[-1]))
    middles = samples.middle
    mass, (x, y, z), inertia = _mass_properties(reconstruction, middles, parachute)
    sensor = np.sqrt(np.diag(reconstruction.smoothed.covariance[0]))
    layout = reconstruction.filter_pass.layout

    def remaining(name: str) -> Array:
        """One sigma ``(3,)`` of the first instrument's remaining error."""
        return sensor[layout[name]] if name in layout else np.zeros(3)

    path, wind = middle["flight_path_angle"], mission.atmosphere.wind_sigma
    stated, low_pass_hz = mission.postflight.windows, mission.postflight.low_pass_hz
    return PostflightInputs(
        time=middles,
        altitude=middle["altitude"],
        speed=speed,
        gravity=-np.einsum("ni,ni->n", air_planet.apparent_gravity(position), up),
        geopotential=air_planet.geopotential(position),
        velocity_body=middle["velocity_body"],
        alpha=alpha,
        beta=beta,
        alpha_total=total_angle(middle["velocity_body"]),
        speed_sigma=middle["speed_sigma"],
        angle_sigma=np.hypot(middle["alpha_total_sigma"], wind / speed),
        altitude_sigma=middle["altitude_sigma"],
        sink_sigma=np.hypot(
            np.sin(path) * middle["speed_sigma"], speed * np.cos(path) * middle["flight_path_angle_sigma"]
        ),
        wind_sigma=wind * np.abs(np.cos(path)),
        specific_force=trajectory.specific_force[1:],
        angular_rate=trajectory.angular_rate[1:],
        force_noise=_noise_of_an_axis(samples.force_noise, samples.force_fill_sigma),
        rate_noise=_noise_of_an_axis(samples.rate_noise, samples.rate_fill_sigma),
        bias_sigma=remaining("accelerometer_bias"),
        alignment_sigma=float(np.max(remaining("accelerometer_misalignment"))),
        mass=mass,
        mass_sigma=vehicle.mass_sigma,
        diameter=vehicle.diameter,
        x_over_d=x,
        offset=(y, z),
        inertia=inertia,
        inertia_relative=vehicle.inertia_sigma,
        product_sigma=vehicle.inertia.product_sigma,
        gas=atmosphere.gas,
        database=database_with_effects(database_of(mission), reconstruction.effects),
        discrepancy=mission.aerodynamics.discrepancy_prior,
        preflight_density=atmosphere.density(middle["altitude"]),
        preflight_temperature=atmosphere.temperature_at(middle["altitude"]),
        preflight_sigma=mission.atmosphere.density_sigma,
        # a batch or a low-pass that contains the mortar's recoil would spread it over the samples before
        parachute=parachute - mission.postflight.batch_s - (0.0 if low_pass_hz is None else 1.0 / low_pass_hz),
        batch=mission.postflight.batch_s,
        low_pass_hz=low_pass_hz,
        top_temperature=mission.postflight.top_temperature,
        top_temperature_sigma=mission.postflight.top_temperature_sigma,
        windows=None if stated is None else tuple(Window(w.name, w.start_s, w.end_s) for w in stated),
        force_read=_is_read(reconstruction, samples.force_fill_sigma),
        rate_read=_is_read(reconstruction, samples.rate_fill_sigma),
    )


def _is_read(reconstruction: Reconstruction, fill_sigma: Array) -> BoolArray:
    """Whether an IMU has read each axis of a triad in each sample (N, 3), by the sigmas (N, 3) of its filled values.

    Stretches that no IMU has read are filled by the database's rotational dynamics, unless they are short: coefficients
    in them would be those of the database. Where rates are lost, forces have a sigma, too: those at the centre of mass
    depend on the rates.
    """
    samples = reconstruction.problem.samples
    middle, unread = samples.middle, np.zeros(len(samples.time), bool)
    for start, end in interpolated_stretches(reconstruction.telemetry):
        if end - start > SHORTEST_BY_DYNAMICS - SAME_TIME:
            unread |= (middle > start) & (middle < end)
    return np.asarray(~(unread[:, None] & (fill_sigma > 0.0)))


def _noise_of_an_axis(noise: Array, fill_sigma: Array) -> Array:
    """One sigma ``(N,)`` of noise ``(N, 3)``, root mean square over the axes, and of filled values, largest axis."""
    return np.asarray(np.sqrt(np.mean(noise**2, axis=1) + np.max(fill_sigma, axis=1) ** 2), np.float64)


def _mass_properties(
    reconstruction: Reconstruction, time: Array, end: float
) -> tuple[Array | float, tuple[Array | float, ...], Array]:
    """Mass (kg), centre of mass (diameters: behind the nose, right, down) and inertia (kg m²) with the effects.

    Of the vehicle at entry; a value for each of the times ``(N,)``, s, where an event changes it before `end` (s).
    """
    mission, effects = reconstruction.mission, reconstruction.effects
    vehicle, entry = mission.vehicle, body_of(mission)
    changes = [(t, body) for t, body in changed_bodies(entry, mission.vehicle_changes()) if t < end]
    bodies = [compose_body(body, effects) for body in (entry, *(body for _, body in changes))]
    centres = np.array([body.centre(vehicle.centre_of_mass, vehicle.diameter) for body in bodies])
    if not changes:
        return bodies[0].mass, tuple(centres[0].tolist()), bodies[0].inertia
    number = np.searchsorted([t for t, _ in changes], time, side="right")
    mass, inertia = np.array([body.mass for body in bodies]), np.stack([body.inertia for body in bodies])
    return mass[number], tuple(centres[number].T), inertia[number]
