"""Turn any IMU log in CSV into a flight file, as a specification in YAML says.

The specification says which columns hold what, in which units, how the IMU sits in the body, and what is
known besides (initial state, events, fixes). Its form is `csv_spec.LogSpec`; an example with every key is
``docs/examples/imu_log.spec.yaml``.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.errors import InputError
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
from edl_filter.telemetry.flight_file import STEP_TOLERANCE, FlightContents, FlightImu, write_flight_file
from edl_filter.telemetry.record import (
    AltimeterRecord,
    InitialState,
    LandingFix,
    ParachuteFix,
    SensorErrors,
)

Array = NDArray[np.float64]

#: Standard gravity, the g of accelerometers' data sheets, m/s².
G = 9.80665
_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_FORCE = {"m/s^2": 1.0, "g": G, "mg": 1e-3 * G}
_RATE = {"rad/s": 1.0, "deg/s": np.pi / 180.0, "deg/h": np.pi / 180.0 / 3600.0}
_LENGTH = {"m": 1.0, "km": 1e3}
#: Increments per sample; divided by the sampling interval they become means.
_FORCE_INCREMENT = {"m/s": 1.0}
_RATE_INCREMENT = {"rad": 1.0, "deg": np.pi / 180.0}


class _Log:
    """Rows of a CSV file by column name; `#` starts a comment, lines are counted as an editor does."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            text = path.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path}: the log cannot be read ({getattr(error, 'strerror', None) or error}).") from None
        lines = [(n, line.split("#")[0]) for n, line in enumerate(text.splitlines(), 1)]
        lines = [(n, line) for n, line in lines if line.strip()]
        rows = list(csv.reader([line for _, line in lines], skipinitialspace=True))
        if len(rows) < 3:
            raise InputError(f"{path}: {len(rows)} lines; a header and at least two samples are needed.")
        self.header, self.rows = [name.strip() for name in rows[0]], rows[1:]
        self.line = [n for n, _ in lines[1:]]
        for n, row in zip(self.line, self.rows, strict=True):
            if len(row) != len(self.header):
                raise InputError(f"{path}, line {n}: {len(row)} fields; the header has {len(self.header)}.")

    def index(self, name: str) -> int:
        if self.header.count(name) != 1:
            there = "is in the header twice" if name in self.header else "is not in the header"
            raise InputError(f"{self.path}: column {name!r} {there}: {', '.join(self.header)}.")
        return self.header.index(name)

    def numbers(self, name: str, blank_is_nan: bool = False) -> Array:
        """Column `name`, (N,); an empty field is an error or NaN."""
        k, values = self.index(name), np.empty(len(self.rows))
        for i, row in enumerate(self.rows):
            field = row[k].strip()
            if blank_is_nan and not field:
                values[i] = np.nan
                continue
            try:
                values[i] = float(field)
            except ValueError:
                values[i] = np.nan
            if not np.isfinite(values[i]):
                raise InputError(
                    f"{self.path}, line {self.line[i]}, column {name!r}: found {field!r}; a finite number is needed."
                )
        return values

    def time(self, spec: TimeColumn) -> Array:
        """Read times, s since the epoch, checked to increase."""
        time = _TIME[spec.unit] * (self.numbers(spec.column) - spec.epoch)
        back = np.diff(time) <= 0.0
        if back.any():
            i = int(back.argmax())
            before, after = (self.rows[k][self.index(spec.column)].strip() for k in (i, i + 1))
            raise InputError(
                f"{self.path}, line {self.line[i + 1]}, column {spec.column!r}: time must increase, "
                f"but it goes from {before} to {after}."
            )
        return time


def _body_from_imu(value: Quaternion | Matrix, spec_path: Path, name: str) -> Array:
    """Quaternion of the mounting; a matrix must be a rotation to 1e-3."""
    mounting = np.asarray(value, np.float64)
    if mounting.ndim == 1:
        return mounting
    if np.max(np.abs(mounting @ mounting.T - np.eye(3))) > 1e-3 or np.linalg.det(mounting) < 0.0:
        raise InputError(f"{spec_path}: imu.{name}.body_from_imu is no rotation matrix (orthonormal, determinant +1).")
    return rotations.from_matrix(mounting)


def _scaled(log: _Log, columns: tuple[str, ...], unit: str, means: dict[str, float],
            increments: dict[str, float], step: float) -> Array:  # fmt: skip
    """Three columns as means over the interval, SI."""
    factor = means[unit] if unit in means else increments[unit] / step
    return factor * np.stack([log.numbers(name) for name in columns], axis=-1)


def _imu(log: _Log, spec: ImuSpec, spec_path: Path, name: str) -> FlightImu:
    step, time = spec.sample_interval_s, log.time(spec.time)
    usual = float(np.median(np.diff(time)))
    if abs(usual / step - 1.0) > STEP_TOLERANCE:
        raise InputError(
            f"{spec_path}: imu.{name}.sample_interval_s is {step:g}, but the usual step of column "
            f"{spec.time.column!r} in unit {spec.time.unit!r} is {usual:g} s."
        )
    return FlightImu(
        time=time,
        specific_force=_scaled(
            log, spec.specific_force.columns, spec.specific_force.unit, _FORCE, _FORCE_INCREMENT, step
        ),
        angular_rate=_scaled(log, spec.angular_rate.columns, spec.angular_rate.unit, _RATE, _RATE_INCREMENT, step),
        sample_interval=step,
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
    seen = np.isfinite(height)
    if not seen.any():
        raise InputError(f"{log.path}: column {spec.height.column!r} of the altimeter is empty throughout.")
    return AltimeterRecord(time[seen], _LENGTH[spec.height.unit] * height[seen], spec.sigma_m, spec.surface_radius_m)


def convert(log_csv: str | Path, spec_yaml: str | Path, out_h5: str | Path) -> Path:
    """Write the flight file that a log and its specification amount to.

    Parameters
    ----------
    log_csv : path
        CSV with a header line; ``#`` starts a comment. One line per sample.
    spec_yaml : path
        See `LogSpec` and ``docs/examples/imu_log.spec.yaml``.
    out_h5 : path
        Flight file to write, or to replace once the new one is whole.

    Returns
    -------
    Path
        `out_h5`.

    Raises
    ------
    InputError
        Anything wrong with log or specification, with file, line and column or key; nothing is written then.
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
