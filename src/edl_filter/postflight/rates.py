"""Smoothed forces and rates, and the angular acceleration for Euler's equations (thesis section 3.2).

A second-order polynomial over batches of one length in time, the thesis's 7 points at 8 Hz; the smoothed rates are
differenced and the differences smoothed again. A zero-phase low-pass can come before (the thesis's for Phoenix).
Predictions that are compared with the flight go through the same operations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from edl_filter.errors import InputError
from edl_filter.estimation.series import moving_mean
from edl_filter.telemetry.smoothing import (
    batch_polynomial,
    batch_polynomial_bandwidth,
    batch_polynomial_gain,
    differentiated_rates,
    low_pass,
    low_pass_gain,
)
from edl_filter.types import Array, IntArray

#: Length of a batch, s: 7 points at 8 Hz (thesis section 3.2).
BATCH = 0.875
_ORDER = 2
#: Least number of points: with fewer, a second-order polynomial would nearly interpolate the samples.
_LEAST_POINTS = 5
#: Number of intervals whose median is the local sampling interval.
_NEIGHBOURS = 11
#: Batches up to this many points have their noise gains computed exactly.
_LONGEST_EXACT = 45
#: Relative difference up to which sampling intervals are the same.
_EVEN = 1e-6
#: Frequencies of a response, cycles per sample.
_FREQUENCY = np.linspace(1e-6, 0.5, 4001)


@dataclass(frozen=True)
class BatchSmoother:
    """Polynomial smoothing of one series of samples.

    Attributes
    ----------
    time : (N,) array
        Middle of each sample's interval, s.
    points : (N,) integer array
        Number of samples in the batch around each sample.
    bandwidth, acceleration_bandwidth : dict
        Points → -3 dB frequency, Hz, of one pass and of the two passes of the angular acceleration.
    gain, acceleration_gain : (N,) arrays
        One sigma of a smoothed value per one sigma of a white sample; of the angular acceleration, 1/s. With a low-pass
        its share in them is that of the middle of the series, at the two ends too.
    low_pass_hz : float, optional
        Half-power frequency of one pass of the low-pass before the batches, Hz; None: there is none.
    """

    time: Array
    points: IntArray
    bandwidth: dict[int, float]
    acceleration_bandwidth: dict[int, float]
    gain: Array
    acceleration_gain: Array
    low_pass_hz: float | None = None

    def smooth(self, values: Array) -> Array:
        """Values ``(N,)`` or ``(N, K)`` through the low-pass, if there is one, and the batch polynomial."""
        if self.low_pass_hz is not None:
            values = low_pass(values, _even_interval(self.time), self.low_pass_hz)
        return self._by_points(lambda p: batch_polynomial(self.time, values, p, _ORDER))

    def differentiate(self, values: Array) -> Array:
        """Time derivative ``(N, K)`` of ``(N, K)`` values: smoothed, differenced, smoothed again."""
        smooth = self.smooth(values)
        return self._by_points(
            lambda p: differentiated_rates(self.time, smooth, lambda t, v: batch_polynomial(t, v, p, _ORDER))
        )

    def smoothed_sigma(self, sample: Array) -> Array:
        """One sigma ``(N,)`` of smoothed values from one sigma ``(N,)`` of each sample, in its unit."""
        return self.gain * self._around(sample, self.points // 2)

    def acceleration_sigma(self, sample: Array) -> Array:
        """One sigma ``(N,)`` of `differentiate` from one sigma ``(N,)`` of each sample, in its unit over s."""
        # two batches and a difference combine the samples within this distance
        return self.acceleration_gain * self._around(sample, 2 * (self.points // 2) + 1)

    def _around(self, sample: Array, reach: IntArray) -> Array:
        """Root mean variance of the samples within `reach` of each, which a batch combines."""
        return np.sqrt(moving_mean(sample[:, None] ** 2, reach)[:, 0])

    def as_derived(self, derivative: Array) -> Array:
        """A predicted derivative as `differentiate` computes it from the sensor's means of the rate.

        It is integrated to a rate (trapezoid rule with its end correction: Hermite cubics), averaged over the samples'
        intervals, and differentiated by `differentiate`.

        Parameters
        ----------
        derivative : (N, K) array
            At the samples' middles, in any unit.

        Returns
        -------
        (N, K) array
            In the same unit.
        """
        step = np.diff(self.time)[:, None]
        bend = np.diff(np.gradient(derivative, self.time, axis=0), axis=0)
        area = 0.5 * step * (derivative[1:] + derivative[:-1]) - step**2 / 12.0 * bend
        rise = np.concatenate((np.zeros((1, derivative.shape[1])), area))
        return self.differentiate(box_mean(np.cumsum(rise, axis=0)))

    def as_smoothed(self, values: Array) -> Array:
        """Predicted values ``(N, K)`` averaged over the samples' intervals, as by the sensor, and smoothed."""
        return self.smooth(box_mean(values))

    def _by_points(self, function: Callable[[int], Array]) -> Array:
        """Result of a function of the number of points, at each sample that of its own number."""
        counts = np.unique(self.points)
        out = function(int(counts[0]))
        for count in counts[1:]:
            mask = self.points == count
            out[mask] = function(int(count))[mask]
        return out


def batch_smoother(time: Array, length: float = BATCH, low_pass_hz: float | None = None) -> BatchSmoother:
    """Smoother of a series, with batches of the odd number of samples nearest to a length in time, at least 5.

    Parameters
    ----------
    time : (N,) array
        Middles of the samples' intervals, s.
    length : float
        s.
    low_pass_hz : float, optional
        Half-power frequency of one pass of a zero-phase low-pass before the batches, Hz.

    Returns
    -------
    BatchSmoother

    Raises
    ------
    InputError
        There are fewer samples than in a batch; with a low-pass, the samples are not evenly spaced, or its frequency is
        not below the Nyquist frequency.
    """
    from scipy import ndimage  # slow to import, and few runs need it

    step = np.diff(time)
    if len(step) < _LEAST_POINTS:
        raise InputError(f"Smoothing needs more than {_LEAST_POINTS} samples; there are {len(time)}.")
    local = ndimage.median_filter(step, _NEIGHBOURS, mode="nearest")
    local = np.concatenate((local[:1], local))
    points = np.maximum(2 * np.round((length / local - 1.0) / 2.0).astype(np.int64) + 1, _LEAST_POINTS)
    points = np.minimum(points, len(time) - 1 - len(time) % 2)
    cycles = None if low_pass_hz is None else low_pass_hz * _even_interval(time)
    bandwidth, acceleration_bandwidth = {}, {}
    gain, acceleration_gain = np.empty(len(time)), np.empty(len(time))
    for count in np.unique(points):
        mask = points == count
        interval = float(np.median(local[mask]))
        smoothing, differentiation = _gains(int(count))
        responses = _responses(int(count))
        passed = np.ones(len(_FREQUENCY)) if cycles is None else low_pass_gain(_FREQUENCY, cycles)
        bandwidth[int(count)] = (
            batch_polynomial_bandwidth(int(count), _ORDER, interval)
            if cycles is None
            else _half_power(responses[0] * passed, interval)
        )
        # relative to the true derivative, whose response is the angular frequency
        acceleration_bandwidth[int(count)] = _half_power(responses[1] * passed / (2.0 * np.pi * _FREQUENCY), interval)
        shares = [np.linalg.norm(r * passed) / np.linalg.norm(r) for r in responses]
        gain[mask] = shares[0] * _spread(smoothing, len(time))[mask]
        acceleration_gain[mask] = shares[1] * _spread(differentiation, len(time))[mask] / local[mask]
    return BatchSmoother(time, points, bandwidth, acceleration_bandwidth, gain, acceleration_gain, low_pass_hz)


def box_mean(values: Array) -> Array:
    """Mean over each sample's interval of values that are quadratic between samples: reading of an integrating sensor.

    Parameters
    ----------
    values : (N, K) array
        At the middles of the intervals, in any unit.

    Returns
    -------
    (N, K) array
        In the same unit.
    """
    out = values.copy()
    out[1:-1] += (values[2:] - 2.0 * values[1:-1] + values[:-2]) / 24.0
    return out


def _gains(points: int) -> tuple[Array, Array]:
    """Noise gains of both operators along a short series of unit spacing, ends included.

    For batches of more than 45 points by scaling with the length, with an error of one percent.
    """
    short = min(points, _LONGEST_EXACT)
    ratio = short / points
    n = 4 * short + 5
    t, impulses = np.arange(float(n)), np.eye(n)
    smooth = batch_polynomial(t, impulses, short, _ORDER)
    second = differentiated_rates(t, smooth, lambda s, v: batch_polynomial(s, v, short, _ORDER))
    gains = np.linalg.norm(smooth, axis=1) * ratio**0.5, np.linalg.norm(second, axis=1) * ratio**1.5
    if ratio == 1.0:
        return gains
    at = np.linspace(0.0, n - 1.0, 4 * points + 5)
    return np.interp(at, t, gains[0]), np.interp(at, t, gains[1])


def _spread(short: Array, n: int) -> Array:
    """A gain along a short series, with its ends and its middle, extended to n samples."""
    half = len(short) // 2
    out = np.full(n, short[half])
    edge = min(half, n // 2)
    out[:edge], out[n - edge :] = short[:edge], short[len(short) - edge :]
    return out


def _responses(points: int) -> tuple[Array, Array]:
    """Responses of a batch, and of the differentiation with two batches (per sample), at `_FREQUENCY`."""
    batch = batch_polynomial_gain(_FREQUENCY, points, _ORDER)
    # a difference over one sample, and the mean of two neighbouring differences
    return batch, batch**2 * np.sin(2.0 * np.pi * _FREQUENCY)


def _half_power(response: Array, interval: float) -> float:
    """Lowest frequency at which less than half the power passes, Hz; the Nyquist frequency if there is none."""
    attenuated = np.flatnonzero(response < np.sqrt(0.5))
    return float(_FREQUENCY[attenuated[0]] if attenuated.size else 0.5) / interval


def _even_interval(time: Array) -> float:
    """Sampling interval of evenly spaced samples, s; raises InputError where they are not."""
    step = np.diff(time)
    if np.ptp(step) > _EVEN * step.min():
        raise InputError(
            f"postflight.low_pass_hz: found sampling intervals from {step.min():.6g} to {step.max():.6g} s; a low-pass "
            "needs evenly spaced samples. Leave the key out: postflight.batch_s smooths by itself."
        )
    return float(np.mean(step))
