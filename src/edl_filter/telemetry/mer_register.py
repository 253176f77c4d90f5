"""The rovers' velocity register: segments of force and rate from accumulated velocity and quaternion.

Input: the cleaned tables (`mer_archive`) and the constants of the mission (`MerSetup`). The table TRANSFORMED has the
velocity that the computer accumulated from the increments of the rover's IMU, in axes that do not rotate, one increment
late and with the alignment error of the on-board transform (`make study-velocity-register`). Output: segments
(`joining.Segment`) in body axes.
"""

from __future__ import annotations

import numpy as np

from edl_filter import rotations
from edl_filter.telemetry.joining import Segment
from edl_filter.telemetry.mer_archive import SAMPLE_INTERVAL, MerTables
from edl_filter.telemetry.mer_segments import (
    BODY_FROM_SPACECRAFT,
    MerSetup,
    in_highrate_axes,
    sample_end,
    usable_quaternions,
)
from edl_filter.telemetry.record import SAME_TIME
from edl_filter.telemetry.smoothing import rates_from_quaternions
from edl_filter.types import Array, IntArray

#: Longest sample between two rows of the rover's quaternion and register, s.
REGISTER_STEP = 0.25
#: Time before and after a segment from which quaternions are used for its attitudes, s: the ends of their spline have
#: no effect beyond some four rows.
_SPLINE_MARGIN = 4.0


def register_rows(tables: MerTables) -> IntArray:
    """Rows of TRANSFORMED with a usable rover quaternion and a register value.

    Parameters
    ----------
    tables : MerTables
        With N rows of TRANSFORMED.

    Returns
    -------
    (K,) array of int
        Indices of the rows.
    """
    t = tables.transformed
    return np.flatnonzero(usable_quaternions(t.rover_j2000_from_sc, t.rover_sigma) & np.isfinite(t.velocity[:, 0]))


def register_segment(
    tables: MerTables,
    setup: MerSetup,
    start: float,
    end: float,
    turn_before: Array | None = None,
    longest_step: float = REGISTER_STEP,
) -> list[Segment]:
    """Segment from `start` to `end` (s): rates from the rover's quaternion, force from its accumulated velocity.

    The register accumulates in axes that do not rotate, so that the difference of two rows is exact for any rotation of
    the lander in between. It is one increment late (`sample_end`), and each increment is rotated with the attitude of
    the cycle in which it is added. With both and without the alignment error of the on-board transform
    (`in_highrate_axes`), the register agrees with the velocity from HIGHRATE to 0.022 m/s (Opportunity) and 0.015 m/s
    (Spirit) RMS from 91 to 200 s; without the delay to 0.7 m/s (docs/validation.md). Samples end where the register's
    increments end; the attitude there is that between two quaternions. Between two rows force (in the register's axes)
    and rate are constant: velocity and attitude are therefore exact at the end of a gap, also of one of 15.75 s.

    Parameters
    ----------
    tables : MerTables
        Cleaned tables.
    setup : MerSetup
        Constants of the mission.
    start, end : float
        First and last end of the register's increments, s since the epoch.
    turn_before : (3,) array, optional
        Rotation vector from the end of the first row's increments to its quaternion, rad, spacecraft axes; default: by
        the quaternions (`_attitudes_between`).
    longest_step : float
        Longest sample, s: longer intervals between two rows are divided.

    Returns
    -------
    list of Segment
        One segment; none if there are fewer than two rows.
    """
    t, imu = tables.transformed, setup.imus["register"]
    rows = register_rows(tables)
    time = sample_end(tables, setup, "register", t.sclk[rows])
    near = (time >= start - _SPLINE_MARGIN) & (time <= end + _SPLINE_MARGIN)
    rows, time = rows[near], time[near]
    inside = np.flatnonzero((time >= start - SAME_TIME) & (time <= end + SAME_TIME))
    if len(inside) < 2:
        return []
    # attitudes where the register's increments end: one increment before each quaternion
    read, time_read = t.rover_j2000_from_sc[rows], sample_end(tables, setup, "rover", t.sclk[rows])
    rate_read = rates_from_quaternions(time_read, read)
    attitude = _attitudes_between(time_read, read, time)[inside]
    rows, time, read, rate_read = rows[inside], time[inside], read[inside], rate_read[inside[:-1]]
    if turn_before is not None:
        attitude[0] = rotations.multiply(read[0], rotations.from_rotation_vector(-turn_before))
    rate = rates_from_quaternions(time, attitude)
    velocity_increment = rotations.rotate(setup.j2000_from_register, np.diff(t.velocity[rows], axis=0))
    samples_per_row = np.maximum(np.ceil(np.diff(time) / longest_step - 1e-6), 1).astype(int)
    row = np.repeat(np.arange(len(samples_per_row)), samples_per_row)
    step = np.diff(time)[row] / samples_per_row[row]
    ordinal = np.arange(len(row)) - np.repeat(np.cumsum(samples_per_row) - samples_per_row, samples_per_row)
    turn_to_middle = rate_read[row] * (step * (ordinal + 0.5))[:, None]
    attitude_at_middle = rotations.multiply(read[row], rotations.from_rotation_vector(turn_to_middle))
    force_j2000 = velocity_increment[row] / np.diff(time)[row][:, None]
    force = rotations.rotate(rotations.conjugate(attitude_at_middle), force_j2000)
    force = in_highrate_axes(force, setup.imus["rover"])
    noise_factor = np.sqrt(SAMPLE_INTERVAL / step)
    segment = Segment(
        source="register",
        unit="register",
        time=time[row] + step * (ordinal + 1),
        interval=step,
        force=force @ BODY_FROM_SPACECRAFT.T,
        rate=rate[row] @ BODY_FROM_SPACECRAFT.T,
        position=np.zeros((len(row), 3)),
        force_noise=imu.accelerometer_noise * noise_factor,
        rate_noise=imu.gyro_noise * noise_factor,
        shared_rate_noise=imu.gyro_noise * noise_factor,
        coning_corrected=True,
        sculling_corrected=True,
    )
    return [segment]


def _attitudes_between(time: Array, attitude: Array, wanted: Array) -> Array:
    """Attitudes (N, 4) at N times that are each up to one interval before one of `time` (N,), s.

    A spline of rotations with continuous angular acceleration goes through the attitudes (N, 4) between two gaps of the
    table. Where a time is before the first one after a gap, the rate is that of the next interval.
    """
    from scipy.spatial.transform import Rotation, RotationSpline  # slow to import

    out = np.empty_like(attitude)
    for run in np.split(np.arange(len(time)), np.flatnonzero(np.diff(time) > 1.1 * REGISTER_STEP) + 1):
        first = run[:1]
        if len(run) > 1:
            out[run] = RotationSpline(time[run], Rotation.from_quat(attitude[run]))(wanted[run]).as_quat()
        nearest = run[:2] if len(run) > 1 else max(run[0] - 1, 0) + np.arange(2)
        rate = rates_from_quaternions(time[nearest], attitude[nearest])
        turn = rate * (wanted[first] - time[first])
        out[first] = rotations.multiply(attitude[first], rotations.from_rotation_vector(turn))
    return out
