"""From a mission and its telemetry to the filter's problem: entry state and constraints.

The mission says which statements are to be used and how well they are known; the telemetry, or the mission
itself, holds the values. Nothing is estimated here but means over windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.effects.air import air_planet, changed_atmosphere, gravity_planet
from edl_filter.effects.effect import Active
from edl_filter.effects.readings import check_imus, corrected_record, moved_record
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.estimation import LandingSite, StatedState
from edl_filter.mission.measurements import FlightFile
from edl_filter.mission.measurements import MerImu as MerMission
from edl_filter.mission.sections import FromTelemetry
from edl_filter.modelling import body_of
from edl_filter.navigation import constraints as known
from edl_filter.navigation.filter import Problem, Settings, pose
from edl_filter.navigation.increments import Samples, effective_samples
from edl_filter.navigation.initial import EntryErrors
from edl_filter.planet import Planet, ellipsoid
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.fetch import find_mer_imu
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.mer_archive import read_mer_tables
from edl_filter.telemetry.mer_flight import MerImu, MerSetup, mer_telemetry
from edl_filter.telemetry.record import ImuRecord, InitialState, Telemetry

Array = NDArray[np.float64]


def read_telemetry(mission: Mission) -> Telemetry:
    """Telemetry of a mission, in body axes and seconds since its epoch.

    Raises
    ------
    InputError
        It is not there, or not as it should be.
    """
    path = mission.telemetry_path()
    if isinstance(mission.telemetry, FlightFile):
        assert path is not None
        telemetry = read_flight_file(path)
        if telemetry.planet.lower() != mission.planet.name.lower():
            raise InputError(
                f"{path}: the flight is of {telemetry.planet}, the mission's planet is {mission.planet.name}."
            )
        return telemetry if mission.telemetry.driving is None else driven_by(telemetry, mission.telemetry.driving)
    assert isinstance(mission.telemetry, MerMission)  # telemetry_path stops the others
    tables = read_mer_tables(find_mer_imu(path), mission.telemetry.spacecraft)
    return mer_telemetry(tables, mer_setup(mission))


def driven_by(telemetry: Telemetry, name: str) -> Telemetry:
    """The same telemetry with the IMU called `name` driving and all others checking.

    Raises
    ------
    InputError
        There is no such IMU.
    """
    records = {record.name: record for record in (telemetry.driving, *telemetry.checking)}
    if name not in records:
        raise InputError(f"telemetry.driving: found '{name}'; the flight file has {', '.join(records)}.")
    driving = records.pop(name)
    return replace(telemetry, driving=driving, checking=tuple(records.values()))


def mer_setup(mission: Mission) -> MerSetup:
    """What reading a rover's tables needs of its mission.

    Raises
    ------
    InputError
        The mission does not say when the backshell separates, or how the inertial frame lies.
    """
    telemetry = mission.telemetry
    assert isinstance(telemetry, MerMission)
    j2000_from_inertial = mission.planet.j2000_from_inertial_matrix
    separation = mission.vehicle.events.get("backshell_separation")
    if j2000_from_inertial is None:
        raise InputError(f"{mission.source}: planet.j2000_from_inertial: found nothing; mer-imu needs it.")
    if separation is None:
        raise InputError(f"{mission.source}: vehicle.events.backshell_separation: found nothing; mer-imu needs it.")
    imus: dict[str, MerImu] = {
        name: MerImu(
            accelerometer_noise=imu.accelerometer_noise,
            gyro_noise=imu.gyro_noise,
            errors=imu.errors,
            spacecraft_from_imu=imu.spacecraft_from_imu_quaternion,
            position=np.array(imu.position),
            transformed_alignment=np.array(imu.transformed_alignment),
            onboard_rate_correction=imu.onboard_rate_correction,
        )
        for name, imu in telemetry.imus.items()
    }
    register = telemetry.velocity_register
    imus["register"] = MerImu(register.accelerometer_noise, register.gyro_noise, register.errors)
    onboard = mission.constraints.onboard_attitude
    events = mission.event_times()
    return MerSetup(
        epoch_sclk=telemetry.epoch_sclk,
        epoch_utc=telemetry.epoch_utc,
        start=telemetry.start_s,
        end=telemetry.end_s,
        separation=events["backshell_separation"],
        positions={
            events[name]: np.array(event.position)
            for name, event in mission.vehicle.events.items()
            if event.position is not None
        },
        inertial_from_j2000=rotations.from_matrix(j2000_from_inertial.T),
        j2000_from_register=rotations.from_matrix(register.frame_matrix.T),
        imus=imus,
        events=events,
        attitude_sigma=onboard.sigma if onboard else 0.0,
    )


def read_atmosphere(mission: Mission) -> Atmosphere:
    """Preflight atmosphere of a mission."""
    a = mission.atmosphere
    return Atmosphere.read(mission.atmosphere_path(), a.gas_constant, a.heat_capacity_ratio)


def without_effects(mission: Mission, telemetry: Telemetry, effects: Sequence[Active]) -> Telemetry:
    """Telemetry as it would be with perfect sensors at known places: what effects did to all IMUs is undone.

    Raises
    ------
    InputError
        An effect names an IMU that is not there.
    """
    if not effects:
        return telemetry
    check_imus(telemetry, effects, str(mission.source or mission.name))
    times = mission.event_times()
    until = min((times[n] for n, e in mission.vehicle.events.items() if e.position is not None), default=np.inf)

    def undone(record: ImuRecord, driving: bool) -> ImuRecord:
        return moved_record(corrected_record(record, effects, driving), effects, until, driving)

    checking = tuple(undone(record, driving=False) for record in telemetry.checking)
    return replace(telemetry, driving=undone(telemetry.driving, driving=True), checking=checking)


def assemble(
    mission: Mission,
    telemetry: Telemetry,
    planet: Planet,
    atmosphere: Atmosphere,
    effects: Sequence[Active] | None = None,
) -> Problem:
    """Put the filter's problem together.

    Parameters
    ----------
    mission : Mission
    telemetry : Telemetry
        As it was read: the effects are undone here.
    planet, atmosphere : Planet, Atmosphere
        The mission's own, without effects.
    effects : sequence of Active, optional
        Instead of the mission's.

    Raises
    ------
    InputError
        The mission takes something from the telemetry that is not in it, or a window holds no samples; an effect names
        an IMU that is not there.
    """
    effects = mission.active_effects() if effects is None else effects
    telemetry = without_effects(mission, telemetry, effects)
    planet = gravity_planet(planet, effects)
    samples = effective_samples(telemetry.driving)
    initial, entry = entry_state(mission, telemetry)
    for a in effects:
        initial = a.effect.entry_state(a.values, initial)
    f = mission.filter
    onboard = mission.constraints.onboard_attitude
    return pose(
        samples,
        initial,
        entry,
        telemetry.driving.errors,
        statements(mission, telemetry, samples, planet, atmosphere, initial.time, effects),
        planet,
        Settings(f.alpha, f.beta, f.kappa, f.longest_interval_s, f.gate_probability),
        times=tuple((mission.event_times() | telemetry.events).values()),
        unit_change_sigma=onboard.unit_change_sigma if onboard else 0.0,
    )


def entry_state(mission: Mission, telemetry: Telemetry) -> tuple[InitialState, EntryErrors]:
    """Entry state, and what may be wrong with it besides its covariance."""
    stated = mission.initial_state
    if not isinstance(stated, StatedState):
        if telemetry.initial is None:
            raise InputError(f"{mission.source}: initial_state.from: the telemetry has no initial state.")
        return telemetry.initial, EntryErrors()
    on_board = stated.attitude == "onboard"
    if on_board:
        if telemetry.attitude is None:
            raise InputError(f"{mission.source}: initial_state.attitude: the telemetry has no on-board attitude.")
        attitude = telemetry.attitude.at(stated.time_s)
    elif stated.attitude is None:
        raise InputError(f"{mission.source}: initial_state.attitude: found nothing; 'onboard' or a quaternion.")
    else:
        attitude = rotations.normalise(stated.attitude)
    covariance = stated.covariance_matrix(attitude, mission.planet.j2000_from_inertial_matrix)
    initial = InitialState(stated.time_s, np.array(stated.position), np.array(stated.velocity), attitude, covariance)
    entry = EntryErrors(stated.epoch_sigma_s, stated.frame_rotation_sigma)
    if mission.constraints.onboard_attitude is not None and telemetry.attitude is not None:
        start, rounding = telemetry.attitude.at(stated.time_s), float(np.max(telemetry.attitude.sigma))
        onboard = mission.constraints.onboard_attitude
        entry = replace(
            entry,
            onboard_attitude=start,
            onboard_sigma=rounding,
            onboard_rate_sigma=onboard.rate_sigma,
            onboard_mounting_sigma=onboard.mounting_sigma,
        )
    return initial, entry


def statements(
    mission: Mission,
    telemetry: Telemetry,
    samples: Samples,
    planet: Planet,
    atmosphere: Atmosphere,
    start: float,
    effects: Sequence[Active] = (),
) -> list[known.Constraint]:
    """All constraints that the mission wants, from `start` (s) on; the air that they ask is that of the effects."""
    c = mission.constraints
    atmosphere = changed_atmosphere(atmosphere, effects)
    found: list[known.Constraint] = []
    if c.pre_entry_zero_force is not None:
        z = c.pre_entry_zero_force
        part = window(samples, z.start_s, z.end_s, "pre_entry_zero_force")
        noise = float(np.sqrt(np.mean(part.force_noise**2) / len(part.time)))
        found.append(known.ZeroSpecificForce(start, mean(part), np.full(3, np.hypot(z.sigma, noise))))
    if c.onboard_attitude is not None:
        found += onboard_attitudes(telemetry, c.onboard_attitude.interval_s, start)
    if c.parachute is not None:
        found.append(_parachute(mission, telemetry, air_planet(planet, effects), atmosphere))
    if c.steady_descent is not None:
        found.append(_steady_descent(mission, samples, planet, atmosphere, body_of(mission, effects).mass))
    if c.landing is not None and not (isinstance(c.landing, LandingSite) and not c.landing.use):
        found.append(_landing(mission, telemetry, planet))
    if c.rest is not None:
        found += _rest(mission, telemetry, samples, planet)
    if c.altimeter is not None:
        found += _altimeter(mission, telemetry)
    return found


def window(samples: Samples, start: float, end: float, name: str) -> Samples:
    """Samples within a constraint's window."""
    first, last = samples.index(start), samples.index(end)
    if last - first < 2:
        raise InputError(
            f"constraints.{name}: no telemetry between {start:g} and {end:g} s; it runs from "
            f"{samples.time[0]:g} to {samples.time[-1]:g} s."
        )
    return samples.part(first, last)


def mean(samples: Samples) -> Array:
    """Mean specific force over time, body axes."""
    return samples.interval @ samples.mean_force / samples.interval.sum()


def onboard_attitudes(telemetry: Telemetry, interval: float, start: float) -> list[known.Constraint]:
    """On-board attitudes every `interval` and on both sides of a gap, where the gyros were read themselves.

    Where the rates were made from the on-board quaternion it would say nothing new.
    """
    attitude, driving = telemetry.attitude, telemetry.driving
    if attitude is None:
        raise InputError("constraints.onboard_attitude: the telemetry has no on-board attitude.")
    gyros = np.isin(driving.source, [i for i, s in enumerate(driving.sources) if s in ("HIGHRATE", "gap")])
    if not gyros.any():
        return []
    span = driving.time[gyros]
    gap = driving.source == (driving.sources.index("gap") if "gap" in driving.sources else -1)
    inside, edges = _within(attitude.time, driving.time[gap], driving.interval[gap])
    found: list[known.Constraint] = []
    last = -np.inf
    for k in np.flatnonzero((attitude.time > max(start, span[0])) & (attitude.time <= span[-1]) & ~inside):
        time = float(attitude.time[k])
        if time - last >= interval or k in edges:
            quaternion, sigma = attitude.inertial_from_body[k], float(attitude.sigma[k])
            found.append(known.OnboardAttitude(time, quaternion, sigma))
            last = time
    return found


def _within(time: Array, end: Array, interval: Array) -> tuple[NDArray[np.bool_], set[int]]:
    """Which of `time` lie within gaps of adjoining samples, and the indices of the last before and first after each."""
    begins = end - interval
    first = np.flatnonzero(np.diff(begins, prepend=-np.inf) > 1.5 * interval)
    inside = np.zeros(len(time), bool)
    edges: set[int] = set()
    for start, stop in zip(begins[first], np.append(end[first[1:] - 1], end[-1:]), strict=True):
        inside |= (time > start + 1e-6) & (time < stop - 1e-6)
        before, after = np.flatnonzero(time <= start + 1e-6), np.flatnonzero(time >= stop - 1e-6)
        edges |= {int(before[-1]), int(after[0])} if len(before) and len(after) else set()
    return inside, edges


def _event(mission: Mission, telemetry: Telemetry, name: str, constraint: str) -> float:
    times = telemetry.events | mission.event_times()
    if name not in times:
        raise InputError(f"{mission.source}: constraints.{constraint} needs the event {name}; there is none.")
    return times[name]


def _parachute(mission: Mission, telemetry: Telemetry, planet: Planet, atmosphere: Atmosphere) -> known.DynamicPressure:
    stated, sigma = mission.constraints.parachute, mission.atmosphere.density_sigma
    if isinstance(stated, FromTelemetry):
        fix = telemetry.parachute
        if fix is None:
            raise InputError(f"{mission.source}: constraints.parachute: the telemetry says nothing of it.")
        return known.DynamicPressure(
            fix.time, fix.dynamic_pressure, fix.dynamic_pressure_sigma, sigma, planet, atmosphere
        )
    assert stated is not None
    time = _event(mission, telemetry, "parachute_deploy", "parachute")
    return known.DynamicPressure(
        time, stated.dynamic_pressure, stated.dynamic_pressure_sigma, sigma, planet, atmosphere
    )


def _steady_descent(
    mission: Mission, samples: Samples, planet: Planet, atmosphere: Atmosphere, mass_at_entry: float
) -> known.SteadyDescent:
    """Terminal speed from the measured drag, ``m f = ρ V² C_D S / 2``, at whatever density the state's altitude has."""
    c, parachute = mission.constraints.steady_descent, mission.vehicle.parachute
    assert c is not None and parachute is not None and parachute.drag_coefficient is not None  # the mission is checked
    part = window(samples, c.start_s, c.end_s, "steady_descent")
    drag = float(part.interval @ np.linalg.norm(part.mean_force, axis=1) / part.interval.sum())
    time = 0.5 * (c.start_s + c.end_s)
    events = mission.event_times()
    masses = [e.mass for n, e in mission.vehicle.events.items() if e.mass is not None and events[n] < time]
    mass = masses[-1] if masses else mass_at_entry
    area = np.pi / 4.0 * parachute.area_diameter**2
    return known.SteadyDescent(
        time=time,
        dynamic_pressure=mass * drag / (parachute.drag_coefficient * area),
        wind_sigma=c.horizontal_sigma,
        # a speed goes with the root of the density
        speed_sigma=float(np.hypot(c.vertical_sigma, 0.5 * mission.atmosphere.density_sigma)),
        planet=planet,
        atmosphere=atmosphere,
    )


def _landing(mission: Mission, telemetry: Telemetry, planet: Planet) -> known.LandingSite:
    stated = mission.constraints.landing
    if isinstance(stated, FromTelemetry):
        fix = telemetry.landing
        if fix is None:
            raise InputError(f"{mission.source}: constraints.landing: the telemetry has no landing position.")
        return known.LandingSite(fix.time, fix.position, np.diag(fix.position_sigma**2), planet)
    assert stated is not None
    enu = ellipsoid.enu_from_fixed(stated.latitude, stated.longitude)
    sigma = np.array([stated.horizontal_sigma, stated.horizontal_sigma, stated.vertical_sigma])
    time = _event(mission, telemetry, "landing", "landing")
    return known.LandingSite(time, stated.position, enu.T @ np.diag(sigma**2) @ enu, planet)


def _rest(mission: Mission, telemetry: Telemetry, samples: Samples, planet: Planet) -> list[known.Constraint]:
    """Rest: no velocity, and minus gravity on the accelerometers; in a flight file also rates on the gyros."""
    stated = mission.constraints.rest
    assert stated is not None
    if isinstance(stated, FromTelemetry):
        if telemetry.landing is None:
            raise InputError(f"{mission.source}: constraints.rest: the telemetry has no landing.")
        start, end = telemetry.landing.time, float(samples.time[-1])
    else:
        start, end = stated.start_s, stated.end_s
    part = window(samples, start, end, "rest")
    count = len(part.time)
    force_sigma = float(np.sqrt(np.mean(part.force_noise**2) / count))
    rate_sigma = float(np.sqrt(np.mean(part.rate_noise**2) / count))
    found: list[known.Constraint] = [known.RestVelocity(start, stated.velocity_sigma, planet)]
    if isinstance(stated, FromTelemetry):
        found.append(known.RestGravity(start, mean(part), force_sigma, planet))
        rate = part.interval @ part.mean_rate / part.interval.sum()
        found.append(known.RestRate(start, rate, rate_sigma, planet))
    elif stated.gravity_direction_sigma is not None:
        force = mean(part)
        sigma = float(np.hypot(force_sigma, np.linalg.norm(force) * stated.gravity_direction_sigma))
        found.append(known.RestGravity(start, force, sigma, planet))
    return found


def _altimeter(mission: Mission, telemetry: Telemetry) -> list[known.Constraint]:
    """Every reading up to the landing."""
    stated, record = mission.constraints.altimeter, telemetry.altimeter
    assert stated is not None
    if record is None:
        raise InputError(f"{mission.source}: constraints.altimeter: the telemetry has no altimeter.")
    end = telemetry.landing.time if telemetry.landing is not None else np.inf
    sigma = stated.sigma if stated.sigma is not None else record.sigma
    return [
        known.Altimeter(float(t), float(h), sigma, record.surface_radius)
        for t, h in zip(record.time, record.height, strict=True)
        if t <= end
    ]
