"""Interpolation by an autoregression: known solutions, calibration of its covariance, and series without a model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.estimation.autoregression import interpolate


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
