"""Bins: the time steps at which prediction and measurement are compared.

A bin holds one sample, or an even number of them where the sampling is faster than the body moves. Its means are those
of the measurement, so prediction is averaged over the same times and nothing is interpolated on one side alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.navigation.increments import Samples

Array = NDArray[np.float64]

#: Length that bins come near to, s: ten steps in the fastest oscillation of a blunt body, about 1 Hz.
LENGTH = 0.1
#: Bins at both ends that are not compared: interpolation has neighbours on one side only.
END = 3


@dataclass(frozen=True)
class Bins:
    """Adjoining time steps.

    Attributes
    ----------
    edges : (B + 1,) array
        s.
    sound : (B,) array of bool
        Every sample is a gyro's and an accelerometer's own reading, of the first instrument, and as long as usual.
    per_bin : int
        Samples in a bin: one, or an even number.
    """

    edges: Array
    sound: NDArray[np.bool_]
    per_bin: int

    @property
    def interval(self) -> Array:
        """Lengths ``(B,)``, s."""
        return np.diff(self.edges)

    @property
    def middle(self) -> Array:
        """Middles ``(B,)``, s."""
        return 0.5 * (self.edges[1:] + self.edges[:-1])


def lay_bins(samples: Samples, sample_edges: Array, end: float) -> Bins:
    """Lay bins over the samples up to `end`.

    Parameters
    ----------
    samples : Samples
        From the initial state on; they may have been cut at further times.
    sample_edges : (M,) array
        Edges of the samples as they were taken, s, within the time of `samples`.
    end : float
        s; the last bin ends before it.
    """
    edges = sample_edges[sample_edges <= end]
    usual = float(np.median(np.diff(edges)))
    per_bin = max(1, 2 * round(0.5 * LENGTH / usual))
    per_bin = 1 if usual > 0.75 * LENGTH else per_bin
    edges = edges[::per_bin]
    interval = np.diff(edges)
    regular = np.abs(interval - per_bin * usual) < 1e-3 * usual
    first = samples.unit == samples.unit[0]
    good = first & ~samples.net_turn & np.all(np.isfinite(samples.mean_force), axis=1)
    start = samples.time - samples.interval
    bad_at = 0.5 * (start + samples.time)[~good]
    spoiled = np.unique(np.searchsorted(edges, bad_at) - 1)
    sound = regular.copy()
    sound[spoiled[(spoiled >= 0) & (spoiled < len(sound))]] = False
    sound[:END] = sound[-END:] = False
    return Bins(edges, sound, per_bin)


def bin_means(edges: Array, time: Array, interval: Array, values: Array) -> Array:
    """Means over bins of a quantity given by its means over adjoining intervals.

    Parameters
    ----------
    edges : (B + 1,) array
        s.
    time, interval : (N,) arrays
        End and length of the intervals, s.
    values : (N, ...) array

    Returns
    -------
    (B, ...) array
        NaN in bins that the intervals do not cover.
    """
    grid = np.concatenate((time[:1] - interval[:1], time))
    tail = (1,) * (values.ndim - 1)
    total = np.concatenate((np.zeros((1, *values.shape[1:])), np.cumsum(values * interval.reshape(-1, *tail), axis=0)))
    k = np.clip(np.searchsorted(grid, edges, side="right") - 1, 0, len(time) - 1)
    at = total[k] + values[k] * (edges - grid[k]).reshape(-1, *tail)
    out = np.diff(at, axis=0) / np.diff(edges).reshape(-1, *tail)
    outside = (edges[:-1] < grid[0] - 1e-6) | (edges[1:] > grid[-1] + 1e-6)
    out[outside] = np.nan
    return out
