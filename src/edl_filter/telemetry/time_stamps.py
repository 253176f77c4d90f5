"""Times of packets: those that scatter about a steady clock, packets out of order, and fractions of a step.

Input: times as they are stored. An IMU samples by an oscillator; stamps that scatter about its counts by less than one
sampling interval are errors of the stamps, rounded ones or those of arrival. Method (`evened`): regression of the times
on the count. Errors of single stamps are independent, so that the mean square of their successive differences is twice
that of themselves (von Neumann 1941, Annals of Mathematical Statistics 12, 367); a clock that jumps or drifts has
errors that hardly differ between neighbours. Packets are then put in order (`ordered_packets`). If nearly all steps are
whole intervals, one that is not is no interval of the sensor, which averages over one interval in each sample: a packet
between two that are in step is an additional one, packets with wrong times are counted, and a clock that leaves its
steps for good has jumped. Output: increasing times.
"""

from __future__ import annotations

import numpy as np

from edl_filter.estimation.series import ROBUST_SIGMA
from edl_filter.telemetry.record import SampleFinding
from edl_filter.telemetry.sample_checks import GAP_STEPS
from edl_filter.types import Array, BoolArray

#: Scatter about the regression, in sampling intervals: at least the root mean square, at most the largest one.
_LEAST_SCATTER, _LARGEST = 0.02, 1.01
#: Least ratio of the mean square successive difference to the mean square: 2 for independent errors, 0 for a drift. Its
#: standard deviation is 2/√N with N samples.
_LEAST_RATIO = 1.0
#: Largest relative difference between the interval of the regression and the stated one.
_INTERVAL = 0.05
#: Fewest samples.
_FEWEST = 100
#: Largest number of successive packets with wrong times that are given times by counting.
_WRONG_TIMES = 8
#: Share of steps that are whole intervals from which the clock is steady; and their largest departure, in intervals and
#: in robust sigmas of all steps. The share of faults is small: rounded stamps may leave their steps more often.
_STEADY, _IN_STEP, _SCATTERS = 0.95, 0.05, 6.0
#: Largest unit of rounded stamps, in intervals; fewest steps, and their largest size in intervals, by which stamps are
#: rounded to a larger one.
_COARSEST, _MANY, _SMALL = 0.1, 10, 0.25


def evened(time: Array, interval: float, imu: str) -> tuple[Array, list[SampleFinding]]:
    """Times with independent errors of the stamps removed.

    Parameters
    ----------
    time : (N,) array
        As stored, s; not finite where unknown.
    interval : float
        Stated sampling interval, s.
    imu : str
        Name of the IMU.

    Returns
    -------
    time : (N,) array
        The same array where the stamps do not scatter, or more than stamps explain.
    findings : list of SampleFinding
        The mean of the errors is not known: packets arrive late, and stamps may be rounded down. The root mean square
        of the scatter is therefore one sigma of the clock.
    """
    if len(time) < _FEWEST or not np.isfinite(time).all() or np.any(np.diff(time) < 0.0):
        return time, []
    steps = np.maximum(1, np.round(np.diff(time) / interval))
    for count in (np.arange(len(time), dtype=float), np.concatenate(([0.0], np.cumsum(steps)))):
        centred = count - count.mean()
        slope = float(centred @ time / (centred @ centred))
        if abs(slope / interval - 1.0) > _INTERVAL:
            continue
        sigma = float(np.std(time - slope * centred) / np.sqrt(centred @ centred))
        if abs(slope - interval) < 5.0 * sigma:  # the stated interval is known better
            slope = interval
        error = time - time.mean() - slope * centred
        square = float(np.mean(error**2))
        if np.abs(error).max() > _LARGEST * interval or square < (_LEAST_SCATTER * interval) ** 2:
            continue
        if float(np.mean(np.diff(error) ** 2)) < _LEAST_RATIO * square:
            continue
        scatter = float(np.sqrt(square))
        repair = f"stamps scatter by {1e3 * scatter:.2g} ms about a steady clock, whose times are used"
        start, end = float(time[0]) - interval, float(time[-1])
        finding = SampleFinding(imu, "all", start, end, len(time), "jitter", repair, clock_sigma=scatter)
        return time.mean() + slope * centred, [finding]
    return time, []


def ordered_packets(
    time: Array, readings: Array, interval: float, imu: str
) -> tuple[Array, Array, list[SampleFinding]]:
    """Put packets in the order of time, each once.

    Packets with a wrong time between packets that are in step with each other get their time by counting. A clock that
    jumps back is continued at the usual step, because two samples cannot have been taken at one time.

    Parameters
    ----------
    time : (N,) array
        As stored, s.
    readings : (N, 6) array
        Specific force (m/s²) and angular rate (rad/s).
    interval : float
        Sampling interval, s.
    imu : str
        Name of the IMU.

    Returns
    -------
    time : (M,) array
        Increasing, s.
    readings : (M, 6) array
    findings : list of SampleFinding
    """
    finite = np.isfinite(time)
    time, readings = time[finite], readings[finite]
    increasing = bool(np.all(np.diff(time) > 0.0))
    findings: list[SampleFinding] = []
    if increasing:  # packets between two others are recognised before close ones are counted
        time, readings, findings = _in_step(time, readings, interval, imu)
    if np.any(np.diff(time) <= 0.25 * interval):
        time, readings, more = _in_order(time, readings, interval, imu)
        findings += more
    if not increasing:
        time, readings, more = _in_step(time, readings, interval, imu)
        findings += more
    return time, readings, findings


def _in_order(time: Array, readings: Array, interval: float, imu: str) -> tuple[Array, Array, list[SampleFinding]]:
    """Packets in the order of time, each once, with steps of more than a quarter of the interval."""
    findings: list[SampleFinding] = []

    def report(kind: str, at: Array, samples: int, repair: str) -> None:
        start, end = float(np.min(at)) - interval, float(np.max(at))
        findings.append(SampleFinding(imu, "all", start, end, samples, kind, repair))

    order = np.argsort(time, kind="stable")
    close = np.flatnonzero(np.diff(time[order]) < 0.25 * interval)
    first, second = order[close], order[close + 1]
    same = np.all((readings[first] == readings[second]) | np.isnan(readings[second]), axis=1)
    if same.any():
        repeated = second[same]
        report("duplicated", time[repeated], len(repeated), "the first of each is used")
        retained = np.ones(len(time), bool)
        retained[repeated] = False
        time, readings = time[retained], readings[retained]
    order = np.argsort(time, kind="stable")
    if np.all(np.diff(time[order]) > 0.25 * interval):
        moved = time[order] != time
        if moved.any():
            report("reordered", time[moved], int(moved.sum()), "put in order of time")
        return time[order], readings[order], findings
    time, counted = _counted_times(time, interval)
    if counted.any():
        report("clock_jump", time[counted], int(counted.sum()), "wrong times of packets, replaced by counting")
    for row in np.flatnonzero(np.diff(time) < 0.25 * interval) + 1:
        step = time[row] - time[row - 1]
        if step < 0.25 * interval:  # not yet corrected by a jump before
            report("clock_jump", time[row - 1 : row], 1, f"{step - interval:+.3f} s, removed from there on")
            time = np.concatenate((time[:row], time[row:] + interval - step))
    return time, readings, findings


def _counted_times(time: Array, interval: float) -> tuple[Array, BoolArray]:
    """Times with those replaced that are out of step with packets before and after, and which were replaced.

    At a step back, a number of packets up to and including it, or from it on, may have wrong times: the smallest number
    is used after which the next packet has the time that counting gives.
    """
    time, counted = time.copy(), np.zeros(len(time), bool)
    for row in np.flatnonzero(np.diff(time) < 0.25 * interval) + 1:
        if time[row] - time[row - 1] >= 0.25 * interval:  # replaced with those before
            continue
        spans = [(a, a + k) for k in range(1, _WRONG_TIMES + 1) for a in (row, row - k)]
        for a, b in spans:
            if a < 1 or b >= len(time):
                continue
            expected = time[a - 1] + interval * np.arange(1, b - a + 2)
            if abs(time[b] - expected[-1]) < 0.25 * interval:
                time[a:b], counted[a:b] = expected[:-1], True
                break
    return time, counted


def _in_step(time: Array, readings: Array, interval: float, imu: str) -> tuple[Array, Array, list[SampleFinding]]:
    """Packets in the steps of a steady clock, as `ordered_packets` returns them; the given ones of an unsteady clock.

    Steps that are no whole intervals divide the record into parts. A short part that is out of step with the packet
    before it, where the next part is in step with that, has wrong times, or has no place between the two. A longer one
    begins with a jump of the clock. After missing samples the sensor may have another phase, which is left.
    """
    step = float(np.median(np.diff(time))) if len(time) >= _FEWEST else 0.0
    if not abs(step / interval - 1.0) < _INTERVAL:
        return time, readings, []
    fraction = _fraction(np.diff(time) / step)
    tolerance = _tolerance(time, fraction, step)
    in_step = np.abs(fraction) <= tolerance
    if in_step.all() or in_step.mean() < _STEADY or _is_rounded(fraction[~in_step]):
        return time, readings, []
    findings: list[SampleFinding] = []

    def report(kind: str, first: int, last: int, repair: str) -> None:
        start, end = float(time[first]) - interval, float(time[last - 1])
        findings.append(SampleFinding(imu, "all", start, end, last - first, kind, repair))

    begins = (np.flatnonzero(~in_step) + 1).tolist()
    out, retained = time.copy(), np.ones(len(time), bool)
    last = begins[0] - 1  # the latest packet in step
    removed = 0.0  # by how much the clock has jumped since the first packet, s
    for first, end in zip(begins, [*begins[1:], len(time)], strict=True):
        out[first:end] -= removed
        steps = float(out[first] - out[last]) / step
        if abs(_fraction(steps)) <= tolerance:
            last = end - 1
            continue
        following = float(time[end] - removed - out[last]) / step if end < len(time) else np.inf
        if end - first <= _WRONG_TIMES and following < np.inf and abs(_fraction(following)) <= tolerance:
            places = round(following) - 1
            count = min(places, end - first)
            steps_after = np.arange(1, count + 1)
            if places > count:  # samples are missing next to them
                steps_after = np.clip(np.round((out[first:end] - out[last]) / step), 1, places).astype(np.int64)
            out[first : first + count] = out[last] + step * steps_after
            retained[first + count : end] = False
            if count:
                report("clock_jump", first, first + count, "wrong times of packets, replaced by counting")
                last = first + count - 1
            if count < end - first:
                report("duplicated", first + count, end, "between packets that are in step; not used")
            continue
        if steps <= GAP_STEPS:
            jump = step * float(_fraction(steps))
            report("clock_jump", first, first + 1, f"{jump:+.3f} s, removed from there on")
            removed += jump
            out[first:end] -= jump
        last = end - 1
    return out[retained], readings[retained], findings


def _tolerance(time: Array, fraction: Array, step: float) -> float:
    """Largest departure of a step from whole intervals by which it is in step, in intervals.

    Stamps scatter by themselves, and those that are rounded to a decimal place by its unit.
    """
    scatter = ROBUST_SIGMA * float(np.median(np.abs(fraction)))
    for exponent in range(-1, -7, -1):
        unit = 10.0**exponent
        if unit <= _COARSEST * step and np.all(np.abs(time / unit - np.round(time / unit)) < 1e-4):
            return max(_IN_STEP, _SCATTERS * scatter, 1.5 * unit / step)
    return max(_IN_STEP, _SCATTERS * scatter)


def _is_rounded(fraction: Array) -> bool:
    """Whether steps out of step are those of rounded stamps: many, all of one small size and in one direction."""
    sizes = np.abs(fraction)
    middle = float(np.median(sizes))
    same = np.abs(sizes - middle) < 0.1 * middle
    one_way = max(np.mean(fraction > 0.0), np.mean(fraction < 0.0))
    return len(fraction) >= _MANY and middle < _SMALL and min(float(np.mean(same)), float(one_way)) > 0.9


def _fraction(steps: Array | float) -> Array:
    """Steps in sampling intervals less the nearest whole number of at least one."""
    return np.asarray(steps - np.maximum(1.0, np.round(steps)))
