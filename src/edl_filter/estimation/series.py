"""Series of samples: finite rows, runs of a condition, moving means, outliers, linear interpolation of columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.types import Array, BoolArray, IntArray

#: Standard deviation of a normal distribution over its median absolute deviation.
ROBUST_SIGMA = 1.4826


def finite_rows(values: Array) -> BoolArray:
    """Rows (N,) of `values` (N, ...) of which all numbers are finite."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))), np.bool_)


def runs(selected: BoolArray) -> list[tuple[int, int]]:
    """First index and end (exclusive) of every run of true values of `selected` (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], selected.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def moving_mean(values: Array, reach: int | IntArray) -> Array:
    """Means of rows over each row and up to `reach` rows on each side, fewer at the ends.

    Parameters
    ----------
    values : (N, m) array
        In any unit.
    reach : int or (N,) array of int
        Rows on each side.

    Returns
    -------
    (N, m) array
        In the same unit.
    """
    total = np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)))
    index = np.arange(len(values))
    first, last = np.maximum(index - reach, 0), np.minimum(index + reach + 1, len(values))
    return np.asarray((total[last] - total[first]) / (last - first)[:, None], np.float64)


def near_running_median(values: Array, noise: Array, size: int, sigmas: float) -> BoolArray:
    """Rows that are no outliers: all columns near their running median; all rows where most are not.

    Parameters
    ----------
    values : (N, m) array
        In any unit.
    noise : (N,) array
        Least scale of the departures, in the same unit. Their robust sigma is added.
    size : int
        Rows of the running median.
    sigmas : float
        Departure of an outlier, in scales.

    Returns
    -------
    (N,) boolean array
    """
    from scipy.ndimage import median_filter  # imported on use: most importers of this module filter nothing

    if not len(values):
        return np.zeros(0, bool)
    # mirrored at the ends, where an outlier is once in the window then
    departure = np.abs(values - median_filter(values, size=(size, 1), mode="mirror"))
    scale = ROBUST_SIGMA * np.median(departure, axis=0) + noise[:, None]
    near = np.all(departure <= sigmas * scale, axis=1)
    return near if 2 * np.count_nonzero(near) > len(near) else np.ones(len(near), bool)


def interpolate_columns(time: ArrayLike, knots: Array, values: Array) -> Array:
    """Linear interpolation of each column, held at the edges.

    Parameters
    ----------
    time : (...) array
        Where to interpolate.
    knots : (N,) array
        Increasing, in the unit of `time`.
    values : (N, m) array
        At the knots, in any unit.

    Returns
    -------
    (..., m) array
        In the unit of `values`.
    """
    time = np.asarray(time, float)
    return np.stack([np.interp(time, knots, column) for column in values.T], axis=-1)
