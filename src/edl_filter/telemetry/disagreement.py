"""Stretches over which two IMUs of one rigid vehicle differ by more than constant errors explain.

Input: records of both in body axes, bad samples NaN. Method: an IMU with a constant error, however large, has no
`parity`; to name it is left to the diagnosis. A fault of some samples changes the constants within the flight. The
regression is that with the largest consensus set (Fischler & Bolles 1981, Communications of the ACM 24, 381): the
fewest samples disagree with it. Since a fault is also in the regressors of the IMU that has it, where it may look like
a scale error, each IMU is regressed on the other one. If one IMU samples much more often, its means over the samples of
the other one are compared (`resampling`). Where force and rate have different delays, a triad of one IMU is late
against its other triad, a constant error that no measurement contradicts. Output: runs of samples whose parity is
significant, such delays, and the IMU that has the difference as an error of its own (`independent_error`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d
from scipy.special import chdtri

from edl_filter.estimation.series import runs
from edl_filter.telemetry.parity import Pair, Parity, pair_of, parity_of
from edl_filter.telemetry.record import ImuRecord, SampleFinding
from edl_filter.telemetry.relative_calibration import FEWEST_SAMPLES
from edl_filter.telemetry.resampling import comparable_records, covered, means_between
from edl_filter.telemetry.sample_checks import interpolation_error
from edl_filter.types import Array, BoolArray

#: Length of the running median of the squared parity, s: several oscillations of an entry vehicle. Shorter faults are
#: found sample by sample (`spikes`).
WINDOW = 5.0
#: Length of the mean of the parity, s: changes of a bias or a scale that single samples do not show.
_LONG_WINDOW = 20.0
#: Equal parts of the flight from each of which a consensus set is grown.
_STARTS = 4
#: Iterations of a consensus set.
_CONSENSUS = 10
#: Least difference between the delays of two triads, in sampling intervals and in sigmas, and least share of the
#: comparison in which both IMUs are read. On simulated flights with two IMUs the difference is estimated as 0.02 at
#: most, on the rovers as 0.05, since the accelerometers are not both linear.
LATE, _LATE_SIGMAS, _LATE_SHARE = 0.1, 6.0, 0.5
#: Fewest samples of a regression on the difference; distance of its slope from 0 or 1, in sigmas and because constant
#: errors are part of the difference, that is still one of them; ratio of mean squares by which an IMU is much smoother.
_FEWEST, _SIGMAS, _SLOPE, _SMOOTHER = 20, 3.0, 0.1, 4.0
TRIADS = {"force": "specific_force", "rate": "angular_rate"}


@dataclass(frozen=True)
class _Delays:
    """By how much the force and the rate of the checked IMU are late, and one sigma, (2,) arrays, s."""

    value: Array
    sigma: Array


def disagreements(reference: ImuRecord, checked: ImuRecord, end: float, probability: float) -> list[SampleFinding]:
    """Stretches over which two IMUs differ by more than constant errors explain.

    Parameters
    ----------
    reference, checked : ImuRecord
        Records in body axes; NaN where samples are lost.
    end : float
        End of the time over which the vehicle is rigid, s: the parachute.
    probability : float
        With which two sound IMUs may disagree in a flight.

    Returns
    -------
    list of SampleFinding
        Of the reference: one for each run of samples of each triad; if there is none, one of kind ``delay`` where force
        and rate have different delays.
    """
    findings = []
    pairs = comparable_records(reference, checked), comparable_records(checked, reference)
    both = [(records[0], *_significant(*records, end, probability)) for records in pairs]
    for triad in TRIADS:
        record, rows = max(
            ((record, significant[triad]) for record, significant, _ in both),
            key=lambda option: np.count_nonzero(option[1]),
        )
        findings += [
            SampleFinding(
                reference.name,
                triad,
                float(record.time[a] - record.interval[a]),
                float(record.time[b - 1]),
                b - a,
                "disagreement",
            )
            for a, b in runs(rows)
        ]
    start, stop = max(reference.start, checked.start), float(min(reference.time[-1], checked.time[-1], end))
    whole = min(end, reference.time[-1]) - reference.start
    if not findings and stop - start > _LATE_SHARE * whole and _differ(both[0][2], both[1][2], both[0][0]):
        force, rate = (f"{abs(d):.3f} s {'later' if d > 0.0 else 'earlier'}" for d in both[0][2].value)
        words = f"{checked.name} reads the force {force} and the rate {rate} than {reference.name}"
        findings.append(SampleFinding(reference.name, "all", start, stop, 0, "delay", f"{words}; kept"))
    return findings


def _significant(
    reference: ImuRecord, checked: ImuRecord, end: float, probability: float
) -> tuple[dict[str, BoolArray], _Delays]:
    """Samples (N,) of each triad of the reference with a significant parity; delays of force and rate."""
    pair = pair_of(reference, checked, end)
    if np.count_nonzero(pair.usable) < FEWEST_SAMPLES:
        return {triad: np.zeros(len(reference), bool) for triad in TRIADS}, _Delays(np.zeros(2), np.full(2, np.inf))
    rate, delay = _consensus(pair, "rate", 0.0, probability)
    force, force_delay = _consensus(pair, "force", 0.0, probability)
    if force.any():  # forces and rates may have delays of their own
        force, force_delay = min(
            ((force, force_delay), _consensus(pair, "force", delay, probability)),
            key=lambda option: np.count_nonzero(option[0]),
        )
    sigma = [parity_of(pair, *fit).delay_sigma for fit in (("force", ~force, force_delay), ("rate", ~rate, delay))]
    return {"force": force, "rate": rate}, _Delays(np.array([force_delay, delay]), np.array(sigma))


def _differ(first: _Delays, second: _Delays, record: ImuRecord) -> bool:
    """Whether force and rate have different delays, by estimates with each IMU as the reference of the other one.

    An error that is not linear in the motion resembles a delay, by which the two estimates differ. `record` has the
    samples of the comparison.
    """
    apart = float(first.value[0] - first.value[1]), float(second.value[1] - second.value[0])
    sigma = max(float(np.hypot(*delays.sigma)) for delays in (first, second))
    least = max(LATE * float(np.median(record.interval)), _LATE_SIGMAS * sigma)
    return apart[0] * apart[1] > 0.0 and min(map(abs, apart)) > least


def independent_error(
    reference: ImuRecord, checked: ImuRecord, findings: list[SampleFinding], end: float
) -> dict[str, float]:
    """Evidence for each of two IMUs that it alone has the difference of the two where they disagree, nats.

    An error that does not depend on the motion (noise, bit errors, the step at which a fault begins) adds the
    difference of the two to the IMU that has it, and nothing to the other one. Of what the neighbours of each sample do
    not predict (cubic interpolation), the regression of an IMU on the difference has the slope 1 for the IMU at fault
    and 0 for the other one. It is 1/2 for late readings, and anything else for a scale error or other axes, of which
    this is no evidence. The IMU without the error must still measure the motion: it is not much smoother than next to
    the stretch.

    Parameters
    ----------
    reference, checked : ImuRecord
        Records in body axes.
    findings : list of SampleFinding
        Of `disagreements`.
    end : float
        End of the comparison, s.

    Returns
    -------
    dict
        Name of each IMU → sum of the log likelihood ratio of the slopes 1 and 0 over the stretches in which this IMU
        has the error; zero if there are none.
    """
    names = reference.name, checked.name
    evidence = dict.fromkeys(names, 0.0)
    reference, checked = comparable_records(reference, checked)
    pair = pair_of(reference, checked, end)
    agreed = pair.usable & ~_within(reference.time, findings)
    delay = parity_of(pair, "rate", agreed, 0.0).delay
    edges = reference.edges + delay
    used = pair.usable & covered(checked, edges)
    used &= np.append(np.zeros(2, bool), used[:-2]) & np.append(used[2:], np.zeros(2, bool))
    readings = means_between(pair.integral, edges)
    for finding in findings:
        both = (pair.force, readings[0]) if finding.channel == "force" else (pair.rate, readings[1])
        values = [interpolation_error(v) for v in both]
        inside, adjoining = used & _within(reference.time, [finding]), used & _adjoining(reference, finding)
        if not inside.any() or not adjoining.any():
            continue
        slope, sigma = _slope(values[0][inside], (values[0] - values[1])[inside])
        at_fault = 0 if slope > 0.5 else 1
        sound = values[1 - at_fault]
        fits = abs(slope - (1 - at_fault)) <= max(_SIGMAS * sigma, _SLOPE)
        if not fits or _mean_square(sound[inside]) * _SMOOTHER < _mean_square(sound[adjoining]):
            continue
        evidence[names[at_fault]] += abs(slope - 0.5) / sigma**2
    return evidence


def _within(time: Array, findings: list[SampleFinding]) -> BoolArray:
    return np.any([(time > f.start) & (time <= f.end) for f in findings], axis=0)


def _adjoining(record: ImuRecord, finding: SampleFinding) -> BoolArray:
    """Samples (N,) in two windows before and two after a stretch."""
    before = (record.time > finding.start - 2.0 * WINDOW) & (record.time <= finding.start)
    return before | ((record.time > finding.end) & (record.time <= finding.end + 2.0 * WINDOW))


def _mean_square(values: Array) -> float:
    return float(np.mean(values**2))


def _slope(values: Array, regressor: Array) -> tuple[float, float]:
    """Regression of (n, 3) on (n, 3) without a constant, and its sigma.

    The larger one of the sigmas for residuals of one variance and of any variance (White 1980, Econometrica 48, 817): a
    single large difference, as at the start of a fault, determines the slope and has no residual.
    """
    square = float(np.sum(regressor**2))
    if len(values) < _FEWEST or square == 0.0:
        return 0.5, np.inf  # no evidence
    slope = float(np.sum(values * regressor)) / square
    residual = values - slope * regressor
    scores = np.sum(residual * regressor, axis=1)
    return slope, float(np.sqrt(max(np.sum(scores**2), _mean_square(residual) * square))) / square


def _consensus(pair: Pair, triad: str, delay: float, probability: float) -> tuple[BoolArray, float]:
    """Samples (N,) with a significant parity, by the regression with which the fewest have one, and its delay, s."""
    best = _iterated_consensus(pair, triad, pair.usable, delay, probability)
    if not best[0].any():
        return best
    for rows in _starts(pair.usable):
        significant, own_delay = _iterated_consensus(pair, triad, rows, delay, probability)
        if np.count_nonzero(significant) < np.count_nonzero(best[0]):
            best = significant, own_delay
    return best


def _starts(usable: BoolArray) -> Iterator[BoolArray]:
    """Parts of the flight from which a consensus set is grown."""
    for rows in np.array_split(np.flatnonzero(usable), _STARTS):
        selected = np.zeros(len(usable), bool)
        selected[rows] = True
        yield selected


def _iterated_consensus(
    pair: Pair, triad: str, rows: BoolArray, delay: float, probability: float
) -> tuple[BoolArray, float]:
    """Samples (N,) that disagree with a regression on the others, beginning with some rows (N,), and its delay, s."""
    significant = np.zeros(len(rows), bool)
    for iteration in range(_CONSENSUS):
        parity = parity_of(pair, triad, rows, delay)
        delay, before = parity.delay, significant
        significant = _in_windows(parity, pair, probability)
        rows = pair.usable & ~significant
        if np.count_nonzero(rows) < FEWEST_SAMPLES or (iteration and np.array_equal(significant, before)):
            break
    return significant, delay


def _in_windows(parity: Parity, pair: Pair, probability: float) -> BoolArray:
    """Samples (N,) in a window of which the median of the squares, or the mean of the parity, is significant.

    A median or a mean exceeds its limit where most of its window does: all of the window may be wrong. The mean is that
    of the samples that no median marks. In it the noise averages out, and the errors that vary in flight do not.
    """
    reference = pair.reference
    significant = np.zeros(len(reference), bool)
    square = parity.square
    known = np.flatnonzero(np.isfinite(square))
    size = _samples(reference, WINDOW)
    median = np.asarray(median_filter(square[known], size=size, mode="mirror"), float)
    bad = median > _limit(probability, size, len(known))
    significant[known] = maximum_filter1d(bad.astype(np.int8), size, mode="nearest") > 0
    known = np.flatnonzero(np.isfinite(square) & ~significant)
    size = _samples(reference, _LONG_WINDOW)
    if len(known) < size:
        return significant
    mean, noise, varying, attenuation = (
        uniform_filter1d(values[known], size, axis=0, mode="mirror")
        for values in (parity.value, parity.noise, parity.varying, parity.attenuation)
    )
    square = np.sum(mean**2 / (noise / size + varying + attenuation**2), axis=1)
    bad = square > _limit(probability, size, len(known))
    significant[known] |= maximum_filter1d(bad.astype(np.int8), size, mode="nearest") > 0
    return significant


def _samples(record: ImuRecord, window: float) -> int:
    """Odd number of samples of a window, s."""
    return 2 * round(0.5 * window / float(np.median(record.interval))) + 1


def _limit(probability: float, size: int, count: int) -> float:
    """Limit of a square with three degrees of freedom in each of the windows of a flight of `count` samples.

    The samples of a window may be correlated, at worst completely: then their median is one of them.
    """
    return float(chdtri(3, probability / max(1.0, count / size)))
