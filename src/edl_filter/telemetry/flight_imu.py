"""One IMU of a flight file: its samples and calibration as they are stored, and as a record in body axes.

Input of the reader: the group ``/imu/<name>``. Method: checks of shapes and sizes, rotation from IMU axes to body axes,
one long sample in each gap. Output: an `ImuRecord`. Input of the writer: a `FlightImu`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry.hdf5_checks import DEGREE_RATES, DEGREES, PARTS, TIME, Limits, Node
from edl_filter.telemetry.record import ImuRecord
from edl_filter.types import Array, BoolArray

#: A step in time longer than this many sampling intervals is a gap.
GAP_STEPS = 1.5
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


def _fill_gaps(time: Array, samples: Array, interval: float) -> tuple[Array, Array, BoolArray]:
    """Insert one long sample into each gap, the mean of its two neighbours.

    Parameters
    ----------
    time : (N,) array
        s.
    samples : (N, K) array
        Any units.
    interval : float
        Sampling interval, s.

    Returns
    -------
    time : (M,) array
    samples : (M, K) array
        Both with the inserted rows.
    inserted : (M,) boolean array
        True at the inserted rows.
    """
    before = np.flatnonzero(np.diff(time) > GAP_STEPS * interval)
    inserted = np.insert(np.zeros(len(time), bool), before + 1, True)
    mean = 0.5 * (samples[before] + samples[before + 1])
    # The sample after a gap covers one sampling interval, so that the inserted one ends where it begins
    return (
        np.insert(time, before + 1, time[before + 1] - interval),
        np.insert(samples, before + 1, mean, axis=0),
        inserted,
    )


def _noise(sigma: float, samples: Array, inserted: BoolArray) -> Array:
    """Sigma of each sample (N,); for an inserted one at least half the difference of its neighbours."""
    noise = np.full(len(samples), sigma)
    rows = np.flatnonzero(inserted)
    noise[rows] = np.maximum(sigma, 0.5 * np.linalg.norm(samples[rows + 1] - samples[rows - 1], axis=1))
    return noise


def read_imu(node: Node, name: str) -> ImuRecord:
    """Record of one IMU in body axes; each gap is filled with one long sample."""
    time = node.increasing("time", node.numbers("time", None))
    if len(time) < 2:
        raise InputError(f"{node.file_name}: /imu/{name}/time has {len(time)} samples; at least 2 are needed.")
    node.within("time", time[[0, -1]], TIME)
    interval = node.attribute("sample_interval", positive=True)
    if median := conflicting_median_step(time, interval):
        raise node.error("@sample_interval", f"is {interval:g} s, but the usual step of its time is {median:g} s.")
    body_from_imu = node.unit("@body_from_imu", node.attribute("body_from_imu", 4))
    measured = {key: node.numbers(key, len(time), 3) for key in ("specific_force", "angular_rate")}
    node.within("specific_force", measured["specific_force"], _FORCE)
    highest_rate = min(50.0, MAX_ROTATION / interval)
    node.within("angular_rate", measured["angular_rate"], Limits("rad/s", 0.0, highest_rate, DEGREE_RATES))
    in_body_axes = [rotations.rotate(body_from_imu, values) for values in measured.values()]
    time, samples, inserted = _fill_gaps(time, np.hstack(in_body_axes), interval)
    force, rate = samples[:, :3].copy(), samples[:, 3:].copy()
    force_sigma = node.attribute("accelerometer_noise", positive=True, limits=Limits("m/s^2", 0.0, 1.0))
    rate_sigma = node.attribute("gyro_noise", positive=True, limits=Limits("rad/s", 0.0, 0.1, DEGREE_RATES))
    errors = SensorErrors(**{
        key: node.attribute(attribute, limits=limits) for key, (attribute, limits) in _ERROR_ATTRIBUTES.items()
    })  # fmt: skip
    position = node.attribute("position", 3, limits=Limits("m", 0.0, 20.0, {"cm": 1e-2, "mm": 1e-3}))
    return ImuRecord(
        name=name,
        time=time,
        interval=np.diff(time, prepend=time[0] - interval),
        specific_force=force,
        angular_rate=rate,
        position=np.tile(position, (len(time), 1)),
        force_noise=_noise(force_sigma, force, inserted),
        rate_noise=_noise(rate_sigma, rate, inserted),
        shared_rate_noise=np.where(inserted, 0.0, rate_sigma),
        net_turn=np.zeros(len(time), bool),
        net_gain=np.zeros(len(time), bool),
        unit=np.zeros(len(time), np.int64),
        units=(name,),
        source=inserted.astype(np.int64),
        sources=("flight file", "gap") if inserted.any() else ("flight file",),
        errors=(errors,),
    )


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
