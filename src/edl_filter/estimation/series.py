"""Series of samples: finite rows, runs of a condition, moving means, linear interpolation of columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.types import Array, BoolArray, IntArray


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
