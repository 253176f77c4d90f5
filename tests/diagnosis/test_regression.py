"""Closed forms of the Bayesian regression on white rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from edl_filter.diagnosis.regression import BLOCK, FOLDS, held_out, regress


def data(seed=0, n=120, k=2, size=1.0):
    rng = np.random.default_rng(seed)
    x, sigma = rng.normal(size=(n, k)), np.array([0.5, 2.0])[:k]
    return x @ (size * sigma) + rng.normal(size=n), x, sigma


@given(st.integers(0, 50), st.floats(0.0, 2.0))
def test_gain_is_the_ratio_of_marginal_likelihoods(seed, size):
    y, x, sigma = data(seed, 12, size=size)
    with_it = multivariate_normal.logpdf(y, cov=np.eye(len(y)) + (x * sigma**2) @ x.T)
    without = multivariate_normal.logpdf(y, cov=np.eye(len(y)))
    assert regress(y, x, sigma).gain == pytest.approx(with_it - without, abs=1e-8)


def test_held_out_is_the_predictive_density_of_each_part():
    y, x, sigma = data(4, 90)
    time = np.linspace(0.0, 3.0 * FOLDS * BLOCK - 1e-6, len(y))
    part = np.floor(time / BLOCK).astype(int) % FOLDS
    expected = 0.0
    for f in range(FOLDS):
        inside = part == f
        fit = regress(y[~inside], x[~inside], sigma)
        mean, cov = x[inside] @ fit.size, np.eye(inside.sum()) + x[inside] @ fit.covariance @ x[inside].T
        expected += multivariate_normal.logpdf(y[inside], mean, cov) - multivariate_normal.logpdf(
            y[inside], np.zeros(inside.sum()), np.eye(inside.sum())
        )
    assert held_out(y, x, sigma, time) == pytest.approx(expected, abs=1e-8)


def test_no_effect_gains_nothing_and_a_large_one_does():
    gains = np.array([regress(*data(seed, size=0.0)).gain for seed in range(400)])
    assert np.mean(gains > np.log(20.0)) < 0.05  # Markov: the evidence ratio's mean is one without the effect
    assert regress(*data(size=1.0)).gain > 20.0


def test_share_of_the_data_goes_from_nothing_to_all():
    y, x, sigma = data()
    assert np.all(regress(y, x, sigma).data_share > 0.9)
    assert np.all(regress(y, 1e-6 * x, sigma).data_share < 1e-6)
