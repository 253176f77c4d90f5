"""Checks of one IMU's samples as they are stored: values that no sensor can have read.

Input: times in order (`time_stamps`) and readings in the axes of the IMU, before rotation. Method: triads that are not
finite, out of range or all zero and axes that are stuck or saturated are marked as lost (`lost_readings`), and rows
with NaN are inserted where samples are missing (`completed`). A repetition is a fault only where it is improbable: the
probability that a channel repeats a value by its quantisation is taken from the samples around it. Output: readings
with NaN where they are lost, and a `SampleFinding` for each stretch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import pdtrc

from edl_filter.estimation.series import ROBUST_SIGMA, finite_rows, runs
from edl_filter.telemetry.record import SampleFinding
from edl_filter.types import Array, BoolArray, IntArray

#: A step in time longer than this many sampling intervals is a gap.
GAP_STEPS = 1.5
#: Samples on each side from which the probability of a repetition is taken.
_REPEAT_REACH = 256
#: Share of rows that repeat another one from which repetition may be a property of the data, and from which it is.
_USUAL_REPETITION, _MOST_REPEATED = 0.02, 0.25
#: Largest specific force (m/s²) and rate (rad/s) of a reading, and largest rotation within one sample (rad): larger
#: values cannot be readings of a vehicle whose attitude is tracked.
_HIGHEST_FORCE, _HIGHEST_RATE, MAX_ROTATION = 5e3, 50.0, 1.5
#: Share of rows of zeros from which zero is what a simulation without noise gives.
_MOST_ZERO = 0.9
#: Relative difference up to which the extremes on both sides of zero are limits of one range.
_SYMMETRIC = 1e-3
#: Steps of the quantisation, or different values, from which the density at an extreme is taken.
_QUANTA = 10
#: Samples of a sine in the last step below its extreme, over the mean number of the next `_QUANTA` steps:
#: 10 / (√11 - 1).
_PEAK = 4.4
#: Decimals, of the largest value, to which two readings are equal, and most samples of a peak at a limit.
_DIGITS, _LONGEST_PEAK = 9, 3
#: Share of the values of an axis that may recur without quantisation, and runs at an extreme from which it is a limit.
_FEW_RECUR, _SEVERAL_RUNS = 0.01, 3
#: Part of its stated noise that an axis shows which is no simulation without noise.
_SHOWN = 0.3
#: Triads and axes of the readings' columns.
CHANNELS = ("force x", "force y", "force z", "rate x", "rate y", "rate z")


@dataclass(frozen=True)
class CheckSettings:
    """Thresholds of the checks of samples.

    Attributes
    ----------
    enabled : bool
        False: only samples that are missing or not finite are treated as lost.
    spike_sigmas : float
        A sample that differs from its neighbours by more than this many robust sigmas is a spike.
    disagreement_sigmas : float
        Two IMUs whose difference exceeds this many robust sigmas disagree.
    false_alarm_probability : float
        Probability per flight with which a sound axis may be taken for a stuck one.
    longest_gap_s : float
        Longest stretch that is filled without another IMU, s.
    """

    enabled: bool = True
    spike_sigmas: float = 15.0
    disagreement_sigmas: float = 15.0
    false_alarm_probability: float = 1e-6
    longest_gap_s: float = 30.0


def highest_readings(interval: float) -> tuple[float, float]:
    """Largest specific force (m/s²) and rate (rad/s) that a sample of this `interval` (s) can have."""
    return _HIGHEST_FORCE, min(_HIGHEST_RATE, MAX_ROTATION / interval)


def findings_of(
    imu: str, channel: str, kind: str, lost: BoolArray, time: Array, interval: float
) -> list[SampleFinding]:
    """One finding for each run of lost samples.

    Parameters
    ----------
    imu, channel, kind : str
        As in `SampleFinding`.
    lost : (N,) boolean array
        Samples.
    time : (N,) array
        Ends of the samples, s.
    interval : float
        Sampling interval, s.
    """
    return [
        SampleFinding(imu, channel, float(time[a]) - interval, float(time[b - 1]), b - a, kind) for a, b in runs(lost)
    ]


def lost_readings(
    time: Array,
    readings: Array,
    interval: float,
    imu: str,
    limits: tuple[float, float],
    settings: CheckSettings,
    noise: tuple[float, float] | None = None,
) -> tuple[Array, list[SampleFinding]]:
    """Readings with NaN in the triads and axes that no sensor can have read, and what they are.

    Parameters
    ----------
    time : (N,) array
        Increasing, s.
    readings : (N, 6) or (N, 3) array
        Specific force (m/s²), and angular rate (rad/s) where it is read, axes of the IMU.
    interval : float
        Sampling interval, s.
    imu : str
        Name of the IMU.
    limits : (2,) floats
        Largest specific force (m/s²) and rate (rad/s) that an instrument can read.
    settings : CheckSettings
        Thresholds.
    noise : (2,) floats, optional
        Stated sigma of the specific force (m/s²) and of the rate (rad/s). Without it, an axis that reads one value in
        the whole record is not tested.

    Returns
    -------
    readings : (N, 6) or (N, 3) array
    findings : list of SampleFinding
        Their limits are in the axes of the IMU (`in_body_axes`).
    """
    findings: list[SampleFinding] = []
    readings = readings.copy()
    channels = CHANNELS[: readings.shape[1]]
    triads = [(slice(0, 3), "force", limits[0]), (slice(3, 6), "rate", limits[1])][: len(channels) // 3]
    row = "all" if len(triads) == 2 else "force"
    for triad, name, limit in triads:
        broken = ~finite_rows(readings[:, triad])
        beyond = np.linalg.norm(np.nan_to_num(readings[:, triad], nan=0.0, posinf=0.0, neginf=0.0), axis=1) > limit
        for kind, lost in (("not_finite", broken), ("out_of_range", beyond & ~broken)):
            findings += findings_of(imu, name, kind, lost, time, interval)
            readings[lost, triad] = np.nan
    if not settings.enabled:
        return readings, findings
    zero = _improbable_zeros(readings, settings.false_alarm_probability)
    if zero.any():
        findings += findings_of(imu, row, "all_zero", zero, time, interval)
        readings[zero] = np.nan
    repeated = _repeated_rows(readings)
    findings += findings_of(imu, row, "duplicated", repeated, time, interval)
    readings[repeated] = np.nan
    held = _held_values(readings, noise) if noise is not None and len(channels) == 6 else {}
    for column, name in enumerate(channels):
        values = readings[:, column].copy()
        lost = values == held.get(column)
        if lost.any() and not _is_limit(held[column], values):
            lost |= bool(np.all(lost[np.isfinite(values)]))  # throughout: rows that were lost before, too
            findings += findings_of(imu, name, "stuck", lost, time, interval)
            readings[lost, column] = np.nan
            continue
        saturated = [(limit, True) for limit in _repeated_extremes(values, settings.false_alarm_probability)]
        saturated += [(held[column], True)] if lost.any() else []
        for a, b in stuck_runs(values, settings.false_alarm_probability):
            nearby = values[max(0, a - _REPEAT_REACH) : b + _REPEAT_REACH]
            if values[a] not in (np.nanmin(nearby), np.nanmax(nearby)):
                lost = np.zeros(len(time), bool)
                lost[a:b] = True
                findings += findings_of(imu, name, "stuck", lost, time, interval)
                readings[lost, column] = np.nan
            else:
                saturated += _limits(float(values[a]), nearby, values)
        for value, is_limit in saturated:  # single samples at the limit, too
            lost = (values == value) & np.isfinite(readings[:, column])
            vector = _vector(value * np.eye(3)[column % 3]) if is_limit else None
            axis_findings = findings_of(imu, name, "saturated", lost, time, interval)
            findings += [replace(f, limit=vector) for f in axis_findings]
            readings[lost, column] = np.nan
    return readings, findings


def _held_values(readings: Array, noise: tuple[float, float]) -> dict[int, float]:
    """Columns of (N, 6) that read one value in most of the record, while others have a part of their noise: that value.

    The others are those of the triad, or, where all of it reads one value, those of the other triad: coarse steps of
    the quantisation may contain the whole motion about an axis. A simulation without noise may have axes on which
    nothing acts; its other axes are smooth where the motion is. Their fourth difference, of independent noise √70
    times its sigma, is compared at its quantile of 10 %, which is 0.126 sigmas of a normal distribution.
    """
    held: dict[int, float] = {}
    for column, values in enumerate(readings.T):
        different, counts = np.unique(values[np.isfinite(values)], return_counts=True)
        if len(counts) and 2 * counts.max() > counts.sum():
            held[column] = float(different[np.argmax(counts)])
    shown = set()
    for column in set(range(6)) - set(held):
        fourth = np.abs(np.diff(readings[:, column], 4))
        fourth = fourth[np.isfinite(fourth)]
        if len(fourth) >= _REPEAT_REACH:
            sigma = float(np.quantile(fourth, 0.1)) / 0.126 / np.sqrt(70.0)
            if sigma > _SHOWN * noise[column // 3]:
                shown.add(column // 3)
    whole = {triad for triad in (0, 1) if {3 * triad, 3 * triad + 1, 3 * triad + 2} <= set(held)}
    return {k: v for k, v in held.items() if (k // 3 in shown) or (k // 3 in whole and shown)}


def _is_limit(value: float, values: Array) -> bool:
    """Whether a held value of an axis (N,) is a limit of its range: the extreme on one side of zero, and not all."""
    low, high = np.nanmin(values), np.nanmax(values)
    return bool(low < high and value != 0.0 and value == (high if value > 0.0 else low))


def _repeated_extremes(values: Array, probability: float) -> list[float]:
    """Lowest and highest value of an axis (N,) as far as they are limits of its range.

    An axis that is saturated in single samples, at the peaks of an oscillation, may have no long run of equal values,
    but its limits more often than values near them. Where hardly any other value recurs, as without quantisation, both
    extremes are limits if they recur and are opposite to the last digit. An extreme in several runs is one, too, if it
    is near the other values, and so is that of the other side of a symmetric range. Else both extremes of a symmetric
    range are compared with their neighbours: without saturation, the number of samples that have the extreme exactly is
    Poisson distributed, at most with `_PEAK` times the mean number of the next `_QUANTA` steps of the quantisation,
    since the density of a sine is greatest at its extreme, or, where the next `_QUANTA` values recur m times, with
    2 m - 1: an oscillation without noise has both extremes once in a period and other values twice, or the reverse. The
    probability of each side must be less than the root of the given one. Longer runs are judged by `stuck_runs`.
    """
    finite = values[np.isfinite(values)]
    rounded = np.round(finite / np.abs(finite).max(), _DIGITS) if finite.any() else finite  # recur to rounding
    different, counts = np.unique(rounded, return_counts=True)
    if len(different) <= 2 * _QUANTA:
        return []
    sides = [finite.min(), finite.max()]
    symmetric = abs(different[0] + different[-1]) <= _SYMMETRIC * different[-1]
    if np.mean(counts[1:-1] > 1) < _FEW_RECUR:
        lengths = [[b - a for a, b in runs(rounded == extreme)] for extreme in (different[0], different[-1])]
        if max(map(max, lengths)) > _REPEAT_REACH // 4:
            return []
        opposite = different[0] == -different[-1] and min(map(sum, lengths)) > 1
        limits = [
            opposite or (len(n) >= _SEVERAL_RUNS and _is_near(ordered))
            for n, ordered in zip(lengths, (different, different[::-1]), strict=True)
        ]
        return [float(v) for v, limit in zip(sides, limits, strict=True) if limit or (symmetric and any(limits))]
    if not symmetric:
        return []
    quantum = float(np.diff(different).min())
    for order in (slice(None), slice(None, None, -1)):
        distance, count = np.abs(different[order] - different[order][0])[1:], counts[order]
        in_steps = int(np.sum(count[1:][distance < (_QUANTA + 0.5) * quantum]))
        expected = max(_PEAK * in_steps / _QUANTA, 2.0 * float(np.mean(count[1 : _QUANTA + 1])) - 1.0)
        longest = max(b - a for a, b in runs(rounded == different[order][0]))
        if longest > _LONGEST_PEAK or pdtrc(count[0] - 1, expected) >= np.sqrt(probability):
            return []
    return [float(v) for v in sides]


def _is_near(ordered: Array) -> bool:
    """Whether the first of several `ordered` values is no farther from the next ones than these are from each other."""
    distance = np.abs(ordered[: _QUANTA + 2] - ordered[0])
    return bool(distance[1] <= distance[-1] - distance[1])


def _limits(value: float, nearby: Array, values: Array) -> list[tuple[float, bool]]:
    """Values at which an axis is saturated that repeats an extreme `value`, and whether they are limits of its range.

    A range is on both sides of zero. Where the extreme of the other side is as far from zero, as on a symmetric range,
    it is a limit, too, however short the axis has it.
    """
    if value == 0.0 or value != (np.nanmax(nearby) if value > 0.0 else np.nanmin(nearby)):
        return [(value, False)]
    opposite = float(np.nanmin(values) if value > 0.0 else np.nanmax(values))
    symmetric = abs(opposite + value) <= _SYMMETRIC * abs(value)
    return [(value, True), (opposite, True)] if symmetric else [(value, True)]


def _improbable_zeros(readings: Array, probability: float) -> BoolArray:
    """Rows (N,) of zeros in all channels that quantisation does not explain.

    The probability that a row reads zero in all channels is the product of the channels' shares of zeros in the nearest
    other rows, on that side of the run on which it is greater.
    """
    zero = np.asarray(np.all(readings == 0.0, axis=1), np.bool_)
    if not zero.any() or zero.mean() >= _MOST_ZERO:
        return np.zeros(len(zero), bool)
    nonzero = np.flatnonzero(~zero)
    is_zero = readings[nonzero] == 0.0
    improbable = zero.copy()
    for a, b in runs(zero):
        k = int(np.searchsorted(nonzero, a))
        sides = (is_zero[max(0, k - _REPEAT_REACH) : k], is_zero[k : k + _REPEAT_REACH])
        by_chance = max((float(np.prod(side.mean(axis=0))) for side in sides if len(side)), default=0.0)
        improbable[a:b] = len(zero) * by_chance < probability
    return improbable


def _repeated_rows(readings: Array) -> BoolArray:
    """Rows (N,) that repeat an earlier row in all channels, where that is not usual in the data.

    Few rows that do so are repetitions. More of them may be a property of the data: a coarse quantisation, a vehicle on
    which nothing acts in a simulation without noise, or readings that are held between slower samples. They are none if
    there is a channel in which hardly any value of the other rows recurs, and if all runs are short.
    """
    finite = finite_rows(readings)
    out = np.zeros(len(readings), bool)
    if not finite.any():
        return out
    _, first, inverse = np.unique(readings[finite], axis=0, return_index=True, return_inverse=True)
    repeated = first[inverse.ravel()] != np.arange(int(finite.sum()))
    unusual = repeated.mean() <= _USUAL_REPETITION
    if not unusual and repeated.mean() <= _MOST_REPEATED:
        distinct = readings[finite][~repeated]
        recurring = 1.0 - max(len(np.unique(channel)) for channel in distinct.T) / len(distinct)
        longest = max(b - a for a, b in runs(repeated))
        unusual = recurring < _FEW_RECUR and longest <= _REPEAT_REACH // 4
    if unusual:
        out[finite] = repeated
    return out


def stuck_runs(values: Array, probability: float) -> list[tuple[int, int]]:
    """Runs ``[a, b)`` of exactly equal values that quantisation does not explain.

    Parameters
    ----------
    values : (N,) array
        Of one channel, any unit.
    probability : float
        With which a sound channel may be taken for a stuck one.
    """
    equal = np.concatenate(([False], np.diff(values) == 0.0))
    stuck = []
    for a, b in runs(equal):
        length = b - a  # repetitions of values[a - 1]
        before, after = slice(max(0, a - _REPEAT_REACH), a - 1), slice(b, min(len(values), b + _REPEAT_REACH))
        # probability that a value recurs in the next sample: by repetition around, or by its quantisation
        count = before.stop - before.start + after.stop - after.start
        repetitions = np.count_nonzero(equal[before]) + np.count_nonzero(equal[after])
        repetition = (repetitions + 1.0) / (count + 1.0)
        if np.log(len(values)) + length * np.log(repetition) > np.log(probability):
            continue
        nearby = np.concatenate((values[before], values[after]))
        nearby = nearby[np.isfinite(nearby)]
        if len(nearby) < 16:
            continue
        quantum = np.diff(np.unique(nearby))
        spread = ROBUST_SIGMA * float(np.median(np.abs(np.diff(nearby)))) if len(nearby) > 1 else 0.0
        if quantum.min(initial=np.inf) > 0.5 * spread:
            continue
        stuck.append((a - 1, b))
    return stuck


def completed(
    time: Array, readings: Array, interval: float, imu: str
) -> tuple[Array, Array, IntArray, list[SampleFinding]]:
    """Rows with NaN inserted where samples are missing.

    The sample after a gap covers one sampling interval, and the gap is divided into equal samples of about that length.

    Parameters
    ----------
    time : (N,) array
        Increasing, s.
    readings : (N, 6) array
        Any units.
    interval : float
        Sampling interval, s.
    imu : str
        Name of the IMU.

    Returns
    -------
    time : (M,) array
        Increasing, s.
    readings : (M, 6) array
    inserted : (M,) integer array
        1 at the inserted rows, otherwise 0.
    findings : list of SampleFinding
    """
    before = np.flatnonzero(np.diff(time) > GAP_STEPS * interval)
    inserted = np.zeros(len(time), np.int64)
    if not len(before):
        return time, readings, inserted, []
    times, rows, findings = [], [], []
    for i in before:
        length = float(time[i + 1] - interval - time[i])
        count = max(1, round(length / interval))
        times.append(time[i] + length * np.arange(1, count + 1) / count)
        rows.append(np.full(count, i + 1))
        findings.append(SampleFinding(imu, "all", float(time[i]), float(time[i] + length), count, "missing"))
    at = np.concatenate(rows)
    return (
        np.insert(time, at, np.concatenate(times)),
        np.insert(readings, at, np.nan, axis=0),
        np.insert(inserted, at, 1),
        findings,
    )


def interpolation_error(values: Array) -> Array:
    """Each sample of (N, 3) minus the cubic interpolation of its four neighbours; zero at the ends."""
    out, v = np.zeros_like(values), values
    out[2:-2] = v[2:-2] - (4.0 * (v[1:-3] + v[3:-1]) - v[:-4] - v[4:]) / 6.0
    return out


def in_body_axes(findings: list[SampleFinding], body_from_imu: Array) -> list[SampleFinding]:
    """Findings of `lost_readings` with their limits in body axes, by the rotation matrix (3, 3) of the mounting."""
    return [f if f.limit is None else replace(f, limit=_vector(body_from_imu @ f.limit)) for f in findings]


def _vector(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def with_repair(finding: SampleFinding, repair: str) -> SampleFinding:
    """The finding with what was done about it."""
    return replace(finding, repair=repair)
