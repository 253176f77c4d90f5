"""Sections of the telemetry: its file or folder, its clock, its instruments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, Tag, model_validator

from edl_filter.mission.fields import (
    DEG,
    DEGREE_RATES,
    DEGREES,
    PARTS,
    ForceSigma,
    LeverArm,
    Sclk,
    Section,
    Time,
    Utc,
    WindowConfig,
    discriminator,
)
from edl_filter.mission.validators import (
    Number,
    Quaternion,
    RotationMatrix,
    Switch,
    Within,
    field_error,
    nearest_rotation_matrix,
    normalised,
    value_text,
)
from edl_filter.telemetry.clock import SclkClock
from edl_filter.types import Array

if TYPE_CHECKING:
    from edl_filter.imu_model.sensor_errors import SensorErrors


class ClockConfig(Section):
    """One pair of simultaneous readings of the spacecraft clock and UTC."""

    sclk: Sclk = Field(description="spacecraft clock count, s")
    utc: Utc = Field(description="UTC at that count, ISO 8601")


RateDegH = Annotated[Number, Within("deg/h", -1e3, 1e3)]


class ErrorBudgetConfig(Section):
    """Noise and constant errors of one source of samples."""

    accelerometer_noise: ForceSigma = Field(description="1 sigma of one sample, m/s^2")
    gyro_noise: Annotated[Number, Within("rad/s", 0.0, 1e-2, DEGREES, above=True)] = Field(
        description="1 sigma of one sample, rad/s"
    )
    accelerometer_bias_sigma: Annotated[Number, Within("m/s^2", 0.0, 1.0)] = Field(
        default=0.0, description="1 sigma of the constant error, m/s^2; 0: none"
    )
    accelerometer_scale_sigma: Annotated[Number, Within("", 0.0, 0.1, PARTS)] = Field(
        default=0.0, description="1 sigma of the scale error, relative; 0: none"
    )
    accelerometer_misalignment_sigma: Annotated[Number, Within("rad", 0.0, 0.1, DEGREES)] = Field(
        default=0.0, description="1 sigma of the misalignment about each axis, rad; 0: none"
    )
    gyro_bias_sigma: Annotated[Number, Within("rad/s", 0.0, 1e-3, DEGREE_RATES)] = Field(
        default=0.0, description="1 sigma of the constant error, rad/s; 0: none"
    )
    gyro_scale_sigma: Annotated[Number, Within("", 0.0, 0.1, PARTS)] = Field(
        default=0.0, description="1 sigma of the scale error, relative; 0: none"
    )

    @property
    def errors(self) -> SensorErrors:
        """Sigmas of the constant errors, in the form of the telemetry's records."""
        from edl_filter.imu_model.sensor_errors import SensorErrors

        return SensorErrors(
            accelerometer_bias=self.accelerometer_bias_sigma,
            accelerometer_scale=self.accelerometer_scale_sigma,
            accelerometer_misalignment=self.accelerometer_misalignment_sigma,
            gyro_bias=self.gyro_bias_sigma,
            gyro_scale=self.gyro_scale_sigma,
        )


Angle = Annotated[Number, Within("deg", -5.0, 5.0)]


class ImuConfig(ErrorBudgetConfig):
    """Mounting, noise and error budget of one IMU."""

    spacecraft_from_imu: Quaternion = Field(
        description="quaternion, scalar last, that takes IMU components to spacecraft ones"
    )
    position: LeverArm = Field(description="position from the centre of mass, m, spacecraft axes")
    position_sigma: Annotated[Number, Within("m", 0.0, 1.0)] = Field(
        default=0.0, description="1 sigma of the position along each axis, m; 0: exact"
    )
    alignment_deg: tuple[Angle, Angle, Angle] = Field(
        default=(0.0, 0.0, 0.0),
        description="rotation vector of its axes against those of the driving IMU, deg, spacecraft axes; removed from "
        "its readings while it checks",
    )
    alignment_sigma_deg: Annotated[Number, Within("deg", 0.0, 5.0)] = Field(
        default=0.0,
        description="1 sigma of the alignment with the driving IMU about each axis while it checks, deg; 0: exact",
    )
    clock_sigma_s: Annotated[Number, Within("s", 0.0, 1.0)] = Field(
        default=0.0,
        description="1 sigma of the offset of its clock from that of the driving IMU while it checks, s; 0: exact",
    )
    transformed_alignment_deg: tuple[Angle, Angle] = Field(
        default=(0.0, 0.0),
        description="share of a_z that the on-board transform adds to a_x and a_y, deg: of the backshell's in the "
        "accelerations of TRANSFORMED, of the rover's in the velocity register",
    )
    onboard_rate_correction_deg_h: tuple[RateDegH, RateDegH, RateDegH] = Field(
        default=(0.0, 0.0, 0.0),
        description="what the on-board software subtracts from the gyros for its quaternion, deg/h, spacecraft axes",
    )

    @property
    def spacecraft_from_imu_quaternion(self) -> Array:
        """`spacecraft_from_imu` divided by its norm, (4,)."""
        return normalised(self.spacecraft_from_imu)

    @property
    def alignment(self) -> Array:
        """`alignment_deg` in rad, (3,)."""
        return np.array(self.alignment_deg) * DEG

    @property
    def alignment_sigma(self) -> float:
        """`alignment_sigma_deg` in rad."""
        return self.alignment_sigma_deg * DEG

    @property
    def transformed_alignment(self) -> tuple[float, float]:
        """`transformed_alignment_deg` in rad."""
        x, y = self.transformed_alignment_deg
        return x * DEG, y * DEG

    @property
    def onboard_rate_correction(self) -> Array:
        """`onboard_rate_correction_deg_h` in rad/s, (3,)."""
        return np.array(self.onboard_rate_correction_deg_h) * DEG / 3600.0


class VelocityRegisterConfig(ErrorBudgetConfig):
    """The rover's velocity register and quaternion, the only samples after the end of HIGHRATE."""

    frame: RotationMatrix = Field(
        description="3 rows: axes in which the register accumulates, in J2000 (Earth mean equator and equinox)"
    )

    @property
    def frame_matrix(self) -> Array:
        """`frame` made orthonormal to rounding, (3, 3): takes J2000 to register components."""
        return nearest_rotation_matrix(self.frame)


class MerImuConfig(WindowConfig):
    """Telemetry of a Mars Exploration Rover, PDS volume merimu_1001."""

    format: Literal["mer-imu"] = Field(description="mer-imu: PDS volume merimu_1001")
    path: str | None = Field(
        default=None,
        description="folder of the volume, or builtin:mer_a, builtin:mer_b: its numbers, which the package ships; "
        "absent: the volume below $EDL_FILTER_DATA or downloaded by 'edl-filter fetch', otherwise the shipped numbers",
    )
    spacecraft: Literal[1, 2] = Field(description="1 is Opportunity (MER-B), 2 is Spirit (MER-A)")
    clock: ClockConfig = Field(description="spacecraft clock against UTC")
    epoch_sclk: Sclk = Field(description="spacecraft clock count at time 0, s")
    velocity_register: VelocityRegisterConfig = Field(description="the rover's accumulated velocity and quaternion")
    imus: dict[Literal["backshell", "rover"], ImuConfig] = Field(
        min_length=2,
        description="backshell, which drives up to the event backshell_separation, and rover, which drives after",
    )
    driving: Literal["backshell", "rover"] = Field(
        default="backshell",
        description="IMU that drives in HIGHRATE up to backshell_separation: rover as in the thesis, with the "
        "backshell's before; a diagnosis needs the backshell's, which drives from entry on",
    )
    driving_from_s: Time | None = Field(
        default=None, description="time from which the rover's IMU drives, s; absent: from the start of HIGHRATE on"
    )

    @model_validator(mode="after")
    def _epoch_near_clock(self) -> MerImuConfig:
        if abs(self.epoch_sclk - self.clock.sclk) > 1e5:
            raise field_error(value_text(self.epoch_sclk), f"s near clock.sclk = {self.clock.sclk!r}", "epoch_sclk")
        return self

    @model_validator(mode="after")
    def _time_of_the_rover(self) -> MerImuConfig:
        if self.driving_from_s is not None and self.driving != "rover":
            raise field_error(value_text(self.driving_from_s), "telemetry.driving: rover with it", "driving_from_s")
        return self

    @property
    def sclk_clock(self) -> SclkClock:
        """Spacecraft clock against UTC."""
        return SclkClock(self.clock.sclk, self.clock.utc)

    @property
    def epoch_utc(self) -> str:
        """UTC of time 0, ISO 8601."""
        return self.sclk_clock.to_utc(self.epoch_sclk)


class SampleChecksConfig(Section):
    """Checks of the IMUs' samples: bad ones are treated as lost, and lost ones are filled."""

    enabled: Switch = Field(
        default=True, description="false: only samples that are missing or not finite are treated as lost"
    )
    spike_sigmas: Annotated[Number, Within("", 5.0, 1e6)] = Field(
        default=15.0, description="robust sigmas by which a single sample leaves its neighbours, from which it is bad"
    )
    disagreement_sigmas: Annotated[Number, Within("", 5.0, 1e6)] = Field(
        default=15.0, description="robust sigmas by which an IMU leaves its neighbours and the other IMU"
    )
    false_alarm_probability: Annotated[Number, Within("", 0.0, 0.01, above=True)] = Field(
        default=1e-6, description="probability per axis with which a repetition by chance is taken for a stuck axis"
    )
    longest_gap_s: Annotated[Number, Within("s", 0.0, 100.0)] = Field(
        default=30.0, description="longest stretch that is filled without another IMU, s; a longer one is refused"
    )


class FlightFileConfig(Section):
    """Telemetry in a flight file, which contains its epoch, IMUs and constraints."""

    format: Literal["flight-file"] = Field(description="flight-file: HDF5 in the neutral layout")
    path: str = Field(description="flight file: a path (--set telemetry.path=FILE), or builtin:NAME")
    driving: str | None = Field(default=None, description="driving IMU; absent: primary, or the only IMU")


class PhoenixPdsConfig(Section):
    """Telemetry of Phoenix, which the package cannot read yet."""

    format: Literal["phoenix-pds"] = Field(description="phoenix-pds: raw IMU product (not read yet)")
    product: str = Field(description="the PDS product that is needed")
    path: str | None = Field(default=None, description="folder of the product")
    epoch_utc: Utc = Field(description="UTC of time 0, ISO 8601")


def _format_tag(value: Any) -> str:
    return f"<{value.get('format') if isinstance(value, dict) else getattr(value, 'format', None)}>"


TelemetryConfig = Annotated[
    Annotated[FlightFileConfig, Tag("<flight-file>")]
    | Annotated[MerImuConfig, Tag("<mer-imu>")]
    | Annotated[PhoenixPdsConfig, Tag("<phoenix-pds>")],
    discriminator(_format_tag),
]
