"""The Kalman filter that whitens measurements under a linear-Gaussian state-space model (`linear_state_space`).

The innovations of the Kalman filter, divided by the Cholesky factor of their covariance, are independent and of unit
variance: the filter multiplies the measurements by the inverse square root of their covariance without forming it, and
gives the log-likelihood (Durbin and Koopman, Time Series Analysis by State Space Methods, 2012, ch. 4 and 7). The gains
do not depend on the measurements, so the same gains whiten any number of columns: measurements, and regressors whose
states are marginalised (augmented Kalman filter: Friedland, IEEE Trans. AC 14 (1969) 359; de Jong, Annals of Statistics
19 (1991) 1073).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit

from edl_filter.estimation.block_sparse import (
    FUSED,
    row_pattern,
    transform_both_sides,
    transform_columns,
    transform_rows,
)
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.estimation.parallel import WORKERS, map_threads, one_blas_thread
from edl_filter.estimation.small_matrices import symmetric_part
from edl_filter.types import Array

#: From columns ``(R, c)`` and their initial means ``(n, c)`` to white rows ``(R, c)``.
Whitening = Callable[[Array, Array], Array]

#: Number of columns from which several threads share them.
_MANY_COLUMNS = 64
#: Largest number of columns that one thread whitens in one pass: its arrays are small compared with the result.
_PASS_COLUMNS = 64
#: Steps after which the products of white columns are added to those of the steps before.
_STEPS_PER_SUM = 64


@dataclass(frozen=True)
class WhiteningFilter:
    """Gains of the Kalman filter of a model, which are the same for every column.

    Attributes
    ----------
    model : LinearStateSpace
    gain : (R, n) array
        ``(P Hᵀ L⁻ᵀ)ᵀ`` of each step: the change of the states by a unit of each white row.
    factor : (R, w) array
        L, the Cholesky factor of each step's innovation covariance.
    log_determinant : float
        Of the covariance of all measurements.
    """

    model: LinearStateSpace
    gain: Array
    factor: Array
    log_determinant: float

    def __call__(self, columns: Array, initial_mean: Array) -> Array:
        """White rows ``(R, c)``: independent and of unit variance where the model holds.

        Parameters
        ----------
        columns : (R, c) array
            Measurements and regressors.
        initial_mean : (m, c) array
            Mean of the first m states under each column; the other states have zero mean.
        """
        s = self.model
        states = s.initial_mean(initial_mean)
        recursion = (row_pattern(s.increment), s.increment.values, s.row_start, s.design, self.gain, self.factor)

        def whiten(part: slice) -> Array:
            return _whiten(*recursion, np.ascontiguousarray(columns[:, part]), np.ascontiguousarray(states[:, part]))

        def write(part: slice) -> None:
            out[:, part] = whiten(part)

        count = columns.shape[1]
        if count < _MANY_COLUMNS:
            with one_blas_thread():
                return whiten(slice(None))
        out = np.empty(columns.shape)
        map_threads(write, _passes(count))
        return out

    def normal_equations(self, columns: Callable[[slice], Array], count: int, white: Array) -> tuple[Array, Array]:
        """``WᵀW`` and ``Wᵀe`` of white columns W ``(R, c)`` and white rows e ``(R,)``; W is not kept.

        Parameters
        ----------
        columns : callable
            From a slice of rows to these rows of the columns, ``(r, c)``; their initial means are zero.
        count : int
            c.
        white : (R,) array
            White rows.

        Returns
        -------
        (c, c), (c,) arrays
        """
        s, pattern, passes = self.model, row_pattern(self.model.increment), _passes(count)
        states = [np.zeros((s.size, part.stop - part.start)) for part in passes]

        def whiten(first: int, last: int, rows: slice) -> Array:
            row_start, increment = s.row_start[first : last + 1] - rows.start, s.increment.values[first:last]
            design, gain, factor = s.design[rows], self.gain[rows], self.factor[rows]
            part = columns(rows)
            out = np.empty(part.shape)

            def write(k: int) -> None:
                of_pass = np.ascontiguousarray(part[:, passes[k]])
                out[:, passes[k]] = _whiten(pattern, increment, row_start, design, gain, factor, of_pass, states[k])

            map_threads(write, range(len(passes)))
            return out

        product, projection = np.zeros((count, count)), np.zeros(count)
        cuts = [*range(0, len(s.row_start) - 1, _STEPS_PER_SUM), len(s.row_start) - 1]
        for first, last in pairwise(cuts):
            rows = slice(int(s.row_start[first]), int(s.row_start[last]))
            part = whiten(first, last, rows)
            product += part.T @ part
            projection += part.T @ white[rows]
        return product, projection

    def posterior_initial_covariance(self, count: int) -> Array:
        """Covariance ``(count, count)`` of the first states at the beginning, given all measurements.

        By the responses of all white rows to a unit initial mean of each state. The first states must be uncorrelated
        with the others a priori.
        """
        unit = np.eye(count)
        responses = self(np.zeros((len(self.gain), count)), unit)
        prior = self.model.initial_covariance[:count, :count]
        return prior - prior @ (responses.T @ responses) @ prior

    def innovations(self, white: Array) -> Array:
        """Innovations ``(R,)`` of white rows ``(R,)``, in the units of the measurements."""
        return _unwhiten(self.model.row_start, self.factor, white)

    def predictions_of_last_states(self, white: Array, count: int) -> Array:
        """Part of the predictions ``(R,)`` that the last states contribute, in the units of the measurements.

        The innovations plus this part are what measurements differ by from the prediction of the other states.

        Parameters
        ----------
        white : (R,) array
            White rows.
        count : int
            Number of states, of zero initial mean, whose transition neither depends on the other states nor acts on
            them, as that of `with_gauss_markov_states`.
        """
        s, first = self.model, self.model.size - count
        own = s.increment.row >= first
        row, column = s.increment.row[own] - first, s.increment.column[own] - first
        gain, design = (np.ascontiguousarray(a[:, first:]) for a in (self.gain, s.design))
        return _predictions(row, column, s.increment.values[:, own], s.row_start, design, gain, white)

    @property
    def innovation_sigma(self) -> Array:
        """Standard deviation of each innovation ``(R,)``."""
        return np.sqrt(np.sum(self.factor**2, axis=1))

    def log_likelihood(self, white: Array) -> float:
        """Log-likelihood of the column whose white rows are `white` ``(R,)``, without the constant R/2 log 2π, nats."""
        return -0.5 * float(white @ white) - 0.5 * self.log_determinant


def _passes(count: int) -> list[slice]:
    """Parts of `count` columns, each of which one thread whitens in one pass."""
    passes = max(WORKERS, -(-count // _PASS_COLUMNS))
    cuts = np.unique(np.linspace(0, count, passes + 1).astype(int))
    return [slice(int(a), int(b)) for a, b in pairwise(cuts)]


def whitening_filter(model: LinearStateSpace) -> WhiteningFilter:
    """Run the covariance recursion of the Kalman filter."""
    gain, factor = np.empty(model.design.shape), np.zeros(model.row_noise.shape)
    log_determinant, _ = _run_filter(model, gain, factor, np.empty(0), np.empty(0))
    return WhiteningFilter(model, gain, factor, log_determinant)


def log_likelihood(model: LinearStateSpace, measurements: Array, initial_mean: Array) -> float:
    """Log-likelihood of one column of measurements, without the constant R/2 log 2π, nats.

    That of `WhiteningFilter.log_likelihood`. The states follow the covariance recursion, so that no gains are kept: the
    filter of a large model has as many numbers as its design matrix.

    Parameters
    ----------
    model : LinearStateSpace
        R measurement rows.
    measurements : (R,) array
        The column.
    initial_mean : (m,) array
        Mean of the first m states; the other states have zero mean.
    """
    gain, factor = np.empty((0, model.size)), np.empty((0, 0))
    log_determinant, square = _run_filter(model, gain, factor, measurements, model.initial_mean(initial_mean))
    return -0.5 * square - 0.5 * log_determinant


def _run_filter(
    model: LinearStateSpace, gain: Array, factor: Array, measurements: Array, states: Array
) -> tuple[float, float]:
    """`_filter` of a model, with one BLAS thread."""
    q = model.process_noise
    with one_blas_thread():
        log_determinant, square, _ = _filter(
            row_pattern(model.increment), model.increment.values, q.row, q.column, q.values, model.row_start,
            np.ascontiguousarray(model.design), model.row_noise, model.initial_covariance.copy(), gain, factor,
            np.ascontiguousarray(measurements)[:, None], states[:, None].copy(),
        )  # fmt: skip
    return log_determinant, square


def measurement_update(covariance: Array, design: Array, noise: Array) -> tuple[Array, Array]:
    """Gain and covariance of one Kalman update, for filters whose steps are no `LinearStateSpace`.

    Joseph's form of the covariance is positive semidefinite whatever the rounding error of the gain (Bucy & Joseph
    1968, Filtering for Stochastic Processes; Tapley, Schutz & Born 2004, Statistical Orbit Determination, section 4.7).

    Parameters
    ----------
    covariance : (n, n) array
        P, of the state before the update.
    design : (m, n) array
        H, derivative of the measurement with respect to the state.
    noise : (m, m) array
        R, covariance of the measurement's error. ``H P Hᵀ + R`` must not be singular.

    Returns
    -------
    gain : (n, m) array
        ``K = P Hᵀ (H P Hᵀ + R)⁻¹``: change of the state by a unit of the innovation.
    covariance : (n, n) array
        ``(1 - K H) P (1 - K H)ᵀ + K R Kᵀ``, made symmetric to the last bit.
    """
    cross = design @ covariance
    gain = np.linalg.solve(symmetric_part(cross @ design.T) + noise, cross).T
    reduction = np.eye(len(covariance)) - gain @ design
    return gain, symmetric_part(reduction @ covariance @ reduction.T + gain @ noise @ gain.T)


@njit(cache=True)
def _predictions(row, column, increment, row_start, design, gain, white):
    """Predictions of states that begin at zero; `row` and `column` are the places of the transition's increments."""
    out, x = np.empty_like(white), np.zeros(design.shape[1])
    for k in range(row_start.size - 1):
        before = x.copy()
        for z in range(row.size):
            x[row[z]] += increment[k, z] * before[column[z]]
        for i in range(row_start[k], row_start[k + 1]):
            out[i] = np.dot(design[i], x)
        for i in range(row_start[k], row_start[k + 1]):
            x += gain[i] * white[i]
    return out


@njit(cache=True)
def _unwhiten(row_start, factor, white):
    """Product of each step's Cholesky factor and white rows."""
    out = np.zeros_like(white)
    for k in range(row_start.size - 1):
        for i in range(row_start[k], row_start[k + 1]):
            for j in range(i - row_start[k] + 1):
                out[i] += factor[i, j] * white[row_start[k] + j]
    return out


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FUSED)
def _filter(pattern, increment, q_row, q_column, q_values, row_start, design, row_noise, p, gains, factor, column, x):
    """Covariance recursion over all steps, and the state recursion of one column of measurements.

    `p` and `x` are the initial covariance ``(n, n)`` and mean ``(n, 1)``, which are overwritten. `gains` ``(R, n)`` and
    `factor` ``(R, w)`` receive gains and Cholesky factors, unless they have no rows; `column` ``(R, 1)`` has no rows
    where there is nothing to whiten. Returns the log determinant, the sum of squares of the white column, and the
    covariance at the end.
    """
    keep, whiten = gains.shape[0] > 0, column.shape[0] > 0
    work, reduction, propagated = np.empty((pattern.rows.size, p.shape[0])), np.empty_like(p), np.empty_like(p)
    work_x, widest = np.empty((pattern.rows.size, 1)), row_noise.shape[1]
    white = np.empty((widest, 1))
    log_determinant, square = 0.0, 0.0
    for k in range(row_start.size - 1):
        transform_both_sides(p, propagated, pattern, increment[k], work)
        p, propagated = propagated, p
        for z in range(q_row.size):
            p[q_row[z], q_column[z]] += q_values[k, z]
        if whiten:
            transform_columns(x, pattern, increment[k], work_x)
        begin, end = row_start[k], row_start[k + 1]
        m = end - begin
        if m == 0:
            continue
        h = design[begin:end]
        hp = np.dot(h, p)
        lower = np.linalg.cholesky(np.dot(hp, h.T) + row_noise[begin:end, :m])
        for i in range(m):
            log_determinant += 2.0 * np.log(lower[i, i])
        solve_lower(lower, hp)  # L⁻¹ H P
        np.dot(hp.T, hp, reduction)
        for i in range(p.shape[0]):  # an array expression would allocate a matrix in every step
            row, less = p[i], reduction[i]
            for j in range(p.shape[0]):
                row[j] -= less[j]
        if keep:
            gains[begin:end] = hp
            factor[begin:end, :m] = lower
        if whiten:
            for i in range(m):
                total, row = column[begin + i, 0], h[i]
                for j in range(row.size):
                    total -= row[j] * x[j, 0]
                for j in range(i):
                    total -= lower[i, j] * white[j, 0]
                white[i, 0] = total / lower[i, i]
                square += white[i, 0] ** 2
            for i in range(m):
                row, e = hp[i], white[i, 0]
                for j in range(row.size):
                    x[j, 0] += row[j] * e
    return log_determinant, square, p


@njit(cache=True, error_model="numpy", fastmath=FUSED, inline="always")
def solve_lower(lower, right):
    """Solve ``L x = right`` in place, with L lower triangular ``(m, m)`` and `right` ``(m, c)``."""
    for i in range(right.shape[0]):
        row = right[i]
        for j in range(i):
            v, above = lower[i, j], right[j]
            for c in range(right.shape[1]):
                row[c] -= v * above[c]
        for c in range(right.shape[1]):
            row[c] /= lower[i, i]


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FUSED)
def _whiten(pattern, increment, row_start, design, gains, factor, columns, x):
    """State recursion over all steps for all columns; `x` holds the initial means and is overwritten."""
    out = np.empty_like(columns)
    work, predicted = np.empty((pattern.rows.size, x.shape[1])), np.empty((factor.shape[1], x.shape[1]))
    update = np.empty_like(x)
    for k in range(row_start.size - 1):
        transform_rows(x, pattern, increment[k], work)
        begin, end = row_start[k], row_start[k + 1]
        m = end - begin
        if m == 0:
            continue
        white = out[begin:end]
        np.dot(design[begin:end], x, predicted[:m])
        for i in range(m):
            for c in range(x.shape[1]):
                white[i, c] = columns[begin + i, c] - predicted[i, c]
        solve_lower(factor[begin:end], white)
        np.dot(gains[begin:end].T, white, update)
        for i in range(x.shape[0]):
            for c in range(x.shape[1]):
                x[i, c] += update[i, c]
    return out
