"""Effects on a record of samples: what several together make of a motion, how they are undone, where the IMU sits.

Of several effects in one sensor the built-in ones act in the order time offset, misalignment, scale, bias (that of the
flight file's own errors), then users' own in the order of the mission; `corrected_record` goes backwards through it.
An effect names the IMU that it sits in: a record, or one of the instruments joined in a record; without a name it is
the instrument that drives at entry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.effects.effect import Active, Body
from edl_filter.errors import InputError
from edl_filter.telemetry.record import ImuRecord, Telemetry

#: Order in which built-in effects act on a reading.
_ORDER = (
    "imu_time_offset", "accelerometer_misalignment", "accelerometer_scale", "gyro_scale", "accelerometer_bias",
    "gyro_bias",
)  # fmt: skip


def in_order(effects: Sequence[Active]) -> list[Active]:
    """Effects that act on readings, in the order in which they do."""
    acting = [a for a in effects if a.effect.acts("imu") or a.effect.acts("corrected")]
    return sorted(acting, key=lambda a: _ORDER.index(a.name) if a.name in _ORDER else len(_ORDER))


def samples_of(record: ImuRecord, imu: str | None, driving: bool) -> NDArray[np.bool_]:
    """Which samples of a record an effect in `imu` acts on, ``(N,)``; without a name the entry's instrument's."""
    if imu is None:
        return (record.unit == record.unit[0]) if driving else np.zeros(len(record), bool)
    if imu == record.name:
        return np.ones(len(record), bool)
    return np.isin(record.unit, [i for i, unit in enumerate(record.units) if unit == imu])


def as_read(record: ImuRecord, effects: Sequence[Active], driving: bool = True) -> ImuRecord:
    """What sensors with `effects` make of the true motion in `record`: the inverse of `corrected_record`."""
    return _through(record, in_order(effects), driving, "imu")


def corrected_record(record: ImuRecord, effects: Sequence[Active], driving: bool = True) -> ImuRecord:
    """The true motion where sensors with `effects` gave `record`.

    Parameters
    ----------
    record : ImuRecord
    effects : sequence of Active
        Those that are no sensor effects, or sit in another IMU, change nothing.
    driving : bool
        Whether the record drives: effects that name no IMU are in it.
    """
    return _through(record, in_order(effects)[::-1], driving, "corrected")


def log_stretch(record: ImuRecord, effects: Sequence[Active], driving: bool = True) -> float:
    """Logarithm of the volume that a sample's corrected readings take of what it was.

    The determinants of the derivatives of corrected force and rate by what was read, averaged over the record; by a
    change that is the same at all times, so that a shift in time takes nothing.
    """
    free = corrected_record(record, effects, driving)
    total = 0.0
    for name, step in (("specific_force", 1e-3), ("angular_rate", 1e-5)):
        slopes = np.empty((3, 3))
        for axis in range(3):
            moved = replace(record, **{name: getattr(record, name) + step * np.eye(3)[axis]})
            change = getattr(corrected_record(moved, effects, driving), name) - getattr(free, name)
            slopes[:, axis] = np.mean(change, axis=0) / step
        total += float(np.linalg.slogdet(slopes)[1])
    return total


def _through(record: ImuRecord, effects: Sequence[Active], driving: bool, hook: str) -> ImuRecord:
    for a in effects:
        there = samples_of(record, a.imu, driving)
        if there.any():
            force, rate = getattr(a.effect, hook)(a.values, record.time, record.specific_force, record.angular_rate)
            record = replace(
                record,
                specific_force=np.where(there[:, None], force, record.specific_force),
                angular_rate=np.where(there[:, None], rate, record.angular_rate),
            )
    return record


def moved_record(record: ImuRecord, effects: Sequence[Active], until: float, driving: bool = True) -> ImuRecord:
    """The record with its IMU where the effects say, against the true centre of mass.

    Parameters
    ----------
    record : ImuRecord
    effects : sequence of Active
        Their `imu_position`, and the offset of the centre of mass that they make: IMUs stay bolted.
    until : float
        When the vehicle's centre of mass is stated anew, s: the offset is that of the vehicle at entry.
    driving : bool
        As in `corrected_record`.
    """
    position, body = record.position, Body(1.0, np.zeros((3, 3)))
    for a in effects:
        if a.effect.acts("imu_position"):
            there = samples_of(record, a.imu, driving)
            position = position + there[:, None] * a.effect.imu_position(a.values)
        body = a.effect.vehicle(a.values, body)
    if body.offset.any():
        position = position - (record.time < until)[:, None] * body.offset
    return record if position is record.position else replace(record, position=position)


def check_imus(telemetry: Telemetry, effects: Sequence[Active], where: str) -> None:
    """Refuse an effect in an IMU that the telemetry has not.

    Raises
    ------
    InputError
        The message begins with `where` and lists the IMUs that are there.
    """
    records = (telemetry.driving, *telemetry.checking)
    known = list(dict.fromkeys(name for r in records for name in (r.name, *r.units)))
    for k, a in enumerate(effects):
        if a.imu is not None and a.imu not in known:
            raise InputError(
                f"{where}: effects.{k}.imu: found {a.imu!r}, but there is no such IMU; accepted: {', '.join(known)}."
            )
