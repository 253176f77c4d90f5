"""Segments of MER's telemetry in body axes, one function for each product of the archive.

Input: the cleaned tables (`mer_archive`) and the constants of the mission (`MerSetup`, `MerImu`). Output: segments
(`joining.Segment`) of TRANSFORMED and of HIGHRATE with its gaps filled, and the on-board attitude. The rover's velocity
register is `mer_register`'s.

Body axes are a cyclic permutation of the archive's spacecraft axes: x is the archive's +z (forward along the symmetry
axis, as in the thesis, whose y and z are not stated), y its +x, z its +y.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.estimation.series import finite_rows, interpolate_columns
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry.joining import GAP, Segment, fill_gaps
from edl_filter.telemetry.mer_archive import SAMPLE_INTERVAL, MerTables
from edl_filter.telemetry.partial_readings import partial_readings
from edl_filter.telemetry.record import SAME_TIME, AttitudeRecord, SampleFinding
from edl_filter.telemetry.sample_checks import (
    CheckSettings,
    highest_readings,
    in_body_axes,
    lost_readings,
)
from edl_filter.telemetry.smoothing import rates_from_quaternions
from edl_filter.types import Array, BoolArray

#: Takes spacecraft components to body components.
BODY_FROM_SPACECRAFT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
#: Largest rounding error (one sigma, rad) of a quaternion from which rates are computed; near a zero fourth element it
#: is larger.
MAX_ROUNDING_SIGMA = 2e-5
#: Sources of samples with a calibration of their own.
UNITS = ("backshell", "rover", "register")
#: Sources of the samples of the on-board navigation and of the increments.
TRANSFORMED, HIGHRATE = "TRANSFORMED", "HIGHRATE"


@dataclass(frozen=True)
class MerImu:
    """Calibration of one source of samples.

    Attributes
    ----------
    accelerometer_noise, gyro_noise : float
        One sigma of an 8 Hz sample, m/s² and rad/s.
    errors : SensorErrors
    spacecraft_from_imu : (4,) array or None
        Mounting; None for the register, which has no axes of its own.
    position : (3,) array or None
        From the centre of mass, m, spacecraft axes.
    alignment : (3,) array or None
        Rotation vector of its axes against those of the other IMU, rad, spacecraft axes.
    transformed_alignment : (2,) array or None
        Error of the on-board transform of acceleration: force along the archive's x and y per force along z, rad
        (`in_highrate_axes`).
    onboard_rate_correction : (3,) array or None
        Rate that the on-board software subtracts from the gyros' before it computes its quaternion, rad/s, spacecraft
        axes. The archive's HIGHRATE does not contain this correction; `highrate_segment` applies it, so that all
        products agree.
    """

    accelerometer_noise: float
    gyro_noise: float
    errors: SensorErrors
    spacecraft_from_imu: Array | None = None
    position: Array | None = None
    alignment: Array | None = None
    transformed_alignment: Array | None = None
    onboard_rate_correction: Array | None = None


@dataclass(frozen=True)
class MerSetup:
    """Constants that the reading of one rover's entry needs.

    Attributes
    ----------
    epoch_sclk : float
        Spacecraft clock at time 0, s.
    epoch_utc : str
    start, end : float
        Start and end of the record, s since the epoch.
    separation : float
        Time of backshell separation, s since the epoch.
    rover_from : float
        Time from which the rover's IMU drives, s since the epoch: the separation or before it; ``-inf`` for the start
        of HIGHRATE.
    positions : dict
        Time (s since the epoch) → position (3,) of the driving IMU relative to the centre of mass from then on, m,
        spacecraft axes.
    inertial_from_j2000 : (4,) array
    j2000_from_register : (4,) array
        Axes in which the velocity register accumulates.
    imus : dict
        `MerImu` of each of ``backshell``, ``rover`` and ``register``.
    events : dict
        Name → s since the epoch.
    attitude_sigma : float
        One sigma of an on-board quaternion without the errors of rounding and reference frame, rad.
    """

    epoch_sclk: float
    epoch_utc: str
    start: float
    end: float
    separation: float
    rover_from: float
    positions: dict[float, Array]
    inertial_from_j2000: Array
    j2000_from_register: Array
    imus: dict[str, MerImu]
    events: dict[str, float]
    attitude_sigma: float


def to_body(vector: Array | None) -> Array:
    """Body components (3,) of a vector in spacecraft axes; zero for None."""
    return np.zeros(3) if vector is None else np.asarray(vector) @ BODY_FROM_SPACECRAFT.T


def sample_end(tables: MerTables, setup: MerSetup, unit: str, sclk: Array) -> Array:
    """Time (N,), s since the epoch, at which the increments end that a product has at the clock counts (N,), s.

    The computer adds each increment to the velocity register one cycle after it has read it: at the clock count of a
    row the register ends one increment before the quaternion (`register_segment`).
    """
    if unit == "register":
        return sample_end(tables, setup, "rover", sclk - SAMPLE_INTERVAL)
    return sclk - setup.epoch_sclk - tables.clocks[unit].lag(sclk)


def driving_change(tables: MerTables, setup: MerSetup) -> float:
    """Time at which the rover's IMU begins to drive, s since the epoch: at least one sample after HIGHRATE's start."""
    return max(setup.rover_from, float(tables.highrate.sclk[0]) - setup.epoch_sclk)


def _inertial_from_body(setup: MerSetup, j2000_from_spacecraft: Array) -> Array:
    """Attitude (N, 4) in the package's frames from the archive's (N, 4)."""
    spacecraft_from_body = rotations.from_matrix(BODY_FROM_SPACECRAFT.T)
    attitude = rotations.multiply(setup.inertial_from_j2000, j2000_from_spacecraft)
    return rotations.multiply(attitude, spacecraft_from_body)


def usable_quaternions(quaternion: Array, sigma: Array) -> BoolArray:
    """True (N,) where a quaternion (N, 4) is not missing and its rounding error (N,), rad, is small enough."""
    return np.isfinite(quaternion[:, 0]) & (sigma < MAX_ROUNDING_SIGMA)


def in_highrate_axes(force: Array, imu: MerImu) -> Array:
    """Force (N, 3), m/s², spacecraft axes, without the alignment error of the on-board transform.

    The on-board software adds a share of the axial force to the lateral ones (`MerImu.transformed_alignment`), in
    TRANSFORMED's acceleration and in its velocity register, but not in the increments of HIGHRATE.
    """
    if imu.transformed_alignment is None:
        return force
    return np.column_stack((force[:, :2] - imu.transformed_alignment * force[:, 2:], force[:, 2:]))


def transformed_segment(
    tables: MerTables, setup: MerSetup, until: float, settings: CheckSettings | None = None
) -> tuple[Segment, list[SampleFinding]]:
    """TRANSFORMED up to a time: force at the centre of mass, and rates from the backshell's quaternion.

    The lateral error of the on-board transform is subtracted, so that these samples and those of HIGHRATE have the same
    alignment. The on-board software divides two increments of velocity by their nominal length; here it is that of the
    IMU's clock. Rates at quaternions with a large rounding error are computed from the neighbouring quaternions.

    Parameters
    ----------
    tables : MerTables
        Cleaned tables.
    setup : MerSetup
        Constants of the mission.
    until : float
        Last time, s since the epoch.
    settings : CheckSettings, optional
        Thresholds of the checks of the stored accelerations (`lost_readings`).

    Returns
    -------
    segment : Segment
        Lost forces are NaN.
    findings : list of SampleFinding
        What is lost; `imu` is the unit, an axis that of the archive's spacecraft.
    """
    t, imu = tables.transformed, setup.imus["backshell"]
    time = sample_end(tables, setup, "backshell", t.sclk)
    rows = np.flatnonzero(time <= until + SAME_TIME)
    nominal = 2.0 * SAMPLE_INTERVAL
    length = time[rows] - sample_end(tables, setup, "backshell", t.sclk[rows] - nominal)
    time, stored = time[rows], t.backshell_acceleration[rows]
    checked, findings = lost_readings(
        time[1:], stored[1:], nominal, "backshell", highest_readings(nominal), settings or CheckSettings()
    )
    force = in_highrate_axes(np.vstack((stored[:1], checked)) * (nominal / length)[:, None], imu)
    sigma = t.backshell_sigma[rows]
    rate, rounding = _quaternion_rates(time, t.backshell_j2000_from_sc[rows], sigma)
    gyro_noise = imu.gyro_noise * np.sqrt(SAMPLE_INTERVAL / np.diff(time))
    n = len(time) - 1
    segment = Segment(
        source=TRANSFORMED,
        unit="backshell",
        time=time[1:],
        interval=np.diff(time),
        force=force[1:] @ BODY_FROM_SPACECRAFT.T,
        rate=rate @ BODY_FROM_SPACECRAFT.T,
        position=np.zeros((n, 3)),
        force_noise=np.full(n, imu.accelerometer_noise),
        rate_noise=np.hypot(rounding, gyro_noise),
        shared_rate_noise=gyro_noise,
        coning_corrected=True,
    )
    return segment, in_body_axes(findings, BODY_FROM_SPACECRAFT)


def _quaternion_rates(time: Array, quaternion: Array, sigma: Array) -> tuple[Array, Array]:
    """Rates between rows and their sigma due to rounding; unusable quaternions are skipped.

    Between the two usable quaternions around an unusable one only the mean rate is known. Its change to the
    neighbouring intervals is used as one sigma of each row in between.

    Parameters
    ----------
    time : (N,) array
        s.
    quaternion : (N, 4) array
        On-board attitude, NaN where missing.
    sigma : (N,) array
        Rounding error of the quaternions, rad.

    Returns
    -------
    rate : (N - 1, 3) array
        rad/s, spacecraft axes.
    rate_sigma : (N - 1,) array
        rad/s.
    """
    usable = np.flatnonzero(usable_quaternions(quaternion, sigma))
    if len(usable) < 3:
        raise InputError("telemetry: fewer than three usable quaternions in the span asked for.")
    rate = rates_from_quaternions(time[usable], quaternion[usable])
    noise = np.hypot(sigma[usable][1:], sigma[usable][:-1]) / np.diff(time[usable])
    change = np.linalg.norm(np.gradient(rate, axis=0), axis=1)
    index = np.clip(np.searchsorted(time[usable], 0.5 * (time[1:] + time[:-1])) - 1, 0, len(rate) - 1)
    skipped = ~(np.isin(np.arange(1, len(time)), usable) & np.isin(np.arange(len(time) - 1), usable))
    return rate[index], np.hypot(noise[index], np.where(skipped, change[index], 0.0))


def highrate_segment(
    tables: MerTables, setup: MerSetup, unit: str, settings: CheckSettings | None = None
) -> tuple[Segment, list[SampleFinding]]:
    """HIGHRATE of one IMU in body axes: increments divided by the length of their sample. Gaps are not filled.

    Parameters
    ----------
    tables : MerTables
        Cleaned tables.
    setup : MerSetup
        Constants of the mission.
    unit : str
        ``backshell`` or ``rover``.
    settings : CheckSettings, optional
        Thresholds of the checks of increments in the axes of the IMU (`lost_readings`).

    Returns
    -------
    segment : Segment
        Triads of which an axis is lost are NaN.
    findings : list of SampleFinding
        What is lost; `imu` is the unit.
    """
    h, imu = tables.highrate, setup.imus[unit]
    angle, velocity = (
        (h.backshell_angle_increment, h.backshell_velocity_increment)
        if unit == "backshell"
        else (h.rover_angle_increment, h.rover_velocity_increment)
    )
    complete = np.isfinite(angle[:, 0]) & np.isfinite(velocity[:, 0])
    assert imu.spacecraft_from_imu is not None
    body_from_imu = BODY_FROM_SPACECRAFT @ rotations.to_matrix(imu.spacecraft_from_imu)
    n = int(complete.sum())
    time = sample_end(tables, setup, unit, h.sclk[complete])
    interval = time - sample_end(tables, setup, unit, h.sclk[complete] - SAMPLE_INTERVAL)
    increments = np.hstack((velocity, angle))[complete] / SAMPLE_INTERVAL
    readings, findings = lost_readings(
        time, increments, SAMPLE_INTERVAL, unit, highest_readings(SAMPLE_INTERVAL), settings or CheckSettings()
    )
    correction = to_body(imu.onboard_rate_correction)
    whole, partial = [], []
    for triad, values, offset in ((slice(0, 3), velocity, np.zeros(3)), (slice(3, 6), angle, correction)):
        body = values[complete] @ body_from_imu.T / interval[:, None] - offset
        read = np.where(np.isnan(readings[:, triad]), np.nan, body @ body_from_imu)
        whole.append(np.where(finite_rows(read)[:, None], body, np.nan))
        partial.append(partial_readings(read, body_from_imu))
    force, rate = whole
    segment = Segment(
        source=HIGHRATE,
        unit=unit,
        time=time,
        interval=interval,
        force=force,
        rate=rate,
        position=np.tile(to_body(imu.position), (n, 1)),
        force_noise=np.full(n, imu.accelerometer_noise),
        rate_noise=np.full(n, imu.gyro_noise),
        shared_rate_noise=np.full(n, imu.gyro_noise),
        partial_force=partial[0],
        partial_rate=partial[1],
    )
    return segment, in_body_axes(findings, body_from_imu)


def fill_highrate_gaps(tables: MerTables, setup: MerSetup, segment: Segment) -> list[Segment]:
    """Segments of HIGHRATE with filled gaps: the force is interpolated, the rates are from the on-board quaternions.

    In the 0.875 s that Spirit's table lacks under the parachute, interpolated gyro rates would have an attitude error
    of more than ten degrees.

    Parameters
    ----------
    tables : MerTables
        With the on-board quaternions.
    setup : MerSetup
        Mountings.
    segment : Segment
        HIGHRATE readings, with gaps.

    Returns
    -------
    list of Segment
        In order of time: what was read, and in between the gaps.
    """
    segments = fill_gaps(segment)
    read = [_with_interpolated_rates(s) for s in segments]
    for i, gap in enumerate(segments):
        if gap.source == GAP:
            rate, sigma = _rates_across_gap(tables, setup, read[i - 1], gap, read[i + 1])
            noise = np.full(len(gap.time), sigma / gap.interval[0] / np.sqrt(len(gap.time)))
            segments[i] = replace(gap, rate=rate, rate_noise=noise, coning_corrected=True)
    return segments


def _with_interpolated_rates(segment: Segment) -> Segment:
    """Segment with linearly interpolated rates in place of lost ones."""
    finite = finite_rows(segment.rate)
    if finite.all() or not finite.any():
        return segment
    return replace(segment, rate=interpolate_columns(segment.time, segment.time[finite], segment.rate[finite]))


def _rates_across_gap(
    tables: MerTables, setup: MerSetup, before: Segment, gap: Segment, after: Segment
) -> tuple[Array, float]:
    """Rates of a gap's samples from the quaternions around and in it.

    Gyro samples between the nearest quaternions and the gap propagate the attitude to the gap's edges. In the gap the
    rate is constant between two quaternions.

    Returns
    -------
    rate : (n, 3) array
        rad/s.
    sigma : float
        One sigma of the rotation over the whole gap, rad.
    """
    t = tables.transformed
    quaternion = t.rover_j2000_from_sc if gap.unit == "rover" else t.backshell_j2000_from_sc
    sigma = t.rover_sigma if gap.unit == "rover" else t.backshell_sigma
    time = sample_end(tables, setup, gap.unit, t.sclk)
    usable = np.flatnonzero(usable_quaternions(quaternion, sigma))
    start, end = gap.start, float(gap.time[-1])
    first = int(np.searchsorted(time[usable], start + SAME_TIME)) - 1
    last = int(np.searchsorted(time[usable], end - SAME_TIME))
    rows = usable[first : last + 1]
    knots, attitudes = time[rows], _inertial_from_body(setup, quaternion[rows])
    attitudes[0] = rotations.multiply(attitudes[0], _gyro_rotation(before.between(knots[0], start)))
    attitudes[-1] = rotations.multiply(
        attitudes[-1], rotations.conjugate(_gyro_rotation(after.between(end, knots[-1])))
    )
    knots[0], knots[-1] = start, end
    rate = rates_from_quaternions(knots, attitudes)
    index = np.searchsorted(knots, gap.time - 0.5 * gap.interval) - 1
    noise = np.hypot(np.hypot(sigma[rows[0]], sigma[rows[-1]]), setup.attitude_sigma)
    return rate[index], float(noise)


def _gyro_rotation(segment: Segment) -> Array:
    """Rotation over the samples of a segment, as a quaternion (4,)."""
    rotation = np.array([0.0, 0.0, 0.0, 1.0])
    for angle in segment.rate * segment.interval[:, None]:
        rotation = rotations.multiply(rotation, rotations.from_rotation_vector(angle))
    return rotation


def onboard_attitude(tables: MerTables, setup: MerSetup) -> AttitudeRecord:
    """On-board attitude: of the IMU that drives, the backshell's and then the rover's, without unusable quaternions."""
    t = tables.transformed
    from_rover = t.sclk - setup.epoch_sclk > driving_change(tables, setup) + SAME_TIME
    time = np.where(from_rover, *(sample_end(tables, setup, unit, t.sclk) for unit in ("rover", "backshell")))
    quaternion = np.where(from_rover[:, None], t.rover_j2000_from_sc, t.backshell_j2000_from_sc)
    sigma = np.where(from_rover, t.rover_sigma, t.backshell_sigma)
    selected = usable_quaternions(quaternion, sigma) & (time >= setup.start) & (time <= setup.end)
    return AttitudeRecord(
        time=time[selected],
        inertial_from_body=_inertial_from_body(setup, quaternion[selected]),
        sigma=np.hypot(sigma[selected], setup.attitude_sigma),
        unit=from_rover[selected].astype(np.int64),
        units=("backshell", "rover"),
    )
