"""One IMU of a flight file: its samples and calibration as they are stored, and as a record in body axes.

Input of the reader: the group ``/imu/<name>``. Method: checks of shapes and sizes, checks of the samples, rotation from
IMU axes to body axes. Output: an `ImuRecord`, with NaN where samples are missing or bad. Input of the writer: a
`FlightImu`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry.hdf5_checks import DEGREE_RATES, DEGREES, PARTS, TIME, Limits, Node
from edl_filter.telemetry.quantisation import bias_with_rounding, coarse, noise_with_rounding, quantum
from edl_filter.telemetry.record import ImuRecord, SampleFinding, finite_rows
from edl_filter.telemetry.sample_checks import CheckSettings, completed, lost_readings, ordered_packets
from edl_filter.types import Array

#: Samples beyond the limits that are bad ones; more of them have a wrong unit.
MOST_OUT_OF_RANGE = 16
#: Largest relative difference between the median step in time and the sampling interval.
STEP_TOLERANCE = 0.1
#: Largest rotation within one sample, rad: larger values cannot be readings of a vehicle whose attitude is tracked.
MAX_ROTATION = 1.5
#: Attribute and its limits, by field of `SensorErrors`.
_ERROR_ATTRIBUTES = {
    "accelerometer_bias": ("accelerometer_bias_sigma", Limits("m/s^2", 0.0, 1.0)),
    "accelerometer_scale": ("accelerometer_scale_sigma", Limits("", 0.0, 0.1, PARTS)),
    "accelerometer_misalignment": ("accelerometer_misalignment_sigma", Limits("rad", 0.0, 0.1, DEGREES)),
    "gyro_bias": ("gyro_bias_sigma", Limits("rad/s", 0.0, 0.1, DEGREE_RATES)),
    "gyro_scale": ("gyro_scale_sigma", Limits("", 0.0, 0.1, PARTS)),
}
_FORCE = Limits("m/s^2", 0.0, 5e3, {"mg": 9.80665e-3})


def conflicting_median_step(time: Array, interval: float) -> float | None:
    """Median step in time if it differs from the stated sampling interval, otherwise None.

    Parameters
    ----------
    time : (N,) array
        s, N ≥ 2.
    interval : float
        Stated sampling interval, s; a relative difference up to `STEP_TOLERANCE` is accepted.

    Returns
    -------
    float or None
        s.
    """
    median = float(np.median(np.diff(time)))
    return median if abs(median / interval - 1.0) > STEP_TOLERANCE else None


def read_imu(
    node: Node, name: str, settings: CheckSettings | None = None
) -> tuple[ImuRecord, tuple[SampleFinding, ...]]:
    """Record of one IMU in body axes, with NaN where a sample is missing or bad.

    Parameters
    ----------
    node : Node
        Group of the IMU.
    name : str
        Name of the record.
    settings : CheckSettings, optional
        Thresholds of the checks.

    Returns
    -------
    record : ImuRecord
    findings : tuple of SampleFinding
        Missing and bad samples.

    Raises
    ------
    InputError
        The group violates the format.
    """
    settings = CheckSettings() if settings is None else settings
    time = node.numbers("time", None, finite=False)
    if np.count_nonzero(np.isfinite(time)) < 2:
        raise InputError(f"{node.file_name}: /imu/{name}/time has {len(time)} samples; at least 2 are needed.")
    interval = node.attribute("sample_interval", positive=True)
    body_from_imu = node.unit("@body_from_imu", node.attribute("body_from_imu", 4))
    measured = {key: node.numbers(key, len(time), 3, finite=False) for key in ("specific_force", "angular_rate")}
    rate_limits = Limits("rad/s", 0.0, min(50.0, MAX_ROTATION / interval), DEGREE_RATES)
    for key, limits in (("specific_force", _FORCE), ("angular_rate", rate_limits)):
        _check_unit(node, key, measured[key], limits)
    time, readings, findings = ordered_packets(time, np.hstack(list(measured.values())), interval, name)
    node.within("time", time[[0, -1]], TIME)
    if median := conflicting_median_step(time, interval):
        raise node.error("@sample_interval", f"is {interval:g} s, but the usual step of its time is {median:g} s.")
    highest = _FORCE.high, rate_limits.high
    steps = [quantum(readings[:, triad]) if settings.enabled else 0.0 for triad in (slice(0, 3), slice(3, 6))]
    readings, bad = lost_readings(time, readings, interval, name, highest, settings)
    time, readings, inserted, missing = completed(time, readings, interval, name)
    force, rate = (rotations.rotate(body_from_imu, v) for v in (readings[:, :3].copy(), readings[:, 3:].copy()))
    force_sigma = node.attribute("accelerometer_noise", positive=True, limits=Limits("m/s^2", 0.0, 1.0))
    rate_sigma = node.attribute("gyro_noise", positive=True, limits=Limits("rad/s", 0.0, 0.1, DEGREE_RATES))
    errors = SensorErrors(**{
        key: node.attribute(attribute, limits=limits) for key, (attribute, limits) in _ERROR_ATTRIBUTES.items()
    })  # fmt: skip
    force_sigma, rate_sigma, errors, rounded = _with_rounding(name, time, steps, (force_sigma, rate_sigma), errors)
    position = node.attribute("position", 3, limits=Limits("m", 0.0, 20.0, {"cm": 1e-2, "mm": 1e-3}))
    record = ImuRecord(
        name=name,
        time=time,
        interval=np.diff(time, prepend=time[0] - interval),
        specific_force=force,
        angular_rate=rate,
        position=np.tile(position, (len(time), 1)),
        force_noise=np.full(len(time), force_sigma),
        rate_noise=np.full(len(time), rate_sigma),
        shared_rate_noise=np.where(inserted > 0, 0.0, rate_sigma),
        net_turn=np.zeros(len(time), bool),
        net_gain=np.zeros(len(time), bool),
        unit=np.zeros(len(time), np.int64),
        units=(name,),
        source=inserted,
        sources=("flight file", "gap") if inserted.any() else ("flight file",),
        errors=(errors,),
        stated_interval=interval,
    )
    return record, (*findings, *bad, *missing, *rounded)


def _with_rounding(
    name: str, time: Array, steps: Sequence[float], noise: tuple[float, float], errors: SensorErrors
) -> tuple[float, float, SensorErrors, list[SampleFinding]]:
    """Noise and errors of an IMU whose readings have coarse steps (m/s², rad/s), and a finding for each triad."""
    force, rate, findings = *noise, []
    for triad, step, sigma, unit in zip(("force", "rate"), steps, noise, ("m/s²", "rad/s"), strict=True):
        if coarse(step, sigma):
            repair = f"steps of {step:.3g} {unit}, which its noise and bias contain"
            findings.append(SampleFinding(name, triad, float(time[0]), float(time[-1]), len(time), "coarse", repair))
    if coarse(steps[0], force):
        bias = bias_with_rounding(steps[0], errors.accelerometer_bias)
        force, errors = noise_with_rounding(steps[0], force), replace(errors, accelerometer_bias=bias)
    if coarse(steps[1], rate):
        bias = bias_with_rounding(steps[1], errors.gyro_bias)
        rate, errors = noise_with_rounding(steps[1], rate), replace(errors, gyro_bias=bias)
    return force, rate, errors, findings


def _check_unit(node: Node, key: str, values: Array, limits: Limits) -> None:
    """Raise if more than `MOST_OUT_OF_RANGE` samples are beyond the limits: their unit is wrong, they are no spikes."""
    finite = finite_rows(values)
    if np.count_nonzero(np.linalg.norm(values[finite], axis=1) > limits.high) > MOST_OUT_OF_RANGE:
        node.within(key, np.where(finite[:, None], values, 0.0), limits)
    if not finite.any():
        raise node.error(key, "has no finite sample.")


@dataclass(frozen=True)
class FlightImu:
    """One IMU as the flight file stores it (group ``/imu/<name>`` of the format): IMU axes, SI units.

    Attributes
    ----------
    time : (N,) array
        End of each sampling interval, s since the epoch.
    specific_force, angular_rate : (N, 3) arrays
        Means over the interval at the IMU, m/s² and rad/s.
    sample_interval : float
        s.
    body_from_imu : (4,) array
    position : (3,) array
        From the centre of mass, m, body axes.
    accelerometer_noise, gyro_noise : float
        One sigma of one sample, m/s² and rad/s.
    errors : SensorErrors
    """

    time: Array
    specific_force: Array
    angular_rate: Array
    sample_interval: float
    body_from_imu: Array
    position: Array
    accelerometer_noise: float
    gyro_noise: float
    errors: SensorErrors = field(default_factory=SensorErrors)


def write_imu(group: Any, imu: FlightImu) -> None:
    """Write one IMU to its group."""
    for key in ("time", "specific_force", "angular_rate"):
        group[key] = np.asarray(getattr(imu, key), np.float64)
    for key in ("sample_interval", "body_from_imu", "position", "accelerometer_noise", "gyro_noise"):
        group.attrs[key] = np.asarray(getattr(imu, key), np.float64)[()]
    for key, (attribute, _) in _ERROR_ATTRIBUTES.items():
        group.attrs[attribute] = float(getattr(imu.errors, key))
