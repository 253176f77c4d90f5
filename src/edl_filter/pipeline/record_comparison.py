"""What is wrong with the whole record of one IMU, by the readings of another one: axes, signs or units.

Input: the telemetry of two IMUs, and that of the one which no measurement contradicts. Method: the readings of the
sound IMU are moved to the place of the other one; each exchange of axes, sign and unit that the record may have is
undone, and the one that leaves the smallest part of the difference explains it. Output: the cause in words.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from edl_filter.estimation.series import finite_rows, interpolate_columns
from edl_filter.imu_model.lever_arm import lever_arm_acceleration
from edl_filter.mission import Mission
from edl_filter.pipeline.fault_hypotheses import exchange_text, imu_axes, sign_text
from edl_filter.pipeline.load import event_times
from edl_filter.pipeline.plausibility import FORCE_UNITS, RATE_UNITS
from edl_filter.telemetry.record import ImuRecord, Telemetry
from edl_filter.types import Array

#: A change of a whole record explains its difference from another IMU if it leaves less than this part of it, in this
#: share of the samples. Smaller differences than this part of the readings are no matter of axes or units.
EXPLAINED, WHOLE, DIFFERENT = 0.15, 0.95, 0.05
#: Sigmas of one reading beyond which it has moved.
SIGNIFICANT = 10.0
#: Time before the parachute from which readings are not compared: the mortar's recoil, s.
_SHOCK = 1.0
SENSORS = {"specific_force": "accelerometers", "angular_rate": "gyros"}


def record_cause(mission: Mission, telemetry: Telemetry, sound: Telemetry) -> str | None:
    """What is wrong with the whole record of an IMU at fault: other axes, signs or units, by a sound IMU's readings.

    Parameters
    ----------
    mission : Mission
        Its events.
    telemetry : Telemetry
        Of both IMUs.
    sound : Telemetry
        Of the IMU that is not at fault.

    Returns
    -------
    str or None
        As words; None where no such change of the whole record explains the difference of the two.
    """
    original = telemetry if telemetry.as_read is None else telemetry.as_read
    reference = sound.driving
    record = next((r for r in (original.driving, *original.checking) if r.name != reference.name), None)
    if record is None:
        return None
    end = event_times(mission, telemetry).get("parachute_deploy", np.inf) - _SHOCK
    noise = {
        "specific_force": float(np.median(record.force_noise)),
        "angular_rate": float(np.median(record.rate_noise)),
    }
    readings, pairs, size = {}, {}, {}
    moved = _moved_to(reference, record)
    for quantity in ("specific_force", "angular_rate"):
        own, expected = _common(record, moved, quantity, end)
        if not len(own):
            return None
        readings[quantity], size[quantity] = (own, expected), _typical(own - expected)
        if size[quantity] > DIFFERENT * max(_typical(own), _typical(expected)):
            pairs[quantity] = own, expected
    best, sentence = EXPLAINED, None
    for changes, text in _changes_of_axes(mission, record.name):
        share = {q: _typical(own @ changes.T - expected) / size[q] for q, (own, expected) in readings.items()}
        largest = max((share[q] for q in pairs), default=np.inf)
        if any(_worse(own, changes, expected, noise[q]) > 1.0 - WHOLE for q, (own, expected) in pairs.items()):
            continue  # it explains a part of the flight
        if largest < best:
            affected = " and ".join(SENSORS[q] for q in readings if share[q] < 1.0)
            best, sentence = largest, f"{text} in the {affected} of IMU {record.name}"
    for quantity, (own, expected) in pairs.items():
        words = quantity.replace("_", " ")
        for unit, value in (FORCE_UNITS if quantity == "specific_force" else RATE_UNITS).items():
            left = _typical(own * value - expected) / size[quantity]
            if left < best and len(pairs) == 1:
                best, sentence = left, f"units, the {words} of IMU {record.name} is in {unit}"
    return sentence


def _moved_to(reference: ImuRecord, record: ImuRecord) -> ImuRecord:
    """The reference with its forces at the place of another record, as both state their places."""
    rate = np.nan_to_num(reference.angular_rate)
    offset = record.position[record.index_at(reference.time)] - reference.position
    force = reference.specific_force + lever_arm_acceleration(reference.interval, rate, offset, reference.unit)
    return replace(reference, specific_force=force)


def _worse(own: Array, change: Array, expected: Array, noise: float) -> float:
    """Share of the readings (N, 3) that a change (3, 3) takes farther from the expected ones, beyond their noise."""
    before, after = (np.linalg.norm(values - expected, axis=1) for values in (own, own @ change.T))
    return float(np.mean(after > before + SIGNIFICANT * noise))


def _common(record: ImuRecord, reference: ImuRecord, quantity: str, end: float) -> tuple[Array, Array]:
    """Readings of a record and those of another one at its times, ``(N, 3)`` each, up to `end` (s)."""
    values, reference_values = getattr(record, quantity), getattr(reference, quantity)
    known = finite_rows(reference_values)
    used = finite_rows(values) & (record.time <= min(end, reference.time[-1])) & (record.time >= reference.time[0])
    if known.sum() < 2:
        return np.zeros((0, 3)), np.zeros((0, 3))
    return values[used], interpolate_columns(record.time[used], reference.time[known], reference_values[known])


def _typical(values: Array) -> float:
    """Length that `WHOLE` of the rows (N, 3) do not exceed."""
    return float(np.quantile(np.linalg.norm(values, axis=1), WHOLE))


def _changes_of_axes(mission: Mission, name: str) -> Iterator[tuple[Array, str]]:
    """Matrices (3, 3) that repair exchanged axes and wrong signs of an IMU, in body axes, and what they repair."""
    mounting = imu_axes(mission, name)
    frames = [(" of the body", np.eye(3))]
    if mounting is not None:
        frames.insert(0, (" of the IMU", mounting))
    for frame, axes in frames:
        for order in permutations(range(3)):
            for signs in product((1, -1), repeat=3):
                matrix = np.diag(signs) @ np.eye(3)[list(order)]
                if np.array_equal(matrix, np.eye(3)):
                    continue
                text = " and ".join(filter(None, (exchange_text(order), sign_text(signs))))
                yield axes @ matrix @ axes.T, f"axes{frame}, {text}"
