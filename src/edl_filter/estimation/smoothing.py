"""Backward recursions through the gains of a Kalman filter: all that the whole record implies for each step.

Notation of `edl_filter.estimation.kalman`: L Cholesky factor of a step's innovation covariance, G its gains
(`WhiteningFilter.gain`), H its design matrix, e its white rows, F = I + D its transition matrix.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve

from edl_filter.estimation.block_sparse import FUSED, row_pattern, transform_both_sides, transform_columns
from edl_filter.estimation.kalman import WhiteningFilter, solve_lower
from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.types import Array


def precision_weighted_residuals(whiten: WhiteningFilter, white: Array) -> tuple[Array, Array]:
    """``C⁻¹ y`` and the diagonal of ``C⁻¹``, with C the covariance of all measurements y.

    Half the square of the former less half the latter is the derivative of the log-likelihood with respect to the
    variance of a row's own noise. The disturbance smoother (de Jong, Biometrika 76 (1989) 79; Koopman, Biometrika 80
    (1993) 117), with r the adjoint of the states and N its covariance, from the last step backwards::

        u = L⁻ᵀ (e - G r)                M = L⁻ᵀ (1 + G N Gᵀ) L⁻¹
        r ← r + Hᵀ u                     N ← N + Hᵀ M H - Hᵀ L⁻ᵀ G N - N Gᵀ L⁻¹ H

    and through the step's transition: ``r ← Fᵀ r``, ``N ← Fᵀ N F``.

    Parameters
    ----------
    whiten : WhiteningFilter
        The whitening filter.
    white : (R,) array
        White rows of y.

    Returns
    -------
    weighted, diagonal : (R,) arrays
    """
    s = whiten.model
    transposed = s.increment.transposed
    with one_blas_thread():
        return _precision_weighted(
            row_pattern(transposed), transposed.values, s.row_start, s.design, whiten.gain, whiten.factor, white
        )


def smoothed_states(whiten: WhiteningFilter, white: Array, initial_mean: Array) -> tuple[Array, Array]:
    """Posterior mean of the states at the beginning and after the transition of every step, given all measurements.

    The fast state smoother: backwards for the adjoint of each step's process noise, then forwards with the noise that
    it implies (Koopman, Biometrika 80 (1993) 117). It needs the gains and no covariance.

    Parameters
    ----------
    whiten : WhiteningFilter
        The whitening filter.
    white : (R,) array
        White rows of the measurements.
    initial_mean : (m,) array
        Prior mean of the first m states; the others have zero mean.

    Returns
    -------
    initial : (n,) array
    states : (K, n) array
    """
    s, q = whiten.model, whiten.model.process_noise
    return _smoothed_states(
        s.increment.row, s.increment.column, s.increment.values, q.row, q.column, q.values, s.row_start, s.design,
        whiten.gain, whiten.factor, white, s.initial_mean(initial_mean), s.initial_covariance,
    )  # fmt: skip


def smoothed_last_states(whiten: WhiteningFilter, white: Array, initial_mean: Array, count: int) -> tuple[Array, Array]:
    """Posterior mean and covariance of the last `count` states after the transition of every step.

    The modified Bryson–Frazier smoother (Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch.
    10), which needs the gains of the filter and no inverse of a covariance.

    Parameters
    ----------
    whiten : WhiteningFilter
        The whitening filter.
    white : (R,) array
        White rows of the measurements.
    initial_mean : (m,) array
        Prior mean of the first m states; the others have zero mean.
    count : int
        Number of states, the last ones of the vector.

    Returns
    -------
    mean : (K, count) array
    covariance : (K, count, count) array
    """
    s, q = whiten.model, whiten.model.process_noise
    transposed = s.increment.transposed
    with one_blas_thread():
        predicted, cross = _predicted_last_states(
            row_pattern(s.increment), s.increment.values, q.row, q.column, q.values, s.row_start, whiten.gain, white,
            s.initial_mean(initial_mean)[:, None].copy(), s.initial_covariance.copy(), count,
        )  # fmt: skip
        return _correct_last_states(
            row_pattern(transposed), transposed.values, s.row_start, s.design, whiten.gain, whiten.factor, white,
            predicted, cross,
        )  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FUSED)
def _predicted_last_states(pattern, increment, q_row, q_column, q_values, row_start, gains, white, x, p, count):
    """Predicted means ``(K, count)``, covariances with all states ``(K, count, n)``; `x` ``(n, 1)``, `p` at start."""
    steps, size = row_start.size - 1, p.shape[0]
    predicted, cross = np.empty((steps, count)), np.empty((steps, count, size))
    propagated = np.empty_like(p)
    work, work_x = np.empty((pattern.rows.size, size)), np.empty((pattern.rows.size, 1))
    for k in range(steps):
        transform_columns(x, pattern, increment[k], work_x)
        transform_both_sides(p, propagated, pattern, increment[k], work)
        p, propagated = propagated, p
        for z in range(q_row.size):
            p[q_row[z], q_column[z]] += q_values[k, z]
        predicted[k], cross[k] = x[size - count :, 0], p[size - count :]
        begin, end = row_start[k], row_start[k + 1]
        if end > begin:
            gain = gains[begin:end]
            x[:, 0] += np.dot(gain.T, white[begin:end])
            p -= np.dot(gain.T, gain)
    return predicted, cross


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FUSED)
def _correct_last_states(pattern, increment, row_start, design, gains, factor, white, predicted, cross):
    """Corrections of the predicted moments by all later measurements; rows of the transposed transition matrices."""
    steps, count, size = cross.shape
    mean, covariance = np.empty((steps, count)), np.empty((steps, count, count))
    r, n, propagated = np.zeros((size, 1)), np.zeros((size, size)), np.empty((size, size))
    work, work_r = np.empty((pattern.rows.size, size)), np.empty((pattern.rows.size, 1))
    for k in range(steps - 1, -1, -1):
        begin, end = row_start[k], row_start[k + 1]
        if end > begin:
            g, h = gains[begin:end], design[begin:end].copy()
            solve_lower(factor[begin:end], h)  # L⁻¹ H
            residual = white[begin:end] - np.dot(g, r)[:, 0]
            r[:, 0] += np.dot(h.T, residual)
            _add_information(n, g, h)
        mean[k] = predicted[k] + np.dot(cross[k], r)[:, 0]
        covariance[k] = cross[k][:, size - count :] - np.dot(np.dot(cross[k], n), cross[k].T)
        transform_columns(r, pattern, increment[k], work_r)
        transform_both_sides(n, propagated, pattern, increment[k], work)
        n, propagated = propagated, n
    return mean, covariance


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FUSED, inline="always")
def _add_information(n, g, h):
    """Add the information of a step's rows to the covariance of the adjoint, ``N ← (1 - GᵀH)ᵀ N (1 - GᵀH) + HᵀH``.

    `g` are the step's gains and `h` its white design ``L⁻¹ H``. Returns ``1 + G N Gᵀ`` with N before the addition.
    """
    gn = np.dot(g, n)
    spread = np.dot(gn, g.T)
    for i in range(spread.shape[0]):
        spread[i, i] += 1.0
    half = np.dot(h.T, 0.5 * np.dot(spread, h) - gn)
    for i in range(n.shape[0]):  # the symmetric part, or rounding errors grow from step to step
        for j in range(i + 1):
            n[i, j] += half[i, j] + half[j, i]
            n[j, i] = n[i, j]
    return spread


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FUSED)
def _precision_weighted(pattern, increment, row_start, design, gains, factor, white):
    size = design.shape[1]
    weighted, diagonal = np.empty_like(white), np.empty_like(white)
    r, n, propagated = np.zeros((size, 1)), np.zeros((size, size)), np.empty((size, size))
    work, work_r = np.empty((pattern.rows.size, size)), np.empty((pattern.rows.size, 1))
    for k in range(row_start.size - 2, -1, -1):
        begin, end = row_start[k], row_start[k + 1]
        m = end - begin
        if m > 0:
            inverse = np.eye(m)
            solve_lower(factor[begin:end], inverse)
            g = gains[begin:end]
            h = np.dot(inverse, design[begin:end])
            residual = white[begin:end] - np.dot(g, r)[:, 0]
            spread = _add_information(n, g, h)
            precision = np.dot(inverse.T, np.dot(spread, inverse))
            weighted[begin:end] = np.dot(inverse.T, residual)
            for i in range(m):
                diagonal[begin + i] = precision[i, i]
            r[:, 0] += np.dot(h.T, residual)
        transform_columns(r, pattern, increment[k], work_r)
        transform_both_sides(n, propagated, pattern, increment[k], work)
        n, propagated = propagated, n
    return weighted, diagonal


@njit(cache=True, error_model="numpy", nogil=True)
def _smoothed_states(
    row, column, increment, q_row, q_column, q_values, row_start, design, gains, factor, white, x, initial_covariance
):
    """Smoothed states; `x` holds the prior mean at the beginning."""
    count, size = row_start.size - 1, x.size
    adjoint = np.zeros((count, size))  # of each step's rows and all later ones
    r = np.zeros(size)
    for k in range(count - 1, -1, -1):
        begin, end = row_start[k], row_start[k + 1]
        if end > begin:
            lower = factor[begin:end]
            residual = white[begin:end] - np.dot(gains[begin:end], r)
            for i in range(end - begin - 1, -1, -1):  # L⁻ᵀ
                for j in range(i + 1, end - begin):
                    residual[i] -= lower[j, i] * residual[j]
                residual[i] /= lower[i, i]
            r += np.dot(design[begin:end].T, residual)
        adjoint[k] = r
        for z in range(row.size):
            r[column[z]] += increment[k, z] * adjoint[k, row[z]]
    x += np.dot(initial_covariance, r)
    initial, out = x, np.empty((count, size))
    for k in range(count):
        state = x.copy()
        for z in range(row.size):
            state[row[z]] += increment[k, z] * x[column[z]]
        for z in range(q_row.size):
            state[q_row[z]] += q_values[k, z] * adjoint[k, q_column[z]]
        x = state
        out[k] = x
    return initial, out


# Rauch-Tung-Striebel smoother


def smoother_gain(cross_covariance: Array, predicted_covariance: Array) -> Array:
    """Gain of the Rauch-Tung-Striebel smoother, ``G = C (P⁻)⁻¹``.

    With the cross-covariance in place of ``P Fᵀ`` the gain is that of any Gaussian filter, linear, extended or
    unscented (Särkkä 2013, Bayesian Filtering and Smoothing, theorem 8.2 and chapter 9).

    Parameters
    ----------
    cross_covariance : (n, m) array
        C, of the state at a step, given the data up to it, with the state at the next step.
    predicted_covariance : (m, m) array
        P⁻, of the state at the next step, given the data up to this one. Positive definite.

    Returns
    -------
    (n, m) array
    """
    return np.asarray(cho_solve(cho_factor(predicted_covariance, check_finite=False), cross_covariance.T).T)


def smoothed_moments(
    mean: Array, covariance: Array, gain: Array, mean_change: Array, covariance_change: Array
) -> tuple[Array, Array]:
    """Mean and covariance of the state at a step given all data, from those at the next step.

    One step backwards of the Rauch-Tung-Striebel smoother (Särkkä 2013, theorem 8.2).

    Parameters
    ----------
    mean : (n,) array
        Of the state given the data up to this step.
    covariance : (n, n) array
        Of the same estimate.
    gain : (n, m) array
        `smoother_gain` to the next step.
    mean_change : (m,) array
        Mean of the state at the next step given all data, minus its mean given the data up to this step.
    covariance_change : (m, m) array
        The same difference of the covariances; negative semidefinite.

    Returns
    -------
    mean : (n,) array
        ``x + G (xˢ⁺ - x⁻)``.
    covariance : (n, n) array
        ``P + G (Pˢ⁺ - P⁻) Gᵀ``, made symmetric to the last bit.
    """
    smoothed = covariance + gain @ covariance_change @ gain.T
    return mean + gain @ mean_change, 0.5 * (smoothed + smoothed.T)


def smoothed_joint_covariance(covariance: Array, gain: Array, steps: Sequence[int], designs: Sequence[Array]) -> Array:
    """Covariance of linear functions of the smoothed states at several steps, with the correlation between the steps.

    A state's error is the gain times the error at the next step, and a part that is independent of all later ones
    (Särkkä 2013, section 8.2). The covariance of the smoothed states at the steps ``i < j`` is therefore
    ``G_i … G_{j-1} Pˢ_j``; its products with the designs are carried backwards from step to step.

    Parameters
    ----------
    covariance : (K, n, n) array
        Pˢ of every step, given all data.
    gain : (K - 1, n, n) array
        `smoother_gain` from each step to the next.
    steps : sequence of int
        Step of each function, in the order of time; a step may occur several times.
    designs : sequence of (m, n) arrays
        H of each function ``H x``; m may differ.

    Returns
    -------
    (M, M) array
        M components of all functions in their order.
    """
    joint = np.zeros((0, 0))
    later = np.zeros((covariance.shape[1], 0))  # of the state at `step` with the functions of later steps
    step = len(covariance) - 1
    for k, design in zip(reversed(steps), reversed(designs), strict=True):
        while step > k:
            step -= 1
            later = gain[step] @ later
        with_state, cross = covariance[k] @ design.T, design @ later
        joint = np.block([[design @ with_state, cross], [cross.T, joint]])
        later = np.concatenate((with_state, later), axis=1)
    return joint
