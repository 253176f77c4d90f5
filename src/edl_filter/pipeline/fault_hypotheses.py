"""Errors of the input that may explain a contradiction, each with its repair of the telemetry.

Input: a mission and its telemetry. Output: hypotheses, in words and as functions of the telemetry: wrong units,
exchanged axes, wrong signs, another convention of the quaternion at entry, and errors of one number that has to be
estimated (clocks, the scale of the altimeter). `causes` tests them.

Axes are tried in the axes of the body and in those of the IMU, since a log may be wrong before or after its mounting
was applied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import h5py
import numpy as np
from scipy import constants

from edl_filter import rotations
from edl_filter.mission import Mission
from edl_filter.mission.measurements import FlightFileConfig
from edl_filter.pipeline.load import check_settings, prepare_telemetry
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.record import Telemetry
from edl_filter.types import AXES, Array

#: Shifts of a clock (s) and relative errors of a scale that are tried; the best is refined.
SHIFTS = (-10.0, -5.0, -2.0, -1.0, -0.5, 0.5, 1.0, 2.0, 5.0, 10.0)
SCALE_ERRORS = (-0.1, -0.03, -0.01, -0.003, 0.003, 0.01, 0.03, 0.1)
#: Largest ratio of two IMUs' readings that are in one unit: below the square root of that of feet and metres.
_SAME_UNIT = 1.7

#: Telemetry as it would be without an error, from that as it was read.
Repair = Callable[[Telemetry], Telemetry]


@dataclass(frozen=True)
class FaultHypothesis:
    """An error of the input with its repair.

    Attributes
    ----------
    kind : str
        ``units``, ``axes``, ``sign`` or ``entry_state``.
    sentence : str
        What is wrong, without a full stop.
    repair : callable
        Telemetry as it would be without the error, from that as it was read.
    """

    kind: str
    sentence: str
    repair: Repair


@dataclass(frozen=True)
class ErrorOfOneNumber:
    """An error of one number, which is estimated from the telemetry.

    Attributes
    ----------
    kind : str
        ``clock`` or ``measurement``.
    sentence : str
        What is wrong, with fields for the size and for one of `words`.
    words : tuple of str
        For a value above zero, and for one below.
    values : tuple of float
        Where the estimate is searched; zero is added.
    resolution : float
        Of the estimate, in the unit of `values`.
    repair : callable
        Value → repair of the telemetry.
    factor : float
        From a value to the size in the sentence.
    """

    kind: str
    sentence: str
    words: tuple[str, str]
    values: tuple[float, ...]
    resolution: float
    repair: Callable[[float], Repair]
    factor: float = 1.0


def errors_of_one_number(telemetry: Telemetry) -> Iterator[ErrorOfOneNumber]:
    """Clocks of IMU and altimeter, and the scale of the altimeter.

    Parameters
    ----------
    telemetry : Telemetry
        As it was read.
    """
    clock = "clock, the times of the {} are about {{size}} s {{sign}}"
    words = ("early", "late")
    yield ErrorOfOneNumber("clock", clock.format("IMU"), words, SHIFTS, 0.01, _shifted_imu)
    if telemetry.altimeter is not None:
        yield ErrorOfOneNumber("clock", clock.format("altimeter"), words, SHIFTS, 0.01, _shifted_altimeter)
        scale = "the altimeter, its heights are {size} % too {sign}"
        yield ErrorOfOneNumber(
            "measurement",
            scale,
            ("large", "small"),
            SCALE_ERRORS,
            1e-4,
            lambda error: _scaled_altimeter(1.0 / (1.0 + error)),
            100.0,
        )


def fault_hypotheses(mission: Mission, telemetry: Telemetry) -> Iterator[FaultHypothesis]:
    """Wrong units, conventions, axes and signs.

    Parameters
    ----------
    mission : Mission
        With the path of the telemetry, of which the mounting of the IMU is read.
    telemetry : Telemetry
        As it was read.
    """
    yield from _unit_hypotheses(mission, telemetry)
    if telemetry.initial is not None:
        yield from (
            FaultHypothesis("entry_state", f"the attitude at entry, its quaternion {text}", _changed_attitude(change))
            for text, change in _QUATERNIONS.items()
        )
    identity = np.eye(3)
    frames = {"": identity}
    mounting = imu_axes(mission, telemetry.driving.name)
    if mounting is not None and not np.allclose(np.abs(mounting).max(axis=0), 1.0, atol=1e-3):
        frames = {" of the IMU": mounting, " of the body": identity}
    for frame, axes in frames.items():
        yield from _axis_hypotheses(frame, axes)


def _unit_hypotheses(mission: Mission, telemetry: Telemetry) -> Iterator[FaultHypothesis]:
    for quantity, factors in (
        ("specific_force", {"g": constants.g, "ft/s^2": constants.foot}),
        ("angular_rate", {"deg/s": np.pi / 180.0, "rpm": np.pi / 30.0}),
    ):
        words = quantity.replace("_", " ")
        for unit, factor in factors.items():
            owner, repair = _in_unit(mission, telemetry, quantity, factor)
            yield FaultHypothesis("units", f"units, the {words}{owner} is in {unit}", repair)
            text = f"units, the {words} was multiplied by {factor:.4g} once too often ({unit})"
            yield FaultHypothesis("units", text, _scaled(quantity, 1.0 / factor))
    if telemetry.altimeter is not None:
        for unit, factor in {"ft": constants.foot, "km": 1e3}.items():
            yield FaultHypothesis("units", f"units, the altimeter is in {unit}", _scaled_altimeter(factor))
            text = f"units, the altimeter was multiplied by {factor:.4g} once too often ({unit})"
            yield FaultHypothesis("units", text, _scaled_altimeter(1.0 / factor))


def exchange_text(order: Sequence[int]) -> str:
    """Which axes are exchanged, in words; empty if none is. `order`: the axis that stands in place of each."""
    exchanged = [AXES[k] for k in range(3) if order[k] != k]
    if not exchanged:
        return ""
    return f"{' and '.join(exchanged)} exchanged" if len(exchanged) == 2 else "x, y and z in another order"


def sign_text(signs: Sequence[int]) -> str:
    """Which axes have the wrong sign, in words; empty if none has. `signs`: 1 or -1 by axis."""
    wrong = [axis for axis, sign in zip(AXES, signs, strict=True) if sign < 0]
    if not wrong:
        return ""
    return f"sign of {' and '.join(wrong) if len(wrong) < 3 else 'all axes'}"


def _axis_hypotheses(frame: str, axes: Array) -> Iterator[FaultHypothesis]:
    """Exchanged axes and wrong signs; `axes`: matrix (3, 3) from the axes in which they are to those of the body."""
    sensors = {
        "accelerometers and gyros": ("specific_force", "angular_rate"),
        "accelerometers": ("specific_force",),
        "gyros": ("angular_rate",),
    }
    for name, quantities in sensors.items():
        for order in list(permutations(range(3)))[1:]:
            matrix = np.eye(3)[list(order)]
            text = exchange_text(order)
            repair = _turned(quantities, axes @ matrix @ axes.T)
            yield FaultHypothesis("axes", f"axes, {text} in the {name}{frame and ', axes' + frame}", repair)
        for signs in ((-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, -1)):
            repair = _turned(quantities, axes @ np.diag(signs) @ axes.T)
            yield FaultHypothesis("sign", f"{sign_text(signs)} in the {name}{frame and ', axes' + frame}", repair)


def imu_axes(mission: Mission, name: str) -> Array | None:
    """Mounting of an IMU in a flight file.

    Parameters
    ----------
    mission : Mission
        With the path of the telemetry.
    name : str
        Of the IMU.

    Returns
    -------
    (3, 3) array or None
        body_from_imu; None where there is no such file or IMU.
    """
    path = mission.telemetry_path()
    if not isinstance(mission.telemetry, FlightFileConfig) or path is None:
        return None
    try:
        with h5py.File(path, "r") as file:
            return rotations.to_matrix(np.array(file[f"imu/{name}"].attrs["body_from_imu"], float))
    except (OSError, KeyError):
        return None


def _in_unit(mission: Mission, telemetry: Telemetry, quantity: str, factor: float) -> tuple[str, Repair]:
    """Whose readings may be in another unit, in words, and the repair.

    These are the driving IMU and those whose readings have its size. The limits beyond which a sample is bad depend on
    the unit: where samples were repaired, the file is read again in this unit.
    """
    path, records = mission.telemetry_path(), (telemetry.driving, *telemetry.checking)
    sizes = [float(np.nanmedian(np.linalg.norm(getattr(r, quantity), axis=1))) for r in records]
    low, high = sizes[0] / _SAME_UNIT, sizes[0] * _SAME_UNIT
    imus = [r.name for r, size in zip(records, sizes, strict=True) if r is records[0] or low < size < high]
    owner = "" if len(imus) == len(records) else f" of IMU {' and '.join(imus)}"
    repaired = any(r.filled.any() for r in records if r.name in imus)
    if not repaired or path is None or not isinstance(mission.telemetry, FlightFileConfig):
        return owner, _scaled(quantity, factor)

    def repair(_: Telemetry) -> Telemetry:
        read = read_flight_file(path, check_settings(mission), {imu: {quantity: factor} for imu in imus})
        return prepare_telemetry(mission, read, str(path))

    return owner, repair


def _scaled(quantity: str, factor: float) -> Repair:
    def repair(t: Telemetry) -> Telemetry:
        return replace(t, driving=replace(t.driving, **{quantity: factor * getattr(t.driving, quantity)}))

    return repair


def _scaled_altimeter(factor: float) -> Repair:
    def repair(t: Telemetry) -> Telemetry:
        assert t.altimeter is not None
        return replace(t, altimeter=replace(t.altimeter, height=factor * t.altimeter.height))

    return repair


def _turned(quantities: tuple[str, ...], matrix: Array) -> Repair:
    def repair(t: Telemetry) -> Telemetry:
        return replace(t, driving=replace(t.driving, **{q: getattr(t.driving, q) @ matrix.T for q in quantities}))

    return repair


#: Conventions of a quaternion, and the change to that of the format: scalar last, inertial axes from those of the body.
_QUATERNIONS: dict[str, Callable[[Array], Array]] = {
    "has its scalar part first": lambda q: np.roll(q, -1),
    "turns from inertial axes to those of the body": rotations.conjugate,
    "has its scalar part first and turns from inertial axes to those of the body": lambda q: rotations.conjugate(
        np.roll(q, -1)
    ),
}


def _changed_attitude(change: Callable[[Array], Array]) -> Repair:
    def repair(t: Telemetry) -> Telemetry:
        assert t.initial is not None
        return replace(t, initial=replace(t.initial, inertial_from_body=change(t.initial.inertial_from_body)))

    return repair


def _shifted_imu(shift: float) -> Repair:
    return lambda t: replace(t, driving=replace(t.driving, time=t.driving.time + shift))


def _shifted_altimeter(shift: float) -> Repair:
    def repair(t: Telemetry) -> Telemetry:
        assert t.altimeter is not None
        return replace(t, altimeter=replace(t.altimeter, time=t.altimeter.time + shift))

    return repair
