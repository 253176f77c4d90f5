"""Whitening: one pass of a Kalman filter that takes the allowed errors out of many columns at once.

The differences (`comparison`) are linear in the unknowns (`unknowns`), which move by a known linear law: then the
filter's innovations are white, and their variance is what the allowed errors explain. The same gains applied to the
signature of an effect give what is left of it when the allowed errors have taken all that they can. So a regression
of white differences on white signatures is the exact Gaussian answer, with navigation error correlated in time, and
density error in altitude (design section 6; Friedland, IEEE Trans. AC 14 (1969) 359, for many columns under one gain).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from edl_filter.diagnosis.sparse import FUSED, Sparse, move_rows, pattern, transpose
from edl_filter.diagnosis.threads import THREADS, in_threads, one_blas_thread

Array = NDArray[np.float64]

#: From columns ``(R, c)``, and what each expects of the unknowns at the beginning, to white rows ``(R, c)``.
Whitens = Callable[[Array, Array], Array]

#: Columns from which threads share them.
_MANY = 64


@dataclass(frozen=True)
class Steps:
    """The linear problem, K steps of ``n`` unknowns: move, then measure.

    Attributes
    ----------
    change, noise : Sparse
        Transition less identity, and process noise, of each step.
    rows : (K + 1,) array
        Where each step's rows begin.
    design : (R, n) array
        Rows' slopes in the unknowns.
    row_noise : (R, w) array
        Covariance of the rows' own noise: row of its step's block, which begins at the step's first row.
    start : (n, n) array
        Covariance at the beginning.
    """

    change: Sparse
    noise: Sparse
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
            What each column expects of the unknowns at the beginning; nothing of those at the end that are left out.
        """
        s = self.steps
        begin = np.zeros((len(s.start), start.shape[1]))
        begin[: len(start)] = start
        model = (*pattern(s.change), s.rows, s.design, self.gain, self.factor)

        def white(part: slice) -> Array:
            return _apply(*model, np.ascontiguousarray(columns[:, part]), np.ascontiguousarray(begin[:, part]))

        count = columns.shape[1]
        if count < _MANY:
            with one_blas_thread():
                return white(slice(None))
        cuts = np.linspace(0, count, THREADS + 1).astype(int)
        return np.concatenate(in_threads(white, [slice(a, b) for a, b in pairwise(cuts)]), axis=1)

    def start_covariance(self, count: int) -> Array:
        """Covariance ``(count, count)`` of the first unknowns at the beginning, given all rows.

        The answer of every row to a unit of each unknown is that of a column that expects it.
        """
        unit = np.zeros((len(self.steps.start), count))
        unit[:count] = np.eye(count)
        answers = self(np.zeros((len(self.gain), count)), unit)
        prior = self.steps.start[:count, :count]
        return prior - prior @ (answers.T @ answers) @ prior

    def smoothed(self, white: Array, start: Array) -> tuple[Array, Array]:
        """What all rows say of every unknown, at the beginning ``(n,)`` and at every step ``(K, n)``.

        The fast state smoother: backwards through the rows for what they say of each step's noise, then forwards with
        that noise (Koopman, Biometrika 80 (1993) 117). It needs the gains and no covariance.

        Parameters
        ----------
        white : (R,) array
            The differences.
        start : (n,) array
            What is stated of the unknowns at the beginning.
        """
        s = self.steps
        begin = np.zeros(len(s.start))
        begin[: len(start)] = start
        n = s.noise
        return _smooth(
            s.change.row, s.change.column, s.change.values, n.row, n.column, n.values, s.rows, s.design, self.gain,
            self.factor, white, begin, s.start,
        )  # fmt: skip

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
    n = steps.noise
    with one_blas_thread():
        gain, factor, log_det = _gains(
            *pattern(steps.change), n.row, n.column, n.values, steps.rows, np.ascontiguousarray(steps.design),
            steps.row_noise, steps.start.copy(),
        )  # fmt: skip
    return Whitener(steps, gain, factor, log_det)


@njit(cache=True)
def _coloured(rows, factor, white):
    out = np.zeros_like(white)
    for k in range(rows.size - 1):
        for i in range(rows[k], rows[k + 1]):
            for j in range(i - rows[k] + 1):
                out[i] += factor[i, j] * white[rows[k] + j]
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _gains(moving, first, column, change, noise_row, noise_column, noise, rows, design, row_noise, p):
    """Covariance recursion of the Kalman filter over all steps."""
    gains = np.empty_like(design)
    factor = np.zeros_like(row_noise)
    room, known = np.empty((moving.size, p.shape[0])), np.empty_like(p)
    log_det = 0.0
    for k in range(rows.size - 1):
        move_rows(p, moving, first, column, change[k], room)  # F P, and again on its transpose, P being symmetric
        transpose(p)
        move_rows(p, moving, first, column, change[k], room)
        for z in range(noise_row.size):
            p[noise_row[z], noise_column[z]] += noise[k, z]
        begin, end = rows[k], rows[k + 1]
        m = end - begin
        if m == 0:
            continue
        h = design[begin:end]
        hp = np.dot(h, p)
        low = np.linalg.cholesky(np.dot(hp, h.T) + row_noise[begin:end, :m])
        for i in range(m):
            log_det += 2.0 * np.log(low[i, i])
        solve_lower(low, hp)  # L⁻¹ H P
        np.dot(hp.T, hp, known)
        for i in range(p.shape[0]):  # an array expression would make a matrix at every step
            row, less = p[i], known[i]
            for j in range(p.shape[0]):
                row[j] -= less[j]
        gains[begin:end] = hp
        factor[begin:end, :m] = low
    return gains, factor, log_det


@njit(cache=True, error_model="numpy", fastmath=FUSED)
def solve_lower(low, right):
    """``L⁻¹ right``, in place."""
    for i in range(right.shape[0]):
        row = right[i]
        for j in range(i):
            v, above = low[i, j], right[j]
            for c in range(right.shape[1]):
                row[c] -= v * above[c]
        for c in range(right.shape[1]):
            row[c] /= low[i, i]


@njit(cache=True, error_model="numpy", nogil=True)
def _apply(moving, first, column, change, rows, design, gains, factor, columns, x):
    """State recursion of the Kalman filter for all columns; `x` begins it and is used up."""
    out = np.empty_like(columns)
    room, expected = np.empty((moving.size, x.shape[1])), np.empty((factor.shape[1], x.shape[1]))
    told = np.empty_like(x)
    for k in range(rows.size - 1):
        move_rows(x, moving, first, column, change[k], room)
        begin, end = rows[k], rows[k + 1]
        m = end - begin
        if m == 0:
            continue
        left = out[begin:end]
        np.dot(design[begin:end], x, expected[:m])
        for i in range(m):
            for c in range(x.shape[1]):
                left[i, c] = columns[begin + i, c] - expected[i, c]
        solve_lower(factor[begin:end], left)
        np.dot(gains[begin:end].T, left, told)
        for i in range(x.shape[0]):
            for c in range(x.shape[1]):
                x[i, c] += told[i, c]
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _smooth(row, column, change, noise_row, noise_column, noise, rows, design, gains, factor, white, x, start):
    """Smoothed state at the beginning, which takes the place of `x`, and after each step's move."""
    count, size = rows.size - 1, x.size
    told = np.zeros((count, size))  # what a step's rows and all later ones say of it
    r = np.zeros(size)
    for k in range(count - 1, -1, -1):
        begin, end = rows[k], rows[k + 1]
        if end > begin:
            low = factor[begin:end]
            seen = white[begin:end] - np.dot(gains[begin:end], r)
            for i in range(end - begin - 1, -1, -1):  # L⁻ᵀ
                for j in range(i + 1, end - begin):
                    seen[i] -= low[j, i] * seen[j]
                seen[i] /= low[i, i]
            r += np.dot(design[begin:end].T, seen)
        told[k] = r
        for z in range(row.size):
            r[column[z]] += change[k, z] * told[k, row[z]]
    x += np.dot(start, r)
    first, out = x, np.empty((count, size))
    for k in range(count):
        moved = x.copy()
        for z in range(row.size):
            moved[row[z]] += change[k, z] * x[column[z]]
        for z in range(noise_row.size):
            moved[noise_row[z]] += noise[k, z] * told[k, noise_column[z]]
        x = moved
        out[k] = x
    return first, out
