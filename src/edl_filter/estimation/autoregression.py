"""Interpolation of a missing stretch of a time series by an autoregressive process, with its covariance.

Input: one equally spaced series with a missing stretch. Model: an autoregression of order p with a constant (damped
oscillations and trends are its solutions) that is fitted by least squares to both sides of the stretch. Method: the
missing values are the most probable ones given the known values on both sides (Janssen, Veldhuis & Vries, IEEE Trans.
ASSP 34 (1986) 317), and their covariance is the inverse of the information that the model gives about them. The
innovations' variance may differ between the two sides; inside the stretch it is the larger one. What the process itself
changes across the stretch is covered by the spread of the values between fits to one side and to both. Order and scale
of the covariance come from cross-validation: stretches of the same length on both sides are predicted from a fit
without them, and the errors of their sums are compared with the predicted sigmas; for an extrapolation they are
predicted from one side, too. Values that leave the range of the
observed ones by more than its width are those of an unstable fit, which is not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from edl_filter.types import Array, BoolArray

#: Orders that are compared.
ORDERS = (2, 4, 8, 16, 24)
#: Fewest equations per coefficient of a fit.
_FEWEST_EQUATIONS = 3
#: Weight of the model's own covariance against the cross-validation, in stretches.
_PRIOR_STRETCHES = 2.0
#: Largest number of stretches of the cross-validation.
_MOST_STRETCHES = 12
#: Ridge of the least squares, relative to the mean information of a coefficient.
_RIDGE = 1e-9
#: Farthest that an interpolated value can be from the observed ones, in ranges of the observed values.
_FARTHEST = 1.0
#: Least variance of an innovation, of a series of unit variance.
_LEAST_VARIANCE = 1e-16


@dataclass(frozen=True)
class Interpolation:
    """A missing stretch of n values.

    Attributes
    ----------
    values : (n,) array
        Most probable values, in the unit of the series.
    covariance : (n, n) array
        Of the values' errors.
    order : int
        Of the autoregression; 0 where none was fitted.
    scale : float
        Ratio of the errors in the cross-validation to the model's own sigmas, by which `covariance` is scaled, up to
        that of a value that is uniform over the credible range.
    """

    values: Array
    covariance: Array
    order: int
    scale: float


def interpolate(series: Array, observed: BoolArray, first: int, last: int) -> Interpolation:
    """Interpolate a missing stretch of a series, or extrapolate where one side has no known values.

    Parameters
    ----------
    series : (N,) array
        Values at equal steps, of any unit; those that are not known are ignored.
    observed : (N,) boolean array
        Which values are observed.
    first, last : int
        The stretch is ``series[first:last]``.

    Returns
    -------
    Interpolation
    """
    length = last - first
    observed = observed.copy()
    observed[first:last] = False
    centre = float(np.mean(series[observed])) if observed.any() else 0.0
    size = float(np.std(series[observed])) if observed.any() else 0.0
    if not size > 0.0:
        return Interpolation(np.full(length, centre), np.zeros((length, length)), 0, 1.0)
    scaled = np.where(observed, (series - centre) / size, 0.0)
    trials = trial_stretches(observed, first, last)
    low, high = _credible_range(scaled, observed)
    extrapolated = not observed[:first].any(), not observed[last:].any()
    best: tuple[float, Interpolation] | None = None
    for order in ORDERS:
        fit = _fill(scaled, observed, first, last, order)
        if fit is None or np.min(fit[0]) < low or np.max(fit[0]) > high:
            continue
        ratios, score = [], 0.0
        for a, b in trials:
            without = observed.copy()
            without[a:b] = False
            given = without.copy()
            if extrapolated[0]:
                given[:a] = False
            if extrapolated[1]:
                given[b:] = False
            trial = _fill(scaled, without, a, b, order, given=given)
            if trial is not None:
                error = float(np.sum(trial[0] - scaled[a:b]))
                ratios.append(error**2 / trial[1].sum())
                score += 0.5 * np.log(trial[1].sum())
        variance = (_PRIOR_STRETCHES + sum(ratios)) / (_PRIOR_STRETCHES + len(ratios))
        # negative log predictive density of the sums, with the scale estimated
        score = score / max(len(ratios), 1) + 0.5 * np.log(variance) + (0.0 if ratios else order)
        if best is None or score < best[0]:
            values, covariance = fit[0], fit[1] + _side_spread(scaled, observed, first, last, order, fit[0])
            covariance *= variance
            # the variance of a value that is uniform over the credible range is the largest one
            covariance *= min(1.0, (high - low) ** 2 / 12.0 / float(np.max(np.diag(covariance))))
            interpolation = Interpolation(centre + size * values, size**2 * covariance, order, float(np.sqrt(variance)))
            best = score, interpolation
    if best is None:
        return Interpolation(np.full(length, centre), np.full((length, length), size**2), 0, 1.0)
    return best[1]


def _side_spread(series: Array, observed: BoolArray, first: int, last: int, order: int, values: Array) -> Array:
    """Spread (n, n) of the values about those by a fit to one side alone: what the process changes in the stretch."""
    spread = np.zeros((len(values), len(values)))
    low, high = _credible_range(series, observed)
    for side in (slice(0, first), slice(last, len(observed))):
        fit = _fill(series, observed, first, last, order, side)
        if fit is not None:
            difference = np.clip(fit[0], low, high) - values
            spread += 0.5 * np.outer(difference, difference)
    return spread


def _credible_range(series: Array, observed: BoolArray) -> tuple[float, float]:
    """Lowest and highest value that an interpolation can have: an unstable process leaves this range."""
    low, high = float(np.min(series[observed])), float(np.max(series[observed]))
    margin = _FARTHEST * (high - low)
    return low - margin, high + margin


def trial_stretches(observed: BoolArray, first: int, last: int) -> list[tuple[int, int]]:
    """Known stretches of the same length, nearest first: those by whose errors an interpolation is judged.

    Parameters
    ----------
    observed : (N,) boolean array
        Which values of the series are observed.
    first, last : int
        The missing stretch is ``first:last``.

    Returns
    -------
    list of (int, int)
        Start and end of each, at most twelve; those of one side overlap by half.
    """
    length = last - first
    step = max(1, length // 2)
    count = np.concatenate(([0], np.cumsum(observed)))
    stretches: list[tuple[int, int]] = []
    for k in range(1, len(observed) // step + 2):
        for start in (first - length - (k - 1) * step, last + (k - 1) * step):
            complete = start >= 0 and start + length <= len(observed) and count[start + length] - count[start] == length
            if complete and len(stretches) < _MOST_STRETCHES:
                stretches.append((start, start + length))
    return stretches


def _fill(
    series: Array,
    observed: BoolArray,
    first: int,
    last: int,
    order: int,
    fitted: slice | None = None,
    given: BoolArray | None = None,
) -> tuple[Array, Array] | None:
    """Values and covariance of ``series[first:last]`` by an autoregression; None with too few equations.

    With `fitted` its coefficients are those of this part of the series. The values are those most probable given the
    observed ones, or given those that are `given` alone.
    """
    given = observed if given is None else given
    begin, end = (0, len(series)) if fitted is None else (fitted.start, fitted.stop)
    possible, values, covariance = _most_probable(series, observed, given, first, last, order, begin, end)
    return (values, covariance) if possible else None


@njit(cache=True, error_model="numpy", nogil=True)
def _most_probable(
    series: Array, observed: BoolArray, given: BoolArray, first: int, last: int, order: int, begin: int, end: int
) -> tuple[bool, Array, Array]:
    """Whether ``series[begin:end]`` has enough equations; values and covariance of the stretch as of `_fill`."""
    length = last - first
    values, covariance = np.zeros(length), np.zeros((length, length))
    design, target = np.empty((max(end - begin - order, 0), order + 1)), np.empty(max(end - begin - order, 0))
    latest = np.empty(len(target), np.int64)  # index of the value that an equation predicts
    count, complete = 0, 0
    for t in range(begin, end):
        complete = complete + 1 if observed[t] else 0
        if complete > order:
            design[count, :order], design[count, order] = series[t - order : t], 1.0
            target[count], latest[count] = series[t], t
            count += 1
    if count < _FEWEST_EQUATIONS * (order + 1):
        return False, values, covariance
    design, target, latest = design[:count], target[:count], latest[:count]
    information = design.T @ design
    ridge = _RIDGE * np.trace(information) / (order + 1)
    for k in range(order + 1):
        information[k, k] += ridge
    coefficients = np.linalg.solve(information, design.T @ target)
    squares = (target - design @ coefficients) ** 2
    excess = count / (count - order - 1.0)
    # innovations before and after the stretch: the larger variance counts
    variance = 0.0
    for side in (squares[latest < first], squares[latest >= last + order]):
        if len(side) > order + 1:
            variance = max(variance, excess * float(np.mean(side)))
    deviation = np.sqrt(variance + _LEAST_VARIANCE + 1e-6 * excess * np.mean(squares))
    # equations with a missing value: from the first one to the last one that contains it
    weights = np.append(-coefficients[:order], 1.0) / deviation
    information = 1e-6 * np.eye(length)  # the series has unit variance: its values are within hundreds
    moment, row = np.zeros(length), np.zeros(length)
    for t in range(max(0, first - order), min(len(series) - order, last)):
        usable, offset = True, -coefficients[order] / deviation
        for k in range(order + 1):
            if not first <= t + k < last:
                usable = usable and given[t + k]
                offset += weights[k] * series[t + k]
        if usable:
            a, b = max(t, first), min(t + order + 1, last)  # the missing values that the equation contains
            row = weights[a - t : b - t]
            information[a - first : b - first, a - first : b - first] += np.outer(row, row)
            moment[a - first : b - first] += offset * row
    eigenvalues, vectors = np.linalg.eigh(information)
    root = vectors / np.sqrt(np.maximum(eigenvalues, 1e-13 * eigenvalues[-1]))
    covariance = root @ root.T
    return True, -covariance @ moment, 0.5 * (covariance + covariance.T)
