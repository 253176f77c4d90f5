"""Smoothed forces and rates, and the angular acceleration for Euler's equations (thesis section 3.2).

A second-order polynomial over batches of one length in time, the thesis's 7 points at 8 Hz; the smoothed rates are
differenced and the differences smoothed again. A model that is to be compared passes through the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError
from edl_filter.telemetry.smoothing import batch_polynomial, batch_polynomial_bandwidth, differentiated_rates

Array = NDArray[np.float64]

#: 7 points at 8 Hz, s (thesis section 3.2).
BATCH = 0.875
_ORDER = 2
#: Fewer points would let a second-order polynomial through every sample.
_LEAST_POINTS = 5
#: Samples whose median interval says how fast the telemetry runs.
_NEIGHBOURS = 11
#: Batches up to this many points have their noise gains computed exactly.
_LONGEST_EXACT = 45


@dataclass(frozen=True)
class Smoother:
    """Smoothing chosen for one series of samples.

    Attributes
    ----------
    time : (N,) array
        When each sample holds (the middle of its interval), s.
    points : (N,) integer array
        Batch around each sample.
    bandwidth, acceleration_bandwidth : dict
        Points → -3 dB frequency, Hz, of one pass and of the angular acceleration's two passes.
    gain, acceleration_gain : (N,) arrays
        One sigma of a smoothed value per one sigma of a white sample; of the angular acceleration, 1/s.
    """

    time: Array
    points: NDArray[np.int64]
    bandwidth: dict[int, float]
    acceleration_bandwidth: dict[int, float]
    gain: Array
    acceleration_gain: Array

    def smooth(self, values: Array) -> Array:
        """Values ``(N,)`` or ``(N, K)`` through the batch polynomial."""
        return self._by_points(lambda p: batch_polynomial(self.time, values, p, _ORDER))

    def differentiate(self, values: Array) -> Array:
        """Time derivative of ``(N, K)`` values: smoothed, differenced, smoothed again."""
        smooth = self.smooth(values)
        return self._by_points(
            lambda p: differentiated_rates(self.time, smooth, lambda t, v: batch_polynomial(t, v, p, _ORDER))
        )

    def smoothed_sigma(self, sample: Array) -> Array:
        """One sigma ``(N,)`` of smoothed values from one sigma of each sample, which need not be the same for all."""
        return self.gain * self._around(sample, self.points // 2)

    def acceleration_sigma(self, sample: Array) -> Array:
        """One sigma ``(N,)`` of `differentiate` from one sigma of each sample: two batches and a difference reach."""
        return self.acceleration_gain * self._around(sample, 2 * (self.points // 2) + 1)

    def _around(self, sample: Array, reach: NDArray[np.int64]) -> Array:
        """Root of the mean variance of the samples within `reach` of each: what a batch mixes."""
        total = np.concatenate(([0.0], np.cumsum(sample**2)))
        index = np.arange(len(sample))
        low, high = np.maximum(index - reach, 0), np.minimum(index + reach + 1, len(sample))
        return np.sqrt((total[high] - total[low]) / (high - low))

    def as_derived(self, derivative: Array) -> Array:
        """A model's derivative ``(N, K)`` as `differentiate` would see it in the means that a sensor takes.

        It is integrated to a rate (trapezoid rule with its end correction: Hermite cubics), averaged over the samples'
        intervals, and sent through the same way.
        """
        step = np.diff(self.time)[:, None]
        bend = np.diff(np.gradient(derivative, self.time, axis=0), axis=0)
        area = 0.5 * step * (derivative[1:] + derivative[:-1]) - step**2 / 12.0 * bend
        rise = np.concatenate((np.zeros((1, derivative.shape[1])), area))
        return self.differentiate(box_mean(np.cumsum(rise, axis=0)))

    def as_smoothed(self, values: Array) -> Array:
        """A model's values ``(N, K)`` as the sensor's means, smoothed."""
        return self.smooth(box_mean(values))

    def _by_points(self, function: Callable[[int], Array]) -> Array:
        counts = np.unique(self.points)
        out = function(int(counts[0]))
        for count in counts[1:]:
            here = self.points == count
            out[here] = function(int(count))[here]
        return out


def smoother(time: Array, length: float = BATCH) -> Smoother:
    """Choose the batches of a series: the odd number of samples nearest to `length` (s), at least 5.

    Raises
    ------
    InputError
        Fewer samples than a batch.
    """
    from scipy import ndimage  # slow to import, and few runs need it

    step = np.diff(time)
    if len(step) < _LEAST_POINTS:
        raise InputError(f"Smoothing needs more than {_LEAST_POINTS} samples; there are {len(time)}.")
    local = ndimage.median_filter(step, _NEIGHBOURS, mode="nearest")
    local = np.concatenate((local[:1], local))
    points = np.maximum(2 * np.round((length / local - 1.0) / 2.0).astype(np.int64) + 1, _LEAST_POINTS)
    points = np.minimum(points, len(time) - 1 - len(time) % 2)
    bandwidth, twice = {}, {}
    gain, acceleration_gain = np.empty(len(time)), np.empty(len(time))
    for count in np.unique(points):
        here = points == count
        interval = float(np.median(local[here]))
        one, two = _gains(int(count))
        bandwidth[int(count)] = batch_polynomial_bandwidth(int(count), _ORDER, interval)
        twice[int(count)] = _acceleration_bandwidth(int(count), interval)
        gain[here] = _spread(one, len(time))[here]
        acceleration_gain[here] = _spread(two, len(time))[here] / local[here]
    return Smoother(time, points, bandwidth, twice, gain, acceleration_gain)


def box_mean(values: Array) -> Array:
    """Mean over each sample's interval, ``(N, K)``, of values quadratic in between: as an integrating sensor gives."""
    out = values.copy()
    out[1:-1] += (values[2:] - 2.0 * values[1:-1] + values[:-2]) / 24.0
    return out


def _gains(points: int) -> tuple[Array, Array]:
    """Gains of both operators along a short unit-spaced series, ends included.

    Of batches beyond 45 points by their scaling with the length, right to a percent.
    """
    short = min(points, _LONGEST_EXACT)
    ratio = short / points
    n = 4 * short + 5
    t, one = np.arange(float(n)), np.eye(n)
    smooth = batch_polynomial(t, one, short, _ORDER)
    second = differentiated_rates(t, smooth, lambda s, v: batch_polynomial(s, v, short, _ORDER))
    gains = np.linalg.norm(smooth, axis=1) * ratio**0.5, np.linalg.norm(second, axis=1) * ratio**1.5
    if ratio == 1.0:
        return gains
    at = np.linspace(0.0, n - 1.0, 4 * points + 5)
    return np.interp(at, t, gains[0]), np.interp(at, t, gains[1])


def _spread(short: Array, n: int) -> Array:
    """A gain known at both ends and in the middle, over n samples."""
    half = len(short) // 2
    out = np.full(n, short[half])
    edge = min(half, n // 2)
    out[:edge], out[n - edge :] = short[:edge], short[len(short) - edge :]
    return out


def _acceleration_bandwidth(points: int, interval: float) -> float:
    """-3 dB frequency of the differentiated rates against the true derivative, Hz."""
    from scipy import signal

    weights = signal.savgol_coeffs(points, _ORDER)
    lag = np.arange(points) - points // 2
    f = np.linspace(1e-6, 0.5, 4001)
    passed = (np.cos(2.0 * np.pi * np.outer(f, lag)) @ weights) ** 2 * np.sinc(2.0 * f)
    low = np.flatnonzero(passed < np.sqrt(0.5))
    return float(f[low[0]] if low.size else 0.5) / interval
