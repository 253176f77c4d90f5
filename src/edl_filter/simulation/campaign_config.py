"""A campaign file: flights × dispersions × number of cases, in the form of a mission's sections.

Every error in it is one `InputError` that names file and key. `edl_filter.simulation.dispersion` draws one case.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import (
    BeforeValidator,
    Field,
    PrivateAttr,
    StringConstraints,
    field_validator,
    model_validator,
)

from edl_filter.errors import InputError
from edl_filter.mission.effects import ParameterValue
from edl_filter.mission.error_messages import validated
from edl_filter.mission.fields import KM, PERCENT, Section
from edl_filter.mission.shipped import BUILTIN
from edl_filter.mission.validators import Number, Switch, Within, field_error, value_text
from edl_filter.mission.yaml_text import parse, read_text
from edl_filter.simulation.scenario import Weather

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_\-]+$")]


class Distribution(Section):
    """A number, or how it is drawn: ``{sigma: S}`` normal about `mean`, ``{low: A, high: B}`` uniform."""

    value: ParameterValue | None = Field(default=None, description="the same in every case")
    mean: Number = Field(default=0.0, description="of a normal distribution")
    sigma: Annotated[Number, Within("", 0.0, 1e9)] | None = Field(default=None, description="1 sigma of it")
    low: Number | None = Field(default=None, description="lower end of a uniform distribution")
    high: Number | None = Field(default=None, description="upper end of it")

    @model_validator(mode="after")
    def _one_form(self) -> Distribution:
        uniform = self.low is not None or self.high is not None
        if (self.value is not None) + (self.sigma is not None) + uniform != 1:
            raise field_error("no form, or several", "a number, or {mean: M, sigma: S}, or {low: A, high: B}")
        if uniform and (self.low is None or self.high is None or self.low > self.high):
            raise field_error(f"low {self.low} and high {self.high}", "both, low not above high")
        return self


def _number_as_section(value: Any) -> Any:
    return {"value": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


class DispersedEffectConfig(Section):
    """An effect that is drawn: in a scenario it is flown, in the model of a measured flight it is assumed."""

    name: Annotated[str, StringConstraints(min_length=1)] = Field(
        description="name in the catalogue ('edl-filter effects'), of an installed package's effect, or in the file"
    )
    file: str | None = Field(
        default=None, description="Python file with a user's effect, relative to the campaign's folder"
    )
    imu: str | None = Field(default=None, description="IMU that a sensor effect acts on; absent: the driving IMU")
    probability: Annotated[Number, Within("", 0.0, 1.0, PERCENT)] = Field(
        default=1.0, description="share of the cases that have the effect"
    )
    size: Annotated[Number, Within("", 0.0, 100.0)] = Field(
        default=1.0, description="1 sigma of the sizes that are not listed, in plausible sizes of the catalogue"
    )
    parameters: dict[str, Annotated[Distribution, BeforeValidator(_number_as_section)]] = Field(
        default_factory=dict, description="value or distribution by parameter, SI and rad"
    )


class EntryDispersionConfig(Section):
    """Normal errors of the entry state, each component alone."""

    position_sigma: Annotated[Number, Within("m", 0.0, 1e6, KM)] = Field(default=0.0, description="1 sigma, m")
    velocity_sigma: Annotated[Number, Within("m/s", 0.0, 1e3)] = Field(default=0.0, description="1 sigma, m/s")
    attitude_sigma_deg: Annotated[Number, Within("deg", 0.0, 45.0)] = Field(
        default=0.0, description="1 sigma about each body axis, deg"
    )


class VehicleDispersionConfig(Section):
    """Constant errors of mass and inertia (a simulated vehicle only)."""

    mass_sigma: Annotated[Number, Within("", 0.0, 0.1, PERCENT)] = Field(default=0.0, description="1 sigma, relative")
    inertia_sigma: Annotated[Number, Within("", 0.0, 0.2, PERCENT)] = Field(
        default=0.0, description="1 sigma of a factor on the whole tensor, relative"
    )


class DispersionConfig(Section):
    """What is drawn anew in each case. A scenario also draws what it states itself."""

    initial_state: EntryDispersionConfig = Field(
        default=EntryDispersionConfig(), description="true entry state; of a measured flight the assumed one"
    )
    imu_errors: Annotated[Number, Within("", 0.0, 100.0)] | None = Field(
        default=None,
        description="constant sensor errors, in stated sigmas; absent: a scenario's own, for a measured flight none. "
        "With an on-board attitude, which has the gyros' errors too, those of the accelerometers only",
    )
    database: Annotated[Number, Within("", 0.0, 10.0)] = Field(
        default=0.0, description="random field of the database's error, in its sigmas (a third of three sigma)"
    )
    air: Weather = Field(default=Weather(), description="density and winds")
    vehicle: VehicleDispersionConfig = Field(default=VehicleDispersionConfig(), description="mass and inertia")
    effects: tuple[DispersedEffectConfig, ...] = Field(default=(), description="effects that are drawn")


class FlightConfig(Section):
    """A simulated flight (`scenario`), reconstructed with `mission`; or the measured flight of `mission`."""

    scenario: str | None = Field(default=None, description="scenario file, or builtin:NAME; absent: a measured flight")
    mission: str | None = Field(
        default=None, description="mission file, or builtin:NAME; absent: that which the scenario names"
    )
    scenario_set: tuple[str, ...] = Field(default=(), description="changes of the scenario, KEY=VALUE")
    set: tuple[str, ...] = Field(default=(), description="changes of the mission, KEY=VALUE")

    @model_validator(mode="after")
    def _has_a_source(self) -> FlightConfig:
        if self.scenario is None and self.mission is None:
            raise field_error("neither scenario nor mission", "scenario: FILE, mission: FILE, or both")
        if self.scenario is None and self.scenario_set:
            raise field_error("scenario_set without scenario", "scenario: FILE", "scenario_set")
        return self


class CaseKey(NamedTuple):
    """What a case is: its number, flight and dispersion."""

    number: int
    flight: str
    dispersion: str


class Campaign(Section):
    """A campaign, created by `Campaign.load`."""

    name: Name = Field(description="short name, letters, digits, _ and -")
    title: str = Field(default="", description="title of the report")
    seed: Annotated[int, Field(strict=True, ge=0)] = Field(default=1, description="of all that is drawn")
    cases: Annotated[int, Field(strict=True, ge=1, le=100_000_000)] = Field(
        description="cases of each flight with each dispersion"
    )
    time_limit_s: Annotated[Number, Within("s", 0.1, 86400.0)] = Field(
        default=300.0, description="time after which a case is ended and counts as failed, s"
    )
    start_limit_s: Annotated[Number, Within("s", 0.0, 86400.0)] = Field(
        default=300.0, description="more time for the first case of a process, which loads and compiles, s"
    )
    analysis: Literal["reconstruct", "diagnose"] = Field(
        default="reconstruct", description="what is done with a case; diagnose takes half a minute"
    )
    leave_one_out: Switch = Field(
        default=True, description="predict each constraint without itself, which doubles the time of a reconstruction"
    )
    flights: dict[Name, FlightConfig] = Field(description="flights by name")
    dispersions: dict[Name, DispersionConfig] = Field(
        default={},
        validate_default=True,
        description="dispersions by name; each is combined with each flight. Empty: one, nominal, that draws nothing",
    )

    _source: Path | None = PrivateAttr(None)

    @field_validator("dispersions")
    @classmethod
    def _nominal_if_empty(cls, value: dict[str, DispersionConfig]) -> dict[str, DispersionConfig]:
        return value or {"nominal": DispersionConfig()}

    @model_validator(mode="after")
    def _consistent(self) -> Campaign:
        if not self.flights:
            raise field_error("no entry", "at least one flight", "flights")
        measured = [name for name, flight in self.flights.items() if flight.scenario is None]
        for name, dispersion in self.dispersions.items():
            if not measured:
                continue
            if dispersion.vehicle != VehicleDispersionConfig():
                expected = f"none: {measured[0]} is a measured flight; disperse the effect mass instead"
                raise field_error("mass or inertia", expected, f"dispersions.{name}.vehicle")
            if dispersion.database and self.analysis == "reconstruct":
                expected = (
                    f"0: {measured[0]} is a measured flight, whose trajectory does not depend on the database; "
                    "or analysis: diagnose"
                )
                raise field_error(value_text(dispersion.database), expected, f"dispersions.{name}.database")
        return self

    @classmethod
    def load(cls, path: str | Path) -> Campaign:
        """Read a campaign file.

        Raises
        ------
        InputError
            The file cannot be read, is not YAML, or a key is unknown, missing or wrong.
        """
        return cls.from_dict(parse(read_text(Path(path)), str(path)), str(path), Path(path))

    @classmethod
    def from_dict(cls, data: Any, label: str = "campaign", source: Path | None = None) -> Campaign:
        """Campaign of plain data in the file's form; relative paths start from the folder of `source`.

        Raises
        ------
        InputError
            As `load`.
        """
        campaign = validated(cls, data, label)
        campaign._source = source
        return campaign

    @property
    def source(self) -> Path | None:
        """File that was read."""
        return self._source

    @property
    def label(self) -> str:
        """Name in messages: the file, or the campaign's name."""
        return str(self._source or self.name)

    @property
    def groups(self) -> list[tuple[str, str]]:
        """Pairs of flight and dispersion; case n belongs to that of index n modulo their number."""
        return [(flight, dispersion) for flight in self.flights for dispersion in self.dispersions]

    @property
    def total(self) -> int:
        """Number of all cases."""
        return self.cases * len(self.groups)

    def case(self, number: int) -> CaseKey:
        """Flight and dispersion of a case; more cases do not change those that exist.

        Raises
        ------
        InputError
            There is no case of that number.
        """
        if not 0 <= number < self.total:
            raise InputError(f"{self.label}: found case {number}; expected 0 to {self.total - 1}.")
        return CaseKey(number, *self.groups[number % len(self.groups)])

    def path(self, reference: str) -> str:
        """A path of the file as an absolute one; ``builtin:NAME`` unchanged."""
        if reference.startswith(BUILTIN):
            return reference
        folder = Path() if self._source is None else self._source.parent
        return str((folder / Path(reference).expanduser()).absolute())
