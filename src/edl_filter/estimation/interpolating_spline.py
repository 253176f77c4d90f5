"""Interpolating spline of odd degree, not-a-knot at both ends.

Input: abscissae and values. Method: B-splines whose knots are the abscissae without those next to the ends, by the
recursion of Cox and de Boor, and the solution of the banded collocation equations (de Boor, A Practical Guide to
Splines, 2001, chapters X and XIII). The same as `scipy.interpolate.make_interp_spline`, whose package takes longer to
import than a record to interpolate. Output: values of the spline and of its derivatives, and
its polynomials.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg import solve_banded

from edl_filter.types import Array

#: Degree of splines through integrals.
DEGREE = 5


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
        inside = (degree + 1) // 2
        ends = np.ones(degree + 1)
        knots = np.concatenate((x[0] * ends, x[inside:-inside], x[-1] * ends))
        bands = _collocation_bands(knots, degree, np.asarray(x, np.float64))
        return cls(knots, solve_banded((degree, degree), bands, y, check_finite=False), degree)

    def __call__(self, x: Array) -> Array:
        """Values ``(M, K)`` at ``(M,)`` abscissae between the first and the last knot."""
        return _evaluate(self.knots, self.degree, self.coefficients, np.asarray(x, np.float64))

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
        factorial, derivative = 1.0, self
        for order in range(self.degree + 1):
            out[order] = derivative(x) / factorial
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


@njit(cache=True, error_model="numpy")
def _collocation_bands(knots, degree, x):
    """Values of the B-splines at the abscissae, as the bands ``(2 degree + 1, N)`` of `scipy.linalg.solve_banded`."""
    bands = np.zeros((2 * degree + 1, len(x)))
    basis = np.empty(degree + 1)
    interval = degree
    for i in range(len(x)):
        interval = _interval(knots, degree, x[i], interval)
        _basis(knots, degree, interval, x[i], basis)
        for k in range(degree + 1):
            column = interval - degree + k
            bands[degree + i - column, column] = basis[k]
    return bands


@njit(cache=True, error_model="numpy")
def _evaluate(knots, degree, coefficients, x):
    """Values ``(M, K)`` at abscissae ``(M,)``."""
    out = np.zeros((len(x), coefficients.shape[1]))
    basis = np.empty(degree + 1)
    interval = degree
    for i in range(len(x)):
        interval = _interval(knots, degree, x[i], interval)
        _basis(knots, degree, interval, x[i], basis)
        for k in range(degree + 1):
            row = coefficients[interval - degree + k]
            for c in range(coefficients.shape[1]):
                out[i, c] += basis[k] * row[c]
    return out


@njit(cache=True, error_model="numpy")
def _interval(knots, degree, x, start):
    """Index of the knot at the beginning of the interval that contains `x`, searched from `start`, which is near."""
    interval = start
    while interval < len(knots) - degree - 2 and x >= knots[interval + 1]:
        interval += 1
    while interval > degree and x < knots[interval]:
        interval -= 1
    return interval


@njit(cache=True, error_model="numpy")
def _basis(knots, degree, interval, x, out):
    """Values ``(degree + 1,)`` of the B-splines that are not zero in an interval (Cox and de Boor)."""
    out[0] = 1.0
    for order in range(1, degree + 1):
        carried = 0.0
        for k in range(order):
            right, left = knots[interval + k + 1], knots[interval + k + 1 - order]
            share = out[k] / (right - left)
            out[k] = carried + (right - x) * share
            carried = (x - left) * share
        out[order] = carried
