"""Telemetry of one rover's entry, in body axes, from MER's two tables and two IMUs.

Input: the cleaned tables (`mer_archive`), and the calibration, times and frames of the mission (`MerSetup`). Output:
`Telemetry`. The driving record joins three products in time:

1. TRANSFORMED up to the start of HIGHRATE (90 s after entry interface): acceleration at the centre of mass from the
   backshell's IMU, rates from its quaternion (thesis eq. 3.1);
2. HIGHRATE: increments of angle and velocity, of the backshell's IMU until it separates, then of the rover's;
3. from the end of HIGHRATE, while the lander still rolls: the rover's quaternion and its accumulated velocity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry.increment_clock import INCREMENT
from edl_filter.telemetry.joining import Segment, interpolated_between, join
from edl_filter.telemetry.mer_archive import SAMPLE_INTERVAL, MerTables
from edl_filter.telemetry.mer_register import register_rows, register_segment
from edl_filter.telemetry.mer_segments import (
    BODY_FROM_SPACECRAFT,
    HIGHRATE,
    TRANSFORMED,
    UNITS,
    MerImu,
    MerSetup,
    driving_change,
    fill_highrate_gaps,
    highrate_segment,
    onboard_attitude,
    sample_end,
    to_body,
    transformed_segment,
)
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, SampleFinding, Telemetry
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.types import Array

__all__ = ["MerImu", "MerSetup", "mer_telemetry"]


def mer_telemetry(tables: MerTables, setup: MerSetup, settings: CheckSettings | None = None) -> Telemetry:
    """Telemetry of one rover's entry, in body axes and seconds since the epoch.

    Parameters
    ----------
    tables : MerTables
        Cleaned tables of the rover.
    setup : MerSetup
        Calibration, times and frames of the mission.
    settings : CheckSettings, optional
        Thresholds of the checks of TRANSFORMED's accelerations and HIGHRATE's increments.

    Returns
    -------
    Telemetry
        `driving` is joined from the three products; `checking` is the rover's IMU up to separation, from its register
        before HIGHRATE, or the backshell's where the rover's drives before separation; `attitude` is the quaternion of
        the IMU that drives. What no sensor can have read is NaN, and stands in `findings`.

    Raises
    ------
    InputError
        The epoch is far from the times of the tables, the separation is outside HIGHRATE, or the start or end is
        outside the telemetry.
    """
    _check_epoch(tables, setup)
    times = tables.highrate.sclk - setup.epoch_sclk
    if not times[0] < setup.separation < times[-1]:
        raise InputError(
            f"vehicle.events.backshell_separation at {setup.separation:g} s lies outside the HIGHRATE table, "
            f"{times[0]:g} to {times[-1]:g} s."
        )
    change = driving_change(tables, setup)
    if change > setup.separation:
        raise InputError(
            f"telemetry.driving_from_s: found {change:g} s; expected a time up to the backshell's separation at "
            f"{setup.separation:g} s, from which the rover's IMU drives anyway."
        )
    backshell, lost_of_backshell = highrate_segment(tables, setup, "backshell", settings)
    rover, lost_of_rover = highrate_segment(tables, setup, "rover", settings)
    transformed, lost_before = transformed_segment(tables, setup, backshell.start, settings)
    handover = _handover(tables, setup)
    driving_backshell = backshell.between(-np.inf, change)
    driving_rover = _continue_from(rover.between(change - INCREMENT, handover), driving_backshell.time[-1])
    errors = tuple(setup.imus[unit].errors for unit in UNITS)
    segments = [
        transformed,
        *_at_current_position(setup, fill_highrate_gaps(tables, setup, driving_backshell)),
        *_at_current_position(setup, fill_highrate_gaps(tables, setup, driving_rover)),
        *register_segment(tables, setup, handover, np.inf, _turn_after(rover, handover)),
    ]
    driving = join("driving", segments, UNITS, errors)
    if not driving.start <= setup.start + 0.5 or driving.time[-1] < setup.end - 0.5:
        raise InputError(
            f"telemetry.start_s and end_s ask for {setup.start:g} to {setup.end:g} s; the telemetry has "
            f"{driving.start:g} to {driving.time[-1]:g} s."
        )
    if change < setup.separation:
        name, segments = "backshell", fill_highrate_gaps(tables, setup, backshell.between(change, setup.separation))
    else:
        # not divided: across rows that the table lacks, its users interpolate
        register = register_segment(tables, setup, -5.0, rover.start, longest_step=np.inf)
        increments = _aligned(setup, rover.between(-np.inf, setup.separation))
        name, segments = (
            "rover",
            [
                *register,
                *(interpolated_between(register[-1], increments) if register else []),
                *fill_highrate_gaps(tables, setup, increments),
            ],
        )
    checking = join(name, _at_current_position(setup, segments), UNITS, errors)
    start, end = max(setup.start, checking.start), min(setup.end, float(checking.time[-1]))
    records = driving.between(setup.start, setup.end), *((checking.between(start, end),) if end - start > 1.0 else ())
    return Telemetry(
        driving=records[0],
        checking=records[1:],
        attitude=onboard_attitude(tables, setup),
        events=dict(setup.events),
        epoch_utc=setup.epoch_utc,
        epoch_sclk=setup.epoch_sclk,
        files=tables.files,
        notes=tables.notes,
        findings=_of_records([*lost_before, *lost_of_backshell, *lost_of_rover], records),
    )


def _of_records(findings: Sequence[SampleFinding], records: Sequence[ImuRecord]) -> tuple[SampleFinding, ...]:
    """Findings of the tables, whose `imu` is the unit, with the name of the record that has the sample."""
    named = []
    for finding in findings:
        for record in records:
            index = int(record.index_at(np.array([finding.start + 0.5 * SAMPLE_INTERVAL]))[0])
            unit, source = record.units[record.unit[index]], record.sources[record.source[index]]
            checked = unit == finding.imu and source in (TRANSFORMED, HIGHRATE)
            if record.start <= finding.start + SAME_TIME < record.time[-1] and checked:
                named.append(replace(finding, imu=record.name))
    return tuple(named)


def _check_epoch(tables: MerTables, setup: MerSetup) -> None:
    """Raise if the epoch is farther from the times of the table than the table is long."""
    first, last = tables.transformed.sclk[[0, -1]]
    if not 2.0 * first - last <= setup.epoch_sclk <= 2.0 * last - first:
        raise InputError(
            f"telemetry.spacecraft: the tables of spacecraft {tables.spacecraft} ({tables.name}) run from SCLK "
            f"{first:.3f} to {last:.3f}, far from telemetry.epoch_sclk = {setup.epoch_sclk:.3f}; one of the two is "
            "another rover's."
        )


def _at_current_position(setup: MerSetup, segments: list[Segment]) -> list[Segment]:
    """Segments with the positions of the IMUs that events of the flight changed.

    Up to the separation an event states the position of the backshell's IMU, and moves the rover's by as much, since
    it is the centre of mass that moves; from the separation on it states that of the rover's. The register's samples
    are at the place that is navigated.
    """
    nominal = to_body(setup.imus["backshell"].position)
    for time, stated in sorted(setup.positions.items()):
        moved = []
        for s in segments:
            own = to_body(setup.imus[s.unit].position)
            together = s.unit == "rover" and time < setup.separation - SAME_TIME
            position = own + to_body(stated) - nominal if together else to_body(stated)
            after = (s.time - 0.5 * s.interval > time)[:, None]
            moved.append(s if s.unit == "register" else replace(s, position=np.where(after, position, s.position)))
        segments = moved
    return segments


def _aligned(setup: MerSetup, segment: Segment) -> Segment:
    """Segment of the rover's IMU in the axes of the backshell's.

    After the separation it drives, and stays in the axes of its own on-board quaternion.
    """
    rotation = rotations.from_rotation_vector(to_body(setup.imus["rover"].alignment))
    names = ("force", "rate", "partial_force", "partial_rate")
    turned: dict[str, Any] = {name: rotations.rotate(rotation, getattr(segment, name)) for name in names}
    return replace(segment, **turned)


def _continue_from(segment: Segment, start: float) -> Segment:
    """Segment whose first sample begins at `start`, s: the increments of two IMUs end up to 2.5 ms apart."""
    interval = segment.interval.copy()
    interval[0] = segment.time[0] - start
    return replace(segment, interval=interval)


def _handover(tables: MerTables, setup: MerSetup) -> float:
    """End of the register's increments, s, in the last row with quaternion and register up to the end of HIGHRATE."""
    sclk = tables.transformed.sclk[register_rows(tables)]
    before = sclk[sclk <= tables.highrate.sclk[-1] + SAME_TIME]
    last = before[-1:] if len(before) else tables.highrate.sclk[-1:]
    return float(sample_end(tables, setup, "register", last)[0])


def _turn_after(segment: Segment, time: float) -> Array | None:
    """Rotation vector (3,) of the sample that begins at a time, rad, spacecraft axes; None without such a sample."""
    sample = segment.between(time, time + 1.5 * SAMPLE_INTERVAL)
    return sample.rate[0] * sample.interval[0] @ BODY_FROM_SPACECRAFT if len(sample.time) else None
