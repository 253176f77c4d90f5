"""One record in body axes from MER's two tables and two IMUs.

Three products follow each other:

1. TRANSFORMED up to HIGHRATE's beginning (90 s after entry interface): acceleration at the centre of mass from the
   backshell's IMU, rates from its quaternion (thesis eq. 3.1);
2. HIGHRATE: increments of angle and velocity, of the backshell's IMU until it separates, of the rover's after;
3. from HIGHRATE's end, when the lander still rolls, the rover's quaternion and its accumulated velocity.

The thesis's body axes are the archive's spacecraft axes taken in turn: x is the archive's +z (forward along the
symmetry axis), y its +x, z its +y.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry.joining import GAP, Piece, fill_gaps, join
from edl_filter.telemetry.mer_archive import SAMPLE_INTERVAL, MerTables
from edl_filter.telemetry.record import AttitudeRecord, SensorErrors, Telemetry
from edl_filter.telemetry.smoothing import rates_from_quaternions

Array = NDArray[np.float64]

#: Takes spacecraft components to body components.
BODY_FROM_SPACECRAFT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
#: A quaternion whose rounding alone is worse than this (rad) gives no rate: its fourth element is too small.
COARSEST_QUATERNION = 2e-5
#: Longest step into which a gap in the rover's quaternion and register is cut, s.
REGISTER_STEP = 0.25
UNITS = ("backshell", "rover", "register")


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
    position : (3,) array
        From the centre of mass, m, spacecraft axes.
    transformed_alignment : (2,) array
        What the on-board transform of acceleration adds to the archive's x and y per z, rad.
    onboard_rate_correction : (3,) array
        What the on-board software subtracts from the gyros before it makes its quaternion, rad/s, spacecraft
        axes. HIGHRATE has not been corrected so; it is here, so that all products agree.
    """

    accelerometer_noise: float
    gyro_noise: float
    errors: SensorErrors
    spacecraft_from_imu: Array | None = None
    position: Array | None = None
    transformed_alignment: Array | None = None
    onboard_rate_correction: Array | None = None


@dataclass(frozen=True)
class MerSetup:
    """How to read one rover's entry.

    Attributes
    ----------
    epoch_sclk : float
        Spacecraft clock at time 0, s.
    epoch_utc : str
    start, end : float
        First and last time wanted, s since the epoch.
    separation : float
        When the backshell leaves and the rover's IMU begins to drive, s since the epoch.
    positions : dict
        Time (s since the epoch) → position of the driving IMU from the centre of mass as it is from then on, m,
        spacecraft axes.
    inertial_from_j2000 : (4,) array
    j2000_from_register : (4,) array
        Axes in which the velocity register accumulates.
    imus : dict
        For each of ``backshell``, ``rover`` and ``register``.
    events : dict
        Name → s since the epoch.
    attitude_sigma : float
        Of an on-board quaternion apart from its rounding and its frame, rad.
    """

    epoch_sclk: float
    epoch_utc: str
    start: float
    end: float
    separation: float
    positions: dict[float, Array]
    inertial_from_j2000: Array
    j2000_from_register: Array
    imus: dict[str, MerImu]
    events: dict[str, float]
    attitude_sigma: float


def mer_telemetry(tables: MerTables, setup: MerSetup) -> Telemetry:
    """Telemetry of one rover's entry, in body axes and seconds since the epoch.

    Parameters
    ----------
    tables : MerTables
    setup : MerSetup

    Returns
    -------
    Telemetry
        `driving` as joined from the three products; `checking` holds the rover's IMU up to separation, from its
        register before HIGHRATE; `attitude` is the backshell's quaternion up to separation and the rover's after it.

    Raises
    ------
    InputError
        The epoch is nowhere near the tables, the separation lies outside HIGHRATE, or the wanted span outside the
        telemetry.
    """
    _check_epoch(tables, setup)
    times = tables.highrate.sclk - setup.epoch_sclk
    if not times[0] < setup.separation < times[-1]:
        raise InputError(
            f"vehicle.events.backshell_separation at {setup.separation:g} s lies outside the HIGHRATE table, "
            f"{times[0]:g} to {times[-1]:g} s."
        )
    backshell = highrate_piece(tables, setup, "backshell")
    rover = highrate_piece(tables, setup, "rover")
    handover = _handover(tables, setup)
    joined = [
        transformed_piece(tables, setup, until=backshell.start),
        *_placed(setup, bridged(tables, setup, backshell.between(-np.inf, setup.separation))),
        *_placed(setup, bridged(tables, setup, rover.between(setup.separation, handover))),
        *register_piece(tables, setup, handover, np.inf),
    ]
    driving = join("driving", joined, UNITS, tuple(setup.imus[u].errors for u in UNITS))
    if not driving.start <= setup.start + 0.5 or driving.time[-1] < setup.end - 0.5:
        raise InputError(
            f"telemetry.start_s and end_s ask for {setup.start:g} to {setup.end:g} s; the telemetry has "
            f"{driving.start:g} to {driving.time[-1]:g} s."
        )
    check = join(
        "rover",
        [
            *register_piece(tables, setup, -5.0, rover.start),
            *bridged(tables, setup, rover.between(-np.inf, setup.separation)),
        ],
        UNITS,
        tuple(setup.imus[u].errors for u in UNITS),
    )
    common = max(setup.start, check.start), min(setup.end, float(check.time[-1]))
    return Telemetry(
        driving=driving.between(setup.start, setup.end),
        checking=(check.between(*common),) if common[1] - common[0] > 1.0 else (),
        attitude=onboard_attitude(tables, setup),
        events=dict(setup.events),
        epoch_utc=setup.epoch_utc,
        epoch_sclk=setup.epoch_sclk,
        files=tables.files,
        notes=tables.notes,
    )


def _check_epoch(tables: MerTables, setup: MerSetup) -> None:
    """See that the epoch is within the table, or not further from it than it is long."""
    first, last = tables.transformed.sclk[[0, -1]]
    if not 2.0 * first - last <= setup.epoch_sclk <= 2.0 * last - first:
        raise InputError(
            f"telemetry.spacecraft: the tables of spacecraft {tables.spacecraft} ({tables.name}) run from SCLK "
            f"{first:.3f} to {last:.3f}, far from telemetry.epoch_sclk = {setup.epoch_sclk:.3f}; one of the two is "
            "another rover's."
        )


def _placed(setup: MerSetup, pieces: list[Piece]) -> list[Piece]:
    """Pieces with the lever arms that the flight's events gave the driving IMU."""
    for time, position in sorted(setup.positions.items()):
        pieces = [
            replace(p, position=np.where((p.time - 0.5 * p.interval > time)[:, None], _to_body(position), p.position))
            for p in pieces
        ]
    return pieces


def _to_body(vector: Array | None) -> Array:
    """Spacecraft components to body components."""
    return np.zeros(3) if vector is None else np.asarray(vector) @ BODY_FROM_SPACECRAFT.T


def _inertial_from_body(setup: MerSetup, j2000_from_spacecraft: Array) -> Array:
    spacecraft_from_body = rotations.from_matrix(BODY_FROM_SPACECRAFT.T)
    attitude = rotations.multiply(setup.inertial_from_j2000, j2000_from_spacecraft)
    return rotations.multiply(attitude, spacecraft_from_body)


def transformed_piece(tables: MerTables, setup: MerSetup, until: float) -> Piece:
    """TRANSFORMED up to `until`: force at the centre of mass and rates from the backshell's quaternion.

    What the on-board transform added to the lateral axes is taken off again, so that these samples and
    HIGHRATE's share one alignment. Quaternions too coarse to give a rate are bridged by their neighbours.
    """
    t, imu = tables.transformed, setup.imus["backshell"]
    time = t.sclk - setup.epoch_sclk
    rows = np.flatnonzero(time <= until + 1e-6)
    time, force = time[rows], t.backshell_acceleration[rows].copy()
    if imu.transformed_alignment is not None:
        force[:, :2] -= imu.transformed_alignment * force[:, 2:]
    sigma = t.backshell_sigma[rows]
    rate, rounding = _quaternion_rates(time, t.backshell_j2000_from_sc[rows], sigma)
    gyro_noise = imu.gyro_noise * np.sqrt(SAMPLE_INTERVAL / np.diff(time))
    n = len(time) - 1
    return Piece(
        source="TRANSFORMED",
        unit="backshell",
        time=time[1:],
        interval=np.diff(time),
        force=force[1:] @ BODY_FROM_SPACECRAFT.T,
        rate=rate @ BODY_FROM_SPACECRAFT.T,
        position=np.zeros((n, 3)),
        force_noise=np.full(n, imu.accelerometer_noise),
        rate_noise=np.hypot(rounding, gyro_noise),
        shared_rate_noise=gyro_noise,
        net_turn=True,
    )


def _quaternion_rates(time: Array, quaternion: Array, sigma: Array) -> tuple[Array, Array]:
    """Rates ``(N - 1, 3)`` between rows and what rounding leaves uncertain of them, coarse quaternions bridged.

    Over a bridge the mean rate is known and its course is not: its change to the neighbouring intervals is taken
    for one sigma of each of the rows.
    """
    good = np.flatnonzero(np.isfinite(quaternion[:, 0]) & (sigma < COARSEST_QUATERNION))
    if len(good) < 3:
        raise InputError("telemetry: fewer than three usable quaternions in the span asked for.")
    rate = rates_from_quaternions(time[good], quaternion[good])
    noise = np.hypot(sigma[good][1:], sigma[good][:-1]) / np.diff(time[good])
    change = np.linalg.norm(np.gradient(rate, axis=0), axis=1)
    index = np.clip(np.searchsorted(time[good], 0.5 * (time[1:] + time[:-1])) - 1, 0, len(rate) - 1)
    bridged = ~(np.isin(np.arange(1, len(time)), good) & np.isin(np.arange(len(time) - 1), good))
    return rate[index], np.hypot(noise[index], np.where(bridged, change[index], 0.0))


def highrate_piece(tables: MerTables, setup: MerSetup, unit: str) -> Piece:
    """HIGHRATE of one IMU: increments over 0.125 s, turned into the body's axes; gaps are left open."""
    h, imu = tables.highrate, setup.imus[unit]
    angle, velocity = (
        (h.backshell_angle_increment, h.backshell_velocity_increment)
        if unit == "backshell"
        else (h.rover_angle_increment, h.rover_velocity_increment)
    )
    good = np.isfinite(angle[:, 0]) & np.isfinite(velocity[:, 0])
    assert imu.spacecraft_from_imu is not None
    body_from_imu = BODY_FROM_SPACECRAFT @ rotations.to_matrix(imu.spacecraft_from_imu)
    n = int(good.sum())
    return Piece(
        source="HIGHRATE",
        unit=unit,
        time=h.sclk[good] - setup.epoch_sclk,
        interval=np.full(n, SAMPLE_INTERVAL),
        force=velocity[good] @ body_from_imu.T / SAMPLE_INTERVAL,
        rate=angle[good] @ body_from_imu.T / SAMPLE_INTERVAL - _to_body(imu.onboard_rate_correction),
        position=np.tile(_to_body(imu.position), (n, 1)),
        force_noise=np.full(n, imu.accelerometer_noise),
        rate_noise=np.full(n, imu.gyro_noise),
        shared_rate_noise=np.full(n, imu.gyro_noise),
    )


def bridged(tables: MerTables, setup: MerSetup, piece: Piece) -> list[Piece]:
    """A piece of HIGHRATE with its gaps filled: force interpolated, the turn as the on-board quaternion has it.

    In the 0.875 s that Spirit's table lacks under the parachute, interpolated gyros would lose more than ten degrees.
    """
    pieces = fill_gaps(piece)
    for i, gap in enumerate(pieces):
        if gap.source == GAP:
            rate, sigma = _turn_across(tables, setup, pieces[i - 1], gap, pieces[i + 1])
            noise = np.full(len(gap.time), sigma / gap.interval[0] / np.sqrt(len(gap.time)))
            pieces[i] = replace(gap, rate=rate, rate_noise=noise, net_turn=True)
    return pieces


def _turn_across(tables: MerTables, setup: MerSetup, before: Piece, gap: Piece, after: Piece) -> tuple[Array, float]:
    """Rates (n, 3) of a gap's samples and the sigma of the whole turn, from the quaternions around and in it.

    Gyro samples between the gap and the nearest quaternion carry the attitude to the gap's edges; in between, the
    attitude turns evenly from quaternion to quaternion.
    """
    t = tables.transformed
    quaternion = t.rover_j2000_from_sc if gap.unit == "rover" else t.backshell_j2000_from_sc
    sigma = t.rover_sigma if gap.unit == "rover" else t.backshell_sigma
    time = t.sclk - setup.epoch_sclk
    good = np.flatnonzero(np.isfinite(quaternion[:, 0]) & (sigma < COARSEST_QUATERNION))
    start, stop = gap.start, float(gap.time[-1])
    first = int(np.searchsorted(time[good], start + 1e-6)) - 1
    last = int(np.searchsorted(time[good], stop - 1e-6))
    rows = good[first : last + 1]
    knots, attitudes = time[rows], _inertial_from_body(setup, quaternion[rows])
    attitudes[0] = rotations.multiply(attitudes[0], _gyro_turn(before.between(knots[0], start)))
    attitudes[-1] = rotations.multiply(attitudes[-1], rotations.conjugate(_gyro_turn(after.between(stop, knots[-1]))))
    knots[0], knots[-1] = start, stop
    turn = rates_from_quaternions(knots, attitudes)
    index = np.searchsorted(knots, gap.time - 0.5 * gap.interval) - 1
    noise = np.hypot(np.hypot(sigma[rows[0]], sigma[rows[-1]]), setup.attitude_sigma)
    return turn[index], float(noise)


def _gyro_turn(piece: Piece) -> Array:
    """Turn over a few samples, as a quaternion."""
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    for angle in piece.rate * piece.interval[:, None]:
        turn = rotations.multiply(turn, rotations.from_rotation_vector(angle))
    return turn


def _register_rows(tables: MerTables, setup: MerSetup) -> NDArray[np.int64]:
    """Rows of TRANSFORMED with a usable rover quaternion and register."""
    t = tables.transformed
    good = np.isfinite(t.rover_j2000_from_sc[:, 0]) & np.isfinite(t.velocity[:, 0])
    return np.flatnonzero(good & (t.rover_sigma < COARSEST_QUATERNION))


def _handover(tables: MerTables, setup: MerSetup) -> float:
    """Last time up to HIGHRATE's end at which the rover's quaternion and register are usable, s."""
    sclk = tables.transformed.sclk[_register_rows(tables, setup)]
    before = sclk[sclk <= tables.highrate.sclk[-1] + 1e-6]
    return float((before[-1] if len(before) else tables.highrate.sclk[-1]) - setup.epoch_sclk)


def register_piece(tables: MerTables, setup: MerSetup, start: float, end: float) -> list[Piece]:
    """From `start` to `end`: rates from the rover's quaternion, force from its accumulated velocity.

    The register accumulates in axes that do not turn, so a difference of two rows is exact however the lander
    rolled between them. It is spread evenly in time, and the turn between two quaternions evenly in angle, over
    steps of at most `REGISTER_STEP`: across a gap of 15.75 s too, velocity and attitude end where they should.
    No piece where there are not two rows.
    """
    t, imu = tables.transformed, setup.imus["register"]
    rows = _register_rows(tables, setup)
    time = t.sclk[rows] - setup.epoch_sclk
    keep = (time >= start - 1e-6) & (time <= end + 1e-6)
    rows, time = rows[keep], time[keep]
    if len(rows) < 2:
        return []
    attitude = t.rover_j2000_from_sc[rows]
    rate = rates_from_quaternions(time, attitude)
    gained = rotations.rotate(setup.j2000_from_register, np.diff(t.velocity[rows], axis=0))
    parts = np.ceil(np.diff(time) / REGISTER_STEP - 1e-6).astype(int)
    row = np.repeat(np.arange(len(parts)), parts)
    step = np.diff(time)[row] / parts[row]
    ordinal = np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)
    middle = rotations.multiply(
        attitude[row], rotations.from_rotation_vector(rate[row] * (step * (ordinal + 0.5))[:, None])
    )
    force = rotations.rotate(rotations.conjugate(middle), gained[row] / np.diff(time)[row][:, None])
    noise = np.sqrt(SAMPLE_INTERVAL / step)
    piece = Piece(
        source="register",
        unit="register",
        time=time[row] + step * (ordinal + 1),
        interval=step,
        force=force @ BODY_FROM_SPACECRAFT.T,
        rate=rate[row] @ BODY_FROM_SPACECRAFT.T,
        position=np.zeros((len(row), 3)),
        force_noise=imu.accelerometer_noise * noise,
        rate_noise=imu.gyro_noise * noise,
        shared_rate_noise=imu.gyro_noise * noise,
        net_turn=True,
        net_gain=True,
    )
    return [piece]


def onboard_attitude(tables: MerTables, setup: MerSetup) -> AttitudeRecord:
    """On-board attitude: the backshell's up to separation, the rover's after; coarse rows left out."""
    t = tables.transformed
    time = t.sclk - setup.epoch_sclk
    rover = time > setup.separation + 1e-6
    quaternion = np.where(rover[:, None], t.rover_j2000_from_sc, t.backshell_j2000_from_sc)
    sigma = np.where(rover, t.rover_sigma, t.backshell_sigma)
    keep = np.isfinite(quaternion[:, 0]) & (sigma < COARSEST_QUATERNION)
    keep &= (time >= setup.start) & (time <= setup.end)
    return AttitudeRecord(
        time=time[keep],
        inertial_from_body=_inertial_from_body(setup, quaternion[keep]),
        sigma=np.hypot(sigma[keep], setup.attitude_sigma),
        unit=rover[keep].astype(np.int64),
        units=("backshell", "rover"),
    )
