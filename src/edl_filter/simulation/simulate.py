"""From a scenario to a flight: draw the random quantities, integrate the motion, simulate the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.sensor_chain import effects_in, moved_position
from edl_filter.errors import InputError
from edl_filter.mission.fields import DEG
from edl_filter.pipeline.forward_model import changed_bodies, forward_model_of
from edl_filter.pipeline.load import changed_position, read_atmosphere
from edl_filter.planet import Planet, ellipsoid
from edl_filter.simulation import chance
from edl_filter.simulation.flight import Flight, stated_state, true_course
from edl_filter.simulation.motion import Course, Motion, fly
from edl_filter.simulation.parachute import Parachute
from edl_filter.simulation.scenario import DRIVING, Scenario
from edl_filter.simulation.sensors import draw_errors, read, true_means
from edl_filter.simulation.world_errors import WorldErrors
from edl_filter.telemetry.flight_file_writer import FlightContents, FlightImu
from edl_filter.telemetry.record import AltimeterRecord, LandingFix, ParachuteFix
from edl_filter.types import Array

#: Streams of random numbers, one for each purpose, so that a change of one does not change the others.
_ENTRY, _WEATHER, _STATED, _FIXES, _ALTIMETER, _IMUS = range(6)


def simulate(
    scenario: Scenario,
    effects: Sequence[EffectInstance] | None = None,
    seed: int | None = None,
    errors: WorldErrors | None = None,
) -> Flight:
    """Simulate a flight.

    With the same seed all random quantities are the same, independent of the effects.

    Parameters
    ----------
    scenario : Scenario
        Entry conditions, instruments, errors.
    effects : sequence of EffectInstance, optional
        Switched on in place of the scenario's own.
    seed : int, optional
        In place of the scenario's own.
    errors : WorldErrors, optional
        Differences of the flown world and entry state from the nominal ones, in addition to what the scenario draws.

    Returns
    -------
    Flight

    Raises
    ------
    InputError
        The scenario's tables are missing, or its vehicle does not reach the surface.
    """
    seed = scenario.seed if seed is None else seed
    effects = scenario.active_effects() if effects is None else tuple(effects)
    _check_imus(effects, scenario)
    errors = WorldErrors() if errors is None else errors
    forward_model = errors.applied(flown_world(scenario, effects, _random(seed, _WEATHER)))
    s = scenario
    course = Course(
        interval=s.sampling.interval_s,
        substeps=s.sampling.substeps,
        deploy_pressure=s.parachute.dynamic_pressure,
        surface_radius=s.landing.surface_radius,
        stop=s.landing.stop_s,
        rest=s.landing.rest_s,
    )
    parachute = s.model.vehicle.parachute
    assert parachute is not None  # the scenario is checked
    chute = Parachute(parachute.area_diameter, s.parachute.arm, s.parachute.inflation_s)
    motion = fly(forward_model, chute, errors.moved(true_start(scenario, forward_model, _random(seed, _ENTRY))), course)
    imus, sensor_errors = _measured(scenario, forward_model, motion, effects, seed, errors.imu_scale)
    fixes = _random(seed, _FIXES)
    truth: dict[str, Any] = {
        **true_course(forward_model, motion, course.substeps),
        "seed": seed,
        "scenario": s.name,
        "events": {"parachute_deploy": motion.deployed, "landing": motion.landed, "rest": motion.stopped},
        "vehicle_events": {name: event.stated() for name, event in s.events.items()},
        "effects": _recorded(effects),
        "sensor_errors": sensor_errors,
    }
    contents = FlightContents(
        name=s.name,
        planet=forward_model.planet.name,
        epoch_utc=s.epoch_utc,
        prime_meridian_at_epoch=forward_model.planet.prime_meridian_at_epoch,
        imus=imus,
        initial=stated_state(_random(seed, _STATED), motion, s.stated_state.sigma, effects),
        events={
            "parachute_deploy": (motion.deployed, s.parachute.time_sigma_s),
            "landing": (motion.landed, s.landing.time_sigma_s),
            **{name: (event.time_s, event.sigma_s) for name, event in s.events.items()},
        },
        parachute=_parachute_fix(scenario, forward_model, motion, fixes),
        landing=_landing_fix(scenario, forward_model, motion, fixes),
        altimeter=_altimeter(scenario, motion, _random(seed, _ALTIMETER)),
        truth=truth,
    )
    return Flight(contents, forward_model, motion)


def _random(seed: int, *purpose: int) -> np.random.Generator:
    return np.random.default_rng([seed, *purpose])


def flown_world(scenario: Scenario, effects: Sequence[EffectInstance], random: np.random.Generator) -> ForwardModel:
    """The nominal model with the scenario's events, with effects and with random errors of the atmosphere."""
    mission = scenario.model
    angle = None if scenario.prime_meridian_deg is None else scenario.prime_meridian_deg * DEG
    nominal = forward_model_of(mission, mission.planet_model(angle), read_atmosphere(mission), ())
    events = [(event.time_s, event) for event in scenario.events.values()]
    forward_model = replace(nominal, changed_bodies=changed_bodies(nominal.body, events))
    w = scenario.weather
    return forward_model.with_effects(
        (*effects, *chance.weather(random, w.density_sigma, w.wind_sigma, w.correlation_length))
    )


def true_start(scenario: Scenario, forward_model: ForwardModel, random: np.random.Generator) -> Array:
    """State at time 0, ``(13,)``: position (m), velocity (m/s), attitude (scalar last), rates (rad/s)."""
    e = scenario.entry
    position, velocity = inertial_state(
        forward_model.planet, e.radius, e.latitude_deg * DEG, e.longitude_deg * DEG, e.speed,
        e.flight_path_angle_deg * DEG, e.azimuth_deg * DEG,
    )  # fmt: skip
    deviates = random.standard_normal(4)
    alpha, beta = np.array([e.angle_of_attack_deg, e.sideslip_deg]) * DEG + e.attitude_sigma_deg * DEG * deviates[:2]
    inertial_from_body = attitude(
        forward_model.planet.velocity_relative(position, velocity),
        position,
        float(alpha),
        float(beta),
        e.bank_deg * DEG,
    )
    rates = np.array([e.spin_rpm * np.pi / 30.0, *(e.rate_sigma_deg_s * DEG * deviates[2:])])
    return np.concatenate((position, velocity, inertial_from_body, rates))


def inertial_state(
    planet: Planet,
    radius: float,
    latitude: float,
    longitude: float,
    speed: float,
    flight_path_angle: float,
    azimuth: float,
) -> tuple[Array, Array]:
    """Inertial position and velocity at time 0.

    Parameters
    ----------
    planet : Planet
        Rotation at time 0.
    radius : float
        From the planet's centre, m.
    latitude, longitude : float
        Areocentric, rad, planet-fixed.
    speed : float
        Inertial, m/s.
    flight_path_angle : float
        Of the inertial velocity above the local horizontal (of the sphere), rad: negative downwards.
    azimuth : float
        Of the inertial velocity from north towards east, rad.

    Returns
    -------
    position, velocity : (3,) arrays
        m and m/s.
    """
    fixed = ellipsoid.fixed_from_areocentric(latitude, longitude, radius)
    enu = planet.enu_at(0.0, latitude, longitude)
    level = np.cos(flight_path_angle)
    local = speed * np.array([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(flight_path_angle)])
    return planet.rotation.to_inertial(0.0, fixed), local @ enu


def attitude(air_velocity: Array, position: Array, alpha: float, beta: float, bank: float) -> Array:
    """Attitude from the angles of the air-relative velocity and a bank angle.

    Parameters
    ----------
    air_velocity, position : (3,) arrays
        Inertial components, m/s and m.
    alpha, beta : float
        ``alpha = atan2(w, u)``, ``beta = asin(v / V)``, rad.
    bank : float
        Rotation about the velocity, rad: at zero, with both angles zero, body z is in the vertical plane, downwards.

    Returns
    -------
    (4,) array
        ``inertial_from_body``, scalar last and not negative: without a rule rounding, which differs between processors,
        would choose between the two signs of the same attitude.
    """
    forward = air_velocity / np.linalg.norm(air_velocity)
    right = rotations.cross(-position, forward)
    right /= np.linalg.norm(right)
    wind = rotations.from_matrix(np.column_stack((forward, right, rotations.cross(forward, right))))
    turns = [rotations.from_rotation_vector(v) for v in ([bank, 0.0, 0.0], [0.0, 0.0, -beta], [0.0, alpha, 0.0])]
    out = wind
    for turn in turns:
        out = rotations.multiply(out, turn)
    return rotations.normalise(-out if out[3] < 0.0 else out)


def _check_imus(effects: Sequence[EffectInstance], scenario: Scenario) -> None:
    for a in effects:
        if a.imu is not None and a.imu not in scenario.imus:
            names = ", ".join(scenario.imus)
            raise InputError(f"effect {a.name}: imu: found {a.imu!r}, but there is no such IMU; accepted: {names}.")


def _measured(
    scenario: Scenario,
    forward_model: ForwardModel,
    motion: Motion,
    effects: Sequence[EffectInstance],
    seed: int,
    error_scale: float,
) -> tuple[dict[str, FlightImu], dict[str, dict[str, Array]]]:
    """Readings of the IMUs and their constant errors, by name."""
    imus, errors = {}, {}
    # positions are stated from the mission's centre of mass, that is without effects
    offset = forward_model.rigid_body.offset - forward_model.body.offset
    changes = [(event.time_s, event) for event in scenario.events.values()]
    middle = 0.5 * (motion.time[1:] + motion.time[:-1])
    for k, (name, imu) in enumerate(scenario.imus.items()):
        instrument = imu.instrument(scenario.sampling.interval_s)
        inside = effects_in(effects, name, driving=name == DRIVING)
        stated = np.tile(instrument.position, (len(middle), 1))
        arm = moved_position(changed_position(stated, name, middle, changes) - offset, inside)
        random = _random(seed, _IMUS, k)
        constant_errors = {key: error_scale * e for key, e in draw_errors(random, instrument.sigmas).items()}
        means = true_means(motion, arm, instrument.interval, instrument.gyro_delay, inside)
        imus[name], errors[name] = read(random, instrument, constant_errors, *means), constant_errors
    return imus, errors


def _parachute_fix(
    scenario: Scenario, forward_model: ForwardModel, motion: Motion, random: np.random.Generator
) -> ParachuteFix:
    time = np.array([motion.deployed])
    s = motion.at(time)
    pressure = float(forward_model.flow(time, s[:, :3], s[:, 3:6], s[:, 6:10], s[:, 10:13]).dynamic_pressure[0])
    sigma = scenario.parachute.dynamic_pressure_sigma * pressure
    return ParachuteFix(motion.deployed, pressure + sigma * random.standard_normal(), sigma)


def _landing_fix(
    scenario: Scenario, forward_model: ForwardModel, motion: Motion, random: np.random.Generator
) -> LandingFix:
    rest = motion.at(np.array([motion.stopped]))[0, :3]
    sigma = scenario.landing.position_sigma
    position = forward_model.planet.rotation.to_fixed(motion.stopped, rest) + sigma * random.standard_normal(3)
    return LandingFix(motion.stopped, position, np.full(3, sigma))


def _altimeter(scenario: Scenario, motion: Motion, random: np.random.Generator) -> AltimeterRecord | None:
    """Heights above the ground at the touchdown, which is up to one interval's descent below the scenario's surface."""
    if scenario.altimeter is None:
        return None
    each, surface = scenario.sampling.substeps, scenario.landing.surface_radius
    if scenario.altimeter.interval_s is not None:
        each *= max(1, round(scenario.altimeter.interval_s / scenario.sampling.interval_s))
    time, radius = motion.time[each::each], np.linalg.norm(motion.state[each::each, :3], axis=1)
    ground = float(np.linalg.norm(motion.state[np.searchsorted(motion.time, motion.landed - 1e-9), :3]))
    height = radius - surface
    seen = (height < scenario.altimeter.highest) & (time > motion.deployed) & (time <= motion.landed + 1e-9)
    noise = scenario.altimeter.sigma * random.standard_normal(int(seen.sum()))
    return AltimeterRecord(time[seen], radius[seen] - ground + noise, scenario.altimeter.sigma, ground)


def _recorded(effects: Sequence[EffectInstance]) -> dict[str, dict[str, Any]]:
    """Effects and their parameters for ``/truth``; several of one name are numbered from the second."""
    out: dict[str, dict[str, Any]] = {}
    for a in effects:
        count = sum(name.split("#")[0] == a.name for name in out)
        values = {key: float(value) for key, value in a.values.items()}
        out[f"{a.name}#{count + 1}" if count else a.name] = values | ({"imu": a.imu} if a.imu else {})
    return out
