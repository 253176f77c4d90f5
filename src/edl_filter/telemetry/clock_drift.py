"""Clock of an IMU that runs at a wrong rate: recognised from its steps in time, and decided by another IMU's rates.

Input: records whose stated sampling interval is known. Where the steps in time add up to another length than the same
number of stated intervals, either the times or the stated interval are wrong. Two IMUs of one vehicle have one angular
rate: of the times as they are and those by counting intervals, that pair is used with which the rates agree. A single
IMU does not show which is wrong: the times stay, and the scale errors of the IMU are uncertain by the ratio of the two.
Output: records with corrected times or uncertainties, and findings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from edl_filter.estimation.series import ROBUST_SIGMA, finite_rows
from edl_filter.imu_model.lever_arm import mean_derivative
from edl_filter.telemetry.record import ImuRecord, SampleFinding
from edl_filter.telemetry.relative_calibration import FEWEST_SAMPLES
from edl_filter.telemetry.resampling import covered, means_between, readings_integral
from edl_filter.types import Array

#: Least ratio of a drift, and least difference that it adds up to (s): less is the accuracy of stated intervals.
_LEAST_DRIFT, _LEAST_DIFFERENCE = 3e-5, 2e-3
#: Steps in time within this ratio of the stated interval are one sample; a longer step is a gap and stays.
_STEP = 0.1
#: Scatter of the difference in rates, relative to that with the times as they are, with which others are used.
_BETTER = 0.7
#: Sigmas and ratio beyond which two IMUs drift against each other although the steps of both are right.
_SIGNIFICANT, _RELATIVE_DRIFT = 6.0, 3e-4
#: Passes of a regression without outliers, or with another drift, and the robust sigmas beyond which a sample is one.
_PASSES, _OUTLIER = 3, 6.0


@dataclass(frozen=True)
class _Agreement:
    """Agreement of two IMUs' rates.

    Attributes
    ----------
    scatter : float
        RMS of the difference with constant delay, bias and alignment, rad/s.
    delay, delay_sigma : float
        By how much the first IMU's times are late in the mean, s.
    drift, drift_sigma : float
        Increase of the delay per time.
    """

    scatter: float
    delay: float
    delay_sigma: float
    drift: float
    drift_sigma: float


def without_drift(records: list[ImuRecord], end: float) -> tuple[list[ImuRecord], list[SampleFinding]]:
    """Records with the times of their clocks corrected.

    Parameters
    ----------
    records : list of ImuRecord
        Driving record first, body axes. One without `ImuRecord.stated_interval` is not examined.
    end : float
        End of the time over which rates are compared, s: the parachute.

    Returns
    -------
    records : list of ImuRecord
    findings : list of SampleFinding
    """
    ratios = [drift_ratio(record) for record in records]
    if len(records) == 1:
        return _with_uncertain_scales(records[0], ratios[0])
    first, second = records[:2]
    if np.isnan(first.stated_interval) or np.isnan(second.stated_interval):
        return records, []
    choices = [(r, counted(r)) if ratio else (r,) for r, ratio in zip((first, second), ratios, strict=False)]
    agreements = {}
    for i, j in product(*(range(len(c)) for c in choices)):
        agreement = _agreement(choices[0][i], choices[1][j], end)
        if agreement is None:
            return records, []
        agreements[i, j] = agreement
    best = min(agreements, key=lambda key: agreements[key].scatter)
    if agreements[best].scatter > _BETTER * agreements[0, 0].scatter:
        best = 0, 0
    agreement, chosen = agreements[best], [choices[0][best[0]], choices[1][best[1]]]
    findings = [
        _finding(r, ratio, "times counted in sampling intervals, which agrees with the other IMU's rates")
        for r, ratio, k in zip(chosen, ratios, best, strict=False)
        if k
    ]
    if sum(best) == 1 and abs(agreement.delay) > _SIGNIFICANT * agreement.delay_sigma:
        k = best.index(1)  # the first sample's time was wrong, too
        chosen[k] = replace(chosen[k], time=chosen[k].time + (agreement.delay if k else -agreement.delay))
    significant = abs(agreement.drift) > max(_RELATIVE_DRIFT, _SIGNIFICANT * agreement.drift_sigma)
    if significant:
        repair = f"not corrected: against {second.name}, and the steps in time do not show which of the two is wrong"
        findings.append(_finding(first, agreement.drift, repair))
    return [*chosen, *records[2:]], findings


def without_relative_drift(record: ImuRecord, reference: ImuRecord, end: float) -> ImuRecord:
    """The record with its times divided by the ratio with which its rates drift from those of another IMU.

    The regression is linear in the drift: over the flight it must add up to less than a period of the rates.

    Parameters
    ----------
    record, reference : ImuRecord
        Body axes.
    end : float
        End of the time over which rates are compared, s.

    Returns
    -------
    ImuRecord
        With the start of the given one; the given one with too few common samples.
    """
    for _ in range(_PASSES):
        agreement = _agreement(record, reference, end)
        if agreement is None:
            break
        interval = record.interval * (1.0 - agreement.drift)
        record = replace(record, time=record.start + np.cumsum(interval), interval=interval)
    return record


def drift_ratio(record: ImuRecord) -> float:
    """Ratio by which a record's times are faster than its number of stated intervals; 0 if that is insignificant."""
    if np.isnan(record.stated_interval):
        return 0.0
    ratio = float(np.median(record.interval[1:]) / record.stated_interval - 1.0)
    total = float(record.time[-1] - counted(record).time[-1])
    duration = float(record.time[-1] - record.start)
    if abs(total) < _LEAST_DIFFERENCE + _LEAST_DRIFT * duration:
        return 0.0
    return ratio if abs(ratio) > _LEAST_DRIFT else total / duration


def counted(record: ImuRecord) -> ImuRecord:
    """The record with every step that is about one sampling interval replaced by the stated one."""
    single_step = np.abs(record.interval / record.stated_interval - 1.0) < _STEP
    interval = np.where(single_step, record.stated_interval, record.interval)
    return replace(record, time=record.start + np.cumsum(interval), interval=interval)


def _with_uncertain_scales(record: ImuRecord, ratio: float) -> tuple[list[ImuRecord], list[SampleFinding]]:
    """The record with scale errors that are uncertain by the drift."""
    if not ratio:
        return [record], []
    errors = tuple(
        replace(
            e,
            accelerometer_scale=float(np.hypot(e.accelerometer_scale, ratio)),
            gyro_scale=float(np.hypot(e.gyro_scale, ratio)),
        )
        for e in record.errors
    )
    repair = "times used as they are; the scale errors of accelerometers and gyros are uncertain by as much"
    return [replace(record, errors=errors)], [_finding(record, ratio, repair)]


def _finding(record: ImuRecord, ratio: float, repair: str) -> SampleFinding:
    text = f"{1e6 * ratio:+.0f} ppm, {repair}"
    return SampleFinding(record.name, "all", record.start, float(record.time[-1]), len(record), "clock_drift", text)


def _agreement(record: ImuRecord, reference: ImuRecord, end: float) -> _Agreement | None:
    """Regression of the difference between two IMUs' rates; None with too few common samples."""
    edges = record.edges
    used = covered(reference, edges) & finite_rows(record.angular_rate) & (record.time <= end)
    if used.sum() < FEWEST_SAMPLES:
        return None
    (rate,) = means_between(readings_integral(reference, reference.angular_rate), edges)
    change = mean_derivative(record.interval, rate)
    middle = record.middle[used]
    design = _design(rate[used], change[used], middle - middle.mean())
    difference = (record.angular_rate - rate)[used]
    kept = np.ones(len(difference), bool)
    for _ in range(_PASSES):
        constant = _least_squares(design[kept][:, :, :-1], difference[kept])[0]
        residual = np.linalg.norm(difference - design[:, :, :-1] @ constant, axis=1)
        kept = residual <= _OUTLIER * ROBUST_SIGMA * np.median(residual)
    scatter = float(np.sqrt(np.mean(residual[kept] ** 2) / 3.0))
    values, sigma = _least_squares(design[kept], difference[kept])
    return _Agreement(scatter, float(values[-2]), float(sigma[-2]), float(values[-1]), float(sigma[-1]))


def _design(rate: Array, change: Array, time: Array) -> Array:
    """Derivatives (n, 3, 8) of the difference in rates by bias, alignment, delay and drift."""
    rotation = np.stack([np.cross(rate, axis) for axis in np.eye(3)], axis=-1)
    bias = np.tile(np.eye(3), (len(rate), 1, 1))
    return np.concatenate((bias, rotation, -change[:, :, None], -(time[:, None] * change)[:, :, None]), axis=2)


def _least_squares(design: Array, difference: Array) -> tuple[Array, Array]:
    """Estimates and sigmas (P,) from (n, 3, P) and (n, 3)."""
    rows = design.reshape(-1, design.shape[-1])
    size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    inverse = np.linalg.pinv((rows / size).T @ (rows / size), hermitian=True)
    values = inverse @ ((rows / size).T @ difference.ravel())
    residual = difference.ravel() - rows / size @ values
    return values / size, np.std(residual) * np.sqrt(np.diag(inverse)) / size
