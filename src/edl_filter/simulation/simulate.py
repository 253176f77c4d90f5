"""From a scenario to a flight: draw what is left to chance, fly, measure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.effects.effect import Active
from edl_filter.effects.readings import in_order
from edl_filter.effects.world import World
from edl_filter.errors import InputError
from edl_filter.mission.sections import DEG
from edl_filter.modelling import world_of
from edl_filter.reading import read_atmosphere
from edl_filter.simulation import chance
from edl_filter.simulation.entry import attitude, inertial_state
from edl_filter.simulation.flight import Flight, stated_state, true_course
from edl_filter.simulation.motion import Course, Motion, fly
from edl_filter.simulation.parachute import Parachute
from edl_filter.simulation.scenario import Scenario
from edl_filter.simulation.sensors import draw_errors, read, true_means
from edl_filter.telemetry.flight_file import FlightContents, FlightImu
from edl_filter.telemetry.record import AltimeterRecord, LandingFix, ParachuteFix

Array = NDArray[np.float64]

#: Streams of chance, one for each purpose, so that a change of one leaves the others as they were.
_ENTRY, _WEATHER, _STATED, _FIXES, _ALTIMETER, _IMUS = range(6)


def simulate(scenario: Scenario, effects: Sequence[Active] | None = None, seed: int | None = None) -> Flight:
    """Simulate a flight.

    With the same seed everything that is drawn is the same, whatever the effects.

    Parameters
    ----------
    scenario : Scenario
    effects : sequence of Active, optional
        Switched on in place of the scenario's own.
    seed : int, optional
        In place of the scenario's own.

    Returns
    -------
    Flight

    Raises
    ------
    InputError
        The scenario's tables are missing, or its vehicle does not come down.
    """
    seed = scenario.seed if seed is None else seed
    effects = scenario.active_effects() if effects is None else tuple(effects)
    _check_imus(effects, scenario)
    world = flown_world(scenario, effects, _random(seed, _WEATHER))
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
    motion = fly(world, chute, true_start(scenario, world, _random(seed, _ENTRY)), course)
    imus, errors = _measured(scenario, world, motion, effects, seed)
    fixes = _random(seed, _FIXES)
    truth: dict[str, Any] = {
        **true_course(world, motion, course.substeps),
        "seed": seed,
        "scenario": s.name,
        "events": {"parachute_deploy": motion.deployed, "landing": motion.landed, "rest": motion.stopped},
        "effects": _recorded(effects),
        "sensor_errors": errors,
    }
    contents = FlightContents(
        name=s.name,
        planet=world.planet.name,
        epoch_utc=s.epoch_utc,
        prime_meridian_at_epoch=world.planet.prime_meridian_at_epoch,
        imus=imus,
        initial=stated_state(_random(seed, _STATED), motion, s.stated_state.sigma, effects),
        events={
            "parachute_deploy": (motion.deployed, s.parachute.time_sigma_s),
            "landing": (motion.landed, s.landing.time_sigma_s),
        },
        parachute=_parachute_fix(scenario, world, motion, fixes),
        landing=_landing_fix(scenario, world, motion, fixes),
        altimeter=_altimeter(scenario, motion, _random(seed, _ALTIMETER)),
        truth=truth,
    )
    return Flight(contents, world, motion)


def _random(seed: int, *purpose: int) -> np.random.Generator:
    return np.random.default_rng([seed, *purpose])


def flown_world(scenario: Scenario, effects: Sequence[Active], random: np.random.Generator) -> World:
    """The nominal model with effects, and with the atmosphere's own errors."""
    mission = scenario.model
    angle = None if scenario.prime_meridian_deg is None else scenario.prime_meridian_deg * DEG
    world = world_of(mission, mission.planet_model(angle), read_atmosphere(mission), ())
    w = scenario.weather
    return world.having((*effects, *chance.weather(random, w.density_sigma, w.wind_sigma, w.correlation_length)))


def true_start(scenario: Scenario, world: World, random: np.random.Generator) -> Array:
    """Position, velocity, attitude and rates at time 0, ``(13,)``."""
    e = scenario.entry
    position, velocity = inertial_state(
        world.planet, e.radius, e.latitude_deg * DEG, e.longitude_deg * DEG, e.speed, e.flight_path_angle_deg * DEG,
        e.azimuth_deg * DEG,
    )  # fmt: skip
    drawn = random.standard_normal(4)
    alpha, beta = np.array([e.angle_of_attack_deg, e.sideslip_deg]) * DEG + e.attitude_sigma_deg * DEG * drawn[:2]
    turned = attitude(
        world.planet.velocity_relative(position, velocity), position, float(alpha), float(beta), e.bank_deg * DEG
    )
    rates = np.array([e.spin_rpm * np.pi / 30.0, *(e.rate_sigma_deg_s * DEG * drawn[2:])])
    return np.concatenate((position, velocity, turned, rates))


def _check_imus(effects: Sequence[Active], scenario: Scenario) -> None:
    for a in effects:
        if a.imu is not None and a.imu not in scenario.imus:
            known = ", ".join(scenario.imus)
            raise InputError(f"effect {a.name}: imu: found {a.imu!r}, but there is no such IMU; accepted: {known}.")


def _measured(
    scenario: Scenario, world: World, motion: Motion, effects: Sequence[Active], seed: int
) -> tuple[dict[str, FlightImu], dict[str, dict[str, Array]]]:
    """IMUs and their constant errors, by name."""
    imus, errors = {}, {}
    # positions are stated from the centre of mass without effects, wherever the mission puts that
    offset = world.rigid_body.offset - world.body.offset
    for k, (name, imu) in enumerate(scenario.imus.items()):
        instrument = imu.instrument(scenario.sampling.interval_s)
        inside = [a for a in in_order(effects) if (a.imu or "primary") == name]
        arm = instrument.position - offset
        for a in effects:
            if (a.imu or "primary") == name:
                arm = arm + a.effect.imu_position(a.values)
        random = _random(seed, _IMUS, k)
        drawn = draw_errors(random, instrument.sigmas)
        means = true_means(motion, arm, instrument.interval, instrument.gyro_delay, inside)
        imus[name], errors[name] = read(random, instrument, drawn, *means), drawn
    return imus, errors


def _parachute_fix(scenario: Scenario, world: World, motion: Motion, random: np.random.Generator) -> ParachuteFix:
    time = np.array([motion.deployed])
    s = motion.at(time)
    pressure = float(world.flow(time, s[:, :3], s[:, 3:6], s[:, 6:10], s[:, 10:13]).dynamic_pressure[0])
    sigma = scenario.parachute.dynamic_pressure_sigma * pressure
    return ParachuteFix(motion.deployed, pressure + sigma * random.standard_normal(), sigma)


def _landing_fix(scenario: Scenario, world: World, motion: Motion, random: np.random.Generator) -> LandingFix:
    rest = motion.at(np.array([motion.stopped]))[0, :3]
    sigma = scenario.landing.position_sigma
    position = world.planet.rotation.to_fixed(motion.stopped, rest) + sigma * random.standard_normal(3)
    return LandingFix(motion.stopped, position, np.full(3, sigma))


def _altimeter(scenario: Scenario, motion: Motion, random: np.random.Generator) -> AltimeterRecord | None:
    if scenario.altimeter is None:
        return None
    each, surface = scenario.sampling.substeps, scenario.landing.surface_radius
    if scenario.altimeter.interval_s is not None:
        each *= max(1, round(scenario.altimeter.interval_s / scenario.sampling.interval_s))
    time = motion.time[each::each]
    height = np.linalg.norm(motion.state[each::each, :3], axis=1) - surface
    seen = (height < scenario.altimeter.highest) & (time > motion.deployed) & (time <= motion.landed + 1e-9)
    noise = scenario.altimeter.sigma * random.standard_normal(int(seen.sum()))
    return AltimeterRecord(time[seen], height[seen] + noise, scenario.altimeter.sigma, surface)


def _recorded(effects: Sequence[Active]) -> dict[str, dict[str, Any]]:
    """Effects and their parameters for ``/truth``; of several alike the later ones are numbered."""
    out: dict[str, dict[str, Any]] = {}
    for a in effects:
        count = sum(name.split("#")[0] == a.name for name in out)
        values = {key: float(value) for key, value in a.values.items()}
        out[f"{a.name}#{count + 1}" if count else a.name] = values | ({"imu": a.imu} if a.imu else {})
    return out
