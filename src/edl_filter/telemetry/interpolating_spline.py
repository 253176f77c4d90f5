"""Interpolating spline of odd degree, not-a-knot at both ends.

Input: abscissae and values. Method: B-splines whose knots are the abscissae without those next to the ends, by the
recursion of Cox and de Boor, and the solution of the banded collocation equations (de Boor, A Practical Guide to
Splines, 2001, chapters X and XIII). The same as `scipy.interpolate.make_interp_spline`, whose package takes longer to
import than a record to interpolate. Output: values of the spline.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded

from edl_filter.types import Array, IntArray


def interpolating_spline(x: Array, y: Array, degree: int, at: Array) -> Array:
    """Values of the spline through given points.

    Parameters
    ----------
    x : (N,) array
        Increasing, N > `degree`.
    y : (N, K) array
        Values at `x`.
    degree : int
        Odd.
    at : (M,) array
        Between ``x[0]`` and ``x[-1]``.

    Returns
    -------
    (M, K) array
    """
    inside = (degree + 1) // 2
    ends = np.ones(degree + 1)
    knots = np.concatenate((x[0] * ends, x[inside:-inside], x[-1] * ends))
    first, basis = _basis(knots, degree, x)
    bands = np.zeros((2 * degree + 1, len(x)))
    columns = first[:, None] + np.arange(degree + 1)
    bands[degree + np.arange(len(x))[:, None] - columns, columns] = basis
    coefficients = solve_banded((degree, degree), bands, y)
    first, basis = _basis(knots, degree, at)
    return np.einsum("mk,mkc->mc", basis, coefficients[first[:, None] + np.arange(degree + 1)])


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
