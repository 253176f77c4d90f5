"""Checks between sections of a mission: what one needs, another states."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from edl_filter.mission.checks import problem, shown
from edl_filter.mission.effects import check_effects
from edl_filter.mission.estimation import ParachutePressure, StatedState, SunLineSigma
from edl_filter.mission.measurements import FlightFile, MerImu, PhoenixPds
from edl_filter.mission.sections import FromTelemetry, Window

if TYPE_CHECKING:
    from edl_filter.mission.mission import Mission


def check_together(mission: Mission) -> None:
    """Raise the error of the first contradiction between sections."""
    for check in (_check_telemetry, _check_events, _check_state, _check_constraints):
        check(mission)
    check_effects(mission.effects)


def event_times(mission: Mission) -> Iterator[tuple[str, float]]:
    """Yield name and time, s since the epoch, of each event that the mission states."""
    epoch = getattr(mission.telemetry, "epoch_sclk", 0.0)
    for name, event in mission.vehicle.events.items():
        if event.time_s is not None:
            yield name, event.time_s
        elif event.sclk is not None:
            yield name, event.sclk - epoch


def _check_telemetry(mission: Mission) -> None:
    """Have the mission say what the telemetry does not."""
    if not isinstance(mission.telemetry, FlightFile) and mission.planet.prime_meridian_deg is None:
        raise problem("nothing", "deg: this telemetry does not say it", "planet.prime_meridian_deg")
    if isinstance(mission.telemetry, MerImu) and mission.planet.j2000_from_inertial is None:
        raise problem("nothing", "a matrix: on-board attitude is in J2000", "planet.j2000_from_inertial")


def _check_events(mission: Mission) -> None:
    """Events come in order, after the epoch, and change only what this telemetry leaves to the mission."""
    before, previous = 0.0, "the epoch"
    has_clock = isinstance(mission.telemetry, MerImu)
    for name, event in mission.vehicle.events.items():
        key = f"vehicle.events.{name}"
        if event.sclk is not None and not has_clock:
            raise problem(shown(event.sclk), "time_s: this telemetry states no epoch_sclk", f"{key}.sclk")
        if event.position is not None and not has_clock:
            raise problem(shown(event.position), "none: a flight file's lever arm is in the file", f"{key}.position")
    for name, time in event_times(mission):
        if not before < time < 1e5:
            event = mission.vehicle.events[name]
            at, field = (event.time_s, "time_s") if event.sclk is None else (event.sclk, "sclk")
            found = f"{at!r}, {time:.6g} s after the epoch"
            raise problem(found, f"a time after {previous} at {before:.6g} s", f"vehicle.events.{name}.{field}")
        before, previous = time, name


def _check_state(mission: Mission) -> None:
    state, telemetry = mission.initial_state, mission.telemetry
    if isinstance(state, FromTelemetry):
        return _check_from_telemetry(mission, "initial_state")
    assert isinstance(state, StatedState)
    if isinstance(telemetry, FlightFile) and state.attitude == "onboard":
        raise problem("'onboard'", "a quaternion: a flight file holds none on board", "initial_state.attitude")
    if state.attitude is None and not isinstance(telemetry, PhoenixPds):
        raise problem("nothing", "onboard, or inertial_from_body as a quaternion", "initial_state.attitude")
    if isinstance(state.attitude_sigma_deg, SunLineSigma) and mission.planet.j2000_from_inertial is None:
        raise problem("nothing", "rows of a matrix, which about_sun needs", "planet.j2000_from_inertial")
    radius = mission.planet.ellipsoid.equatorial_radius
    distance = sum(x * x for x in state.position) ** 0.5
    if not 0.95 * radius < distance < 10.0 * radius:
        found = f"{shown(state.position)}, {distance:.6g} m from the centre"
        raise problem(found, f"m, outside the planet of radius {radius:.6g} m", "initial_state.position")
    return None


def _check_from_telemetry(mission: Mission, key: str) -> None:
    if not isinstance(mission.telemetry, FlightFile):
        expected = f"values: only a flight file holds them, not {mission.telemetry.format}"
        raise problem("from: telemetry", expected, key)


def _check_constraints(mission: Mission) -> None:
    """Constraints have what they need: an event, a parachute, telemetry that holds them, time covered."""
    constraints, telemetry = mission.constraints, mission.telemetry
    for key in type(constraints).model_fields:
        value = getattr(constraints, key)
        if isinstance(value, FromTelemetry):
            _check_from_telemetry(mission, f"constraints.{key}")
        if isinstance(value, Window) and isinstance(telemetry, MerImu):
            for end in ("start_s", "end_s"):
                if not telemetry.start_s <= getattr(value, end) <= telemetry.end_s:
                    expected = f"s within the telemetry used, {telemetry.start_s:g} to {telemetry.end_s:g}"
                    raise problem(shown(getattr(value, end)), expected, f"constraints.{key}.{end}")
    if constraints.onboard_attitude is not None and isinstance(telemetry, FlightFile):
        raise problem("a section", "none: a flight file holds no on-board attitude", "constraints.onboard_attitude")
    if isinstance(constraints.parachute, ParachutePressure):
        _check_event(mission, "parachute", "parachute_deploy")
    if constraints.landing is not None and not isinstance(constraints.landing, FromTelemetry):
        _check_event(mission, "landing", "landing")
        ratio = constraints.landing.radius / mission.planet.ellipsoid.equatorial_radius
        if not 0.9 < ratio < 1.1:
            raise problem(
                shown(constraints.landing.radius),
                "m from the planet's centre, within 10 % of the equatorial radius",
                "constraints.landing.radius",
            )
    parachute = mission.vehicle.parachute
    if constraints.steady_descent is not None and (parachute is None or parachute.drag_coefficient is None):
        raise problem("nothing", "a number: steady_descent needs it", "vehicle.parachute.drag_coefficient")


def _check_event(mission: Mission, constraint: str, event: str) -> None:
    if event not in mission.vehicle.events and not isinstance(mission.telemetry, FlightFile):
        raise problem("nothing", f"the event that constraints.{constraint} needs", f"vehicle.events.{event}")
