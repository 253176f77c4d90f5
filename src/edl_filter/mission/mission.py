"""A mission: its sections, read and checked together, and the files that it names."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, PrivateAttr, StringConstraints, ValidationError, model_validator

from edl_filter.errors import InputError
from edl_filter.mission.aerodynamics import Aerodynamics, Postflight
from edl_filter.mission.checks import shown
from edl_filter.mission.consistency import check_together, event_times
from edl_filter.mission.effects import EffectEntry, switched_on
from edl_filter.mission.estimation import Constraints, FilterSettings, InitialState, Outputs
from edl_filter.mission.measurements import MerImu, PhoenixPds, Telemetry
from edl_filter.mission.messages import describe
from edl_filter.mission.sections import Section
from edl_filter.mission.text import flow_text, parse, parse_override, read_text, set_key
from edl_filter.mission.world import Atmosphere, Planet, Vehicle

if TYPE_CHECKING:
    from edl_filter.effects.effect import Active, Effect
    from edl_filter.planet import Planet as PlanetModel

BUILTIN = "builtin:"
#: Keys that name a file to read. In a mission file they start from its folder, in --set from the current one.
PATH_KEYS = (
    "telemetry.path",
    "atmosphere.table",
    "aerodynamics.continuum",
    "aerodynamics.rarefied",
    "aerodynamics.damping",
)


class Mission(Section):
    """The model of one entry. Made by `Mission.load` or `Mission.from_dict`.

    Attributes are the file's sections; `text` and `source` say what was read.
    """

    name: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_\-]+$")] = Field(
        description="short name, letters, digits, _ and -"
    )
    title: str = Field(default="", description="name for people")
    planet: Planet = Field(description="the planet")
    atmosphere: Atmosphere = Field(description="preflight atmosphere")
    telemetry: Telemetry = Field(description="what was measured")
    vehicle: Vehicle = Field(description="the vehicle")
    aerodynamics: Aerodynamics | None = Field(
        default=None, description="aerodynamic database; absent: no atmosphere and no coefficients are derived"
    )
    postflight: Postflight = Field(default=Postflight(), description="how they are derived")
    initial_state: InitialState = Field(description="state at entry")
    constraints: Constraints = Field(default=Constraints(), description="an absent constraint is not used")
    filter: FilterSettings = Field(default=FilterSettings(), description="the filter's settings")
    effects: tuple[EffectEntry, ...] = Field(default=(), description="physical effects that are switched on")
    outputs: Outputs = Field(default=Outputs(), description="what is written")

    _text: str = PrivateAttr("")
    _source: Path | None = PrivateAttr(None)
    _session: tuple[Active, ...] = PrivateAttr(())

    @classmethod
    def load(cls, path: str | Path, overrides: Sequence[str] = ()) -> Mission:
        """Read the mission file at `path`, or the shipped one that ``builtin:NAME`` names.

        Parameters
        ----------
        path : str or Path
        overrides : sequence of str
            ``KEY=VALUE`` with a dotted key; the value is YAML, and ``null`` leaves a section out. A
            relative path given to a key that names a file starts from the current folder, as anyone at a
            shell expects.

        Raises
        ------
        InputError
            The file cannot be read, is not YAML, or a key is unknown, missing or wrong.
        """
        text_path = str(path)
        file = shipped_mission(text_path[len(BUILTIN) :]) if text_path.startswith(BUILTIN) else Path(path)
        return cls.from_text(read_text(file), str(path), file, overrides)

    @classmethod
    def from_dict(cls, data: dict[str, Any], source: str = "mission", overrides: Sequence[str] = ()) -> Mission:
        """Mission of plain `data` in the file's form; `source` stands for the file in messages.

        Relative paths start from the current folder.

        Raises
        ------
        InputError
            As `load`.
        """
        plain = json.loads(json.dumps(data, default=_plain))
        return cls.from_text(flow_text(plain, "  "), source, None, overrides)

    @classmethod
    def from_text(cls, text: str, where: str, source: Path | None, overrides: Sequence[str] = ()) -> Mission:
        """Mission of a file's `text`, which messages call `where`; its relative paths start beside `source`.

        Raises
        ------
        InputError
            As `load`.
        """
        changed = []
        for override in overrides:
            key, value = parse_override(override)
            if key in PATH_KEYS and isinstance(value, str) and not value.startswith(BUILTIN):
                value = str(Path(value).expanduser().absolute())
            text = set_key(text, key, value, where)
            changed.append(key)
        data = parse(text, where)
        if not isinstance(data, dict):
            raise InputError(f"{where}: found {_kind(data)}; expected a mapping of keys, such as 'name: my_mission'.")
        try:
            mission = cls.model_validate(data)
        except ValidationError as error:
            raise InputError(describe(error, cls, where, changed)) from None
        mission._text, mission._source = text, source
        return mission

    @property
    def text(self) -> str:
        """The mission's YAML with all changes made, to be kept with results."""
        return self._text

    @property
    def source(self) -> Path | None:
        """File that was read."""
        return self._source

    @model_validator(mode="after")
    def _consistent(self) -> Mission:
        check_together(self)
        return self

    def planet_model(self, prime_meridian: float | None = None) -> PlanetModel:
        """Planet with gravity, shape and rotation.

        Parameters
        ----------
        prime_meridian : float, optional
            Angle to the prime meridian at the epoch, rad, as the telemetry says it; used where the mission
            does not state one.

        Raises
        ------
        InputError
            Neither states one.
        """
        from edl_filter.planet import Planet as PlanetModel

        angle = self.planet.prime_meridian if self.planet.prime_meridian is not None else prime_meridian
        if angle is None:
            raise InputError(f"{self._where}: planet.prime_meridian_deg: found nothing; expected deg at the epoch.")
        return PlanetModel(
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
        """Give the times of the events that the mission states, s since the epoch, in order."""
        return dict(event_times(self))

    def telemetry_path(self) -> Path | None:
        """File or folder of the telemetry; None where the reader knows where to look (mer-imu).

        Raises
        ------
        InputError
            It does not exist, or the package cannot read it (phoenix-pds).
        """
        telemetry = self.telemetry
        if isinstance(telemetry, PhoenixPds):
            found = "no path" if telemetry.path is None else shown(telemetry.path)
            raise InputError(
                f"{self._where}: telemetry.path: found {found}; this mission needs {telemetry.product}, "
                "which edl-filter cannot read yet. Bring it as a table with 'edl-filter convert LOG.csv "
                "--spec S.yaml -o FLIGHT.h5', then run a mission with telemetry.format: flight-file, such "
                "as practice_phoenix."
            )
        if telemetry.path is None:
            return None
        return self._existing("telemetry.path", telemetry.path, folder=isinstance(telemetry, MerImu))

    def atmosphere_path(self) -> Path:
        """Table of the preflight atmosphere.

        Raises
        ------
        InputError
            There is no such file.
        """
        return self._existing("atmosphere.table", self.atmosphere.table)

    def aerodynamic_table(self, key: str) -> str | Path:
        """Aerodynamic database at ``aerodynamics.KEY``: a ``builtin:`` name as it stands, or the file's path.

        Raises
        ------
        InputError
            There is no such file.
        """
        reference = str(getattr(self.aerodynamics, key))
        return reference if reference.startswith(BUILTIN) else self._existing(f"aerodynamics.{key}", reference)

    def damping_path(self) -> Path | None:
        """Table of pitch and yaw damping; None where the mission names none.

        Raises
        ------
        InputError
            There is no such file.
        """
        reference = None if self.aerodynamics is None else self.aerodynamics.damping
        return None if reference is None else self._existing("aerodynamics.damping", reference)

    def active_effects(self) -> tuple[Active, ...]:
        """Give the effects that are switched on, in the file's order, with all their parameters.

        Those that only this Python session has (`with_effect`) come last.

        Raises
        ------
        InputError
            The file of a user's effect is missing or cannot be used, or has no such effect or parameter.
        """
        return (*switched_on(self.effects, self._existing, self._where), *self._session)

    def with_effect(
        self,
        effect: str | Effect | type[Effect] | Active | None,
        *,
        imu: str | None = None,
        fixed: bool = False,
        **values: float,
    ) -> Mission:
        """Give this mission with one effect more; see `edl_filter.mission.having.with_effect`."""
        from edl_filter.mission.having import with_effect

        return with_effect(self, effect, imu, fixed, values)

    def with_effects(self, model: Sequence[Active]) -> Mission:
        """Give this mission with a `model`: its own effects at other values, then further ones.

        Raises
        ------
        InputError
            The model does not begin with the mission's own effects.
        """
        from edl_filter.mission.having import with_effects

        return with_effects(self, model)

    @property
    def session_effects(self) -> tuple[Active, ...]:
        """Effects that no file names: a class written in a notebook. They are not in `text`."""
        return self._session

    def _repr_html_(self) -> str:
        from edl_filter.report.cards import mission_card

        return mission_card(self)

    def output_directory(self) -> Path:
        """Folder of the results, relative to the current folder."""
        return Path(self.outputs.directory or f"results/{self.name}")

    @property
    def _where(self) -> str:
        return str(self._source or self.name)

    def _existing(self, key: str, reference: str, folder: bool = False) -> Path:
        if reference.startswith(BUILTIN):
            return _builtin_data(reference[len(BUILTIN) :], f"{self._where}: {key}")
        path = Path(reference).expanduser()
        if self._source is not None:
            path = self._source.parent / path  # an absolute path stays as it is
        if not (path.is_dir() if folder else path.is_file()):
            what = "folder" if folder else "file"
            raise InputError(
                f"{self._where}: {key}: found {reference!r}, but there is no {what} {path}; expected a {what}"
                + ("." if folder else ", or builtin:NAME for data that the package ships.")
            )
        return path


def shipped_mission(name: str) -> Path:
    """Path of the mission file that the package ships as `name`.

    An installed wheel holds them in the package; a working copy has them in ``missions/`` beside ``src/``.

    Raises
    ------
    InputError
        There is none of that name.
    """
    for folder in _shipped():
        if (path := folder / f"{name}.yaml").is_file():
            return path
    raise InputError(f"{BUILTIN}{name}: found no such mission; expected one of {', '.join(shipped_names())}.")


def shipped_names() -> list[str]:
    """Names of the missions that the package ships."""
    return sorted({path.stem for folder in _shipped() for path in folder.glob("*.yaml")})


def _shipped() -> tuple[Path, Path]:
    package = Path(str(files("edl_filter")))
    return package / "missions", package.parent.parent / "missions"


def _builtin_data(name: str, where: str) -> Path:
    folder = Path(str(files("edl_filter"))) / "data"
    for suffix in (".csv", ".h5"):
        if (path := folder / (name + suffix)).is_file():
            return path
    names = ", ".join(sorted(path.stem for path in folder.glob("*") if path.suffix in (".csv", ".h5")))
    raise InputError(f"{where}: found {BUILTIN + name!r}; the package ships {names}.")


def _plain(value: Any) -> Any:
    """Arrays and paths in the data of `Mission.from_dict` as JSON holds them."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _kind(data: Any) -> str:
    return {list: "a list", type(None): "nothing"}.get(type(data), shown(data))
