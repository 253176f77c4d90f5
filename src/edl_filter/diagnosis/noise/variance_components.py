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
from edl_filter.estimation.block_sparse import from_blocks, merge
from edl_filter.estimation.kalman import LinearStateSpace, WhiteningFilter, whitening_filter
from edl_filter.estimation.parallel import THREADS, map_threads
from edl_filter.estimation.smoothing import precision_weighted_residuals
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array, BoolArray, IntArray


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
    colour : (int, int) or None
        Most likely correlation time and factor (`most_likely_colour`), as places in the settings; None if unknown.
    """

    variance: Array
    significant: BoolArray
    penalty: float = 0.0
    colour: tuple[int, int] | None = None

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


def colour_excess(model: LinearStateSpace, index: RowIndex, excess: ExcessVariance, memory: float) -> LinearStateSpace:
    """The state-space model whose excess variance of forces and moments is correlated in time.

    A force or moment that the model lacks lasts for longer than a time bin: each axis is a first-order Gauss–Markov
    process (Tapley, Schutz and Born, Statistical Orbit Determination, 2004, section 4.9) of unit variance, times the
    standard deviation of the excess, as the last six states. Both IMUs measure it, so that it is in the rows of the
    driving IMU against the prediction and not in those of a checking IMU, whose excess stays white.

    Parameters
    ----------
    model : LinearStateSpace
        At the stated noise.
    index : RowIndex
        Positions of the rows.
    excess : ExcessVariance
        Its size, which may change from interval to interval.
    memory : float
        Correlation time, s.
    """
    n, axes = model.size, 6
    appended = slice(n, n + axes)
    design, covariance = np.pad(model.design, ((0, 0), (0, axes))), np.eye(n + axes)
    covariance[:n, :n] = model.initial_covariance
    white = excess.variance.copy()
    for axis in range(axes):
        rows = index.bin_rows[:, axis]
        rows = rows[rows >= 0]
        design[rows, n + axis], white[rows] = np.sqrt(excess.variance[rows]), 0.0
    decay = np.exp(-index.step_interval / memory)[:, None, None]
    increment, noise = (
        from_blocks(n + axes, [(appended, appended, v * np.eye(axes))]) for v in (decay - 1.0, 1.0 - decay**2)
    )
    coloured = replace(
        model,
        design=design,
        increment=merge(model.increment, increment, n + axes),
        process_noise=merge(model.process_noise, noise, n + axes),
        initial_covariance=covariance,
    )
    return add_variance(coloured, index, replace(excess, variance=white))


def most_likely_colour(
    white: WhiteningFilter,
    model: LinearStateSpace,
    index: RowIndex,
    excess: ExcessVariance,
    residuals: Array,
    initial_mean: Array,
    settings: DecisionSettings,
    initial: tuple[int, int] | None = None,
) -> tuple[WhiteningFilter, tuple[int, int] | None]:
    """The whitening filter with white or correlated excess variance, whichever is most likely.

    Parameters
    ----------
    white : WhiteningFilter
        With white excess variance.
    model : LinearStateSpace
        At the stated noise.
    index : RowIndex
        Positions of the rows.
    excess : ExcessVariance
        Its size.
    residuals : (R,) array
        Residuals about the linearisation point.
    initial_mean : (n,) array
        Prior mean of the states at the beginning.
    settings : DecisionSettings
        Thresholds of the diagnosis: the correlation times and factors that are tried (`colour_penalty`).
    initial : (int, int), optional
        Places of correlation time and factor at which the search begins: the most likely ones of a similar model.

    Returns
    -------
    whiten : WhiteningFilter
    colour : (int, int) or None
        Places of the most likely correlation time and factor, also where white excess variance is more likely; None
        without excess variance.
    """
    if excess.is_zero:
        return white, None

    def evaluate(place: tuple[int, int]) -> tuple[float, WhiteningFilter]:
        memory, factor = place
        scaled = replace(excess, variance=factors[factor] * excess.variance)
        whiten = whitening_filter(colour_excess(model, index, scaled, memories[memory]))
        return whiten.log_likelihood(whiten(residuals[:, None], initial_mean[:, None])[:, 0]), whiten

    memories, factors = settings.excess_memories_s, settings.excess_colour_factors
    place = (len(memories) // 2, len(factors) // 2) if initial is None else initial
    likelihood, coloured = evaluate(place)
    likelihoods = {place: likelihood}  # the filters are large: only that of the best place is kept
    # uphill on the grid; the data determine the ratio of variance and time best: along the ridge both increase together
    steps = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))
    while True:
        neighbours = [(place[0] + a, place[1] + b) for a, b in steps]
        new = [p for p in neighbours if 0 <= p[0] < len(memories) and 0 <= p[1] < len(factors) and p not in likelihoods]
        best = place
        for i in range(0, len(new), THREADS):
            tried = new[i : i + THREADS]
            for p, (value, whiten) in zip(tried, map_threads(evaluate, tried), strict=True):
                likelihoods[p] = value
                if value > likelihood:
                    best, likelihood, coloured = p, value, whiten
        if best == place:
            break
        place = best
    at_white = white.log_likelihood(white(residuals[:, None], initial_mean[:, None])[:, 0])
    return coloured if likelihood - colour_penalty(settings) > at_white else white, place


def colour_penalty(settings: DecisionSettings) -> float:
    """Cost in evidence of choosing a correlation time and a factor of the excess variance, nats."""
    return float(np.log(len(settings.excess_memories_s) * len(settings.excess_colour_factors)))


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

    def evaluate(candidate: ExcessVariance) -> tuple[float, WhiteningFilter, Array]:
        whiten = stated if candidate.is_zero else whitening_filter(add_variance(stated.model, index, candidate))
        white = whiten(residuals[:, None], initial_mean[:, None])[:, 0]
        return whiten.log_likelihood(white), whiten, white

    pieces, best = _pieces(index, settings.noise_piece_s), -np.inf
    estimate, best_filter = moment_estimate(stated, index, residuals, initial_mean, settings), stated
    if estimate.is_zero:
        return estimate, stated
    at_stated, _, _ = evaluate(ExcessVariance.zero(len(residuals)))
    variance = estimate.variance
    first = evaluate(estimate)
    if initial is not None:
        alternative = initial.on(pieces, len(residuals))
        evaluated = evaluate(replace(estimate, variance=alternative))
        if evaluated[0] > first[0]:
            variance, first = alternative, evaluated
    iterations: list[_Iteration] = []
    for i in range(settings.variance_iterations):
        likelihood, whiten, white = evaluate(replace(estimate, variance=variance)) if i else first
        tolerance = max(settings.variance_convergence_nats, settings.variance_convergence_share * (best - at_stated))
        if likelihood < best + tolerance:
            break
        weighted, diagonal = precision_weighted_residuals(whiten, white)
        best, best_filter = likelihood, whiten
        significant = _significant(variance, pieces, diagonal, settings)
        estimate = ExcessVariance(variance, significant, _penalty(variance, pieces))
        iterations.append(_Iteration.of(variance, pieces, weighted, diagonal))
        variance = _next_variance(iterations, pieces, len(variance), settings)
    significant_variance = np.where(estimate.significant, estimate.variance, 0.0)
    simpler = [np.zeros_like(significant_variance)]
    if np.any(significant_variance) and np.any(significant_variance != estimate.variance):
        simpler.insert(0, significant_variance)
    for candidate in (ExcessVariance(v, v > 0.0, _penalty(v, pieces)) for v in simpler):
        likelihood, whiten, _ = evaluate(candidate)
        if likelihood - candidate.penalty > best - estimate.penalty:
            best, best_filter, estimate = likelihood, whiten, candidate
    return estimate, best_filter


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
