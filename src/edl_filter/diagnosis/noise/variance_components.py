"""Variance components: noise of each channel beyond the stated noise, by restricted maximum likelihood.

A vehicle vibrates, a table has discontinuities of slope, and a model that lacks an effect fails by hundreds of sigmas
for some time. Where the residuals of a channel exceed the stated noise over an interval, the variance that maximises
the marginal likelihood is added to the noise there. One failure then does not dominate all estimates, and models are
compared at the noise that each of them leaves. If the model holds, no variance is added.

All intervals share one path, so their variances are estimated together. With C the covariance of all residuals y, the
derivative of the likelihood with respect to an interval's variance vanishes where the sums over its rows of ``(C⁻¹
y)²`` and of the diagonal of ``C⁻¹`` are equal (`precision_weighted_residuals`). Each variance is multiplied by the
ratio of the sums until they are (MacKay, Neural Computation 4 (1992) 415; Harville, JASA 72 (1977) 320), from the
second iteration on by a power of the ratio, since the plain steps are always too short. The power is the secant of the
ratio's logarithm over that of the variance in the last two iterations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.estimation.kalman import WhiteningFilter, log_likelihood, whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.estimation.smoothing import precision_weighted_residuals
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array, BoolArray, IntArray

#: Places of correlation time and factor in the settings, of forces and of moments (`excess_colour`).
ColourPlaces = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True)
class ExcessVariance:
    """Variance beyond the stated noise, of each row.

    Attributes
    ----------
    variance : (R,) array
        In the rows' own units, squared.
    significant : (R,) array of bool
        Where it exceeds what chance allows.
    penalty : float
        Cost in evidence, nats: each interval was selected among all, and its variance estimated from the interval's own
        rows (Schwarz, Annals of Statistics 6 (1978) 461).
    colour : ColourPlaces or None
        Most likely correlation times and factors (`excess_colour`); None if unknown.
    """

    variance: Array
    significant: BoolArray
    penalty: float = 0.0
    colour: ColourPlaces | None = None

    @classmethod
    def zero(cls, count: int) -> ExcessVariance:
        """No excess variance in `count` rows."""
        return cls(np.zeros(count), np.zeros(count, bool))

    @property
    def is_zero(self) -> bool:
        """Whether no variance is added anywhere."""
        return not np.any(self.variance)

    @property
    def share(self) -> float:
        """Share of the rows with significant excess variance."""
        return float(np.mean(self.significant))

    def on(self, pieces: list[IntArray], count: int) -> Array:
        """Its variance ``(R,)`` in the pieces of another model of `count` rows, which may be a few more or fewer."""
        out = np.zeros(count)
        for rows in pieces:
            out[rows] = self.variance[min(int(rows[0]), len(self.variance) - 1)]
        return out


def add_variance(model: LinearStateSpace, index: RowIndex, excess: ExcessVariance) -> LinearStateSpace:
    """The state-space model with excess variance in its rows."""
    if excess.is_zero:
        return model
    noise = model.row_noise.copy()
    noise[np.arange(len(noise)), index.column] += excess.variance
    return replace(model, row_noise=noise)


def moment_estimate(
    stated: WhiteningFilter, index: RowIndex, residuals: Array, initial_mean: Array, settings: DecisionSettings
) -> ExcessVariance:
    """Excess variance by moments: mean square of the innovations less their stated variance, where significant.

    Parameters
    ----------
    stated : WhiteningFilter
        At the stated noise.
    index : RowIndex
        Positions of the rows.
    residuals : (R,) array
        Residuals about the linearisation point.
    initial_mean : (n,) array
        Prior mean of the states at the beginning.
    settings : DecisionSettings
        Thresholds of the diagnosis.
    """
    white = stated(residuals[:, None], initial_mean[:, None])[:, 0]
    innovation, sigma = stated.innovations(white), stated.innovation_sigma
    out = np.zeros_like(white)
    for rows in _pieces(index, settings.noise_piece_s):
        square, variance = innovation[rows] ** 2, sigma[rows] ** 2
        excess = np.mean(square) - np.mean(variance)
        if min(np.mean(square / variance) - 1.0, excess / np.mean(variance)) > _chance(len(rows), settings):
            out[rows] = excess
    return ExcessVariance(out, out > 0.0)


def estimate_variance_components(
    stated: WhiteningFilter,
    index: RowIndex,
    residuals: Array,
    initial_mean: Array,
    settings: DecisionSettings,
    initial: ExcessVariance | None = None,
) -> tuple[ExcessVariance, WhiteningFilter]:
    """Excess variance that maximises the marginal likelihood, and the whitening filter with it.

    Parameters
    ----------
    stated : WhiteningFilter
        At the stated noise.
    index : RowIndex
        Positions of the rows.
    residuals : (R,) array
        Residuals about the linearisation point.
    initial_mean : (n,) array
        Prior mean of the states at the beginning.
    settings : DecisionSettings
        Thresholds of the diagnosis.
    initial : ExcessVariance, optional
        Estimate about another linearisation point or without an effect; the iteration starts there where that is more
        likely than the moment estimate.

    Returns
    -------
    excess : ExcessVariance
        The most likely variances, or the significant ones alone, or none, whichever has the largest likelihood less
        penalty; none where the moment estimate is zero.
    whiten : WhiteningFilter
    """

    def evaluate(variance: Array) -> tuple[float, WhiteningFilter, Array]:
        whiten = filter_at(variance)
        white = whiten(residuals[:, None], initial_mean[:, None])[:, 0]
        return whiten.log_likelihood(white), whiten, white

    def filter_at(variance: Array) -> WhiteningFilter:
        return whitening_filter(with_variance(variance)) if np.any(variance) else stated

    def with_variance(variance: Array) -> LinearStateSpace:
        return add_variance(stated.model, index, replace(estimate, variance=variance))

    pieces, best = _pieces(index, settings.noise_piece_s), -np.inf
    estimate, best_filter = moment_estimate(stated, index, residuals, initial_mean, settings), stated
    if estimate.is_zero:
        return estimate, stated
    at_stated, variance = evaluate(np.zeros(len(residuals)))[0], estimate.variance
    likelihood, whiten, white = evaluate(variance)
    if initial is not None:
        alternative = initial.on(pieces, len(residuals))
        evaluated = evaluate(alternative)
        if evaluated[0] > likelihood:
            variance, (likelihood, whiten, white) = alternative, evaluated
        del evaluated  # a filter is large: two are kept, the best and that of the iteration
    iterations: list[_Iteration] = []
    for i in range(settings.variance_iterations):
        if i:
            likelihood, whiten, white = evaluate(variance)
        tolerance = max(settings.variance_convergence_nats, settings.variance_convergence_share * (best - at_stated))
        if likelihood < best + tolerance:
            break
        weighted, diagonal = precision_weighted_residuals(whiten, white)
        best, best_filter = likelihood, whiten
        significant = _significant(variance, pieces, diagonal, settings)
        estimate = ExcessVariance(variance, significant, _penalty(variance, pieces))
        iterations.append(_Iteration.of(variance, pieces, weighted, diagonal))
        variance = _next_variance(iterations, pieces, len(variance), settings)
    del whiten
    simpler = [(np.zeros(len(variance)), at_stated)]
    significant_variance = np.where(estimate.significant, estimate.variance, 0.0)
    if np.any(significant_variance) and np.any(significant_variance != estimate.variance):
        likelihood = log_likelihood(with_variance(significant_variance), residuals, initial_mean)
        simpler.insert(0, (significant_variance, likelihood))
    simplest = estimate
    for variance, likelihood in simpler:
        candidate = ExcessVariance(variance, variance > 0.0, _penalty(variance, pieces))
        if likelihood - candidate.penalty > best - simplest.penalty:
            best, simplest = likelihood, candidate
    return simplest, best_filter if simplest is estimate else filter_at(simplest.variance)


def _pieces(index: RowIndex, length: float) -> list[IntArray]:
    """Rows of one channel in one interval of `length` seconds, for all channels and intervals."""
    pieces = []
    for channel in index.bin_rows.T:
        rows = channel[channel >= 0]
        if not len(rows):
            continue
        number = np.floor((index.time[rows] - index.time[rows[0]]) / length).astype(int)
        pieces += [rows[number == p] for p in np.unique(number)]
    return pieces


@dataclass(frozen=True)
class _Iteration:
    """One iteration, by piece.

    Attributes
    ----------
    variance : (p,) array
    square, expected : (p,) arrays
        Sums over a piece's rows of ``(C⁻¹ y)²`` and of the diagonal of ``C⁻¹``.
    """

    variance: Array
    square: Array
    expected: Array

    @classmethod
    def of(cls, variance: Array, pieces: list[IntArray], weighted: Array, diagonal: Array) -> _Iteration:
        return cls(
            variance=np.array([variance[rows[0]] for rows in pieces]),
            square=np.array([np.sum(weighted[rows] ** 2) for rows in pieces]),
            expected=np.array([np.sum(diagonal[rows]) for rows in pieces]),
        )

    @property
    def ratio(self) -> Array:
        """Factor by which a variance is too small, approximately."""
        return self.square / self.expected


def _power(iterations: list[_Iteration], settings: DecisionSettings) -> Array:
    """Power of each piece's ratio by which its variance is multiplied."""
    ones = np.ones(len(iterations[-1].variance))
    if len(iterations) < 3:
        return ones if len(iterations) == 1 else settings.variance_step_power * ones
    before, last = iterations[-2:]
    fitted = (before.variance > 0.0) & (last.variance > 0.0) & (before.ratio > 0.0) & (last.ratio > 0.0)
    step, fall = ones.copy(), np.zeros_like(ones)
    step[fitted] = np.log(last.variance[fitted] / before.variance[fitted])
    fall[fitted] = np.log(before.ratio[fitted] / last.ratio[fitted])
    converging = step * fall > 0.0  # otherwise other pieces changed the ratio more than the piece's own variance did
    secant = np.clip(step / np.where(converging, fall, 1.0), 1.0, settings.variance_step_power_max)
    return np.where(converging, secant, settings.variance_step_power)


def _next_variance(
    iterations: list[_Iteration], pieces: list[IntArray], count: int, settings: DecisionSettings
) -> Array:
    """The next variances ``(R,)``."""
    last, power, out = iterations[-1], _power(iterations, settings), np.zeros(count)
    for i, rows in enumerate(pieces):
        n = len(rows)
        if last.variance[i] * last.expected[i] > settings.negligible_variance_share * n:
            out[rows] = last.variance[i] * last.ratio[i] ** power[i]
        elif last.ratio[i] - 1.0 > _chance(n, settings):
            out[rows] = (last.square[i] - last.expected[i]) * n / last.expected[i] ** 2
    return out


def _significant(variance: Array, pieces: list[IntArray], diagonal: Array, settings: DecisionSettings) -> BoolArray:
    """Where the variance exceeds chance, relative to a residual's variance without it, all others given."""
    out = np.zeros(len(variance), bool)
    for rows in pieces:
        share = variance[rows[0]] * np.mean(diagonal[rows])
        out[rows] = share > _chance(len(rows), settings) * (1.0 - share)
    return out


def _penalty(variance: Array, pieces: list[IntArray]) -> float:
    """Cost in evidence of selecting the pieces with excess variance and estimating their variances, nats."""
    fitted = [len(rows) for rows in pieces if variance[rows[0]] > 0.0]
    return len(fitted) * float(np.log(len(pieces))) + 0.5 * float(np.sum(np.log(fitted)))


def _chance(count: int, settings: DecisionSettings) -> float:
    """Relative excess of the mean square of `count` residuals that chance allows."""
    return float(settings.excess_variance_sigmas * np.sqrt(2.0 / count))
