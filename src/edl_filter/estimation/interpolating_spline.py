"""Interpolating spline of odd degree, not-a-knot at both ends.

Input: abscissae and values. Method: B-splines whose knots are the abscissae without those next to the ends, by the
recursion of Cox and de Boor, and the solution of the banded collocation equations (de Boor, A Practical Guide to
Splines, 2001, chapters X and XIII). The same as `scipy.interpolate.make_interp_spline`, whose package takes longer to
import than a record to interpolate. Output: values of the spline and of its derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from edl_filter.types import Array, IntArray


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
        first, basis = _basis(knots, degree, x)
        bands = np.zeros((2 * degree + 1, len(x)))
        columns = first[:, None] + np.arange(degree + 1)
        bands[degree + np.arange(len(x))[:, None] - columns, columns] = basis
        return cls(knots, solve_banded((degree, degree), bands, y), degree)

    def __call__(self, x: Array) -> Array:
        """Values ``(M, K)`` at ``(M,)`` abscissae between the first and the last knot."""
        first, basis = _basis(self.knots, self.degree, x)
        return np.einsum("mk,mkc->mc", basis, self.coefficients[first[:, None] + np.arange(self.degree + 1)])

    def derivative(self, order: int = 1) -> InterpolatingSpline:
        """Derivative of an order up to the degree, a spline of lower degree (de Boor 2001, X (16))."""
        if order == 0:
            return self
        spans = self.knots[self.degree + 1 : -1] - self.knots[1 : -self.degree - 1]
        slopes = self.degree * np.diff(self.coefficients, axis=0) / spans[:, None]
        return InterpolatingSpline(self.knots[1:-1], slopes, self.degree - 1).derivative(order - 1)


def _basis(knots: Array, degree: int, x: Array) -> tuple[IntArray, Array]:
    """Index (M,) of the first B-spline that is not zero at each x (M,), and the values (M, degree + 1)."""
    last = len(knots) - degree - 2
    interval = np.clip(np.searchsorted(knots, x, side="right") - 1, degree, last)
    values = np.zeros((degree + 1, len(x)))
    values[0] = 1.0
    for order in range(1, degree + 1):
        carried = np.zeros(len(x))
        for k in range(order):
            right, left = knots[interval + k + 1], knots[interval + k + 1 - order]
            share = values[k] / (right - left)
            values[k] = carried + (right - x) * share
            carried = (x - left) * share
        values[order] = carried
    return interval - degree, values.T
