"""Models that are derived from a linear state-space model, against the dense joint Gaussian."""

from dataclasses import replace

import numpy as np
import pytest
from linear_problems import (
    from_dense,
    joint_measurements,
    joint_noise,
    posterior_states,
    random_model,
    step_rows,
    whiten_column,
)
from scipy.stats import multivariate_normal

from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import (
    append_constant_states,
    with_gauss_markov_states,
    with_known_states,
    with_less_noise,
)
from edl_filter.estimation.smoothing import smoothed_states


@pytest.mark.parametrize(("memory", "variance"), [(0.3, 1.0), (2.0, 0.25), (50.0, 9.0)])
def test_gauss_markov_states_add_a_covariance_that_decays_exponentially(memory, variance):
    """Of two processes with their own columns: ``h_i h_j σ² exp(-|t_i - t_j| / memory)``."""
    model, rng = random_model(3), np.random.default_rng(8)
    design = rng.normal(size=(model.row_start[-1], 2))
    interval = rng.uniform(0.05, 0.4, len(model.increment))
    constant = append_constant_states(model, design, np.ones(2))
    processes = with_gauss_markov_states(constant, interval, np.full(2, memory), np.full(2, variance))
    assert processes.design is constant.design
    mean = rng.normal(size=7)
    time = np.repeat(np.cumsum(interval), np.diff(model.row_start))
    correlation = np.exp(-np.abs(np.subtract.outer(time, time)) / memory)
    expected = joint_measurements(model, mean)[1] + variance * correlation * (design @ design.T)
    actual = joint_measurements(processes, np.concatenate((mean, np.zeros(2))))[1]
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("seed", "count"), [(3, 1), (4, 2), (5, 5)])
def test_appended_constant_states_are_those_of_the_dense_gaussian(seed, count):
    """Likelihood: each adds a rank-one covariance to that of the measurements. Posterior: of the whole dense model."""
    model, rng = random_model(seed), np.random.default_rng(seed)
    rows = model.row_start[-1]
    design, sigma = rng.normal(size=(rows, count)), rng.uniform(0.1, 3.0, count)
    appended = append_constant_states(model, design, sigma)
    assert appended.size == model.size + count
    measurements, initial_mean = rng.normal(size=rows), rng.normal(size=model.size)
    mean, covariance = joint_measurements(model, initial_mean)
    for column, s in zip(design.T, sigma, strict=True):
        covariance = covariance + s**2 * np.outer(column, column)
    whiten = whitening_filter(appended)
    constant = 0.5 * rows * np.log(2.0 * np.pi)
    expected = multivariate_normal.logpdf(measurements, mean, covariance) + constant
    assert whiten.log_likelihood(whiten_column(whiten, measurements, initial_mean)) == pytest.approx(expected, rel=1e-9)
    # the posterior of the constants, by conditioning the dense Gaussian on the measurements
    gain = np.linalg.solve(covariance, design * sigma**2).T
    estimate, posterior = gain @ (measurements - mean), np.diag(sigma**2) - gain @ (design * sigma**2)
    padded = np.concatenate((initial_mean, np.zeros(count)))
    states, state_covariance = posterior_states(appended, padded, measurements)
    for step in (0, len(appended.increment)):  # and it does not change with time
        np.testing.assert_allclose(states[step, -count:], estimate, rtol=1e-8, atol=1e-10)
        block = state_covariance[step, -count:, step, -count:]
        np.testing.assert_allclose(block, posterior, rtol=1e-7, atol=1e-10)
    initial, smoothed = smoothed_states(whiten, whiten_column(whiten, measurements, initial_mean), padded)
    np.testing.assert_allclose(initial[-count:], estimate, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(smoothed[:, -count:], np.tile(estimate, (len(smoothed), 1)), rtol=1e-8, atol=1e-10)


def test_constant_states_that_are_exact_change_nothing():
    model, rng = random_model(), np.random.default_rng(8)
    rows = model.row_start[-1]
    plain, exact = (
        whitening_filter(m) for m in (model, append_constant_states(model, rng.normal(size=(rows, 2)), np.zeros(2)))
    )
    columns, initial_mean = rng.normal(size=(rows, 3)), rng.normal(size=(7, 3))
    np.testing.assert_allclose(exact(columns, initial_mean), plain(columns, initial_mean), rtol=1e-12, atol=1e-12)
    assert exact.log_determinant == pytest.approx(plain.log_determinant, rel=1e-12)
    assert append_constant_states(model, np.zeros((rows, 0)), np.zeros(0)).size == model.size


def test_known_states_are_not_correlated_with_others_by_process_noise():
    """Noise of two correlated states keeps only the variance of the one that is not known."""
    dense = np.tile([[4.0, 1.0, 0.0], [1.0, 9.0, 2.0], [0.0, 2.0, 16.0]], (5, 1, 1))
    model = random_model(steps=5, size=3)
    model = replace(model, process_noise=from_dense(dense), initial_covariance=dense[0])
    conditioned = with_known_states(model, [1])
    expected = np.diag([4.0, 0.0, 16.0])
    np.testing.assert_array_equal(conditioned.process_noise[3], expected)
    np.testing.assert_array_equal(conditioned.initial_covariance, expected)
    np.testing.assert_array_equal(model.process_noise[3], dense[3])
    np.testing.assert_array_equal(model.initial_covariance, dense[0])


@pytest.mark.parametrize("seed", [3, 4])
def test_a_constant_that_is_known_is_one_that_was_never_appended(seed):
    model, rng = random_model(seed), np.random.default_rng(seed)
    rows = model.row_start[-1]
    design, sigma = rng.normal(size=(rows, 3)), rng.uniform(0.1, 3.0, 3)
    known = whitening_filter(with_known_states(append_constant_states(model, design, sigma), np.array([7, 9])))
    expected = whitening_filter(append_constant_states(model, design[:, 1:2], sigma[1:2]))
    columns = rng.normal(size=(rows, 2))
    initial_mean = rng.normal(size=(7, 2))
    np.testing.assert_allclose(known(columns, initial_mean), expected(columns, initial_mean), rtol=1e-9, atol=1e-10)
    assert known.log_determinant == pytest.approx(expected.log_determinant, rel=1e-10)


def test_less_noise_is_that_of_the_joint_gaussian():
    """Of all rows of some steps, whose noise is correlated within the step."""
    model = random_model()
    rows = np.concatenate([np.arange(r.start, r.stop) for r in step_rows(model)[5:12]])
    improved = whitening_filter(with_less_noise(model, rows, 10.0))
    covariance = joint_measurements(model, np.zeros(7))[1]
    part = np.ix_(rows, rows)
    covariance[part] -= 0.99 * joint_noise(model)[part]
    assert improved.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-9)
    np.testing.assert_array_equal(model.row_noise, random_model().row_noise)
