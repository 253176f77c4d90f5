"""Interpolating spline of odd degree, not-a-knot at both ends.

Input: abscissae and values. Method: B-splines whose knots are the abscissae without those next to the ends, by the
recursion of Cox and de Boor, and the solution of the banded collocation equations (de Boor, A Practical Guide to
Splines, 2001, chapters X and XIII). The same as `scipy.interpolate.make_interp_spline`, whose package takes longer to
import than a record to interpolate. Output: values of the spline and of its derivatives, and its polynomials.
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
        first, basis = _basis(knots, degree, np.asarray(x, np.float64))
        bands = np.zeros((2 * degree + 1, len(x)))
        columns = first[:, None] + np.arange(degree + 1)
        bands[degree + np.arange(len(x))[:, None] - columns, columns] = basis
        return cls(knots, solve_banded((degree, degree), bands, y), degree)

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
