"""Stretches in which the readings of an IMU have more noise than before and after them, and no other IMU reads.

Input: a record in body axes. Method: what the cubic through its four neighbours does not predict of a sample is noise,
as far as the motion is smooth. Its level is the running median of the magnitude of this difference, which single
spikes and jumps do not change. The motion, a structure that shakes or a wake that buffets raises it over many seconds;
a level that is several times higher than within some seconds before and after it is noise of the IMU.
Output: the record with the sigma of these readings in `force_fill_sigma` and `rate_fill_sigma`, and the findings. The
readings are kept: where no other IMU has the samples, noisy ones are better than filled ones. Independent errors of the
samples are assumed.

Where another IMU reads, their difference shows the noise (`disagreement`), and the samples are those of the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from edl_filter.estimation.series import finite_rows, runs
from edl_filter.telemetry.record import ImuRecord, SampleFinding
from edl_filter.telemetry.resampling import covered
from edl_filter.telemetry.sample_checks import findings_of, interpolation_error, with_repair
from edl_filter.types import Array

#: Kind of the findings.
KIND = "noise"
#: Samples of the running median, which is the shortest stretch: a thruster that fires for a second leaves fewer that
#: are not predicted; and samples before and after with which the level is compared.
_WINDOW, _AROUND = 17, 32
#: Ratio of the level to the levels around from which on it is noise of the IMU, and the least level around that is
#: assumed, in stated sigmas.
_RATIO, _LEAST = 4.0, 3.0
#: Sigma of what the cubic does not predict of a sample, over that of independent errors: its weights are -1/6, 2/3,
#: 2/3 and -1/6.
_GAIN = float(np.sqrt(1.0 + 2.0 * (4.0**2 + 1.0) / 6.0**2))
_TRIADS = {"force": "specific_force", "rate": "angular_rate"}


def with_noise_of_stretches(
    record: ImuRecord, until: float, others: Sequence[ImuRecord] = ()
) -> tuple[ImuRecord, list[SampleFinding]]:
    """A record with the sigma of the readings that have more noise than those around.

    Parameters
    ----------
    record : ImuRecord
        Body axes; NaN where samples are lost.
    until : float
        Time up to which the motion is smooth, s.
    others : sequence of ImuRecord
        Stretches of which one of these reads more than half are left as they are.

    Returns
    -------
    record : ImuRecord
        The same object if there are no such readings.
    findings : list of SampleFinding
    """
    findings: list[SampleFinding] = []
    read_by_others = np.any([covered(other, record.edges) for other in others], axis=0) if others else None
    for triad, attribute in _TRIADS.items():
        values, noise = getattr(record, attribute), getattr(record, f"{triad}_noise")
        error = interpolation_error(values)  # NaN next to lost samples
        rows = np.flatnonzero(finite_rows(error))
        smooth = int(np.count_nonzero(record.time[rows] <= until))
        if smooth < 3 * _AROUND:
            continue
        difference = error[rows]
        noisy = np.zeros(len(record), bool)
        sigma = np.zeros((len(record), 3))
        for a, b in _noisy(np.linalg.norm(difference, axis=1), _LEAST * noise[rows], smooth):
            stretch = slice(int(rows[a]), int(rows[b - 1]) + 1)
            if read_by_others is not None and np.mean(read_by_others[stretch]) > 0.5:
                continue
            total = np.sqrt(np.mean(difference[a : min(b, smooth)] ** 2, axis=0)) / _GAIN
            sigma[stretch] = np.sqrt(np.maximum(total**2 - noise[stretch, None] ** 2, 0.0))
            noisy[stretch] = finite_rows(values[stretch])
        sigma[~noisy] = 0.0
        if noisy.any():
            interval = float(np.median(record.interval))
            for finding in findings_of(record.name, triad, KIND, noisy, record.time, interval):
                inside = (record.time > finding.start) & (record.time <= finding.end)
                size = float(np.max(sigma[inside] / noise[inside, None]))
                findings.append(with_repair(finding, f"kept with {size:.0f} times the stated sigma"))
            changed: dict[str, Any] = {f"{triad}_fill_sigma": np.hypot(getattr(record, f"{triad}_fill_sigma"), sigma)}
            record = replace(record, **changed)
    return record, findings


def _noisy(size: Array, least: Array, smooth: int) -> list[tuple[int, int]]:
    """First sample and end of the stretches with a level that is higher than those before and after.

    The longest of the stretches that overlap is taken: thresholds are tried from the lowest one up. It ends where the
    level becomes less than half of its own, also after the smooth motion.

    Parameters
    ----------
    size : (N,) array
        Magnitude of what is not predicted.
    least : (N,) array
        Least level around a stretch that is assumed, in the same unit.
    smooth : int
        Number of samples while the motion is smooth, in which stretches begin.
    """
    every = median_filter(size, size=_WINDOW, mode="nearest")
    level = median_filter(size[:smooth], size=_WINDOW, mode="nearest")
    stretches: list[tuple[int, int]] = []
    threshold, highest = _RATIO * float(np.min(least[:smooth])), float(np.max(level))
    while threshold <= highest:
        for a, b in runs(np.asarray(level > threshold, np.bool_)):
            if b - a < _WINDOW or any(a < d and c < b for c, d in stretches):
                continue
            if _contrast(level, least, a, b) > _RATIO:
                half = 0.5 * np.median(level[a:b])
                inside = a + np.flatnonzero(level[a:b] > half)
                first, end = max(int(inside[0]) - 1, 0), min(int(inside[-1]) + 2, smooth)
                if end == smooth:
                    end += int(np.argmax(np.append(every[smooth:] < half, True)))
                stretches.append((first, end))
        threshold *= 2.0**0.5
    return sorted(stretches)


def _contrast(level: Array, least: Array, a: int, b: int) -> float:
    """Smaller ratio, of both ends of a stretch, of the level within to the highest level outside.

    Levels whose running median contains samples of both sides are not used. A stretch at an end of the record has one
    end only.
    """
    half = _WINDOW // 2
    inside = (level[a : min(a + _WINDOW, b)], level[max(b - _WINDOW, a) : b])
    outside = (level[max(a - half - _AROUND, 0) : max(a - half, 0)], level[b + half : b + half + _AROUND])
    floor = float(np.max(least[a:b]))
    return min(
        (float(np.median(i)) / max(float(np.max(o)), floor) for i, o in zip(inside, outside, strict=True) if len(o)),
        default=0.0,
    )
