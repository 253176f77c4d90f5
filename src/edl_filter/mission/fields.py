"""Building blocks of the sections of a mission file: the base class, and numbers with unit and accepted range."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from edl_filter.errors import InputError
from edl_filter.mission.validators import Number, Vector, Within, field_error, value_text
from edl_filter.telemetry.clock import parse_utc

#: Radians in a degree
DEG = math.pi / 180.0

# Units that are often used by mistake, each with the factor that converts it to the right unit
KM = (("km", 1e3), ("cm", 1e-2), ("mm", 1e-3))
PERCENT = (("%", 1e-2),)
PARTS = (("ppm", 1e-6), *PERCENT)
DEGREES = (("deg", DEG),)
DEGREE_RATES = (("deg/s", DEG), ("deg/h", DEG / 3600), ("deg/day", DEG / 86400))


def _utc(text: str) -> str:
    try:
        parse_utc(text)
    except InputError:
        raise field_error(value_text(text), "a UTC time in ISO 8601, such as 2004-01-04T04:21:21.532") from None
    return text


Radius = Annotated[Number, Within("m", 1e5, 1e8, KM)]
Time = Annotated[Number, Within("s", -1e5, 1e5)]
TimeSigma = Annotated[Number, Within("s", 0.0, 1e3, above=True)]
Sclk = Annotated[Number, Within("s", 0.0, 1e10, above=True)]
Utc = Annotated[str, AfterValidator(_utc)]
LengthSigma = Annotated[Number, Within("m", 0.0, 1e6, above=True)]
SpeedSigma = Annotated[Number, Within("m/s", 0.0, 1e3, above=True)]
AngleSigma = Annotated[Number, Within("deg", 0.0, 180.0, above=True)]
ForceSigma = Annotated[Number, Within("m/s^2", 0.0, 1.0, above=True)]
RelativeSigma = Annotated[Number, Within("", 0.0, 1.0, PERCENT, above=True)]
Pressure = Annotated[Number, Within("Pa", 10.0, 1e6, (("kPa", 1e3),))]
Mass = Annotated[Number, Within("kg", 1.0, 1e5, (("t", 1e3), ("g", 1e-3)))]
LeverArm = Annotated[Vector, Within("m", 0.0, 20.0, (("mm", 1e-3), ("cm", 1e-2)))]
Moment = Annotated[Number, Within("kg m^2", 0.0, 1e7, above=True)]
Product = Annotated[Number, Within("kg m^2", -1e6, 1e6)]
ProductSigma = Annotated[Number, Within("kg m^2", 0.0, 1e6)]


class Section(BaseModel):
    """Base class of the sections of a file: frozen; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def discriminator(tag_of: Callable[[Any], str]) -> Discriminator:
    """Select one form of a section by the tag that `tag_of` returns for the data.

    Tags are written in angle brackets, which `edl_filter.mission.error_messages` removes from keys.
    """
    return Discriminator(tag_of)


class FromTelemetryConfig(Section):
    """Take the values and their sigmas from the telemetry's file."""

    from_: Literal["telemetry"] = Field(alias="from", description="telemetry: values and sigmas are in its file")


def _source_tag(value: Any) -> str:
    from_telemetry = "from" in value if isinstance(value, dict) else isinstance(value, FromTelemetryConfig)
    return "<telemetry>" if from_telemetry else "<stated>"


Stated = TypeVar("Stated")
FromTelemetry = TypeVar("FromTelemetry", bound=FromTelemetryConfig)
#: A section whose values are stated in the mission, or the section that takes them from the telemetry's file.
StatedOrFromTelemetry = Annotated[
    Annotated[Stated, Tag("<stated>")] | Annotated[FromTelemetry, Tag("<telemetry>")], discriminator(_source_tag)
]


class WindowConfig(Section):
    """A span of time."""

    start_s: Time = Field(description="beginning, s since the epoch")
    end_s: Time = Field(description="end, s since the epoch")

    @model_validator(mode="after")
    def _start_before_end(self) -> WindowConfig:
        if self.start_s >= self.end_s:
            raise field_error(value_text(self.end_s), f"s, after start_s = {self.start_s!r}", "end_s")
        return self
