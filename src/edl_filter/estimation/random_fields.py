"""Smooth Gaussian processes: squared exponential correlation, and realisations over one or two coordinates."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from edl_filter.types import Array


def squared_exponential_correlation(distance: Array) -> Array:
    """Correlation ``exp(-r² / 2)`` of a process whose realisations are differentiable without limit.

    Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006, eq. 4.9.

    Parameters
    ----------
    distance : (...) array
        Distance r of two places over the correlation length; of either sign.

    Returns
    -------
    (...) array
        For unit variance.
    """
    return np.asarray(np.exp(-0.5 * np.asarray(distance, float) ** 2), float)


def covariance_root(points: Array, length: float) -> Array:
    """Square root of the squared exponential correlation, by eigenvalues.

    The matrix of a smooth field is singular to rounding, where a Cholesky decomposition fails.

    Parameters
    ----------
    points : (N,) array
        Coordinates.
    length : float
        Correlation length, in their unit.

    Returns
    -------
    (N, N) array
        Its product with its own transpose is the correlation matrix.
    """
    return _root(np.ascontiguousarray(points, float).tobytes(), float(length))


@lru_cache(maxsize=32)
def _root(points: bytes, length: float) -> Array:
    """The root for points as bytes: fields that are drawn at the same points share it."""
    coordinates = np.frombuffer(points)
    correlation = squared_exponential_correlation(np.subtract.outer(coordinates, coordinates) / length)
    values, vectors = np.linalg.eigh(correlation)
    root = np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
    root.setflags(write=False)
    return root


def smooth_field(
    random: np.random.Generator, first: Array, first_length: float, second: Array, second_length: float
) -> Array:
    """One realisation over a grid, of unit variance.

    Parameters
    ----------
    random : Generator
        Source of the deviates.
    first, second : (N,), (A,) arrays
        Coordinates of the grid.
    first_length, second_length : float
        Correlation lengths in the units of the coordinates.

    Returns
    -------
    (N, A) array
    """
    along, across = covariance_root(first, first_length), covariance_root(second, second_length)
    return along @ random.standard_normal((len(first), len(second))) @ across.T


def smooth_profile(random: np.random.Generator, points: Array, length: float) -> Array:
    """One realisation ``(N,)`` of unit variance at coordinates ``(N,)`` with a correlation `length` in their unit."""
    return covariance_root(points, length) @ random.standard_normal(len(points))
