"""Convert an IMU log in CSV into a flight file, by a specification in YAML.

Input: the log, and a specification (`csv_spec.LogSpec`) of its columns and units, the orientation of the IMU in the
body, and the quantities that the log does not contain (initial state, events, fixes). An example with every key is
``docs/examples/imu_log.spec.yaml``. Output: a flight file (`flight_file_writer.write_flight_file`).
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from scipy import constants

from edl_filter import rotations
from edl_filter.errors import InputError, quoted
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.io.csv_table import numbered_lines
from edl_filter.telemetry.csv_spec import (
    AltimeterSpec,
    ImuSpec,
    InitialSpec,
    LandingSpec,
    Matrix,
    ParachuteSpec,
    Quaternion,
    TimeColumn,
    read_spec,
)
from edl_filter.telemetry.flight_file import conflicting_median_step
from edl_filter.telemetry.flight_file_writer import FlightContents, FlightImu, write_flight_file
from edl_filter.telemetry.record import (
    AltimeterRecord,
    InitialState,
    LandingFix,
    ParachuteFix,
)
from edl_filter.types import Array

#: Factors from the units of the log to SI.
_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_FORCE = {"m/s^2": 1.0, "g": constants.g, "mg": 1e-3 * constants.g}
_RATE = {"rad/s": 1.0, "deg/s": np.pi / 180.0, "deg/h": np.pi / 180.0 / 3600.0}
_LENGTH = {"m": 1.0, "km": 1e3}
#: The same for increments per sample, which become means when they are divided by the sampling interval.
_FORCE_INCREMENT = {"m/s": 1.0}
_RATE_INCREMENT = {"rad": 1.0, "deg": np.pi / 180.0}


class _Log:
    """Rows of a CSV file by column name; ``#`` starts a comment. Lines are counted from 1, comments included."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            text = path.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path}: the log cannot be read ({getattr(error, 'strerror', None) or error}).") from None
        lines = numbered_lines(text)
        try:
            rows = list(csv.reader([line for _, line in lines], skipinitialspace=True))
        except csv.Error as error:
            raise InputError(f"{path}: the log is no CSV ({error}).") from None
        if len(rows) < len(lines):  # a quoted field goes on in the next line
            number = next((number for number, line in lines if line.count('"') % 2), lines[0][0])
            raise InputError(f"{path}, line {number}: a quotation mark is not closed on its line.")
        if len(rows) < 3:
            raise InputError(f"{path}: {len(rows)} lines; a header and at least two samples are needed.")
        self.header, self.rows = [name.strip() for name in rows[0]], rows[1:]
        self.line = [number for number, _ in lines[1:]]
        for number, row in zip(self.line, self.rows, strict=True):
            if len(row) != len(self.header):
                raise InputError(f"{path}, line {number}: {len(row)} fields; the header has {len(self.header)}.")

    def index(self, name: str) -> int:
        """Index of the column `name`."""
        if self.header.count(name) != 1:
            problem = "is in the header twice" if name in self.header else "is not in the header"
            raise InputError(f"{self.path}: column {name!r} {problem}: {', '.join(self.header)[:400]}.")
        return self.header.index(name)

    def numbers(self, name: str, blank_is_nan: bool = False) -> Array:
        """Column `name` (N,); an empty field is NaN if allowed, otherwise an error."""
        column, values = self.index(name), np.empty(len(self.rows))
        for i, row in enumerate(self.rows):
            field = row[column].strip()
            if blank_is_nan and not field:
                values[i] = np.nan
                continue
            try:
                values[i] = float(field)
            except ValueError:
                values[i] = np.nan
            if not np.isfinite(values[i]):
                raise InputError(
                    f"{self.path}, line {self.line[i]}, column {name!r}: found {quoted(field)}; "
                    "a finite number is needed."
                )
        return values

    def time(self, spec: TimeColumn) -> Array:
        """Times (N,), s since the epoch; an error if they do not increase."""
        time = _TIME[spec.unit] * (self.numbers(spec.column) - spec.epoch)
        decreasing = np.diff(time) <= 0.0
        if decreasing.any():
            i = int(decreasing.argmax())
            before, after = (self.rows[k][self.index(spec.column)].strip() for k in (i, i + 1))
            raise InputError(
                f"{self.path}, line {self.line[i + 1]}, column {spec.column!r}: time must increase, "
                f"but it goes from {before} to {after}."
            )
        return time


def _body_from_imu(value: Quaternion | Matrix, spec_path: Path, name: str) -> Array:
    """Quaternion of the mounting; a matrix must be orthonormal to 1e-3."""
    body_from_imu = np.asarray(value, np.float64)
    if body_from_imu.ndim == 1:
        return body_from_imu
    if np.max(np.abs(body_from_imu @ body_from_imu.T - np.eye(3))) > 1e-3 or np.linalg.det(body_from_imu) < 0.0:
        raise InputError(f"{spec_path}: imu.{name}.body_from_imu is no rotation matrix (orthonormal, determinant +1).")
    return rotations.from_matrix(body_from_imu)


def _means(log: _Log, columns: tuple[str, ...], unit: str, mean_factors: dict[str, float],
           increment_factors: dict[str, float], interval: float) -> Array:  # fmt: skip
    """Three columns (N, 3) as means over the sampling interval, SI."""
    factor = mean_factors[unit] if unit in mean_factors else increment_factors[unit] / interval
    return factor * np.stack([log.numbers(name) for name in columns], axis=-1)


def _imu(log: _Log, spec: ImuSpec, spec_path: Path, name: str) -> FlightImu:
    """The IMU as the flight file stores it."""
    interval, time = spec.sample_interval_s, log.time(spec.time)
    if median := conflicting_median_step(time, interval):
        raise InputError(
            f"{spec_path}: imu.{name}.sample_interval_s is {interval:g}, but the usual step of column "
            f"{spec.time.column!r} in unit {spec.time.unit!r} is {median:g} s."
        )
    force, rate = spec.specific_force, spec.angular_rate
    return FlightImu(
        time=time,
        specific_force=_means(log, force.columns, force.unit, _FORCE, _FORCE_INCREMENT, interval),
        angular_rate=_means(log, rate.columns, rate.unit, _RATE, _RATE_INCREMENT, interval),
        sample_interval=interval,
        body_from_imu=_body_from_imu(spec.body_from_imu, spec_path, name),
        position=np.array(spec.position_m),
        accelerometer_noise=spec.accelerometer_noise_m_s2,
        gyro_noise=spec.gyro_noise_rad_s,
        errors=SensorErrors(
            spec.accelerometer_bias_sigma_m_s2,
            spec.accelerometer_scale_sigma,
            spec.accelerometer_misalignment_sigma_rad,
            spec.gyro_bias_sigma_rad_s,
            spec.gyro_scale_sigma,
        ),
    )


def _initial(spec: InitialSpec) -> InitialState:
    sigma = np.array([*spec.position_sigma_m, *spec.velocity_sigma_m_s, *spec.attitude_sigma_rad])
    return InitialState(
        spec.time_s,
        np.array(spec.position_m),
        np.array(spec.velocity_m_s),
        np.array(spec.inertial_from_body),
        np.diag(sigma**2),
    )


def _parachute(spec: ParachuteSpec) -> ParachuteFix:
    return ParachuteFix(spec.time_s, spec.dynamic_pressure_pa, spec.dynamic_pressure_sigma_pa)


def _landing(spec: LandingSpec) -> LandingFix:
    return LandingFix(spec.time_s, np.array(spec.position_m), np.array(spec.position_sigma_m))


def _altimeter(log: _Log, spec: AltimeterSpec) -> AltimeterRecord:
    time, height = log.time(spec.time), log.numbers(spec.height.column, blank_is_nan=True)
    measured = np.isfinite(height)
    if not measured.any():
        raise InputError(f"{log.path}: column {spec.height.column!r} of the altimeter is empty throughout.")
    height = _LENGTH[spec.height.unit] * height[measured]
    return AltimeterRecord(time[measured], height, spec.sigma_m, spec.surface_radius_m)


def convert(log_csv: str | Path, spec_yaml: str | Path, out_h5: str | Path) -> Path:
    """Convert a log into a flight file.

    Parameters
    ----------
    log_csv : path
        CSV with a header line; ``#`` starts a comment. One line per sample.
    spec_yaml : path
        Its specification: see `LogSpec` and ``docs/examples/imu_log.spec.yaml``.
    out_h5 : path
        Flight file to write. An existing file is replaced when the new one is complete.

    Returns
    -------
    Path
        `out_h5`.

    Raises
    ------
    InputError
        The log or the specification is wrong: the message names the file, the line and the column or key. Nothing is
        written in that case.
    """
    spec_path, log = Path(spec_yaml), _Log(Path(log_csv))
    spec = read_spec(spec_path)
    contents = FlightContents(
        name=spec.name,
        planet=spec.planet,
        epoch_utc=spec.epoch_utc,
        prime_meridian_at_epoch=spec.prime_meridian_at_epoch_rad,
        imus={name: _imu(log, imu, spec_path, name) for name, imu in spec.imu.items()},
        initial=_initial(spec.initial),
        events={name: (event.time_s, event.time_sigma_s) for name, event in spec.events.items()},
        parachute=_parachute(spec.parachute) if spec.parachute else None,
        landing=_landing(spec.landing) if spec.landing else None,
        altimeter=_altimeter(log, spec.altimeter) if spec.altimeter else None,
    )
    return write_flight_file(out_h5, contents)
