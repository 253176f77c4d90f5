"""Schema of the YAML specification that `csv_log.convert` reads, and its reader.

Input: a YAML file. Output: a validated `LogSpec`. The schema is independent of the mission's. An example with every
key: ``docs/examples/imu_log.spec.yaml``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from edl_filter.errors import InputError, quoted
from edl_filter.io.yaml_guard import refuse_aliases

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Number, Number, Number]
Sigmas = tuple[Positive, Positive, Positive]
Quaternion = tuple[Number, Number, Number, Number]
Matrix = tuple[Vector, Vector, Vector]


class Section(BaseModel):
    """Base class of all sections: unknown keys are an error."""

    model_config = ConfigDict(extra="forbid")


class TimeColumn(Section):
    """Column of times; ``epoch`` is the log's time (in `unit`) at time 0 of the flight file."""

    column: str
    unit: Literal["s", "ms", "us"]
    epoch: Number = 0.0


class ForceColumns(Section):
    """Specific force (m/s^2, g, mg) or velocity increments per sample (m/s)."""

    columns: tuple[str, str, str]
    unit: Literal["m/s^2", "g", "mg", "m/s"]


class RateColumns(Section):
    """Angular rate (rad/s, deg/s, deg/h) or angle increments per sample (rad, deg)."""

    columns: tuple[str, str, str]
    unit: Literal["rad/s", "deg/s", "deg/h", "rad", "deg"]


class ImuSpec(Section):
    """One IMU; ``body_from_imu`` is a quaternion [x, y, z, w] or a 3 x 3 matrix, row by row."""

    time: TimeColumn
    sample_interval_s: Positive
    specific_force: ForceColumns
    angular_rate: RateColumns
    body_from_imu: Quaternion | Matrix
    position_m: Vector
    accelerometer_noise_m_s2: Positive
    gyro_noise_rad_s: Positive
    accelerometer_bias_sigma_m_s2: NotNegative = 0.0
    accelerometer_scale_sigma: NotNegative = 0.0
    accelerometer_misalignment_sigma_rad: NotNegative = 0.0
    gyro_bias_sigma_rad_s: NotNegative = 0.0
    gyro_scale_sigma: NotNegative = 0.0


class InitialSpec(Section):
    """Inertial initial state; one sigma per axis, for the attitude about body axes."""

    time_s: Number
    position_m: Vector
    velocity_m_s: Vector
    inertial_from_body: Quaternion
    position_sigma_m: Sigmas
    velocity_sigma_m_s: Sigmas
    attitude_sigma_rad: Sigmas


class EventSpec(Section):
    """Time of one event, with one sigma."""

    time_s: Number
    time_sigma_s: Positive


class ParachuteSpec(Section):
    """Dynamic pressure at parachute deployment, with one sigma."""

    time_s: Number
    dynamic_pressure_pa: Positive
    dynamic_pressure_sigma_pa: Positive


class LandingSpec(Section):
    """Planet-fixed position at rest after the landing, one sigma per axis."""

    time_s: Number
    position_m: Vector
    position_sigma_m: Sigmas


class HeightColumn(Section):
    """Column of heights; an empty field is a row without a measurement."""

    column: str
    unit: Literal["m", "km"]


class AltimeterSpec(Section):
    """Radar altimeter: height above a sphere of radius `surface_radius_m`."""

    time: TimeColumn
    height: HeightColumn
    sigma_m: Positive
    surface_radius_m: Positive


class LogSpec(Section):
    """The whole specification."""

    name: str
    planet: str
    epoch_utc: str
    prime_meridian_at_epoch_rad: Number
    imu: dict[str, ImuSpec]
    initial: InitialSpec
    events: dict[str, EventSpec] = {}
    parachute: ParachuteSpec | None = None
    landing: LandingSpec | None = None
    altimeter: AltimeterSpec | None = None


def read_spec(path: str | Path) -> LogSpec:
    """Read and validate a specification.

    Raises
    ------
    InputError
        No such file, no YAML, or a key that is unknown, missing or of a wrong value. The message names the file, the
        key and the value.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        refuse_aliases(text, str(path))
        content = yaml.safe_load(text)
    except OSError as error:
        raise InputError(f"{path}: the specification cannot be read ({error.strerror}).") from None
    except (yaml.YAMLError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}{line}: this is not YAML ({getattr(error, 'problem', error)}).") from None
    try:
        spec = LogSpec.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or "the file"
        if first["type"] == "extra_forbidden":
            raise InputError(f"{path}: {key} is an unknown key.") from None
        if first["type"] == "missing":
            raise InputError(f"{path}: {key} is missing.") from None
        raise InputError(f"{path}: {key} is {quoted(first['input'])}; {first['msg']}.") from None
    if "primary" not in spec.imu:
        raise InputError(f"{path}: imu has {', '.join(spec.imu) or 'nothing'}; one IMU must be called primary.")
    return spec
