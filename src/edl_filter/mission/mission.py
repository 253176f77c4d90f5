"""A mission: its sections, read and checked together, and the files that they name."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, PrivateAttr, StringConstraints, model_validator

from edl_filter.display import render
from edl_filter.errors import InputError
from edl_filter.mission.aerodynamics import AerodynamicsConfig, PostflightConfig
from edl_filter.mission.cross_checks import event_times, section_errors
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.mission.effects import Effects, effect_instances
from edl_filter.mission.error_messages import validated
from edl_filter.mission.estimation import ConstraintsConfig, FilterConfig, InitialStateConfig, OutputsConfig
from edl_filter.mission.fields import Section
from edl_filter.mission.measurements import MerImuConfig, PhoenixPdsConfig, SampleChecksConfig, TelemetryConfig
from edl_filter.mission.shipped import BUILTIN, shipped_data, shipped_mission
from edl_filter.mission.validators import value_text
from edl_filter.mission.world import AtmosphereConfig, EventConfig, PlanetConfig, VehicleConfig
from edl_filter.mission.yaml_text import apply_overrides, flow_text, parse, read_text

if TYPE_CHECKING:
    from edl_filter.effects.base import EffectInstance
    from edl_filter.planet import Planet

#: Keys that name a file to read, ``*`` for every index of a list. A relative path in a mission file starts from the
#: folder of that file, a relative path in --set from the current folder.
PATH_KEYS = (
    "telemetry.path",
    "atmosphere.table",
    "aerodynamics.continuum",
    "aerodynamics.rarefied",
    "aerodynamics.damping",
    "aerodynamics.increments",
    "effects.*.file",
)


class Mission(Section):
    """The model of one entry, created by `Mission.load` or `Mission.from_dict`.

    Attributes are the sections of the file; `text` is its YAML and `source` its path.
    """

    name: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_\-]+$")] = Field(
        description="short name, letters, digits, _ and -"
    )
    title: str = Field(default="", description="title in reports and figures")
    planet: PlanetConfig = Field(description="the planet")
    atmosphere: AtmosphereConfig = Field(description="preflight atmosphere")
    telemetry: TelemetryConfig = Field(description="telemetry of the flight")
    sample_checks: SampleChecksConfig = Field(
        default=SampleChecksConfig(), description="checks of the IMUs' samples, and filling of lost ones"
    )
    vehicle: VehicleConfig = Field(description="the vehicle")
    aerodynamics: AerodynamicsConfig | None = Field(
        default=None, description="aerodynamic database; absent: no atmosphere and no coefficients are derived"
    )
    postflight: PostflightConfig = Field(
        default=PostflightConfig(), description="how atmosphere and coefficients are derived"
    )
    initial_state: InitialStateConfig = Field(description="state at entry")
    constraints: ConstraintsConfig = Field(default=ConstraintsConfig(), description="an absent constraint is not used")
    filter: FilterConfig = Field(default=FilterConfig(), description="the filter's settings")
    effects: Effects = Field(default=(), description="physical effects that are switched on")
    diagnosis: DecisionSettings = Field(default=DecisionSettings(), description="thresholds of the diagnosis")
    outputs: OutputsConfig = Field(default=OutputsConfig(), description="files of a run")

    _text: str = PrivateAttr("")
    _source: Path | None = PrivateAttr(None)
    _session: tuple[EffectInstance, ...] = PrivateAttr(())

    @classmethod
    def load(cls, path: str | Path, overrides: Sequence[str] = ()) -> Mission:
        """Read a mission file, or a mission that the package ships.

        Parameters
        ----------
        path : str or Path
            Mission file, or ``builtin:NAME``.
        overrides : sequence of str
            ``KEY=VALUE`` with a dotted key; the value is YAML, and ``null`` removes a section. A relative path as
            value of a key that names a file starts from the current folder, as in a shell.

        Raises
        ------
        InputError
            The file cannot be read, is not YAML, or a key is unknown, missing or wrong.
        """
        label, file = str(path), mission_file(path)
        return cls.from_text(read_text(file), label, file, overrides)

    @classmethod
    def from_dict(cls, data: dict[str, Any], source: str = "mission", overrides: Sequence[str] = ()) -> Mission:
        """Create a mission from data in the form of a mission file; relative paths start from the current folder.

        Parameters
        ----------
        data : dict
            Sections by key; numpy arrays and paths are accepted as values.
        source : str
            Name of the mission in error messages, in place of a file.
        overrides : sequence of str
            As in `load`.

        Raises
        ------
        InputError
            As `load`.
        """
        plain = json.loads(json.dumps(data, default=_as_json))
        return cls.from_text(flow_text(plain, "  "), source, None, overrides)

    @classmethod
    def from_text(cls, text: str, label: str, source: Path | None, overrides: Sequence[str] = ()) -> Mission:
        """Create a mission from the text of a mission file.

        Parameters
        ----------
        text : str
            YAML.
        label : str
            Name of the file in error messages.
        source : Path or None
            File of the mission; relative paths start from its folder, or from the current folder if it is None.
        overrides : sequence of str
            As in `load`.

        Raises
        ------
        InputError
            As `load`.
        """
        text, changed = apply_overrides(text, label, overrides, PATH_KEYS)
        mission = validated(cls, parse(text, label), label, changed)
        mission._text, mission._source = text, source
        return mission

    @property
    def text(self) -> str:
        """The mission's YAML after all overrides; results are stored with it."""
        return self._text

    @property
    def source(self) -> Path | None:
        """File that was read; None where the mission was created from data."""
        return self._source

    @property
    def label(self) -> str:
        """Name of the mission in error messages: the path of its file, or its name where it has no file."""
        return str(self._source or self.name)

    @model_validator(mode="after")
    def _consistent(self) -> Mission:
        for error in section_errors(dict(self)):
            raise error
        return self

    def planet_model(self, prime_meridian: float | None = None) -> Planet:
        """Planet with gravity, shape and rotation.

        Parameters
        ----------
        prime_meridian : float, optional
            Angle to the prime meridian at the epoch, rad, from the telemetry; used where the mission states none.

        Raises
        ------
        InputError
            Neither the mission nor the telemetry states the angle.
        """
        from edl_filter.planet import Planet

        angle = self.planet.prime_meridian if self.planet.prime_meridian is not None else prime_meridian
        if angle is None:
            raise InputError(f"{self.label}: planet.prime_meridian_deg: found nothing; expected deg at the epoch.")
        return Planet(
            name=self.planet.name,
            mu=self.planet.gravity.mu,
            j2=self.planet.gravity.j2,
            gravity_radius=self.planet.gravity.radius,
            equatorial_radius=self.planet.ellipsoid.equatorial_radius,
            flattening=self.planet.ellipsoid.flattening,
            rotation_rate=self.planet.rotation_rate,
            prime_meridian_at_epoch=angle,
        )

    def event_times(self) -> dict[str, float]:
        """Return the times of the events that the mission states, s since the epoch, in order."""
        return dict(event_times(self.telemetry, self.vehicle))

    def vehicle_changes(self) -> list[tuple[float, EventConfig]]:
        """Events that change the vehicle or an IMU's position, with their times, s since the epoch, in order."""
        times, unchanged = self.event_times(), {"sclk", "time_s", "sigma_s"}
        return [(times[n], e) for n, e in self.vehicle.events.items() if e.model_fields_set - unchanged]

    def telemetry_path(self) -> Path | None:
        """File or folder of the telemetry; None where a rover's mission names none (mer-imu).

        Raises
        ------
        InputError
            The file or folder does not exist, or the package cannot read its format (phoenix-pds).
        """
        telemetry = self.telemetry
        if isinstance(telemetry, PhoenixPdsConfig):
            path_text = "no path" if telemetry.path is None else value_text(telemetry.path)
            raise InputError(
                f"{self.label}: telemetry.path: found {path_text}; this mission needs {telemetry.product}, "
                "which edl-filter cannot read yet. Bring it as a table with 'edl-filter convert LOG.csv "
                "--spec S.yaml -o FLIGHT.h5', then run a mission with telemetry.format: flight-file, such "
                "as practice_phoenix."
            )
        if telemetry.path is None:
            return None
        return self._existing_path("telemetry.path", telemetry.path, folders=isinstance(telemetry, MerImuConfig))

    def atmosphere_path(self) -> Path:
        """Path of the table of the preflight atmosphere.

        Raises
        ------
        InputError
            The file does not exist.
        """
        return self._existing_path("atmosphere.table", self.atmosphere.table)

    def aerodynamic_table(self, key: str) -> str | Path:
        """Aerodynamic database at ``aerodynamics.KEY``: its ``builtin:`` name unchanged, or the path of its file.

        Raises
        ------
        InputError
            The file does not exist.
        """
        reference = str(getattr(self.aerodynamics, key))
        return reference if reference.startswith(BUILTIN) else self._existing_path(f"aerodynamics.{key}", reference)

    def damping_path(self) -> Path | None:
        """Path of the table of pitch and yaw damping; None where the mission names none.

        Raises
        ------
        InputError
            The file does not exist.
        """
        reference = None if self.aerodynamics is None else self.aerodynamics.damping
        return None if reference is None else self._existing_path("aerodynamics.damping", reference)

    def increments_path(self) -> Path | None:
        """Path of the database's increments; None where the mission names none.

        Raises
        ------
        InputError
            The file does not exist.
        """
        reference = None if self.aerodynamics is None else self.aerodynamics.increments
        return None if reference is None else self._existing_path("aerodynamics.increments", reference)

    def active_effects(self) -> tuple[EffectInstance, ...]:
        """Return the mission's effects in the file's order, with all their parameters.

        Effects that exist in this Python session only (`edl_filter.mission.edit_effects.with_effect`) come last.

        Raises
        ------
        InputError
            The file of a user's effect is missing or cannot be used, or has no such effect or parameter.
        """
        return (*effect_instances(self.effects, self._existing_path, self.label), *self._session)

    @property
    def session_effects(self) -> tuple[EffectInstance, ...]:
        """Effects whose class is defined in this Python session, such as a notebook, and not in a file.

        They are not part of `text`.
        """
        return self._session

    def _repr_html_(self) -> str:
        return str(render("html", self))

    def output_directory(self) -> Path:
        """Folder of the results, relative to the current folder."""
        return Path(self.outputs.directory or f"results/{self.name}")

    def _existing_path(self, key: str, reference: str, folders: bool = False) -> Path:
        """Path of the file that `key` names as `reference`, as `existing_path`."""
        return existing_path(reference, key, self._source, self.label, folders)


def mission_file(path: str | Path) -> Path:
    """File of a mission from the argument of a command: the path itself, or that of ``builtin:NAME``."""
    label = str(path)
    return shipped_mission(label[len(BUILTIN) :]) if label.startswith(BUILTIN) else Path(path)


def existing_path(reference: str, key: str, source: Path | None, label: str, folders: bool = False) -> Path:
    """Path of a file that a mission names.

    Parameters
    ----------
    reference : str
        Path or ``builtin:NAME``, as the mission has it.
    key : str
        Its dotted key, for the message.
    source : Path or None
        File of the mission; relative paths start from its folder, or from the current folder if it is None.
    label : str
        Name of the mission in the message.
    folders : bool
        Whether it may be a folder as well.

    Raises
    ------
    InputError
        It does not exist.
    """
    if reference.startswith(BUILTIN):
        return shipped_data(reference[len(BUILTIN) :], f"{label}: {key}")
    path = Path(reference).expanduser()
    if source is not None:
        path = source.parent / path  # an absolute path is not changed by this
    try:
        exists = path.is_file() or (folders and path.is_dir())
    except OSError:  # a name that no file system accepts
        exists = False
    if not exists:
        kind = "folder or file" if folders else "file"
        raise InputError(
            f"{label}: {key}: found {reference!r}, but there is no {kind} {path}; expected a {kind}, "
            "or builtin:NAME for data that the package ships."
        )
    return path


def require_prediction_inputs(mission: Mission, label: str | None = None) -> None:
    """Check that a mission has the sections from which a flight is predicted.

    Parameters
    ----------
    mission : Mission
        Mission to check.
    label : str, optional
        File that the message names; by default that of the mission.

    Raises
    ------
    InputError
        The mission has no aerodynamic database or no inertia, or another IMU drives in the atmosphere than at entry.
    """
    for key, section in (("aerodynamics", mission.aerodynamics), ("vehicle.inertia", mission.vehicle.inertia)):
        if section is None:
            raise InputError(
                f"{label or mission.label}: {key}: found nothing; "
                "a diagnosis compares the flight with a prediction, which needs it."
            )
    if isinstance(mission.telemetry, MerImuConfig) and mission.telemetry.driving != "backshell":
        raise InputError(
            f"{label or mission.label}: telemetry.driving: found {mission.telemetry.driving}; a diagnosis compares the "
            "readings of the IMU that drives from entry on: run the mission with backshell first."
        )


def _as_json(value: Any) -> Any:
    """Arrays and paths in the data of `Mission.from_dict` as JSON values."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
