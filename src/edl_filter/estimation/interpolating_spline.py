"""Interpolating spline of odd degree, not-a-knot at both ends.

Input: abscissae and values. Method: B-splines whose knots are the abscissae without those next to the ends, by the
recursion of Cox and de Boor, and the solution of the banded collocation equations (de Boor, A Practical Guide to
Splines, 2001, chapters X and XIII). The same as `scipy.interpolate.make_interp_spline`, whose package takes longer to
import than a record to interpolate. Output: values of the spline and of its derivatives, and its polynomials.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from scipy.linalg.lapack import dgbtrf, dgbtrs

from edl_filter.estimation.series import finite_rows
from edl_filter.types import Array, IntArray

#: Degree of splines through integrals.
DEGREE = 5
#: Number of sets of abscissae of which knots, factors and values of the B-splines are kept: the same record is
#: interpolated again and again with other corrections of its readings.
_KEPT_ABSCISSAE = 8


@dataclass(frozen=True)
class InterpolatingSpline:
    """A linear combination of B-splines.

    Attributes
    ----------
    knots : (n + degree + 1,) array
        Not decreasing.
    coefficients : (n, K) array
        Of each B-spline.
    degree : int
    """

    knots: Array
    coefficients: Array
    degree: int

    @classmethod
    def through(cls, x: Array, y: Array, degree: int) -> InterpolatingSpline:
        """Spline through given points.

        Parameters
        ----------
        x : (N,) array
            Increasing, N > `degree`.
        y : (N, K) array
            Values at `x`.
        degree : int
            Odd.
        """
        knots, factor, pivots = _collocation(np.asarray(x, np.float64).tobytes(), degree)
        coefficients, _ = dgbtrs(factor, degree, degree, np.asarray_chkfinite(y), pivots)
        return cls(knots, coefficients, degree)

    def __call__(self, x: Array) -> Array:
        """Values ``(M, K)`` at ``(M,)`` abscissae between the first and the last knot."""
        first, basis = _basis(self.knots, self.degree, np.asarray(x, np.float64))
        return _combination(first, basis, self.coefficients)

    def powers(self, x: Array) -> Array:
        """Coefficients of the polynomials that the spline is after each abscissa.

        Parameters
        ----------
        x : (M,) array
            Increasing.

        Returns
        -------
        (degree + 1, M, K) array
            Of the powers of the distance from `x`, the constant first, up to the next knot.
        """
        out = np.empty((self.degree + 1, len(x), self.coefficients.shape[1]))
        bases = _derivative_bases(self.knots.tobytes(), self.degree, np.asarray(x, np.float64).tobytes())
        factorial, derivative = 1.0, self
        for order, (first, basis) in enumerate(bases):
            out[order] = _combination(first, basis, derivative.coefficients) / factorial
            factorial *= order + 1.0
            if order < self.degree:
                derivative = derivative.derivative()
        return out

    def derivative(self, order: int = 1) -> InterpolatingSpline:
        """Derivative of an order up to the degree, a spline of lower degree (de Boor 2001, X (16))."""
        if order == 0:
            return self
        spans = self.knots[self.degree + 1 : -1] - self.knots[1 : -self.degree - 1]
        slopes = self.degree * np.diff(self.coefficients, axis=0) / spans[:, None]
        return InterpolatingSpline(self.knots[1:-1], slopes, self.degree - 1).derivative(order - 1)


def integral_spline(edges: Array, interval: Array, mean: Array, degree: int = DEGREE) -> InterpolatingSpline:
    """Spline through the integral of a quantity whose means over adjoining intervals are known.

    Parameters
    ----------
    edges : (N + 1,) array
        Of the intervals.
    interval : (N,) array
        Their lengths.
    mean : (N, m) array
        Means over the intervals.
    degree : int
        Odd. With fewer edges than the degree needs, the largest odd degree that they allow.

    Returns
    -------
    InterpolatingSpline
        Of the integral ``(m,)``, zero at the first edge. Its derivative has the means that are given.
    """
    integral = np.zeros((len(edges), mean.shape[1]))
    np.cumsum(mean * interval[:, None], axis=0, out=integral[1:])
    largest = len(interval) if len(interval) % 2 else len(interval) - 1
    return InterpolatingSpline.through(edges, integral, min(degree, largest))


@dataclass(frozen=True)
class PiecewiseSpline:
    """Splines over adjoining ranges of the abscissa.

    Attributes
    ----------
    edges : (K + 1,) array
        Of the ranges, increasing.
    pieces : tuple of InterpolatingSpline or None
        One for each range; None: zero.
    count : int
        Number of values.
    """

    edges: Array
    pieces: tuple[InterpolatingSpline | None, ...]
    count: int

    def __call__(self, x: Array) -> Array:
        """Values ``(M, count)`` at ``(M,)`` abscissae, those outside at the nearest end.

        A common end of two ranges belongs to the second one, or to the first one if the second one has no spline.
        """
        inside = np.asarray(np.clip(x, self.edges[0], self.edges[-1]), float)
        piece = np.asarray(np.searchsorted(self.edges, inside, side="right") - 1)
        piece = np.minimum(piece, len(self.pieces) - 1)
        empty = np.array([spline is None for spline in self.pieces])
        piece = piece - (empty[piece] & (piece > 0) & np.asarray(inside == self.edges[piece]))
        out = np.zeros((len(inside), self.count))
        for k, spline in enumerate(self.pieces):
            rows = np.flatnonzero(piece == k)
            if spline is not None and len(rows):
                out[rows] = spline(inside[rows])
        return out


def piecewise_integral(edges: Array, interval: Array, mean: Array, degree: int = DEGREE) -> PiecewiseSpline:
    """Splines through the integral of a quantity, one for each run of intervals whose means are known.

    Parameters
    ----------
    edges : (N + 1,) array
        Of the intervals.
    interval : (N,) array
        Their lengths.
    mean : (N, m) array
        Means over the intervals; NaN where they are not known.
    degree : int
        As of `integral_spline`.

    Returns
    -------
    PiecewiseSpline
        Of the integral ``(m,)`` since the start of each run. Differences across an unknown interval have no meaning.
    """
    known = finite_rows(mean)
    begins = np.concatenate(([0], 1 + np.flatnonzero(np.diff(known))))
    pieces = [
        integral_spline(edges[i : j + 1], interval[i:j], mean[i:j], degree) if known[i] else None
        for i, j in zip(begins, [*begins[1:], len(known)], strict=True)
    ]
    return PiecewiseSpline(np.append(edges[begins], edges[-1]), tuple(pieces), mean.shape[1])


@lru_cache(_KEPT_ABSCISSAE)
def _collocation(abscissae: bytes, degree: int) -> tuple[Array, Array, IntArray]:
    """Knots, and triangular factors with pivots of the collocation matrix, which depend on the abscissae only.

    Parameters
    ----------
    abscissae : bytes
        Of the array ``(N,)`` of floats.
    degree : int
        Of the spline.

    Returns
    -------
    knots : (N + degree + 1,) array
    factor : (3 degree + 1, N) array
        As LAPACK's ``gbtrf`` stores it.
    pivots : (N,) array of int
    """
    x = np.frombuffer(abscissae)
    inside = (degree + 1) // 2
    ends = np.ones(degree + 1)
    knots = np.concatenate((x[0] * ends, x[inside:-inside], x[-1] * ends))
    first, basis = _basis(knots, degree, x)
    bands = np.zeros((3 * degree + 1, len(x)))
    columns = first[:, None] + np.arange(degree + 1)
    bands[2 * degree + np.arange(len(x))[:, None] - columns, columns] = basis
    factor, pivots, singular = dgbtrf(bands, degree, degree)
    if singular:
        raise np.linalg.LinAlgError("The abscissae of a spline must increase.")
    return knots, factor, pivots


@lru_cache(_KEPT_ABSCISSAE)
def _derivative_bases(knots: bytes, degree: int, abscissae: bytes) -> tuple[tuple[IntArray, Array], ...]:
    """Results of `_basis` for a spline and each of its derivatives; knots and abscissae as bytes of their arrays."""
    t, x = np.frombuffer(knots), np.frombuffer(abscissae)
    return tuple(_basis(t[order : len(t) - order], degree - order, x) for order in range(degree + 1))


@njit(cache=True, error_model="numpy")
def _basis(knots, degree, x):
    """Index ``(M,)`` of the first B-spline that is not zero at each abscissa, and the values ``(M, degree + 1)``.

    By the recursion of Cox and de Boor. The interval of an abscissa is searched from that of the one before.
    """
    first, values = np.empty(len(x), np.int64), np.empty((len(x), degree + 1))
    last, interval = len(knots) - degree - 2, degree
    for i in range(len(x)):
        while interval < last and x[i] >= knots[interval + 1]:
            interval += 1
        while interval > degree and x[i] < knots[interval]:
            interval -= 1
        first[i] = interval - degree
        value = values[i]
        value[0] = 1.0
        for order in range(1, degree + 1):
            carried = 0.0
            for k in range(order):
                right, left = knots[interval + k + 1], knots[interval + k + 1 - order]
                share = value[k] / (right - left)
                value[k] = carried + (right - x[i]) * share
                carried = (x[i] - left) * share
            value[order] = carried
    return first, values


@njit(cache=True, error_model="numpy")
def _combination(first, basis, coefficients):
    """Values ``(M, K)`` of the spline from the B-splines that are not zero."""
    out = np.zeros((len(first), coefficients.shape[1]))
    for i in range(len(first)):
        for k in range(basis.shape[1]):
            for c in range(coefficients.shape[1]):
                out[i, c] += basis[i, k] * coefficients[first[i] + k, c]
    return out
