"""Samples that jump beyond what their neighbours and the other IMU allow.

Input: records of one or two IMUs in body axes. A shock is seen by both IMUs of a rigid vehicle; a bad sample by one.
Method: with two IMUs, the difference between one and the other transferred to it is compared with its robust scale
nearby; the IMU at fault is the one that leaves its own neighbours by as much, while the other one does not. With one
IMU, and only while no parachute can shake the vehicle, a single sample that its four neighbours do not predict (cubic
interpolation) although they predict each other, and after which the signal is as before it, so that it is no step; near
lost samples, one that the nearest known ones do not predict; and a burst: a few samples that jump from those before and
after by several times what these vary by, and by more than thrusters do. Neither of the last two is tested if no
parachute's time is known. Output: records with NaN in these samples, and the findings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, percentile_filter

from edl_filter.estimation.series import ROBUST_SIGMA, finite_rows, runs
from edl_filter.telemetry.record import ImuRecord, SampleFinding
from edl_filter.telemetry.resampling import samples_less_often
from edl_filter.telemetry.sample_checks import CheckSettings, findings_of, interpolation_error
from edl_filter.telemetry.transfer import transferred
from edl_filter.types import Array, BoolArray, IntArray

#: Samples of the running medians: of a signal's neighbourhood, and of its scale.
_NEIGHBOURHOOD, _SCALE = 25, 81
#: Samples around a difference in which the IMU that is not at fault runs smoothly.
_SMOOTH = 5
#: Passes: bad samples of the first one that no IMU alone shows falsify the calibration of one IMU against the other.
_PASSES = 2
#: Share of a difference by which the IMU at fault leaves its neighbours, and by which the other one does not.
_AT_FAULT, _NOT_AT_FAULT = 0.6, 0.2
#: Least difference between two IMUs that counts, relative to the size of the signal around it.
_RELATIVE = 0.02
#: Largest number of samples of a burst, less than half of a neighbourhood, and the number of samples within it, or
#: between two spikes that another IMU shows and next to a run of those, that are not marked by themselves.
_LONGEST_BURST, _SOUND_IN_BURST = 12, 2
#: Percentile of the departures from the running median that is taken for their natural size, the multiple of it by
#: which a burst departs, and by how much more: force (m/s²; the attitude thrusters of entry vehicles give less than 1)
#: and rate (rad/s). The share of its departure by which its first and last sample jump.
_NATURAL, _BURST_RATIO, _LEAST_BURST, _JUMP = 80.0, 5.0, {"force": 2.0, "rate": 0.1}, 0.5
#: Samples from a lost one within which another is tested by the nearest known ones, how often, since each that is bad
#: falsifies its neighbours' predictions, and the share of a burst's least departure from which on it counts: a thruster
#: that begins or ends leaves half of its force. On the rovers and ten other flights, with gaps of 1 to 8 samples at
#: 18 000 places, departures of more than 15 sigmas are at most 0.28 m/s² and 0.013 rad/s.
_NEAR, _REPETITIONS, _LEAST_SHARE = 4, 4, 0.5
#: Change of the signal across a sample, over the larger one of the changes before and after it, from which on the
#: sample is in a step and no spike.
_STEP = 0.5
#: Spikes in smooth motion from which an IMU has them in other motion too, and their least size there over the median
#: of those.
_SEVERAL, _SIMILAR = 3, 0.5
#: Known samples beyond which one does not affect the prediction of another.
_REACH = 4
_TRIADS = {"force": "specific_force", "rate": "angular_rate"}


def bad_triads(
    records: list[ImuRecord], settings: CheckSettings, smooth_until: float
) -> tuple[list[ImuRecord], list[SampleFinding]]:
    """Records with NaN in place of spikes, and the findings.

    Parameters
    ----------
    records : list of ImuRecord
        Driving record first, body axes.
    settings : CheckSettings
        Thresholds.
    smooth_until : float
        Time up to which the vehicle is rigid and its motion smooth, s.

    Returns
    -------
    records : list of ImuRecord
    findings : list of SampleFinding
    """
    findings: list[SampleFinding] = []
    as_read = list(records)
    for _ in range(_PASSES):
        records, more = _one_pass(list(records), as_read, settings, smooth_until)
        findings += more
        if not more:
            break
    return records, findings


def _one_pass(
    records: list[ImuRecord], as_read: list[ImuRecord], settings: CheckSettings, smooth_until: float
) -> tuple[list[ImuRecord], list[SampleFinding]]:
    """Records without the bad samples that one pass marks, and its findings; `as_read` is before the first pass."""
    originals, findings = list(records), []
    alone = [{triad: _marked_alone(record, triad, settings, smooth_until) for triad in _TRIADS} for record in originals]
    sound = [_without(record, kinds) for record, kinds in zip(originals, alone, strict=True)]
    for i, record in enumerate(originals):
        others = (k for k, r in enumerate(originals) if k != i and not samples_less_often(r, record))
        second = next(others, None)
        source = None
        if second is not None:
            source = transferred(record, originals[second], smooth_until, (sound[i], sound[second]))
        for triad, attribute in _TRIADS.items():
            values, kinds = getattr(record, attribute), alone[i][triad]
            noise = record.force_noise if triad == "force" else record.rate_noise
            if source is not None:
                covered = finite_rows(getattr(source, triad))
                parted = _disagreement(values, getattr(source, triad), noise, settings.disagreement_sigmas)
                kinds = {kind: bad & ~covered for kind, bad in kinds.items()}
                known = finite_rows(values)
                earlier = finite_rows(getattr(as_read[i], attribute)) & ~known
                kinds["spike"] |= _closed(earlier | _joined(parted & covered)) & covered & known
            kinds["burst"] &= ~kinds["spike"]
            bad = (kinds["spike"] | kinds["burst"]) & _readings(record, triad)
            if bad.any():
                interval = float(np.median(record.interval))
                for kind, which in kinds.items():
                    findings += findings_of(record.name, triad, kind, which & bad, record.time, interval)
                lost: dict[str, Any] = {attribute: np.where(bad[:, None], np.nan, getattr(records[i], attribute))}
                records[i] = replace(records[i], **lost)
    return records, findings


def _marked_alone(record: ImuRecord, triad: str, settings: CheckSettings, smooth_until: float) -> dict[str, BoolArray]:
    """Samples (N,) of a triad that are spikes or in bursts by the record alone."""
    values = getattr(record, _TRIADS[triad])
    noise = record.force_noise if triad == "force" else record.rate_noise
    single = _single_spikes(values, noise, settings.spike_sigmas)
    kinds = {"spike": _in_smooth_motion(single, values, record.time <= smooth_until)}
    kinds["burst"] = np.zeros(len(record), bool)
    if np.isfinite(smooth_until):
        rows, least = record.time <= smooth_until, _LEAST_BURST[triad]
        near = _spikes_near_lost(values[rows], noise[rows], settings.spike_sigmas, _LEAST_SHARE * least)
        kinds["spike"][rows] |= near
        kinds["burst"][rows] = _bursts(values[rows], least)
    return kinds


def _without(record: ImuRecord, marked: dict[str, dict[str, BoolArray]]) -> ImuRecord:
    """The record without marked samples, which would falsify its calibration against another IMU."""
    changed: dict[str, Any] = {}
    for triad, kinds in marked.items():
        bad = kinds["spike"] | kinds["burst"]
        if bad.any():
            values = getattr(record, _TRIADS[triad])
            changed[_TRIADS[triad]] = np.where(bad[:, None], np.nan, values)
    return replace(record, **changed) if changed else record


def _joined(bad: BoolArray) -> BoolArray:
    """Bad samples (N,) with the few between two of them, and the few next to a run of more than `_SMOOTH`.

    No test can show these, whose neighbours are bad, to be sound.
    """
    out = _closed(bad)
    for a, b in runs(out):
        if b - a > _SMOOTH:
            out[max(a - _SOUND_IN_BURST, 0) : b + _SOUND_IN_BURST] = True
    return _closed(out)


def _closed(bad: BoolArray) -> BoolArray:
    """Bad samples (N,) with those in gaps of at most `_SOUND_IN_BURST` between two of them."""
    out = bad.copy()
    for a, b in runs(~bad):
        out[a:b] = a > 0 and b < len(bad) and b - a <= _SOUND_IN_BURST
    return out


def _readings(record: ImuRecord, triad: str) -> BoolArray:
    """Samples (N,) that are direct readings of the triad."""
    return ~record.sculling_corrected if triad == "force" else ~record.coning_corrected


def _disagreement(own: Array, transferred_values: Array, noise: Array, sigmas: float) -> BoolArray:
    """Samples (N,) in which an IMU leaves its neighbours and another one, which does not."""
    difference = own - transferred_values
    known = finite_rows(difference)
    if known.sum() < _SCALE:
        return np.zeros(len(own), bool)
    out = np.zeros(len(own), bool)
    rows = np.flatnonzero(known)
    d, a, b = difference[rows], own[rows], transferred_values[rows]
    departure = d - _median(d, _SCALE)
    scale = ROBUST_SIGMA * _median(np.abs(departure), _SCALE) + noise[rows, None]
    size = np.linalg.norm(_median(a, _NEIGHBOURHOOD), axis=1)[:, None]
    large = (np.abs(departure) > sigmas * scale) & (np.abs(departure) > _RELATIVE * size)
    length = np.linalg.norm(departure, axis=1)
    own_jump = np.linalg.norm(a - _median(a, _NEIGHBOURHOOD), axis=1)
    transferred_jump = maximum_filter1d(np.linalg.norm(interpolation_error(b), axis=1), _SMOOTH)
    fault = (own_jump > _AT_FAULT * length) & (transferred_jump < _NOT_AT_FAULT * length)
    out[rows] = large.any(axis=1) & fault
    return out


def _single_spikes(values: Array, noise: Array, sigmas: float) -> BoolArray:
    """Single samples (N,) that their neighbours do not predict although they predict each other."""
    bad = np.zeros(len(values), bool)
    if len(values) < _SCALE:
        return bad
    finite = finite_rows(values)
    filled = np.where(finite[:, None], values, 0.0)
    error = interpolation_error(filled)
    scale = ROBUST_SIGMA * _median(np.abs(error), _SCALE) + noise[:, None]  # a quantised signal may repeat one value
    ratio = np.max(np.abs(error) / scale, axis=1)
    near = np.convolve(~finite, np.ones(9), mode="same") > 0.5
    for i in np.flatnonzero((ratio > sigmas) & ~near).tolist():
        around = slice(max(0, i - 4), i + 5)
        if ratio[i] < np.max(ratio[around]):
            continue
        without = filled[max(0, i - 8) : i + 9].copy()
        j = i - max(0, i - 8)
        without[j] -= error[i]
        remaining = np.max(np.abs(interpolation_error(without)) / scale[i], axis=1)
        predicted = np.all(remaining[max(0, j - 4) : j + 5] < max(5.0, 0.05 * ratio[i]))
        channel = int(np.argmax(np.abs(error[i]) / scale[i]))
        bad[i] = predicted and not _is_step(error[max(0, i - 4) : i + 5, channel], min(i, 4))
    return bad


def _is_step(error: Array, place: int) -> bool:
    """Whether what the neighbours do not predict is a step of the signal at a sample, and no spike.

    Parameters
    ----------
    error : (n,) array
        `interpolation_error` of one channel around the sample.
    place : int
        Index of the sample.
    """
    steps = np.zeros((len(error) + 8, 3))  # the columns of a triad; the ends of an interpolation are zero
    steps[place + 4 :, 0] = steps[place + 5 :, 1] = 1.0
    pattern = interpolation_error(steps)[4:-4, :2]
    (first, second), *_ = np.linalg.lstsq(pattern, error, rcond=None)
    return bool(abs(first + second) > _STEP * max(abs(first), abs(second)))


def _in_smooth_motion(spikes: BoolArray, values: Array, smooth: BoolArray) -> BoolArray:
    """Spikes (N,) while the motion is `smooth` (N,), and all of their size if there are several.

    A parachute may shake the vehicle for the time of one sample. An IMU with spikes before it has them under it too, of
    a similar size.
    """
    within = spikes & smooth
    if np.count_nonzero(within) < _SEVERAL:
        return within
    size = np.linalg.norm(interpolation_error(np.where(finite_rows(values)[:, None], values, 0.0)), axis=1)
    return within | (spikes & (size >= _SIMILAR * np.median(size[within])))


def _spikes_near_lost(values: Array, noise: Array, sigmas: float, least: float) -> BoolArray:
    """Samples (N,) near lost ones that the cubic through the two nearest known ones on each side does not predict.

    A bad sample falsifies the predictions of its neighbours. Of those that are not predicted, the one is bad without
    which the others are predicted best.
    """
    bad = np.zeros(len(values), bool)
    known = finite_rows(values)
    for _ in range(_REPETITIONS if not known.all() else 0):
        suspected = np.flatnonzero(_ratios_near_lost(values, known, noise, least) > sigmas)
        if not len(suspected):
            break
        rows, rank_of = np.flatnonzero(known), np.cumsum(known) - 1
        for group in np.split(suspected, np.flatnonzero(np.diff(rank_of[suspected]) > _REACH) + 1):
            first, last = (
                rows[np.clip(rank_of[k] + n, 0, len(rows) - 1)] for k, n in ((group[0], -_REACH), (group[-1], _REACH))
            )
            part = slice(max(0, first - _SCALE), last + _SCALE)
            remaining = []
            for k in group.tolist():
                without = known.copy()
                without[k] = False
                ratio = _ratios_near_lost(values[part], without[part], noise[part], least)
                remaining.append(float(np.max(ratio[first - part.start : last + 1 - part.start])))
            bad[group[np.argmin(remaining)]] = True
        known = known & ~bad
    return bad


def _ratios_near_lost(values: Array, known: BoolArray, noise: Array, least: float) -> Array:
    """Departures (N,) of samples near lost ones, in robust sigmas; zero where they are less than `least`."""
    ratio, rows = np.zeros(len(values)), np.flatnonzero(known)
    near = np.convolve(~known, np.ones(2 * _NEAR + 1), mode="same")[rows] > 0.5
    order = np.flatnonzero(near[2:-2]) + 2
    place, stencil = rows[order], rows[order[:, None] + np.array([-2, -1, 1, 2])] - rows[order][:, None]
    weight = _cubic_weights(stencil)
    error = values[place] - np.einsum("ij,ijk->ik", weight, values[place[:, None] + stencil])
    for k in np.flatnonzero(np.any(np.abs(error) > least, axis=1)).tolist():
        scale = _scale_of_stencil(values, known, place[k], stencil[k], weight[k]) + noise[place[k]]
        ratio[place[k]] = np.max(np.abs(error[k]) / scale)
    return ratio


def _cubic_weights(stencil: IntArray) -> Array:
    """Weights (M, 4) of values at the places (M, 4), in samples from the one that the cubic through them predicts."""
    weight = np.ones(stencil.shape)
    for i in range(4):
        for j in range(4):
            if i != j:
                weight[:, i] *= stencil[:, j] / (stencil[:, j] - stencil[:, i])
    return weight


def _scale_of_stencil(values: Array, known: BoolArray, place: int, stencil: IntArray, weight: Array) -> Array:
    """Robust sigma (3,) of what a stencil does not predict, over the samples around that have all its values."""
    reach = _SCALE // 2
    around = np.arange(max(-stencil[0], place - reach), min(len(values) - stencil[-1], place + reach + 1))
    around = around[(around != place) & known[around] & np.all(known[around[:, None] + stencil], axis=1)]
    if len(around) < reach // 2:
        return np.full(3, np.inf)
    error = values[around] - np.einsum("j,ijk->ik", weight, values[around[:, None] + stencil])
    return np.asarray(ROBUST_SIGMA * np.median(np.abs(error), axis=0))


def _bursts(values: Array, least: float) -> BoolArray:
    """Samples (N,) of short runs that jump from those around by several times what these vary by.

    The departure of a sample is that from the running median, whose window is more than twice as long as a run. It is
    compared with a percentile of the departures nearby: for a vehicle that oscillates, about the amplitude. On rovers,
    practice flights and 24 simulated flights no departure before the parachute exceeds 0.31 of the threshold. A smooth
    peak may: the first and the last sample of a run must also depart from the cubic through the two samples before and
    the two after it, by half as much.
    """
    out = np.zeros(len(values), bool)
    rows = np.flatnonzero(finite_rows(values))
    if len(rows) < _SCALE:
        return out
    v = values[rows]
    departure = np.abs(v - _median(v, _NEIGHBOURHOOD))
    natural = np.column_stack([percentile_filter(c, _NATURAL, _SCALE, mode="nearest") for c in departure.T])
    excess = departure > _BURST_RATIO * natural + least
    beyond = np.any(excess, axis=1)
    for a, b in runs(~beyond):
        if a > 0 and b < len(rows) and b - a <= _SOUND_IN_BURST:
            beyond[a:b] = True
    for a, b in runs(beyond):
        if b - a > _LONGEST_BURST or a < 2 or b + 2 > len(rows) or rows[b + 1] - rows[a - 2] > b - a + 3 + _NEAR:
            continue  # it does not adjoin known samples on both sides
        outside = np.array([a - 2, a - 1, b, b + 1])
        ends = np.array([a, b - 1])
        weight = _cubic_weights(rows[outside] - rows[ends][:, None])
        jump = np.abs(v[ends] - weight @ v[outside])
        out[rows[a:b]] = np.all(np.any(excess[ends] & (jump > _JUMP * departure[ends]), axis=1))
    return out


def _median(values: Array, size: int) -> Array:
    """Running median of each column."""
    columns = [median_filter(np.ascontiguousarray(column), size=size, mode="nearest") for column in values.T]
    return np.asarray(np.column_stack(columns), float)
