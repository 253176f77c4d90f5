"""Interpolation by an autoregression: dense Gaussian, known solutions, calibration, and series without a model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.estimation import autoregression
from edl_filter.estimation.autoregression import ORDERS, interpolate

#: Variance of a value of which nothing is known, for a series of unit variance.
UNKNOWN = 1e6


def oscillation(rng, n, sigma, frequency=0.13, damping=0.002):
    """Damped oscillator with white excitation, and noise: (true, read)."""
    a, b = 2.0 * np.exp(-damping) * np.cos(2 * np.pi * frequency), -np.exp(-2.0 * damping)
    x = np.zeros(n + 500)
    for k in range(2, len(x)):
        x[k] = a * x[k - 1] + b * x[k - 2] + 0.05 * rng.standard_normal()
    return x[500:] + sigma * rng.standard_normal(n)


def sum_sigma(fill):
    """One sigma of the sum of the values' errors."""
    return np.sqrt(max(fill.covariance.sum(), 0.0))


def fitted(x, known, first, last, order, part):
    """Coefficients, oldest first, constant, and variance of the innovations, by least squares; None with few values."""
    starts = [t for t in range(part[0], part[1] - order) if known[t : t + order + 1].all()]
    if len(starts) < 3 * (order + 1):
        return None
    design = np.array([[*x[t : t + order], 1.0] for t in starts])
    target = np.array([x[t + order] for t in starts])
    ridge = np.sqrt(1e-9 * np.mean(np.sum(design**2, axis=0))) * np.eye(order + 1)
    solution = np.linalg.lstsq(np.concatenate((design, ridge)), np.concatenate((target, np.zeros(order + 1))), None)[0]
    residual = target - design @ solution
    excess = len(starts) / (len(starts) - order - 1)
    before = [r for t, r in zip(starts, residual, strict=True) if t + order < first]
    after = [r for t, r in zip(starts, residual, strict=True) if t >= last]
    variance = max(excess * np.mean(np.square(side)) for side in (before, after) if len(side) > order + 1)
    return solution[:order], solution[order], variance + 1e-16 + 1e-6 * excess * np.mean(residual**2)


def conditional_gaussian(x, known, first, last, order, part=None, given=None):
    """Mean and covariance of ``x[first:last]`` given the known values that adjoin it on both sides, or those `given`.

    By the covariance of these values and of the missing ones: unknown first values and independent innovations, and the
    response to each by running the autoregression. No matrix of the implementation, whose unknowns are the missing
    values alone, occurs in it.
    """
    model = fitted(x, known, first, last, order, part or (0, len(x)))
    if model is None:
        return None
    coefficients, constant, variance = model
    begin, end = first, last
    adjoining = known if given is None else given
    while begin > 0 and adjoining[begin - 1]:
        begin -= 1
    while end < len(x) and adjoining[end]:
        end += 1
    mean, response = np.zeros(end - begin), np.zeros((end - begin, end - begin))
    for t in range(end - begin):
        response[t, t] = np.sqrt(UNKNOWN if t < order else variance)
        if t >= order:
            mean[t] = constant + coefficients @ mean[t - order : t]
            response[t] += coefficients @ response[t - order : t]
    covariance = response @ response.T
    missing = np.arange(first - begin, last - begin)
    given = np.setdiff1d(np.arange(end - begin), missing)
    gain = np.linalg.solve(covariance[np.ix_(given, given)], covariance[np.ix_(given, missing)]).T
    return (
        mean[missing] + gain @ (x[begin:end][given] - mean[given]),
        covariance[np.ix_(missing, missing)] - gain @ covariance[np.ix_(given, missing)],
    )


def dense_interpolation(series, known, first, last):
    """Values, covariance and order of `interpolate`, with the dense Gaussian for every stretch that is predicted."""
    known, length = known.copy(), last - first
    known[first:last] = False
    centre, size = series[known].mean(), series[known].std()
    x = (series - centre) / size
    low, high = 2.0 * x[known].min() - x[known].max(), 2.0 * x[known].max() - x[known].min()
    stretches = []
    for k in range(len(x)):
        shift = k * max(1, length // 2)
        for a in (first - length - shift, last + shift):
            if a >= 0 and a + length <= len(x) and known[a : a + length].all() and len(stretches) < 12:
                stretches.append(a)
    best = None
    for order in ORDERS:
        fill = conditional_gaussian(x, known, first, last, order)
        if fill is None or fill[0].min() < low or fill[0].max() > high:
            continue
        squares, log_sigma = [], 0.0
        for a in stretches:
            left = known & ~((np.arange(len(x)) >= a) & (np.arange(len(x)) < a + length))
            place, one_sided = np.arange(len(x)), left.copy()
            if not known[:first].any():
                one_sided &= place >= a
            if not known[last:].any():
                one_sided &= place < a
            trial = conditional_gaussian(x, left, a, a + length, order, given=one_sided)
            if trial is not None:
                variance = trial[1].sum()
                squares.append((trial[0] - x[a : a + length]).sum() ** 2 / variance)
                log_sigma += 0.5 * np.log(variance)
        scale = (2.0 + sum(squares)) / (2.0 + len(squares))
        score = log_sigma / len(squares) + 0.5 * np.log(scale)
        covariance = fill[1].copy()
        for part in ((0, first), (last, len(x))):
            side = conditional_gaussian(x, known, first, last, order, part)
            if side is not None:
                difference = np.clip(side[0], low, high) - fill[0]
                covariance += 0.5 * np.outer(difference, difference)
        covariance *= scale
        covariance *= min(1.0, (high - low) ** 2 / 12.0 / np.diag(covariance).max())
        if best is None or score < best[0]:
            best = score, centre + size * fill[0], size**2 * covariance, order
    return best[1:]


@pytest.mark.parametrize(
    ("seed", "first", "length"), [(1, 70, 1), (2, 70, 5), (3, 80, 12), (4, 30, 20), (5, 0, 4), (6, 150, 10)]
)
def test_values_and_covariance_are_those_of_the_dense_conditional_gaussian(seed, first, length):
    """Between known values, and at the beginning and the end of the series; another stretch is missing elsewhere.

    To 1e-5: the implementation takes every missing value for unknown to a thousand, the twin the first ones alone.
    """
    series = 2.0 + 3.0 * oscillation(np.random.default_rng(seed), 160, 0.05)
    observed = np.ones(160, bool)
    observed[110:113] = False
    fill = interpolate(series, observed, first, first + length)
    values, covariance, order = dense_interpolation(series, observed, first, first + length)
    assert fill.order == order
    np.testing.assert_allclose(fill.values, values, atol=1e-5 * np.std(series))
    np.testing.assert_allclose(fill.covariance, covariance, atol=1e-5 * np.abs(covariance).max())


def test_an_extrapolated_random_walk_has_at_most_the_variance_of_a_uniform_value():
    """Nothing is known before the first value: three times the range of the series is credible, and no more."""
    series = np.cumsum(np.random.default_rng(13).standard_normal(160))
    fill = interpolate(series, np.ones(160, bool), 0, 50)
    values, covariance, order = dense_interpolation(series, np.ones(160, bool), 0, 50)
    assert fill.order == order
    credible = 3.0 * np.ptp(series[50:])
    assert np.diag(fill.covariance).max() == pytest.approx(credible**2 / 12.0, rel=1e-9)
    np.testing.assert_allclose(np.diag(fill.covariance), np.diag(covariance), rtol=0.01)
    np.testing.assert_allclose(fill.values, values, atol=0.01 * np.std(series))


def test_without_a_stretch_for_the_cross_validation_the_order_is_the_lowest():
    """No known stretch is as long as the missing one: of the scores, which nothing supports, none is better."""
    series = oscillation(np.random.default_rng(14), 60, 0.05)
    fill = interpolate(series, np.ones(60, bool), 20, 45)
    assert fill.order == ORDERS[0]
    assert fill.scale == 1.0
    centre, size = np.mean(np.delete(series, np.s_[20:45])), np.std(np.delete(series, np.s_[20:45]))
    known = np.ones(60, bool)
    known[20:45] = False
    expected, _ = conditional_gaussian((series - centre) / size, known, 20, 45, ORDERS[0])
    np.testing.assert_allclose(fill.values, centre + size * expected, atol=1e-4 * size)


@pytest.mark.parametrize("length", [1, 8, 40])
def test_a_noise_free_oscillation_is_continued_through_a_gap(length):
    t = np.arange(240)
    series = 3.0 + 0.5 * np.sin(0.7 * t) + 0.02 * t
    fill = interpolate(series, np.ones(240, bool), 100, 100 + length)
    np.testing.assert_allclose(fill.values, series[100 : 100 + length], atol=1e-3)
    mean_of_neighbours = 0.5 * (series[99] + series[100 + length])
    assert np.max(np.abs(series[100 : 100 + length] - mean_of_neighbours)) > 0.02


@pytest.mark.parametrize("length", [1, 4, 8, 24])
def test_errors_of_the_sum_agree_with_their_sigma(length):
    """Normalised errors of 60 series: mean square within 4 sigma of chance of 1, with a third for the selection."""
    rng = np.random.default_rng(length)
    ratios = []
    for _ in range(60):
        series = oscillation(rng, 200, 0.02)
        fill = interpolate(series, np.ones(200, bool), 90, 90 + length)
        ratios.append((fill.values - series[90 : 90 + length]).sum() / sum_sigma(fill))
    assert 1.0 - 4.0 * np.sqrt(2 / 60) * 0.9 < np.mean(np.square(ratios)) < 1.33 + 4.0 * np.sqrt(2 / 60)


@pytest.mark.parametrize("length", [4, 12])
@pytest.mark.parametrize("backwards", [False, True])
def test_errors_of_an_extrapolated_sum_agree_with_their_sigma(length, backwards):
    """After the last known value, and before the first one."""
    rng = np.random.default_rng(length)
    ratios = []
    for _ in range(60):
        series = oscillation(rng, 100 + length, 0.02)[:: -1 if backwards else 1]
        known = np.ones(len(series), bool)
        first = 0 if backwards else 100
        known[first : first + length] = False
        fill = interpolate(series, known, first, first + length)
        ratios.append((fill.values - series[first : first + length]).sum() / sum_sigma(fill))
    assert 1.0 - 4.0 * np.sqrt(2 / 60) * 0.9 < np.mean(np.square(ratios)) < 1.33 + 4.0 * np.sqrt(2 / 60)


def test_an_extrapolation_is_judged_by_extrapolations(monkeypatch):
    """No value of a trial is predicted from those that lie where the stretch itself has none."""
    calls = []
    fill = autoregression._fill

    def recorded(series, observed, first, last, order, fitted=None, given=None):
        calls.append((first, last, given))
        return fill(series, observed, first, last, order, fitted, given)

    monkeypatch.setattr(autoregression, "_fill", recorded)
    known = np.ones(100, bool)
    known[90:] = False
    interpolate(oscillation(np.random.default_rng(1), 100, 0.02), known, 90, 100)
    trials = [c for c in calls if c[2] is not None]
    assert len(trials) > 10 and all(not given[first:].any() and given[:first].all() for first, _, given in trials)


def test_a_constant_series_is_continued_exactly():
    fill = interpolate(np.full(100, 2.5), np.ones(100, bool), 40, 50)
    np.testing.assert_array_equal(fill.values, 2.5)
    assert sum_sigma(fill) == 0.0


def test_too_few_values_give_their_mean_and_scatter():
    series = np.array([1.0, 3.0, 0.0, 0.0, 0.0, 1.0, 3.0])
    fill = interpolate(series, np.array([1, 1, 0, 0, 0, 1, 1], bool), 2, 5)
    assert fill.order == 0
    np.testing.assert_allclose(fill.values, 2.0)
    assert sum_sigma(fill) == pytest.approx(3.0)


def test_an_unstable_process_does_not_leave_the_range_of_the_series():
    """A series that is almost constant and then varies: fits to one side extrapolate without bounds."""
    rng = np.random.default_rng(1)
    series = np.concatenate((1e-12 * rng.standard_normal(100), np.exp(0.4 * np.arange(60)) * 1e-12, np.zeros(40)))
    for first in range(80, 150, 7):
        fill = interpolate(series, np.ones(200, bool), first, first + 9)
        reach = np.ptp(series)
        assert np.all((fill.values >= series.min() - reach) & (fill.values <= series.max() + reach))
        assert sum_sigma(fill) < 100.0 * reach


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    first=st.integers(0, 110),
    length=st.integers(1, 30),
    size=st.floats(1e-6, 1e6),
    offset=st.floats(-1e3, 1e3),
)
def test_the_covariance_is_symmetric_positive_and_follows_the_unit(seed, first, length, size, offset):
    series = oscillation(np.random.default_rng(seed), 140, 0.05)
    observed = np.ones(140, bool)
    fill, rescaled = (
        interpolate(series, observed, first, first + length),
        interpolate(size * (series + offset), observed, first, first + length),
    )
    assert np.isfinite(fill.values).all()
    assert np.linalg.eigvalsh(fill.covariance)[0] > 0.0
    np.testing.assert_array_equal(fill.covariance, fill.covariance.T)
    np.testing.assert_allclose(rescaled.values / size - offset, fill.values, atol=1e-3 * (1.0 + abs(offset)))
    assert sum_sigma(rescaled) == pytest.approx(size * sum_sigma(fill), rel=0.05)
