"""Whitening: one pass of a Kalman filter that takes the allowed errors out of many columns at once.

The differences (`comparison`) are linear in the unknowns (`unknowns`), which move by a known linear law: then the
filter's innovations are white, and their variance is what the allowed errors explain. The same gains applied to the
signature of an effect give what is left of it when the allowed errors have taken all that they can. So a regression
of white differences on white signatures is the exact Gaussian answer, with navigation error correlated in time, and
density error in altitude (design section 6; Friedland, IEEE Trans. AC 14 (1969) 359, for many columns under one gain).
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

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
class Whitener:
    """The gains of the filter, which are the same for every column.

    Attributes
    ----------
    steps : Steps
    gain : (R, n) array
        ``P Hᵀ L⁻ᵀ`` of each step, transposed: what a white row moves.
    factor : (R, w) array
        L, the Cholesky factor of each step's innovation covariance.
    log_determinant : float
        Of the innovations' covariance, over the whole flight.
    """

    steps: Steps
    gain: Array
    factor: Array
    log_determinant: float

    def __call__(self, columns: Array, start: Array) -> Array:
        """White rows ``(R, c)``: of unit variance and independent, if the allowed errors are all there is.

        Parameters
        ----------
        columns : (R, c) array
            Differences and signatures.
        start : (n, c) array
            What each column expects of the unknowns at the beginning.
        """
        s = self.steps
        with _one_thread():
            return _apply(
                s.move, s.rows, s.design, self.gain, self.factor,
                np.ascontiguousarray(columns), np.ascontiguousarray(start),
            )  # fmt: skip

    def start_correction(self, white: Array, count: int) -> tuple[Array, Array]:
        """What all rows say of the first `count` unknowns at the beginning, beyond what was stated of them.

        Fixed-point smoothing: the answer of every row to a unit of each unknown is that of a column that expects it.

        Parameters
        ----------
        white : (R,) array
            The differences.
        count : int

        Returns
        -------
        mean : (count,) array
        covariance : (count, count) array
            Before: `steps.start`.
        """
        unit = np.zeros((len(self.steps.start), count))
        unit[:count] = np.eye(count)
        answers = self(np.zeros((len(white), count)), unit)
        prior = self.steps.start[:count, :count]
        mean = -prior @ (answers.T @ white)
        return mean, prior - prior @ (answers.T @ answers) @ prior

    def innovations(self, white: Array) -> Array:
        """The innovations ``(R,)`` behind white rows, in their own units."""
        return _coloured(self.steps.rows, self.factor, white)

    @property
    def innovation_sigma(self) -> Array:
        """One sigma of each innovation ``(R,)``."""
        return np.sqrt(np.sum(self.factor**2, axis=1))

    def log_likelihood(self, white: Array) -> float:
        """Of the column that became `white` ``(R,)``, up to a constant of the flight."""
        return -0.5 * float(white @ white) - 0.5 * self.log_determinant


def whitener(steps: Steps) -> Whitener:
    """Run the covariances once."""
    design = np.ascontiguousarray(steps.design)
    # rows that no step moves need not be multiplied
    moves = np.any(steps.move != np.eye(len(steps.start)), axis=(0, 2))
    with _one_thread():
        gain, factor, log_det = _gains(
            np.flatnonzero(moves), np.ascontiguousarray(steps.move[:, moves]), steps.noise, steps.rows, design,
            steps.row_noise, steps.start.copy(),
        )  # fmt: skip
    return Whitener(steps, gain, factor, log_det)


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def _one_thread() -> AbstractContextManager[object]:
    """Small matrices in a long loop: threads that wait for each other cost ten times what they save."""
    return _blas().limit(limits=1, user_api="blas")


@njit(cache=True)
def _coloured(rows, factor, white):
    out = np.zeros_like(white)
    for k in range(rows.size - 1):
        for i in range(rows[k], rows[k + 1]):
            for j in range(i - rows[k] + 1):
                out[i] += factor[i, j] * white[rows[k] + j]
    return out


@njit(cache=True, error_model="numpy")
def _gains(moving, move, noise, rows, design, row_noise, p):
    """Covariance recursion of the Kalman filter over all steps; `move` has the rows `moving` only."""
    gains = np.empty_like(design)
    factor = np.zeros_like(row_noise)
    log_det = 0.0
    for k in range(rows.size - 1):
        moved = np.dot(move[k], p)
        for i in range(moving.size):
            p[moving[i]] = moved[i]
        across = np.dot(p, move[k].T)
        for i in range(moving.size):
            p[:, moving[i]] = across[:, i]
        p += noise[k]
        first, last = rows[k], rows[k + 1]
        m = last - first
        if m == 0:
            continue
        h = design[first:last]
        ph = np.dot(p, h.T)
        low = np.linalg.cholesky(np.dot(h, ph) + row_noise[first:last, :m])
        for i in range(m):
            log_det += 2.0 * np.log(low[i, i])
        gain = np.linalg.solve(low, ph.T.copy())  # L⁻¹ H P
        p -= np.dot(gain.T.copy(), gain)
        gains[first:last] = gain
        factor[first:last, :m] = low
    return gains, factor, log_det


@njit(cache=True, error_model="numpy")
def _apply(move, rows, design, gains, factor, columns, start):
    """State recursion of the Kalman filter for all columns."""
    out = np.empty_like(columns)
    x = start.copy()
    for k in range(rows.size - 1):
        x = np.dot(move[k], x)
        first, last = rows[k], rows[k + 1]
        m = last - first
        if m == 0:
            continue
        left = columns[first:last] - np.dot(design[first:last], x)
        for i in range(m):  # forward substitution
            for j in range(i):
                left[i] -= factor[first + i, j] * left[j]
            left[i] /= factor[first + i, i]
        x = x + np.dot(gains[first:last].T.copy(), left)
        out[first:last] = left
    return out
