"""Times of packets that scatter about a steady clock: rounded, or those of arrival.

Input: times as they are stored. An IMU samples by an oscillator; stamps that scatter about its counts by less than one
sampling interval are errors of the stamps. Method: regression of the times on the count. Errors of single stamps are
independent, so that the mean square of their successive differences is twice that of themselves (von Neumann 1941,
Annals of Mathematical Statistics 12, 367); a clock that jumps or drifts has errors that hardly differ between
neighbours. Output: times of the regression.
"""

from __future__ import annotations

import numpy as np

from edl_filter.telemetry.record import SampleFinding
from edl_filter.types import Array

#: Scatter about the regression, in sampling intervals: at least the root mean square, at most the largest one.
_LEAST_SCATTER, _LARGEST = 0.02, 1.01
#: Least ratio of the mean square successive difference to the mean square: 2 for independent errors, 0 for a drift. Its
#: standard deviation is 2/√N with N samples.
_LEAST_RATIO = 1.0
#: Largest relative difference between the interval of the regression and the stated one.
_INTERVAL = 0.05
#: Fewest samples.
_FEWEST = 100


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
        repair = f"stamps scatter by {1e3 * np.sqrt(square):.2g} ms about a steady clock, whose times are used"
        finding = SampleFinding(imu, "all", float(time[0]) - interval, float(time[-1]), len(time), "jitter", repair)
        return time.mean() + slope * centred, [finding]
    return time, []
