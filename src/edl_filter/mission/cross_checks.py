"""Checks between sections of a mission: each section finds in the others what it requires."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from edl_filter.mission.aerodynamics import AerodynamicsConfig
from edl_filter.mission.effects import EffectConfig, check_effects
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


def check_sections(
    telemetry: TelemetryConfig,
    planet: PlanetConfig,
    vehicle: VehicleConfig,
    initial_state: InitialStateConfig,
    constraints: ConstraintsConfig,
    effects: Sequence[EffectConfig],
    aerodynamics: AerodynamicsConfig | None,
) -> None:
    """Raise the error of the first inconsistency between sections."""
    _check_telemetry(telemetry, planet)
    _check_events(telemetry, vehicle)
    _check_state(initial_state, telemetry, planet)
    _check_constraints(constraints, telemetry, planet, vehicle)
    chute = constraints.parachute
    if isinstance(chute, ParachuteDeploymentConfig) and chute.axial_force_window_s and aerodynamics is None:
        raise field_error("nothing", "a section: constraints.parachute.axial_force_window_s needs CA", "aerodynamics")
    check_effects(effects)


def event_times(telemetry: TelemetryConfig, vehicle: VehicleConfig) -> Iterator[tuple[str, float]]:
    """Yield name and time, s since the epoch, of each event that the mission states."""
    epoch = getattr(telemetry, "epoch_sclk", 0.0)
    for name, event in vehicle.events.items():
        if event.time_s is not None:
            yield name, event.time_s
        elif event.sclk is not None:
            yield name, event.sclk - epoch


def _check_telemetry(telemetry: TelemetryConfig, planet: PlanetConfig) -> None:
    """The mission states what its telemetry does not contain."""
    if not isinstance(telemetry, FlightFileConfig) and planet.prime_meridian_deg is None:
        raise field_error("nothing", "deg: this telemetry does not say it", "planet.prime_meridian_deg")
    if isinstance(telemetry, MerImuConfig) and planet.j2000_from_inertial is None:
        raise field_error("nothing", "a matrix: on-board attitude is in J2000", "planet.j2000_from_inertial")


def _check_events(telemetry: TelemetryConfig, vehicle: VehicleConfig) -> None:
    """Events are in order of time, after the epoch, and change only what the telemetry does not contain."""
    previous_time, previous_name = 0.0, "the epoch"
    has_clock = isinstance(telemetry, MerImuConfig)
    for name, event in vehicle.events.items():
        key = f"vehicle.events.{name}"
        if event.sclk is not None and not has_clock:
            raise field_error(value_text(event.sclk), "time_s: this telemetry states no epoch_sclk", f"{key}.sclk")
        if event.position is not None and not has_clock:
            raise field_error(
                value_text(event.position),
                "centre_of_mass_shift or imu_positions: a flight file's lever arm is in the file",
                f"{key}.position",
            )
        for field in ("centre_of_mass_shift", "imu_positions"):
            value = getattr(event, field)
            if value and not isinstance(telemetry, FlightFileConfig):
                raise field_error(value_text(value), "position: this one is for a flight file", f"{key}.{field}")
    for name, time in event_times(telemetry, vehicle):
        if not previous_time < time < 1e5:
            event = vehicle.events[name]
            stated_time, field = (event.time_s, "time_s") if event.sclk is None else (event.sclk, "sclk")
            raise field_error(
                f"{stated_time!r}, {time:.6g} s after the epoch",
                f"a time after {previous_name} at {previous_time:.6g} s",
                f"vehicle.events.{name}.{field}",
            )
        previous_time, previous_name = time, name


def _check_state(state: InitialStateConfig, telemetry: TelemetryConfig, planet: PlanetConfig) -> None:
    if isinstance(state, FromTelemetryConfig):
        return _check_from_telemetry(telemetry, "initial_state")
    assert isinstance(state, StatedStateConfig)
    if isinstance(telemetry, FlightFileConfig) and state.attitude == "onboard":
        raise field_error("'onboard'", "a quaternion: a flight file holds none on board", "initial_state.attitude")
    if state.attitude is None and not isinstance(telemetry, PhoenixPdsConfig):
        raise field_error("nothing", "onboard, or inertial_from_body as a quaternion", "initial_state.attitude")
    if isinstance(state.attitude_sigma_deg, SunLineSigmaConfig) and planet.j2000_from_inertial is None:
        raise field_error("nothing", "rows of a matrix, which about_sun needs", "planet.j2000_from_inertial")
    radius = planet.ellipsoid.equatorial_radius
    distance = sum(x * x for x in state.position) ** 0.5
    if not 0.95 * radius < distance < 10.0 * radius:
        actual = f"{value_text(state.position)}, {distance:.6g} m from the centre"
        raise field_error(actual, f"m, outside the planet of radius {radius:.6g} m", "initial_state.position")
    return None


def _check_from_telemetry(telemetry: TelemetryConfig, key: str) -> None:
    if not isinstance(telemetry, FlightFileConfig):
        expected = f"values: only a flight file holds them, not {telemetry.format}"
        raise field_error("from: telemetry", expected, key)


def _check_constraints(
    constraints: ConstraintsConfig, telemetry: TelemetryConfig, planet: PlanetConfig, vehicle: VehicleConfig
) -> None:
    """Constraints have the event, parachute, telemetry and time span that they require."""
    for key in type(constraints).model_fields:
        value = getattr(constraints, key)
        if isinstance(value, FromTelemetryConfig):
            _check_from_telemetry(telemetry, f"constraints.{key}")
        if isinstance(value, WindowConfig) and isinstance(telemetry, MerImuConfig):
            for bound, time in (("start_s", value.start_s), ("end_s", value.end_s)):
                if not telemetry.start_s <= time <= telemetry.end_s:
                    expected = f"s within the telemetry used, {telemetry.start_s:g} to {telemetry.end_s:g}"
                    raise field_error(value_text(time), expected, f"constraints.{key}.{bound}")
    if constraints.onboard_attitude is not None and isinstance(telemetry, FlightFileConfig):
        raise field_error("a section", "none: a flight file holds no on-board attitude", "constraints.onboard_attitude")
    if isinstance(constraints.parachute, ParachuteDeploymentConfig):
        _check_event(telemetry, vehicle, "parachute", "parachute_deploy")
    if constraints.landing is not None and not isinstance(constraints.landing, FromTelemetryConfig):
        _check_event(telemetry, vehicle, "landing", "landing")
        ratio = constraints.landing.radius / planet.ellipsoid.equatorial_radius
        if not 0.9 < ratio < 1.1:
            raise field_error(
                value_text(constraints.landing.radius),
                "m from the planet's centre, within 10 % of the equatorial radius",
                "constraints.landing.radius",
            )
    parachute = vehicle.parachute
    if constraints.steady_descent is not None and (parachute is None or parachute.drag_coefficient is None):
        raise field_error("nothing", "a number: steady_descent needs it", "vehicle.parachute.drag_coefficient")


def _check_event(telemetry: TelemetryConfig, vehicle: VehicleConfig, constraint: str, event: str) -> None:
    if event not in vehicle.events and not isinstance(telemetry, FlightFileConfig):
        raise field_error("nothing", f"the event that constraints.{constraint} needs", f"vehicle.events.{event}")
