"""Step in which an IMU's readings are quantised, and what a coarse step means for its errors.

Input: readings in the axes of the IMU. Method: differences between neighbouring distinct values of a channel are
multiples of its step (`quantum`). A rounding error is uniform over a step: q/√12 in a reading. Where the remainder is
carried on, the errors of successive readings cancel; where it is not, a constant quantity is wrong by a constant. Which
of the two an IMU does is not known: its noise contains the former (q/√6, Widrow & Kollár 2008, Quantization Noise), its
bias the latter. Output: steps, and whether they exceed the stated noise.
"""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array

#: Percentile of the differences that is one step: single bad values cause smaller ones.
_PERCENTILE = 20.0
#: Share of differences that are multiples of the step, within this part of it.
_SHARE, _PART = 0.98, 0.05
#: Fewest distinct values of a channel from which its step is taken.
_FEWEST = 4


def quantum(readings: Array) -> float:
    """Step of a triad's readings: the largest of its channels'; 0 where the values are no multiples of a step.

    Parameters
    ----------
    readings : (N, 3) array
        Any unit; NaN where lost.
    """
    steps = [_step(np.unique(column[np.isfinite(column)])) for column in readings.T]
    return max(steps)


def _step(values: Array) -> float:
    """Step of the distinct, increasing values of a channel."""
    if len(values) < _FEWEST:
        return 0.0
    differences = np.diff(values)
    differences = differences[differences > 1e-9 * np.abs(values).max()]  # the same value, rounded otherwise
    if len(differences) < _FEWEST - 1:
        return 0.0
    step = float(np.percentile(differences, _PERCENTILE, method="lower"))
    number = differences / step
    multiple = np.abs(number - np.round(number)) < _PART
    return step if np.mean(multiple) >= _SHARE else 0.0


def coarse(step: float, noise: float) -> bool:
    """Whether the rounding error of a step exceeds the stated noise of a reading."""
    return step / np.sqrt(12.0) > noise


def noise_with_rounding(step: float, noise: float) -> float:
    """One sigma of a reading whose remainder is carried on to the next one."""
    return float(np.hypot(noise, step / np.sqrt(6.0)))


def bias_with_rounding(step: float, bias: float) -> float:
    """One sigma of the constant error of a constant quantity that is rounded."""
    return float(np.hypot(bias, step / np.sqrt(12.0)))
