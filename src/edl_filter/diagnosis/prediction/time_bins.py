"""Time bins: the intervals over which prediction and measurement are averaged and compared.

A bin holds one sample, or an even number of samples where the sampling is fast against the motion of the body. Its
means are those of the measurement; the prediction is averaged over the same times, so nothing is interpolated on one
side alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edl_filter.estimation.interpolating_spline import DEGREE, InterpolatingSpline
from edl_filter.estimation.series import finite_rows
from edl_filter.navigation.increments import Samples
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, sample_edges
from edl_filter.types import Array, BoolArray, IntArray

#: Length of a sample, relative to that which bins approach, from which each sample is a bin.
_SINGLE_SAMPLE = 0.75


@dataclass(frozen=True)
class TimeBins:
    """Adjoining time intervals.

    Attributes
    ----------
    edges : (B + 1,) array
        s.
    valid : (B,) array of bool
        Every sample in the bin was read by a gyro and an accelerometer of the first instrument, over the usual
        interval, none of its values was filled in, and no event changed the vehicle or an IMU's position near it.
    changes : tuple of float
        Times of these events, s. Nothing is interpolated across them, nor across the end.
    """

    edges: Array
    valid: BoolArray
    changes: tuple[float, ...] = ()

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
    per_bin = 1 if usual > _SINGLE_SAMPLE * length else per_bin
    edges = edges[::per_bin]
    regular = np.abs(np.diff(edges) - per_bin * usual) < 1e-3 * usual
    first = samples.unit == samples.unit[0]
    measured = first & ~samples.coning_corrected & ~samples.filled & np.all(np.isfinite(samples.mean_force), axis=1)
    sample_start = samples.time - samples.interval
    invalid_time = 0.5 * (sample_start + samples.time)[~measured]
    invalid_bin = np.unique(np.searchsorted(edges, invalid_time) - 1)
    valid = regular.copy()
    valid[invalid_bin[(invalid_bin >= 0) & (invalid_bin < len(valid))]] = False
    valid[:ends] = valid[max(0, len(valid) - ends) :] = False
    for time in changes:
        i = int(np.searchsorted(edges, time - 0.5 * usual))  # the edge at the event, or the first after it
        if 0 < i < len(edges):
            valid[max(0, i - ends) : i + ends] = False
    return TimeBins(edges, valid, tuple(changes))


def bin_means(
    edges: Array,
    time: Array,
    interval: Array,
    values: Array,
    smooth: bool = False,
    excluded: BoolArray | None = None,
) -> Array:
    """Means over bins of a quantity that is given by its means over adjoining intervals.

    The integral is known at the ends of the intervals. At an edge inside an interval it is interpolated linearly: the
    quantity is constant over the interval. A smooth one is interpolated by a spline of fifth degree. Linear
    interpolation would be wrong by half the product of second derivative, interval and distance to the end: with two
    IMUs whose samples end 2 ms apart this is six times their noise on a vehicle that oscillates.

    Parameters
    ----------
    edges : (B + 1,) array
        s.
    time, interval : (N,) arrays
        End and length of the intervals, s.
    values : (N, ...) array
        Means over the intervals.
    smooth : bool
        The quantity is smooth.
    excluded : (N,) array of bool, optional
        Intervals of which no bin is formed. Their values interpolate a smooth quantity in the intervals next to them.

    Returns
    -------
    (B, ...) array
        NaN in bins that the intervals do not cover, and in those that an excluded interval or a value which is NaN
        contributes to; of a smooth quantity also in bins that end inside an interval next to a gap or to an end.
    """
    lost = ~finite_rows(values)
    if lost.any():
        values = np.where(lost.reshape(-1, *(1,) * (values.ndim - 1)), 0.0, values)
    grid = sample_edges(time, interval)
    tail = (1,) * (values.ndim - 1)
    total = np.concatenate((np.zeros((1, *values.shape[1:])), np.cumsum(values * interval.reshape(-1, *tail), axis=0)))
    k = np.clip(np.searchsorted(grid, edges, side="right") - 1, 0, len(time) - 1)
    integral = total[k] + values[k] * (edges - grid[k]).reshape(-1, *tail)
    if smooth:
        _interpolate(integral, edges, grid, total, k, lost)
    out = np.diff(integral, axis=0) / np.diff(edges).reshape(-1, *tail)
    outside = (edges[:-1] < grid[0] - SAME_TIME) | (edges[1:] > grid[-1] + SAME_TIME)
    without_bin = lost if excluded is None else lost | excluded
    if without_bin.any():
        count = np.concatenate(([0], np.cumsum(without_bin)))
        # an edge at the end of a sample is not inside the next one
        begin = np.searchsorted(grid, edges[:-1] + SAME_TIME) - 1
        end = np.searchsorted(grid, edges[1:] - SAME_TIME)
        outside |= count[np.clip(end, 0, len(time))] > count[np.clip(begin, 0, len(time))]
    out[outside] = np.nan
    return out


def bin_means_of_readings(bins: TimeBins, record: ImuRecord, values: Array) -> Array:
    """Means over the bins ``(B, 3)`` of values by sample ``(N, 3)`` of a checking IMU.

    NaN in bins with a filled sample, which would be compared with the driving IMU from which it was filled. Force and
    angular acceleration jump inside the sample in which the vehicle changes.
    """
    changes = np.array(bins.changes)
    changes = changes[(changes > record.start) & (changes <= record.time[-1])]
    if len(changes):
        values = values.copy()
        values[record.index_at(changes)] = np.nan
    return bin_means(bins.edges, record.time, record.interval, values, smooth=True, excluded=record.filled)


#: Number of intervals on each side of an edge without which its integral is not interpolated: a spline amplifies noise
#: near its ends.
_REACH = 2
#: Distance from the nearest end of an interval, relative to its length, below which that noise is negligible.
_NEAR_A_NODE = 0.05
#: Ratio of the lengths of two adjoining intervals from which they are not regular.
_IRREGULAR = 1.5


def _interpolate(integral: Array, edges: Array, grid: Array, total: Array, k: IntArray, lost: BoolArray) -> None:
    """Interpolate the integral at edges inside an interval, in place; `k` is the interval of each edge.

    The integral is not known across samples that are `lost` (N,): each run of regular ones has its own spline. It is
    NaN at an edge that has not `_REACH` intervals of a run on each side and is not near the end of an interval. The
    last run ends `_REACH` intervals after the last edge: a jump that follows, of a parachute, would be in the spline's
    values of ten intervals before it.
    """
    length = np.diff(grid)
    inside = np.flatnonzero(np.minimum(edges - grid[k], grid[k + 1] - edges) > SAME_TIME)
    longer, shorter = np.maximum(length[1:], length[:-1]), np.minimum(length[1:], length[:-1])
    breaks = np.concatenate(([True], (longer > _IRREGULAR * shorter) | lost[1:] | lost[:-1]))
    breaks[k[-1] + _REACH + 1 :] = True
    begin, run = np.flatnonzero(breaks), np.cumsum(breaks) - 1
    end = np.append(begin[1:], len(length))
    integral[inside] = np.nan
    at = k[inside]
    interior = (at - begin[run[at]] >= _REACH) & (end[run[at]] - at > _REACH)
    nearest = np.minimum(edges[inside] - grid[at], grid[at + 1] - edges[inside])
    inside = inside[interior | (nearest < _NEAR_A_NODE * length[at])]
    for i in np.unique(run[k[inside]]):
        rows = inside[run[k[inside]] == i]
        nodes = slice(begin[i], end[i] + 1)
        values = total[nodes].reshape(end[i] + 1 - begin[i], -1)
        degree = min(DEGREE, (len(values) - 2) // 2 * 2 + 1)
        spline = InterpolatingSpline.through(grid[nodes], values, degree)
        integral[rows] = spline(edges[rows]).reshape(len(rows), *total.shape[1:])


def bin_sigma(bins: TimeBins, time: Array, interval: Array, noise: Array) -> Array:
    """One sigma of the means over bins of samples with independent noise.

    Parameters
    ----------
    bins : TimeBins
        Time bins of the comparison.
    time, interval, noise : (N,) arrays
        End and length of the samples' intervals, s; one sigma of each sample.

    Returns
    -------
    (B,) array
    """
    variance = bin_means(bins.edges, time, interval, noise**2 * interval)
    return np.sqrt(variance / bins.interval)
