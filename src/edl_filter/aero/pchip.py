"""Monotone piecewise cubic interpolation (PCHIP): coefficients of the polynomials, and their values.

Input: nodes and values. Method: cubic Hermite polynomials whose slopes are weighted harmonic means of the slopes of
the neighbouring intervals, zero where these have different signs (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5
(1984) 300; Moler, Numerical Computing with MATLAB, 2004, section 3.6), so that the curve has no extremum between the
nodes. The same as `scipy.interpolate.PchipInterpolator`, whose package takes longer to import than a table to look up.
"""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array


def pchip_coefficients(nodes: Array, values: Array) -> Array:
    """Coefficients of the cubic polynomial of each interval.

    Parameters
    ----------
    nodes : (N,) array
        Increasing, N ≥ 2.
    values : (N, ...) array
        At the nodes.

    Returns
    -------
    (4, N - 1, ...) array
        Highest power first, in the distance from the interval's first node.
    """
    step = np.diff(nodes).reshape(-1, *(1,) * (values.ndim - 1))
    slope = np.diff(values, axis=0) / step
    derivative = _derivatives(step, slope)
    excess = (derivative[:-1] + derivative[1:] - 2.0 * slope) / step
    return np.stack([excess / step, (slope - derivative[:-1]) / step - excess, derivative[:-1], values[:-1]])


def piecewise_cubic(nodes: Array, coefficients: Array, x: Array) -> Array:
    """Values of piecewise cubic polynomials.

    Parameters
    ----------
    nodes : (N,) array
        Increasing.
    coefficients : (4, N - 1, ...) array
        Of `pchip_coefficients`.
    x : (M,) array
        Between the first and the last node.

    Returns
    -------
    (M, ...) array
    """
    interval = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
    distance = (x - nodes[interval]).reshape(-1, *(1,) * (coefficients.ndim - 2))
    c = coefficients[:, interval]
    return ((c[0] * distance + c[1]) * distance + c[2]) * distance + c[3]


def _derivatives(step: Array, slope: Array) -> Array:
    """Derivatives (N, ...) at the nodes from steps (N - 1, 1, ...) and slopes (N - 1, ...) of the intervals."""
    if len(slope) == 1:
        return np.concatenate((slope, slope))
    first, second = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
    flat = (np.sign(slope[1:]) != np.sign(slope[:-1])) | (slope[1:] == 0.0) | (slope[:-1] == 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (first + second) / (first / slope[:-1] + second / slope[1:])
    inner = np.where(flat, 0.0, mean)
    ends = [_end_derivative(step[i], step[k], slope[i], slope[k])[None] for i, k in ((0, 1), (-1, -2))]
    return np.concatenate((ends[0], inner, ends[1]))


def _end_derivative(step: Array, next_step: Array, slope: Array, next_slope: Array) -> Array:
    """Derivative (...) at an end: of three points, limited so that the curve stays monotone."""
    derivative = ((2.0 * step + next_step) * slope - step * next_slope) / (step + next_step)
    opposite = np.sign(derivative) != np.sign(slope)
    steep = (np.sign(slope) != np.sign(next_slope)) & (np.abs(derivative) > 3.0 * np.abs(slope))
    return np.where(opposite, 0.0, np.where(steep, 3.0 * slope, derivative))
