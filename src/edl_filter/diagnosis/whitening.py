"""Whitening: one pass of a Kalman filter that takes the allowed errors out of many columns at once.

The differences (`comparison`) are linear in the unknowns (`unknowns`), which move by a known linear law: then the
filter's innovations are white, and their variance is what the allowed errors explain. The same gains applied to the
signature of an effect give what is left of it when the allowed errors have taken all that they can. So a regression of
white differences on white signatures is the exact Gaussian answer, with navigation error correlated in time, and density
error in altitude (design section 6; Friedland, IEEE Trans. AC 14 (1969) 359, for many columns under one gain).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Steps:
    """The linear problem, K steps of ``n`` unknowns: move, then measure.

    Attributes
    ----------
    move, noise : (K, n, n) arrays
        Transition and process noise of each step.
    rows : (K + 1,) array
        Where each step's rows begin.
    design : (R, n) array
        Rows' slopes in the unknowns.
    row_noise : (R, w) array
        Covariance of the rows' own noise: row of its step's block, which begins at the step's first row.
    start : (n, n) array
        Covariance at the beginning.
    """

    move: Array
    noise: Array
    rows: NDArray[np.int64]
    design: Array
    row_noise: Array
    start: Array


@dataclass(frozen=True)
class White:
    """White rows: of unit variance and independent, if the allowed errors are all there is.

    Attributes
    ----------
    rows : (R, c) array
        Innovations over their Cholesky factor, a column for each that was given.
    log_determinant : float
        Of the innovations' covariance, over the whole flight.
    """

    rows: Array
    log_determinant: float


def whiten(steps: Steps, columns: Array, start: Array) -> White:
    """Pass columns through the filter.

    Parameters
    ----------
    steps : Steps
    columns : (R, c) array
        Differences and signatures.
    start : (n, c) array
        What each column expects of the unknowns at the beginning.
    """
    rows, log_det = _pass(
        steps.move, steps.noise, steps.rows, np.ascontiguousarray(steps.design), steps.row_noise, steps.start.copy(),
        np.ascontiguousarray(columns), np.ascontiguousarray(start).copy(),
    )  # fmt: skip
    return White(rows, log_det)


@njit(cache=True, error_model="numpy")
def _pass(move, noise, rows, design, row_noise, p, columns, x):
    """Kalman filter over all steps; `p` and `x` are changed in place."""
    out = np.empty_like(columns)
    log_det = 0.0
    for k in range(rows.size - 1):
        p = np.dot(np.dot(move[k], p), move[k].T) + noise[k]
        x = np.dot(move[k], x)
        first, last = rows[k], rows[k + 1]
        m = last - first
        if m == 0:
            continue
        h = design[first:last]
        ph = np.dot(p, h.T)
        low = np.linalg.cholesky(np.dot(h, ph) + row_noise[first:last, :m])
        for i in range(m):
            log_det += 2.0 * np.log(low[i, i])
        white = np.linalg.solve(low, columns[first:last] - np.dot(h, x))
        gain = np.linalg.solve(low, ph.T.copy()).T.copy()  # P Hᵀ L⁻ᵀ
        x = x + np.dot(gain, white)
        p = p - np.dot(gain, gain.T)
        p = 0.5 * (p + p.T)
        out[first:last] = white
    return out, log_det
