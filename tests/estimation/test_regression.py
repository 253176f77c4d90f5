"""Bayesian regression on white rows against dense Gaussians."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from edl_filter.estimation.regression import fit_normal_equations, held_out_gain, regress, smallest_size

BLOCK, FOLDS = 5.0, 5


def simulated(seed=0, rows=120, size=1.0):
    """Measurements of two coefficients of `size` sigmas, regressors, and prior sigmas."""
    rng = np.random.default_rng(seed)
    x, sigma = rng.normal(size=(rows, 2)), np.array([0.5, 2.0])
    return x @ (size * sigma) + rng.normal(size=rows), x, sigma


@given(st.integers(0, 50), st.floats(0.0, 2.0))
def test_gain_is_the_ratio_of_marginal_likelihoods(seed, size):
    y, x, sigma = simulated(seed, 12, size)
    with_regressors = multivariate_normal.logpdf(y, cov=np.eye(len(y)) + (x * sigma**2) @ x.T)
    without = multivariate_normal.logpdf(y, cov=np.eye(len(y)))
    assert regress(y, x, sigma).gain == pytest.approx(with_regressors - without, abs=1e-8)


@given(st.integers(0, 1000), st.integers(1, 4))
def test_posterior_is_the_conditional_of_the_joint_gaussian(seed, count):
    """Of coefficients and measurements."""
    rng = np.random.default_rng(seed)
    x, sigma = rng.normal(size=(10, count)), rng.uniform(0.1, 3.0, count)
    y = rng.normal(size=10)
    prior = np.diag(sigma**2)
    total = x @ prior @ x.T + np.eye(10)
    estimate = prior @ x.T @ np.linalg.solve(total, y)
    covariance = prior - prior @ x.T @ np.linalg.solve(total, x @ prior)
    gain = multivariate_normal.logpdf(y, cov=total) - multivariate_normal.logpdf(y, cov=np.eye(10))
    for fit in (regress(y, x, sigma), fit_normal_equations(x.T @ x, x.T @ y, sigma)):
        np.testing.assert_allclose(fit.estimate, estimate, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-8, atol=1e-9)
        assert fit.gain == pytest.approx(gain, abs=1e-7)
        np.testing.assert_allclose(fit.data_share, 1.0 - np.diag(covariance) / sigma**2, atol=1e-9)


def slow_held_out_gain(y, x, sigma, time):
    """The predictive density of each fold, from the posterior of all others."""
    fold = np.floor((time - time[0]) / BLOCK).astype(int) % FOLDS
    total = 0.0
    for f in set(fold):
        inside = fold == f
        fit = regress(y[~inside], x[~inside], sigma)
        count = int(inside.sum())
        mean = x[inside] @ fit.estimate
        covariance = np.eye(count) + x[inside] @ fit.covariance @ x[inside].T
        total += multivariate_normal.logpdf(y[inside], mean, covariance)
        total -= multivariate_normal.logpdf(y[inside], np.zeros(count), np.eye(count))
    return total


def test_held_out_gain_is_the_predictive_density_of_each_fold():
    y, x, sigma = simulated(4, 90)
    time = np.linspace(0.0, 3.0 * FOLDS * BLOCK - 1e-6, len(y))
    expected = slow_held_out_gain(y, x, sigma, time)
    assert held_out_gain(y, x, sigma, time, BLOCK, FOLDS) == pytest.approx(expected, abs=1e-8)


@given(st.integers(0, 1000), st.floats(2.0, 100.0), st.floats(0.0, 1.0))
def test_with_irregular_times_and_empty_folds_too(seed, span, size):
    """A short record has fewer blocks than folds; some blocks have no rows."""
    y, x, sigma = simulated(seed, 30, size)
    time = 300.0 + np.sort(np.random.default_rng(seed).uniform(0.0, span, len(y)))
    expected = slow_held_out_gain(y, x, sigma, time)
    assert held_out_gain(y, x, sigma, time, BLOCK, FOLDS) == pytest.approx(expected, abs=1e-7)


def test_no_effect_gains_nothing_and_a_large_one_does():
    gains = np.array([regress(*simulated(seed, size=0.0)).gain for seed in range(400)])
    assert np.mean(gains > np.log(20.0)) < 0.05  # Markov: the mean of the evidence ratio is one without the effect
    assert regress(*simulated(size=1.0)).gain > 20.0


def test_data_share_is_one_with_much_data_and_zero_without():
    y, x, sigma = simulated()
    assert np.all(regress(y, x, sigma).data_share > 0.9)
    assert np.all(regress(y, 1e-6 * x, sigma).data_share < 1e-6)


@given(st.floats(-6.0, 24.0), st.floats(-3.0, 5.0), st.floats(1.0, 20.0))
def test_the_smallest_size_does_not_depend_on_the_unit(log_information, log_ratio, gain):
    """Sizes of rad/s and of kilometres alike: in prior sigmas it depends on the information of a sigma alone."""
    sigma = 10.0 ** (0.5 * (log_ratio - log_information))
    expected = smallest_size(10.0**log_ratio, 1.0, gain)
    assert smallest_size(10.0**log_information, sigma, gain) / sigma == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 5.0, 20.0, 1e4])
@pytest.mark.parametrize("gain", [1.0, 6.0])
def test_data_of_the_smallest_size_gain_on_average_what_is_required(ratio, gain):
    """`regress` on 20,000 random data sets, also where the prior contributes much: within four sigmas of their mean."""
    rng = np.random.default_rng(5)
    sigma, column = 0.7, rng.normal(size=12)
    column *= np.sqrt(ratio) / sigma / np.linalg.norm(column)
    s = smallest_size(float(column @ column), sigma, gain)
    gains = np.array([
        regress(s * column + noise, column[:, None], np.array([sigma])).gain for noise in rng.normal(size=(20_000, 12))
    ])  # fmt: skip
    assert abs(np.mean(gains) - gain) < 4.0 * np.std(gains) / np.sqrt(len(gains))


def test_without_information_no_size_is_detectable():
    assert smallest_size(0.0, 1.0, 6.0) == np.inf and smallest_size(1.0, 0.0, 6.0) == np.inf
