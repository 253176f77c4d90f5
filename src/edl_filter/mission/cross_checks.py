"""Checks between sections of a mission: each section finds in the others what it requires."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from pydantic_core import PydanticCustomError

from edl_filter.mission.aerodynamics import AerodynamicsConfig
from edl_filter.mission.estimation import (
    ConstraintsConfig,
    InitialStateConfig,
    ParachuteDeploymentConfig,
    StatedStateConfig,
    SunLineSigmaConfig,
)
from edl_filter.mission.fields import FromTelemetryConfig, WindowConfig
from edl_filter.mission.measurements import FlightFileConfig, MerImuConfig, PhoenixPdsConfig, TelemetryConfig
from edl_filter.mission.validators import field_error, value_text
from edl_filter.mission.world import PlanetConfig, VehicleConfig


def section_errors(sections: Mapping[str, Any]) -> Iterator[PydanticCustomError]:
    """Yield the error of every inconsistency between sections.

    Parameters
    ----------
    sections : mapping
        Valid sections of a mission by key. A check whose sections are not all in it is left out, so that the valid
        part of a wrong mission can be checked.
    """
    for check, names in _CHECKS:
        if all(name in sections for name in names):
            yield from check(*(sections[name] for name in names))


def event_times(telemetry: TelemetryConfig, vehicle: VehicleConfig) -> Iterator[tuple[str, float]]:
    """Yield name and time, s since the epoch, of each event that the mission states."""
    epoch = getattr(telemetry, "epoch_sclk", 0.0)
    for name, event in vehicle.events.items():
        if event.time_s is not None:
            yield name, event.time_s
        elif event.sclk is not None:
            yield name, event.sclk - epoch


def _telemetry_errors(telemetry: TelemetryConfig, planet: PlanetConfig) -> Iterator[PydanticCustomError]:
    """The mission states what its telemetry does not contain."""
    if not isinstance(telemetry, FlightFileConfig) and planet.prime_meridian_deg is None:
        yield field_error("nothing", "deg: this telemetry does not say it", "planet.prime_meridian_deg")
    if isinstance(telemetry, MerImuConfig) and planet.j2000_from_inertial is None:
        yield field_error("nothing", "a matrix: on-board attitude is in J2000", "planet.j2000_from_inertial")


def _event_errors(telemetry: TelemetryConfig, vehicle: VehicleConfig) -> Iterator[PydanticCustomError]:
    """Events are in order of time, after the epoch, and change only what the telemetry does not contain."""
    previous_time, previous_name = 0.0, "the epoch"
    has_clock = isinstance(telemetry, MerImuConfig)
    for name, event in vehicle.events.items():
        key = f"vehicle.events.{name}"
        if event.sclk is not None and not has_clock:
            yield field_error(value_text(event.sclk), "time_s: this telemetry states no epoch_sclk", f"{key}.sclk")
        if event.position is not None and not has_clock:
            yield field_error(
                value_text(event.position),
                "centre_of_mass_shift or imu_positions: a flight file's lever arm is in the file",
                f"{key}.position",
            )
        for field in ("centre_of_mass_shift", "imu_positions"):
            value = getattr(event, field)
            if value and not isinstance(telemetry, FlightFileConfig):
                yield field_error(value_text(value), "position: this one is for a flight file", f"{key}.{field}")
    for name, time in event_times(telemetry, vehicle):
        if not previous_time < time < 1e5:
            event = vehicle.events[name]
            stated_time, field = (event.time_s, "time_s") if event.sclk is None else (event.sclk, "sclk")
            yield field_error(
                f"{stated_time!r}, {time:.6g} s after the epoch",
                f"a time after {previous_name} at {previous_time:.6g} s",
                f"vehicle.events.{name}.{field}",
            )
        previous_time, previous_name = time, name


def _state_errors(
    state: InitialStateConfig, telemetry: TelemetryConfig, planet: PlanetConfig
) -> Iterator[PydanticCustomError]:
    """The entry state is outside the planet, and its source is known."""
    if isinstance(state, FromTelemetryConfig):
        yield from _from_telemetry_errors(telemetry, "initial_state")
        return
    assert isinstance(state, StatedStateConfig)
    if isinstance(telemetry, FlightFileConfig) and state.attitude == "onboard":
        yield field_error("'onboard'", "a quaternion: a flight file holds none on board", "initial_state.attitude")
    if state.attitude is None and not isinstance(telemetry, PhoenixPdsConfig):
        yield field_error("nothing", "onboard, or inertial_from_body as a quaternion", "initial_state.attitude")
    if isinstance(state.attitude_sigma_deg, SunLineSigmaConfig) and planet.j2000_from_inertial is None:
        yield field_error("nothing", "rows of a matrix, which about_sun needs", "planet.j2000_from_inertial")
    radius = planet.ellipsoid.equatorial_radius
    distance = sum(x * x for x in state.position) ** 0.5
    if not 0.95 * radius < distance < 10.0 * radius:
        actual = f"{value_text(state.position)}, {distance:.6g} m from the centre"
        yield field_error(actual, f"m, outside the planet of radius {radius:.6g} m", "initial_state.position")


def _from_telemetry_errors(telemetry: TelemetryConfig, key: str) -> Iterator[PydanticCustomError]:
    if not isinstance(telemetry, FlightFileConfig):
        expected = f"values: only a flight file holds them, not {telemetry.format}"
        yield field_error("from: telemetry", expected, key)


def _constraint_errors(
    constraints: ConstraintsConfig, telemetry: TelemetryConfig, planet: PlanetConfig, vehicle: VehicleConfig
) -> Iterator[PydanticCustomError]:
    """Constraints have the event, parachute, telemetry and time span that they require."""
    for key in type(constraints).model_fields:
        value = getattr(constraints, key)
        if isinstance(value, FromTelemetryConfig):
            yield from _from_telemetry_errors(telemetry, f"constraints.{key}")
        if isinstance(value, WindowConfig) and isinstance(telemetry, MerImuConfig):
            for bound, time in (("start_s", value.start_s), ("end_s", value.end_s)):
                if not telemetry.start_s <= time <= telemetry.end_s:
                    expected = f"s within the telemetry used, {telemetry.start_s:g} to {telemetry.end_s:g}"
                    yield field_error(value_text(time), expected, f"constraints.{key}.{bound}")
    if constraints.onboard_attitude is not None and isinstance(telemetry, FlightFileConfig):
        yield field_error("a section", "none: a flight file holds no on-board attitude", "constraints.onboard_attitude")
    if isinstance(constraints.parachute, ParachuteDeploymentConfig):
        yield from _missing_event_errors(telemetry, vehicle, "parachute", "parachute_deploy")
    if constraints.landing is not None and not isinstance(constraints.landing, FromTelemetryConfig):
        yield from _missing_event_errors(telemetry, vehicle, "landing", "landing")
        ratio = constraints.landing.radius / planet.ellipsoid.equatorial_radius
        if not 0.9 < ratio < 1.1:
            yield field_error(
                value_text(constraints.landing.radius),
                "m from the planet's centre, within 10 % of the equatorial radius",
                "constraints.landing.radius",
            )
    parachute = vehicle.parachute
    if constraints.steady_descent is not None and (parachute is None or parachute.drag_coefficient is None):
        yield field_error("nothing", "a number: steady_descent needs it", "vehicle.parachute.drag_coefficient")


def _missing_event_errors(
    telemetry: TelemetryConfig, vehicle: VehicleConfig, constraint: str, event: str
) -> Iterator[PydanticCustomError]:
    if event not in vehicle.events and not isinstance(telemetry, FlightFileConfig):
        yield field_error("nothing", f"the event that constraints.{constraint} needs", f"vehicle.events.{event}")


def _database_errors(
    constraints: ConstraintsConfig, vehicle: VehicleConfig, aerodynamics: AerodynamicsConfig | None
) -> Iterator[PydanticCustomError]:
    """The parachute's constraint has the database that it requires, and the database the inertia for its moments."""
    chute = constraints.parachute
    if isinstance(chute, ParachuteDeploymentConfig) and chute.axial_force_window_s and aerodynamics is None:
        yield field_error("nothing", "a section: constraints.parachute.axial_force_window_s needs CA", "aerodynamics")


#: Checks, and the sections that each takes.
_CHECKS: tuple[tuple[Callable[..., Iterable[PydanticCustomError]], tuple[str, ...]], ...] = (
    (_telemetry_errors, ("telemetry", "planet")),
    (_event_errors, ("telemetry", "vehicle")),
    (_state_errors, ("initial_state", "telemetry", "planet")),
    (_constraint_errors, ("constraints", "telemetry", "planet", "vehicle")),
    (_database_errors, ("constraints", "vehicle", "aerodynamics")),
)
