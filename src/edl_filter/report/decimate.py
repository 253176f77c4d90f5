"""Reduction of long curves to the resolution of a picture, without loss of a peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.report.description import Curve
from edl_filter.types import Array


def envelope(time: ArrayLike, values: ArrayLike, bins: int = 1200) -> tuple[Array, Array]:
    """Smallest and largest sample of every bin, in their order of time.

    In a picture no wider than `bins` pixels the line through them looks like the line through all samples.

    Parameters
    ----------
    time, values : (N,) arrays
        NaN among `values` is ignored; a bin of NaN only retains one NaN, so that a gap remains a gap.
    bins : int
        Bins of equal numbers of samples.

    Returns
    -------
    time, values : (M,) arrays
        ``M <= 2 bins + 2``; the input itself if it is not longer. The first and last samples are retained.
    """
    time, values = np.asarray(time, float), np.asarray(values, float)
    index = extremes(values, bins)
    return (time, values) if len(index) == len(time) else (time[index], values[index])


def extremes(values: ArrayLike, bins: int = 1200) -> NDArray[np.intp]:
    """Indices of the samples that `envelope` retains.

    Parameters
    ----------
    values : (N,) array
        NaN is ignored.
    bins : int
        As in `envelope`.
    """
    values = np.asarray(values, float)
    n = len(values)
    index = np.arange(n)
    if n <= 2 * bins + 2:
        return index
    edges = np.linspace(0, n, bins + 1).astype(int)[:-1]
    groups = np.repeat(np.arange(bins), np.diff(np.append(edges, n)))
    missing = np.isnan(values)
    least = np.minimum.reduceat(np.where(missing, np.inf, values), edges)
    most = np.maximum.reduceat(np.where(missing, -np.inf, values), edges)
    beyond = n + 1
    low = np.minimum.reduceat(np.where(~missing & (values == least[groups]), index, beyond), edges)
    high = np.minimum.reduceat(np.where(~missing & (values == most[groups]), index, beyond), edges)
    empty = low == beyond
    low[empty], high[empty] = edges[empty], edges[empty]
    return np.unique(np.concatenate(([0], low, high, [n - 1])))


def reduced(curve: Curve, bins: int) -> NDArray[np.intp]:
    """Indices of the points of a curve that a picture of `bins` pixels needs: all of those with a symbol."""
    if curve.symbol:
        return np.arange(len(curve.x))
    dependent = {"x": (curve.y,), "y": (curve.x,), "none": (curve.x, curve.y)}[curve.independent]
    return np.unique(np.concatenate([extremes(values, bins) for values in dependent]))
