"""Thinning of long curves that keeps every peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.types import Array


def envelope(time: ArrayLike, values: ArrayLike, bins: int = 1200) -> tuple[Array, Array]:
    """Smallest and largest sample of every bin, in their order of time.

    On a picture no wider than `bins` pixels the line through them looks as the line through all samples.

    Parameters
    ----------
    time, values : (N,) arrays
        NaN among `values` is passed over; a bin of nothing but NaN leaves one NaN: the gap stays a gap.
    bins : int
        Bins of equal numbers of samples.

    Returns
    -------
    time, values : (M,) arrays
        ``M <= 2 bins + 2``; the input itself where it is as short as that. First and last samples are kept.
    """
    time, values = np.asarray(time, float), np.asarray(values, float)
    index = extremes(values, bins)
    return (time, values) if len(index) == len(time) else (time[index], values[index])


def extremes(values: ArrayLike, bins: int = 1200) -> NDArray[np.intp]:
    """Indices of the samples that `envelope` keeps."""
    values = np.asarray(values, float)
    n = len(values)
    index = np.arange(n)
    if n <= 2 * bins + 2:
        return index
    edges = np.linspace(0, n, bins + 1).astype(int)[:-1]
    groups = np.repeat(np.arange(bins), np.diff(np.append(edges, n)))
    # Sorted by bin, then value, the first and last of each bin are its extremes; NaN is put in the middle
    mean = np.nan_to_num(np.nanmean(values)) if np.isfinite(values).any() else 0.0
    missing = np.isnan(values)
    filled = np.where(missing, mean, values)
    least = np.minimum.reduceat(np.where(missing, np.inf, filled), edges)
    most = np.maximum.reduceat(np.where(missing, -np.inf, filled), edges)
    far = n + 1
    low = np.minimum.reduceat(np.where(~missing & (values == least[groups]), index, far), edges)
    high = np.minimum.reduceat(np.where(~missing & (values == most[groups]), index, far), edges)
    empty = low == far
    low[empty], high[empty] = edges[empty], edges[empty]
    return np.unique(np.concatenate(([0], low, high, [n - 1])))
