"""A scenario: entry conditions, instruments and errors of a simulated flight; the nominal model is a mission's.

The file is YAML in the form of a mission's sections; every error in it is one `InputError` that names file and key.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, PrivateAttr, StringConstraints, model_validator

from edl_filter.errors import InputError
from edl_filter.mission.effects import Effects, effect_instances
from edl_filter.mission.error_messages import validated
from edl_filter.mission.fields import (
    DEG,
    KM,
    PERCENT,
    LengthSigma,
    LeverArm,
    Pressure,
    Radius,
    RelativeSigma,
    Section,
    SpeedSigma,
    TimeSigma,
    Utc,
)
from edl_filter.mission.measurements import ErrorBudgetConfig
from edl_filter.mission.mission import Mission, existing_path
from edl_filter.mission.shipped import BUILTIN, shipped_scenario
from edl_filter.mission.validators import Number, Quaternion, Within, field_error, normalised, value_text
from edl_filter.mission.world import VehicleChangeConfig
from edl_filter.mission.yaml_text import apply_overrides, parse, read_text
from edl_filter.types import Array

if TYPE_CHECKING:
    from edl_filter.effects.base import EffectInstance
    from edl_filter.simulation.sensors import Instrument

#: Name of the IMU that drives, as in a flight file.
DRIVING = "primary"
#: Keys that name a file to read.
_PATH_KEYS = ("mission", "effects.*.file")

Degrees = Annotated[Number, Within("deg", -360.0, 360.0)]
Angle = Annotated[Number, Within("deg", -90.0, 90.0)]
Spread = Annotated[Number, Within("deg", 0.0, 45.0)]
Duration = Annotated[Number, Within("s", 0.0, 1e4, above=True)]


class Entry(Section):
    """Entry conditions at time 0."""

    radius: Radius = Field(description="distance from the planet's centre, m")
    latitude_deg: Angle = Field(description="areocentric latitude, deg, north positive")
    longitude_deg: Degrees = Field(description="longitude, deg, east positive")
    speed: Annotated[Number, Within("m/s", 100.0, 1e5, (("km/s", 1e3),))] = Field(description="inertial speed, m/s")
    flight_path_angle_deg: Angle = Field(
        description="inertial velocity above the local horizontal, deg: negative downwards"
    )
    azimuth_deg: Degrees = Field(description="direction of the inertial velocity from north towards east, deg")
    angle_of_attack_deg: Angle = Field(default=0.0, description="of the air-relative velocity, deg")
    sideslip_deg: Angle = Field(default=0.0, description="of the air-relative velocity, deg")
    bank_deg: Degrees = Field(default=0.0, description="turn about the velocity, deg")
    attitude_sigma_deg: Spread = Field(
        default=0.0, description="1 sigma of the random errors of angle of attack and sideslip, deg"
    )
    spin_rpm: Annotated[Number, Within("rpm", -60.0, 60.0)] = Field(
        default=0.0, description="rate about the symmetry axis, rpm"
    )
    rate_sigma_deg_s: Annotated[Number, Within("deg/s", 0.0, 20.0)] = Field(
        default=0.0, description="1 sigma of the random rates across it, deg/s"
    )


class StatedState(Section):
    """Uncertainty of the stated entry state."""

    position_sigma: LengthSigma = Field(description="1 sigma of each component, m")
    velocity_sigma: SpeedSigma = Field(description="1 sigma of each component, m/s")
    attitude_sigma_deg: Annotated[Number, Within("deg", 0.0, 45.0, above=True)] = Field(
        description="1 sigma about each body axis, deg"
    )

    @property
    def sigma(self) -> Array:
        """One sigma of all components, ``(9,)``: m, m/s, rad."""
        return np.repeat([self.position_sigma, self.velocity_sigma, self.attitude_sigma_deg * DEG], 3)


class Sampling(Section):
    """Sampling of the instruments and steps of the integration."""

    interval_s: Annotated[Number, Within("s", 1e-3, 1.0, (("ms", 1e-3),))] = Field(
        description="sampling interval of all IMUs, s"
    )
    substeps: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        description="steps of the integration in one interval"
    )


class Imu(ErrorBudgetConfig):
    """Mounting, noise and errors of one IMU."""

    body_from_imu: Quaternion = Field(description="quaternion, scalar last, that takes IMU components to body ones")
    position: LeverArm = Field(description="position from the nominal centre of mass, m, body axes")
    velocity_quantum: Annotated[Number, Within("m/s", 0.0, 0.1)] = Field(
        default=0.0, description="size of one count of the velocity increments, m/s; 0: none"
    )
    angle_quantum: Annotated[Number, Within("rad", 0.0, 0.01)] = Field(
        default=0.0, description="size of one count of the angle increments, rad; 0: none"
    )
    gyro_delay_s: Annotated[Number, Within("s", -2.0, 2.0, (("ms", 1e-3),))] = Field(
        default=0.0, description="delay of the gyros' samples against the accelerometers', s"
    )

    def instrument(self, interval: float) -> Instrument:
        """The instrument, sampled at `interval` (s)."""
        from edl_filter.simulation.sensors import Instrument

        return Instrument(
            interval=interval,
            body_from_imu=normalised(self.body_from_imu),
            position=np.array(self.position),
            accelerometer_noise=self.accelerometer_noise,
            gyro_noise=self.gyro_noise,
            sigmas=self.errors,
            velocity_quantum=self.velocity_quantum,
            angle_quantum=self.angle_quantum,
            gyro_delay=self.gyro_delay_s,
        )


class Weather(Section):
    """Random difference of the true atmosphere from the preflight table."""

    density_sigma: Annotated[Number, Within("", 0.0, 0.3, PERCENT)] = Field(
        default=0.0, description="1 sigma of the density's error, relative; 0: none"
    )
    wind_sigma: Annotated[Number, Within("m/s", 0.0, 100.0)] = Field(
        default=0.0, description="1 sigma of the winds towards east and north, m/s; 0: none"
    )
    correlation_length: Annotated[Number, Within("m", 100.0, 1e6, KM)] = Field(
        default=1e4, description="altitude over which both are correlated (1/e), m"
    )


class Parachute(Section):
    """Deployment and drag of the parachute; its diameter is the mission's."""

    dynamic_pressure: Pressure = Field(description="dynamic pressure at which, falling, it is deployed, Pa")
    dynamic_pressure_sigma: RelativeSigma = Field(description="1 sigma of the pressure in the flight file, relative")
    time_sigma_s: TimeSigma = Field(default=0.02, description="1 sigma of the time in the flight file, s")
    arm: Annotated[Number, Within("m", 0.0, 20.0)] = Field(
        default=1.6, description="distance of its attachment behind the nominal centre of mass, m"
    )
    inflation_s: Annotated[Number, Within("s", 0.0, 10.0, above=True)] = Field(
        default=0.6, description="time in which its drag grows to its full value, s"
    )


class Landing(Section):
    """End of the flight."""

    surface_radius: Radius = Field(description="radius of the surface where the vehicle comes down, m")
    position_sigma: LengthSigma = Field(description="1 sigma of the site in the flight file, each component, m")
    time_sigma_s: TimeSigma = Field(default=0.02, description="1 sigma of the time in the flight file, s")
    stop_s: Duration = Field(default=0.5, description="time from touchdown to rest, s")
    rest_s: Duration = Field(default=19.5, description="length of the record at rest, s")


class VehicleEvent(VehicleChangeConfig):
    """An event that changes the vehicle, with the keys of a mission's ``vehicle.events``."""

    time_s: Duration = Field(description="time, s, a multiple of sampling.interval_s")
    sigma_s: TimeSigma = Field(default=0.02, description="1 sigma of the time in the flight file, s")

    def stated(self) -> dict[str, Any]:
        """Keys with values, as a mission states the event."""
        return self.model_dump(mode="json", exclude_none=True, exclude_defaults=True) | {"sigma_s": self.sigma_s}


class Altimeter(Section):
    """Radar altimeter, from a height above the radius of the surface to the touchdown."""

    sigma: LengthSigma = Field(description="1 sigma of one sample, m")
    highest: Annotated[Number, Within("m", 0.0, 1e5, above=True)] = Field(description="height where it begins, m")
    interval_s: Duration | None = Field(default=None, description="time between readings, s; absent: every sample")


class Scenario(Section):
    """A flight to simulate. Made by `Scenario.load` or `Scenario.from_dict`."""

    name: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_\-]+$")] = Field(
        description="short name, letters, digits, _ and -"
    )
    title: str = Field(default="", description="name for people")
    mission: str = Field(description="mission of the nominal model: a path, or builtin:NAME")
    epoch_utc: Utc = Field(description="UTC of time 0, ISO 8601")
    prime_meridian_deg: Degrees | None = Field(
        default=None,
        description="angle from the inertial x axis to the prime meridian at time 0, deg; absent: mission's",
    )
    seed: Annotated[int, Field(strict=True, ge=0)] = Field(default=0, description="of all random quantities")
    entry: Entry = Field(description="entry conditions")
    stated_state: StatedState = Field(description="uncertainty of the stated entry state")
    sampling: Sampling = Field(description="sampling and steps of the integration")
    imus: dict[str, Imu] = Field(description="IMUs by name; one is called primary")
    weather: Weather = Field(default=Weather(), description="difference of the true air from the preflight table")
    parachute: Parachute = Field(description="the parachute")
    landing: Landing = Field(description="the end of the flight")
    altimeter: Altimeter | None = Field(default=None, description="absent: none")
    events: dict[str, VehicleEvent] = Field(
        default_factory=dict, description="events by name, in order of time, that change the vehicle before the landing"
    )
    effects: Effects = Field(default=(), description="physical effects that are switched on, with their true values")

    _source: Path | None = PrivateAttr(None)
    _model: Mission | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        if DRIVING not in self.imus:
            raise field_error(f"{', '.join(self.imus) or 'none'}", f"an IMU called {DRIVING}", "imus")
        for k, effect in enumerate(self.effects):
            if effect.imu is not None and effect.imu not in self.imus:
                raise field_error(value_text(effect.imu), f"one of {', '.join(self.imus)}", f"effects.{k}.imu")
        previous = 0.0
        for name, event in self.events.items():
            steps = event.time_s / self.sampling.interval_s
            expected = "s, a multiple of sampling.interval_s"
            if abs(steps - round(steps)) > 1e-6:
                raise field_error(value_text(event.time_s), expected, f"events.{name}.time_s")
            if event.time_s <= previous:
                raise field_error(value_text(event.time_s), f"s, after {previous:g}", f"events.{name}.time_s")
            previous = event.time_s
            for imu in event.imu_positions:
                if imu not in self.imus:
                    raise field_error(value_text(imu), f"one of {', '.join(self.imus)}", f"events.{name}.imu_positions")
        for key in ("stop_s", "rest_s"):
            length = getattr(self.landing, key)
            if abs(length / self.sampling.interval_s - round(length / self.sampling.interval_s)) > 1e-6:
                raise field_error(value_text(length), "s, a multiple of sampling.interval_s", f"landing.{key}")
        return self

    @classmethod
    def load(cls, path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
        """Read the scenario at `path`, or the shipped one that ``builtin:NAME`` names.

        Parameters
        ----------
        path : str or Path
            File, or ``builtin:NAME``.
        overrides : sequence of str
            ``KEY=VALUE`` with a dotted key; the value is YAML, ``null`` omits a section. A relative path as value
            starts from the current folder.

        Raises
        ------
        InputError
            The file or its mission cannot be read, is not YAML, or a key is unknown, missing or wrong.
        """
        where = str(path)
        file = shipped_scenario(where[len(BUILTIN) :]) if where.startswith(BUILTIN) else Path(path)
        text, changed = apply_overrides(read_text(file), where, overrides, _PATH_KEYS)
        return cls.from_dict(parse(text, where), where, file, changed)

    @classmethod
    def from_dict(
        cls, data: Any, where: str = "scenario", source: Path | None = None, changed: Sequence[str] = ()
    ) -> Scenario:
        """Scenario of plain `data` in the file's form; relative paths start from the folder of `source`.

        Raises
        ------
        InputError
            As `load`.
        """
        scenario = validated(cls, data, where, changed)
        scenario._source = source
        scenario._model = scenario._read_model(where)
        return scenario

    @property
    def source(self) -> Path | None:
        """File that was read."""
        return self._source

    @property
    def model(self) -> Mission:
        """The mission of the nominal model."""
        if self._model is None:  # the scenario was validated without `load` or `from_dict`
            self._model = self._read_model(self.name)
        return self._model

    def active_effects(self) -> tuple[EffectInstance, ...]:
        """Effects with their true values, in the file's order.

        Raises
        ------
        InputError
            The file of a user's effect is missing or cannot be used, or has no such effect or parameter.
        """
        return effect_instances(self.effects, self._existing, str(self._source or self.name))

    def _existing(self, key: str, reference: str) -> Path:
        return existing_path(reference, key, self._source, str(self._source or self.name))

    def _read_model(self, where: str) -> Mission:
        name = self.mission
        if not name.startswith(BUILTIN) and self._source is not None:
            name = str(self._source.parent / Path(name).expanduser())
        # a mission may have no telemetry; this flight's does not exist yet
        model = Mission.load(name, ("telemetry.path=simulated.h5",))
        if model.aerodynamics is None:
            raise InputError(f"{where}: mission: {self.mission} has no aerodynamics; a simulation needs a database.")
        if model.vehicle.inertia is None:
            raise InputError(f"{where}: mission: {self.mission} has no vehicle.inertia; a simulation needs it.")
        if model.vehicle.parachute is None:
            raise InputError(f"{where}: mission: {self.mission} has no vehicle.parachute; a simulation needs it.")
        return model
