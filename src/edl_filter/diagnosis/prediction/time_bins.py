"""Time bins: the intervals over which prediction and measurement are averaged and compared.

A bin holds one sample, or an even number of samples where the sampling is fast against the motion of the body. Its
means are those of the measurement; the prediction is averaged over the same times, so nothing is interpolated on one
side alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edl_filter.navigation.increments import Samples
from edl_filter.types import Array, BoolArray


@dataclass(frozen=True)
class TimeBins:
    """Adjoining time intervals.

    Attributes
    ----------
    edges : (B + 1,) array
        s.
    valid : (B,) array of bool
        Every sample in the bin was read by a gyro and an accelerometer of the first instrument, over the usual
        interval, and no event changed the vehicle or an IMU's position near it.
    samples_per_bin : int
        One, or an even number.
    """

    edges: Array
    valid: BoolArray
    samples_per_bin: int

    @property
    def interval(self) -> Array:
        """Lengths ``(B,)``, s."""
        return np.diff(self.edges)

    @property
    def middle(self) -> Array:
        """Middles ``(B,)``, s."""
        return 0.5 * (self.edges[1:] + self.edges[:-1])


def make_time_bins(
    samples: Samples, sample_edges: Array, end: float, length: float, ends: int, changes: Sequence[float] = ()
) -> TimeBins:
    """Divide the samples up to `end` into bins.

    Parameters
    ----------
    samples : Samples
        From the initial state on; they may have been cut at further times.
    sample_edges : (M,) array
        Edges of the samples as they were taken, s, within the time of `samples`.
    end : float
        s; the last bin ends before it.
    length : float
        Length that bins approach, s.
    ends : int
        Number of bins at both ends that are not compared, since interpolation has neighbours on one side only.
    changes : sequence of float
        Times of events that change the vehicle or an IMU's position, s. Forces and angular accelerations are
        discontinuous there, so that the same number of bins is not compared before and after each.
    """
    edges = sample_edges[sample_edges <= end]
    usual = float(np.median(np.diff(edges)))
    per_bin = max(1, 2 * round(0.5 * length / usual))
    per_bin = 1 if usual > 0.75 * length else per_bin
    edges = edges[::per_bin]
    regular = np.abs(np.diff(edges) - per_bin * usual) < 1e-3 * usual
    first = samples.unit == samples.unit[0]
    measured = first & ~samples.net_turn & np.all(np.isfinite(samples.mean_force), axis=1)
    sample_start = samples.time - samples.interval
    invalid_time = 0.5 * (sample_start + samples.time)[~measured]
    invalid_bin = np.unique(np.searchsorted(edges, invalid_time) - 1)
    valid = regular.copy()
    valid[invalid_bin[(invalid_bin >= 0) & (invalid_bin < len(valid))]] = False
    valid[:ends] = valid[-ends:] = False
    for time in changes:
        i = int(np.searchsorted(edges, time - 0.5 * usual))  # the edge at the event, or the first after it
        if 0 < i < len(edges):
            valid[max(0, i - ends) : i + ends] = False
    return TimeBins(edges, valid, per_bin)


def bin_means(edges: Array, time: Array, interval: Array, values: Array) -> Array:
    """Means over bins of a quantity that is given by its means over adjoining intervals.

    Parameters
    ----------
    edges : (B + 1,) array
        s.
    time, interval : (N,) arrays
        End and length of the intervals, s.
    values : (N, ...) array
        Means over the intervals.

    Returns
    -------
    (B, ...) array
        NaN in bins that the intervals do not cover.
    """
    grid = np.concatenate((time[:1] - interval[:1], time))
    tail = (1,) * (values.ndim - 1)
    total = np.concatenate((np.zeros((1, *values.shape[1:])), np.cumsum(values * interval.reshape(-1, *tail), axis=0)))
    k = np.clip(np.searchsorted(grid, edges, side="right") - 1, 0, len(time) - 1)
    integral = total[k] + values[k] * (edges - grid[k]).reshape(-1, *tail)
    out = np.diff(integral, axis=0) / np.diff(edges).reshape(-1, *tail)
    outside = (edges[:-1] < grid[0] - 1e-6) | (edges[1:] > grid[-1] + 1e-6)
    out[outside] = np.nan
    return out
