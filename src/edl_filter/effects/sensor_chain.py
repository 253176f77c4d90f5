"""Sensor effects in the readings of an IMU: their order, their inverse, and the position of the IMU.

`apply_sensor_effects` gives the readings of true motion, for the simulation; `corrected_record` inverts the effects in
a record. `moved_position` is the place of an IMU with effects on it, and `moved_record` corrects that of a record.
Several effects in one sensor act in one order (`sensor_effects`): the built-in ones as time offset, misalignment,
scale, bias (the order of the flight file's own errors), then users' own in the order of the mission. `corrected_record`
inverts them in the opposite order. An effect names its IMU: a record, or one of the instruments that are joined in a
record. An effect without a name is in the instrument that drives at entry.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from edl_filter.effects.base import EffectInstance, EffectKey
from edl_filter.effects.forward_model import compose_body
from edl_filter.effects.types import Body
from edl_filter.errors import InputError
from edl_filter.telemetry.record import ImuRecord, Telemetry
from edl_filter.types import Array, BoolArray, IntArray

#: Order in which built-in effects act on a reading.
_ORDER = (
    "imu_time_offset", "accelerometer_misalignment", "accelerometer_scale", "gyro_scale", "accelerometer_bias",
    "gyro_bias",
)  # fmt: skip


def sensor_effects(effects: Sequence[EffectInstance]) -> list[EffectInstance]:
    """Those of `effects` that act on readings, in the order in which they act."""
    acting = [a for a in effects if a.effect.acts("imu") or a.effect.acts("corrected")]
    return sorted(acting, key=lambda a: _ORDER.index(a.name) if a.name in _ORDER else len(_ORDER))


def effects_in(effects: Sequence[EffectInstance], imu: str, driving: bool) -> list[EffectInstance]:
    """Those of `effects` that name an IMU of one instrument: those of which `samples_of` its record are all.

    Parameters
    ----------
    effects : sequence of EffectInstance
        In any IMUs.
    imu : str
        Name of the IMU.
    driving : bool
        Whether it is the driving one: effects that name no IMU are in it.
    """
    return [a for a in effects if a.imu == imu or (driving and a.imu is None)]


def apply_sensor_effects(
    effects: Sequence[EffectInstance], time: Array, force: Array, rate: Array
) -> tuple[Array, Array]:
    """Readings of an IMU with `effects`, where the true means are `force` and `rate`.

    Parameters
    ----------
    effects : sequence of EffectInstance
        In this IMU, listed in any order; those that are no sensor effects change nothing.
    time, force, rate : (N,), (N, 3) and (N, 3) arrays
        Arguments of `Effect.imu`, as are the results.
    """
    for a in sensor_effects(effects):
        force, rate = a.effect.imu(a.values, time, force, rate)
    return force, rate


def samples_of(record: ImuRecord, imu: str | None, driving: bool) -> BoolArray:
    """Mask ``(N,)`` of the samples of a record on which an effect in `imu` acts.

    Parameters
    ----------
    record : ImuRecord
        N samples.
    imu : str or None
        Name of a record or of an instrument; None is the instrument of the first sample of the driving record.
    driving : bool
        Whether the record is the driving one.
    """
    if imu is None:
        return (record.unit == record.unit[0]) if driving else np.zeros(len(record), bool)
    if imu == record.name:
        return np.ones(len(record), bool)
    return np.isin(record.unit, [i for i, unit in enumerate(record.units) if unit == imu])


def canonical_key(instance: EffectInstance, driving: ImuRecord) -> EffectKey:
    """Key of an effect, its IMU None where it names the instrument that drives at entry.

    Parameters
    ----------
    instance : EffectInstance
        The effect.
    driving : ImuRecord
        The driving record.
    """
    affected, default = (samples_of(driving, imu, True) for imu in (instance.imu, None))
    same = instance.imu is not None and np.array_equal(affected, default)
    return (instance.name, None) if same else instance.key


def acts_on_driving(instance: EffectInstance, driving: ImuRecord) -> bool:
    """Whether an effect acts on the driving record, or outside the IMUs; otherwise only on a checking IMU."""
    outside = not instance.effect.is_sensor_effect or instance.effect.is_model_effect
    return outside or bool(np.any(samples_of(driving, instance.imu, True)))


def corrected_record(record: ImuRecord, effects: Sequence[EffectInstance], driving: bool = True) -> ImuRecord:
    """The true motion where sensors with `effects` read `record`.

    Parameters
    ----------
    record : ImuRecord
        As it was read.
    effects : sequence of EffectInstance
        Those that are no sensor effects, or are in another IMU, change nothing.
    driving : bool
        Whether the record is the driving one: effects that name no IMU are in it.
    """
    for a in sensor_effects(effects)[::-1]:
        affected = samples_of(record, a.imu, driving)
        if affected.any():
            force, rate = a.effect.corrected(a.values, record.time, record.specific_force, record.angular_rate)
            record = replace(
                record,
                specific_force=np.where(affected[:, None], force, record.specific_force),
                angular_rate=np.where(affected[:, None], rate, record.angular_rate),
            )
    return record


def log_abs_det_jacobian(
    record: ImuRecord, effects: Sequence[EffectInstance], driving: bool = True, samples: IntArray | None = None
) -> float:
    """Logarithm of the Jacobian determinant of a sample's corrected readings by its readings.

    The sum over force and rate of the mean log determinant of the derivative. The readings are changed by the same
    amount at all times, so a shift in time contributes nothing.

    Parameters
    ----------
    record : ImuRecord
        As it was read.
    effects : sequence of EffectInstance
        As in `corrected_record`.
    driving : bool
        As in `corrected_record`.
    samples : (M,) integer array, optional
        Samples that the mean is over, instead of all: an effect may act on some instruments of the record only.
    """
    chosen = np.arange(len(record)) if samples is None else samples
    reference = corrected_record(record, effects, driving)
    total = 0.0
    for name, step in (("specific_force", 1e-3), ("angular_rate", 1e-5)):
        slopes = np.empty((len(chosen), 3, 3))
        for axis in range(3):
            moved = replace(record, **{name: getattr(record, name) + step * np.eye(3)[axis]})
            change = getattr(corrected_record(moved, effects, driving), name) - getattr(reference, name)
            slopes[:, :, axis] = change[chosen] / step
        total += float(np.mean(np.linalg.slogdet(slopes)[1]))
    return total


def moved_position(
    position: Array, effects: Sequence[EffectInstance], affected: Callable[[EffectInstance], BoolArray] | None = None
) -> Array:
    """Place of an IMU with the `imu_position` of effects, where it is `position` without them.

    Parameters
    ----------
    position : (N, 3) array
        By sample, m, body axes.
    effects : sequence of EffectInstance
        Those without this hook change nothing.
    affected : callable, optional
        From an effect to the mask ``(N,)`` of the samples on which it acts; absent: all are affected.

    Returns
    -------
    (N, 3) array
        m, body axes; `position` itself if no effect has the hook.
    """
    for a in effects:
        if a.effect.acts("imu_position"):
            offset = a.effect.imu_position(a.values)
            position = position + (offset if affected is None else affected(a)[:, None] * offset)
    return position


def moved_record(record: ImuRecord, effects: Sequence[EffectInstance], until: float, driving: bool = True) -> ImuRecord:
    """The record with the IMU's position relative to the true centre of mass, as the effects give it.

    Parameters
    ----------
    record : ImuRecord
        With the stated position.
    effects : sequence of EffectInstance
        Their `imu_position` is added. The offset of the centre of mass that they make is subtracted, because the IMUs
        are fixed to the structure.
    until : float
        Time at which the mission states the vehicle's centre of mass anew, s: the offset is that of the vehicle at
        entry.
    driving : bool
        As in `corrected_record`.
    """
    position = moved_position(record.position, effects, lambda a: samples_of(record, a.imu, driving))
    offset = compose_body(Body(1.0, np.zeros((3, 3))), effects).offset
    if offset.any():
        position = position - (record.time < until)[:, None] * offset
    return record if position is record.position else replace(record, position=position)


def check_imus(telemetry: Telemetry, effects: Sequence[EffectInstance], where: str) -> None:
    """Check that the telemetry has the IMU of every effect.

    Raises
    ------
    InputError
        It does not. The message begins with `where` and lists the IMUs that exist.
    """
    records = (telemetry.driving, *telemetry.checking)
    names = list(dict.fromkeys(name for r in records for name in (r.name, *r.units)))
    for k, a in enumerate(effects):
        if a.imu is not None and a.imu not in names:
            raise InputError(
                f"{where}: effects.{k}.imu: found {a.imu!r}, but there is no such IMU; accepted: {', '.join(names)}."
            )
