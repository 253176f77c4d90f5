"""What the whole flight says of each row: the differences weighed by the inverse of their covariance.

With C the covariance of all differences y, as the allowed errors and the rows' noise make it, this gives ``C⁻¹ y`` and
the diagonal of ``C⁻¹``. Half the square of the one less half the other is the slope of the log-likelihood in the
variance of a row's own noise. An innovation knows only what came before it; here every row is judged by all others.

The disturbance smoother, backwards through the gains of the filter (de Jong, Biometrika 76 (1989) 79; Koopman,
Biometrika 80 (1993) 117). With L the Cholesky factor of a step's innovation covariance, G its gains (`Whitener`), H
its design, e its white rows, r what all later rows say of the unknowns and N the covariance of that::

    u = L⁻ᵀ (e - G r)                D = L⁻ᵀ (1 + G N Gᵀ) L⁻¹
    r ← r + Hᵀ u                     N ← N + Hᵀ D H - Hᵀ L⁻ᵀ G N - N Gᵀ L⁻¹ H

and through the step's move F: ``r ← Fᵀ r``, ``N ← Fᵀ N F``.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from edl_filter.diagnosis.sparse import move_rows, pattern, transpose
from edl_filter.diagnosis.threads import one_blas_thread
from edl_filter.diagnosis.whitening import Whitener, solve_lower

Array = NDArray[np.float64]


def in_hindsight(whiten: Whitener, white: Array) -> tuple[Array, Array]:
    """``C⁻¹ y`` and the diagonal of ``C⁻¹``, ``(R,)`` each.

    Parameters
    ----------
    whiten : Whitener
    white : (R,) array
        The differences y, white.
    """
    s = whiten.steps
    with one_blas_thread():
        return _backwards(*pattern(s.change.transposed), s.rows, s.design, whiten.gain, whiten.factor, white)


@njit(cache=True, error_model="numpy", nogil=True)
def _backwards(moving, first, column, change, rows, design, gains, factor, white):
    size = design.shape[1]
    weighed, diagonal = np.empty_like(white), np.empty_like(white)
    r, n = np.zeros((size, 1)), np.zeros((size, size))
    room, room_r = np.empty((moving.size, size)), np.empty((moving.size, 1))
    for k in range(rows.size - 2, -1, -1):
        begin, end = rows[k], rows[k + 1]
        m = end - begin
        if m > 0:
            inverse = np.eye(m)
            solve_lower(factor[begin:end], inverse)
            g = gains[begin:end]
            gn, h = np.dot(g, n), np.dot(inverse, design[begin:end])
            seen = white[begin:end] - np.dot(g, r)[:, 0]
            spread = np.dot(gn, g.T)
            for i in range(m):
                spread[i, i] += 1.0
            whole = np.dot(inverse.T, np.dot(spread, inverse))
            weighed[begin:end] = np.dot(inverse.T, seen)
            for i in range(m):
                diagonal[begin + i] = whole[i, i]
            r[:, 0] += np.dot(h.T, seen)
            half = np.dot(h.T, 0.5 * np.dot(spread, h) - gn)
            for i in range(size):  # the symmetric part, or rounding grows from step to step
                for j in range(i + 1):
                    n[i, j] += half[i, j] + half[j, i]
                    n[j, i] = n[i, j]
        move_rows(r, moving, first, column, change[k], room_r)
        move_rows(n, moving, first, column, change[k], room)
        transpose(n)
        move_rows(n, moving, first, column, change[k], room)
    return weighed, diagonal
