"""Sanity check of a record before it is filtered: physics that holds for every entry vehicle.

Four laws need neither an atmosphere nor an aerodynamic database:

- **drag**: while the air decelerates the vehicle most, the mean specific force points to -x of the body axes, within
  60 degrees. Blunt bodies fly at less than 20 degrees of total angle of attack, lifting ones at up to 45;
- **momentum**: the specific force, integrated from the entry state to the parachute, is the speed that the vehicle has
  lost. Its ratio to the entry speed is within `LOST_SPEED`, since the parachute opens far below it and gravity adds
  little;
- **gravity**: at rest on the surface, the accelerometers read the gravity of the planet;
- **rigid body**: two IMUs of one vehicle measure the same angular rate.

A violation is a matter of units, signs or axes. A unit that repairs it is named here; axes and signs are ranked by
`causes`, as is what these laws cannot see (lateral axes, gyros of a single IMU, clocks, a wrong entry state).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import constants

from edl_filter.estimation.series import finite_rows, interpolate_columns
from edl_filter.mission import Mission
from edl_filter.navigation.filter import Problem
from edl_filter.pipeline.load import event_times
from edl_filter.planet import Planet
from edl_filter.telemetry.record import ImuRecord, Telemetry
from edl_filter.types import AXES, Array

#: Least cosine between the mean specific force and -x.
DRAG_COSINE = 0.5
#: Share of the largest deceleration above which samples count as deceleration.
DECELERATION_SHARE = 0.3
#: Limits of the integrated specific force over the entry speed, and of the force at rest over gravity.
LOST_SPEED, GRAVITY_RATIO = (0.6, 1.4), (0.8, 1.25)
#: Largest relative difference of the rates of two IMUs, and that with which a factor or other axes explain it.
RATE_DIFFERENCE, EXPLAINED_DIFFERENCE = 0.3, 0.15
#: Unit in which a specific force may have been recorded → its value in m/s².
FORCE_UNITS = {"g": constants.g, "ft/s^2": constants.foot, "km/s^2": 1e3, "mm/s^2": 1e-3}
#: The same of an angular rate, in rad/s.
RATE_UNITS = {"deg/s": float(np.pi / 180.0), "deg/h": float(np.pi / 648000.0), "rpm": float(np.pi / 30.0)}


@dataclass(frozen=True)
class Violation:
    """A law that a record violates.

    Attributes
    ----------
    finding : str
        The record, what was found, and what is possible: one sentence.
    cause : str or None
        The unit that repairs it, as words; None where units do not.
    """

    finding: str
    cause: str | None = None


def find_violation(mission: Mission, telemetry: Telemetry, problem: Problem) -> Violation | None:
    """Find the first law that a record violates.

    Parameters
    ----------
    mission : Mission
        Its events, and the name of its telemetry.
    telemetry : Telemetry
        As it was read.
    problem : Problem
        Assembled from both.

    Returns
    -------
    Violation or None
    """
    record = telemetry.driving
    where = f"{mission.telemetry_path() or mission.source or mission.name}: IMU {record.name}"
    times = event_times(mission, telemetry)
    end = min((times[n] for n in ("parachute_deploy", "landing") if n in times), default=None)
    violations = [
        _check_rates(where, record, checking, np.inf if end is None else end) for checking in telemetry.checking
    ]
    if end is not None:
        entry = record.between(problem.initial.time, end)
        if len(entry) > 2:
            velocity = problem.planet.velocity_relative(problem.initial.position, problem.initial.velocity)
            violations += [_check_lost_speed(where, entry, float(np.linalg.norm(velocity))), _check_drag(where, entry)]
    if telemetry.landing is not None:
        at_rest = record.specific_force[record.time - record.interval >= telemetry.landing.time]
        if len(at_rest):
            violations.append(_check_gravity(where, at_rest, problem.planet, telemetry.landing.position))
    return next((violation for violation in violations if violation is not None), None)


def likely_unit(ratio: float, limits: tuple[float, float], units: dict[str, float]) -> str | None:
    """The unit in which values were recorded that are `ratio` times too large; None if no unit brings it into `limits`.

    Parameters
    ----------
    ratio : float
        Found over expected.
    limits : (float, float)
        Between which it must be.
    units : dict
        Name → value in SI.
    """
    candidates = {name: ratio * value for name, value in units.items() if limits[0] <= ratio * value <= limits[1]}
    return min(candidates, key=lambda name: abs(np.log(candidates[name]))) if candidates else None


def _check_lost_speed(where: str, entry: ImuRecord, speed: float) -> Violation | None:
    """Momentum: integrated specific force against the entry speed, m/s."""
    lost = float(entry.interval @ np.linalg.norm(np.nan_to_num(entry.specific_force), axis=1))
    low, high = LOST_SPEED
    if low <= lost / speed <= high:
        return None
    unit = likely_unit(lost / speed, LOST_SPEED, FORCE_UNITS)
    finding = (
        f"{where}: the specific force takes {lost:.0f} m/s from an entry speed of {speed:.0f} m/s before "
        f"{entry.time[-1]:.0f} s; between {low * speed:.0f} and {high * speed:.0f} m/s are possible."
    )
    return Violation(finding, f"units, the specific force is in {unit} instead of m/s^2" if unit else None)


def _check_drag(where: str, entry: ImuRecord) -> Violation | None:
    """Direction of the mean specific force during the deceleration."""
    force = np.nan_to_num(entry.specific_force)
    size = np.linalg.norm(force, axis=1)
    selected = size > DECELERATION_SHARE * float(np.quantile(size, 0.995))
    mean = entry.interval[selected] @ force[selected]
    direction = mean / np.linalg.norm(mean)
    if -direction[0] >= DRAG_COSINE:
        return None
    axis = int(np.argmax(np.abs(direction)))
    axis_name = f"{'+' if direction[axis] > 0.0 else '-'}{AXES[axis]}"
    return Violation(
        f"{where}: during the deceleration the specific force points to {axis_name} of the body axes; "
        "drag points to -x."
    )


def _check_gravity(where: str, at_rest: Array, planet: Planet, position: Array) -> Violation | None:
    """Specific force ``(N, 3)`` at rest against gravity at a planet-fixed position ``(3,)``, m.

    The median is compared: with a wrong clock the rest begins with samples of the impact, which are no matter of units.
    """
    gravity = float(np.linalg.norm(planet.apparent_gravity(position)))
    reading = float(np.linalg.norm(np.median(at_rest, axis=0)))
    if GRAVITY_RATIO[0] <= reading / gravity <= GRAVITY_RATIO[1]:
        return None
    unit = likely_unit(reading / gravity, GRAVITY_RATIO, FORCE_UNITS)
    finding = (
        f"{where}: at rest after the landing the accelerometers read {reading:.3g} m/s^2; the gravity of the planet is "
        f"{gravity:.3g} m/s^2."
    )
    return Violation(finding, f"units, the specific force is in {unit} instead of m/s^2" if unit else None)


def _check_rates(where: str, record: ImuRecord, checking: ImuRecord, end: float) -> Violation | None:
    """The same angular rate in two IMUs, up to `end` (s)."""
    common = (record.time > checking.time[0]) & (record.time <= min(end, checking.time[-1]))
    if np.count_nonzero(common) < 10:
        return None
    rate = record.angular_rate[common]
    compared = interpolate_columns(record.time[common], checking.time, checking.angular_rate)
    finite = finite_rows(rate) & finite_rows(compared)
    rate, compared = rate[finite], compared[finite]
    difference = relative_difference(rate, compared) if len(rate) else 0.0
    if difference <= RATE_DIFFERENCE:
        return None
    finding = (
        f"{where}: its angular rate and that of IMU {checking.name} differ by {100.0 * difference:.0f} % of their "
        "size; a rigid body has one rate. Check whether the two IMUs, or their body_from_imu, are exchanged."
    )
    return Violation(finding, explain_rates(rate, compared))


def relative_difference(rate: Array, checking_rate: Array) -> float:
    """Size of the difference of two rates ``(N, 3)`` over the larger of their sizes, by medians."""
    difference, size, checking_size = (
        float(np.median(np.linalg.norm(values, axis=1))) for values in (rate - checking_rate, rate, checking_rate)
    )
    return difference / max(size, checking_size, 1e-12)


def explain_rates(rate: Array, checking_rate: Array) -> str | None:
    """The unit that makes two rates ``(N, 3)`` equal, as words; None if none does."""
    options: list[tuple[float, str]] = []
    for unit, value in RATE_UNITS.items():
        options.append((relative_difference(rate * value, checking_rate), f"units, its angular rate is in {unit}"))
        options.append(
            (relative_difference(rate, checking_rate * value), f"units, the other IMU's angular rate is in {unit}")
        )
    difference, text = min(options)
    return text if difference <= EXPLAINED_DIFFERENCE else None
