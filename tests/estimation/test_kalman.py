"""The whitening filter against a textbook Kalman filter, the dense joint Gaussian, and sampled data sets."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st
from linear_problems import (
    joint_measurements,
    posterior_states,
    random_model,
    step_rows,
    transition,
    whiten_column,
)
from scipy.stats import multivariate_normal

from edl_filter.estimation import kalman
from edl_filter.estimation.kalman import log_likelihood, measurement_update, solve_lower, whitening_filter
from edl_filter.estimation.linear_state_space import (
    append_constant_states,
    with_gauss_markov_states,
)


def kalman_filter(model, measurements, initial_mean):
    """Textbook filter: innovations ``(R,)``, their covariance by step, and the log determinant of all of them."""
    p, x = model.initial_covariance.copy(), initial_mean.copy()
    innovations, covariances, log_determinant = np.zeros_like(measurements), [], 0.0
    for k, rows in enumerate(step_rows(model)):
        f, h = transition(model, k), model.design[rows]
        p, x = f @ p @ f.T + model.process_noise[k], f @ x
        s = h @ p @ h.T + model.row_noise[rows, : len(h)]
        innovations[rows] = measurements[rows] - h @ x
        covariances.append(s)
        log_determinant += np.linalg.slogdet(s)[1]
        gain = p @ h.T @ np.linalg.inv(s)
        x, p = x + gain @ innovations[rows], p - gain @ h @ p
    return innovations, covariances, log_determinant


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_white_rows_are_the_innovations_of_the_kalman_filter_over_their_cholesky_factor(seed):
    model = random_model(seed)
    rng = np.random.default_rng(1)
    columns, initial_mean = rng.normal(size=(model.row_start[-1], 3)), rng.normal(size=(7, 3))
    whiten = whitening_filter(model)
    white = whiten(columns, initial_mean)
    for c in range(3):
        innovations, covariances, log_determinant = kalman_filter(model, columns[:, c], initial_mean[:, c])
        expected = [
            np.linalg.solve(np.linalg.cholesky(s), innovations[rows])
            for s, rows in zip(covariances, step_rows(model), strict=True)
        ]
        np.testing.assert_allclose(white[:, c], np.concatenate(expected), atol=1e-9)
        assert whiten.log_determinant == pytest.approx(log_determinant, abs=1e-9)


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_likelihood_is_that_of_the_joint_gaussian(seed):
    model = random_model(seed)
    rng = np.random.default_rng(2)
    measurements, initial_mean = rng.normal(size=model.row_start[-1]), rng.normal(size=7)
    whiten = whitening_filter(model)
    mean, covariance = joint_measurements(model, initial_mean)
    constant = 0.5 * len(mean) * np.log(2.0 * np.pi)
    expected = multivariate_normal.logpdf(measurements, mean, covariance) + constant
    white = whiten_column(whiten, measurements, initial_mean)
    assert whiten.log_likelihood(white) == pytest.approx(expected, rel=1e-9)
    assert whiten.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-9)


def test_innovations_are_the_factor_times_the_white_rows():
    """Step by step; the first are the measurements themselves, nothing being estimated before them."""
    model = random_model()
    measurements = np.random.default_rng(2).normal(size=model.row_start[-1])
    whiten = whitening_filter(model)
    white = whiten_column(whiten, measurements, np.zeros(7))
    innovations = whiten.innovations(white)
    expected, covariances, _ = kalman_filter(model, measurements, np.zeros(7))
    np.testing.assert_allclose(innovations, expected, atol=1e-11)
    for rows, covariance in zip(step_rows(model), covariances, strict=True):
        factor = whiten.factor[rows, : rows.stop - rows.start]
        np.testing.assert_allclose(innovations[rows], factor @ white[rows], rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(factor @ factor.T, covariance, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(whiten.innovation_sigma[rows] ** 2, np.diag(covariance), rtol=1e-10)
    first = next(rows for rows in step_rows(model) if rows.stop > rows.start)
    np.testing.assert_allclose(innovations[first], measurements[first], atol=1e-12)


@pytest.mark.parametrize(("seed", "memory", "count"), [(3, 0.3, 1), (4, 2.0, 3), (5, 50.0, 2)])
def test_predictions_of_last_states_are_their_part_of_those_of_the_kalman_filter(seed, memory, count):
    """A textbook filter, whose prediction is divided between the last states and the others."""
    rng = np.random.default_rng(seed)
    base = random_model(seed)
    constant = append_constant_states(base, rng.normal(size=(base.row_start[-1], count)), np.ones(count))
    model = with_gauss_markov_states(
        constant, rng.uniform(0.1, 1.0, 40), memory * np.arange(1.0, count + 1.0), np.linspace(4.0, 2.0, count)
    )
    measurements, initial_mean = rng.normal(size=base.row_start[-1]), np.concatenate((np.ones(7), np.zeros(count)))
    expected = np.zeros_like(measurements)
    p, x = model.initial_covariance.copy(), initial_mean.copy()
    for k, rows in enumerate(step_rows(model)):
        f, h = transition(model, k), model.design[rows]
        p, x = f @ p @ f.T + model.process_noise[k], f @ x
        expected[rows] = h[:, 7:] @ x[7:]
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + model.row_noise[rows, : len(h)])
        x, p = x + gain @ (measurements[rows] - h @ x), p - gain @ h @ p
    whiten = whitening_filter(model)
    white = whiten_column(whiten, measurements, initial_mean)
    actual = whiten.predictions_of_last_states(white, count)
    assert np.max(np.abs(expected)) > 0.1
    np.testing.assert_allclose(actual, expected, atol=1e-9)


def test_sampled_innovations_have_the_stated_covariance():
    """Of 20 000 sampled data sets; a sampled covariance of S has the variance (S_ii S_jj + S_ij²) / count."""
    model, count = random_model(), 20_000
    rng, rows = np.random.default_rng(7), model.row_start[-1]
    initial_mean = rng.normal(size=7)
    mean, covariance = joint_measurements(model, initial_mean)
    samples = mean[:, None] + np.linalg.cholesky(covariance) @ rng.normal(size=(rows, count))
    whiten = whitening_filter(model)
    white = whiten(samples, np.repeat(initial_mean[:, None], count, axis=1))
    innovations = np.column_stack([whiten.innovations(np.ascontiguousarray(w)) for w in white.T])
    expected = scipy.linalg.block_diag(
        *(whiten.factor[r, : r.stop - r.start] @ whiten.factor[r, : r.stop - r.start].T for r in step_rows(model))
    )
    variance = np.diag(expected)
    sampling_sigma = np.sqrt((np.outer(variance, variance) + expected**2) / count)
    standardised = (innovations @ innovations.T / count - expected) / sampling_sigma
    assert np.abs(standardised).max() < 5.0  # of rows²/2 numbers of unit variance
    assert np.std(standardised[np.triu_indices(rows)]) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(np.sqrt(variance), whiten.innovation_sigma, rtol=1e-12)
    np.testing.assert_array_less(np.abs(innovations.mean(axis=1)), 5.0 * whiten.innovation_sigma / np.sqrt(count))


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_likelihood_without_gains_is_that_of_the_filter_and_of_the_joint_gaussian(seed):
    """Initial means that are not given are zero; nothing is changed."""
    model, rng = random_model(seed), np.random.default_rng(2)
    measurements, initial_mean = rng.normal(size=model.row_start[-1]), rng.normal(size=7)
    whiten, before = whitening_filter(model), model.initial_covariance.copy()
    value = log_likelihood(model, measurements, initial_mean)
    expected = whiten.log_likelihood(whiten_column(whiten, measurements, initial_mean))
    assert value == pytest.approx(expected, rel=1e-12)
    mean, covariance = joint_measurements(model, initial_mean)
    dense = multivariate_normal.logpdf(measurements, mean, covariance)
    assert value == pytest.approx(dense + 0.5 * len(measurements) * np.log(2.0 * np.pi), rel=1e-9)
    part = np.concatenate((initial_mean[:3], np.zeros(4)))
    assert log_likelihood(model, measurements, initial_mean[:3]) == log_likelihood(model, measurements, part)
    np.testing.assert_array_equal(model.initial_covariance, before)


@pytest.mark.parametrize("count", [1, 63, 64, 65, 200])
def test_columns_do_not_affect_each_other(count):
    """From 64 columns on several threads share them."""
    model = random_model()
    rng, whiten = np.random.default_rng(6), whitening_filter(model)
    columns, initial_mean = rng.normal(size=(model.row_start[-1], count)), rng.normal(size=(7, count))
    white = whiten(columns, initial_mean)
    for c in {0, count // 2, count - 1}:
        np.testing.assert_allclose(white[:, c], whiten_column(whiten, columns[:, c], initial_mean[:, c]), atol=1e-12)


@pytest.mark.parametrize(("steps", "count", "together"), [(1, 1, 64), (40, 3, 1), (64, 70, 64), (200, 70, 64)])
def test_normal_equations_are_the_products_of_all_white_rows(steps, count, together, monkeypatch):
    """The recursion goes on from part to part, some without rows; columns are asked for in the order of their rows."""
    monkeypatch.setattr(kalman, "_STEPS_PER_SUM", together)
    model, rng, asked = random_model(seed=5, steps=steps), np.random.default_rng(7), []
    whiten, rows = whitening_filter(model), model.row_start[-1]
    columns, residuals = rng.normal(size=(rows, count)), rng.normal(size=rows)

    def of_rows(part):
        asked.append(part)
        return columns[part]

    product, projection = whiten.normal_equations(of_rows, count, residuals)
    white = np.stack([whiten_column(whiten, columns[:, c], np.zeros(7)) for c in range(count)], axis=1)
    np.testing.assert_allclose(product, white.T @ white, rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(projection, white.T @ residuals, rtol=1e-12, atol=1e-10)
    assert np.array_equal(np.concatenate([np.arange(p.start, p.stop) for p in asked]), np.arange(rows))


def test_initial_means_that_are_not_given_are_zero():
    model = random_model()
    assert model.size == 7
    np.testing.assert_array_equal(model.initial_mean(np.array([1.0, 2.0])), [1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(model.initial_mean(np.ones((2, 3)))[:, 1], [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    rng, whiten = np.random.default_rng(6), whitening_filter(model)
    columns, leading = rng.normal(size=(model.row_start[-1], 2)), rng.normal(size=(3, 2))
    padded = np.concatenate((leading, np.zeros((4, 2))))
    np.testing.assert_array_equal(whiten(columns, leading), whiten(columns, padded))


def test_the_model_and_the_columns_are_not_changed():
    model = random_model()
    arrays = (model.design, model.row_noise, model.initial_covariance, model.increment.values)
    copies = [a.copy() for a in arrays]
    columns, initial_mean = np.ones((model.row_start[-1], 2)), np.ones((7, 2))
    whitening_filter(model)(columns, initial_mean)
    for array, copy in zip(arrays, copies, strict=True):
        np.testing.assert_array_equal(array, copy)
    assert np.all(columns == 1.0) and np.all(initial_mean == 1.0)


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_posterior_covariance_of_the_initial_states(seed):
    """Of all of them; of the first ones only where they are not correlated with the others a priori."""
    model = random_model(seed)
    measurements = np.zeros(model.row_start[-1])
    _, posterior = posterior_states(model, np.zeros(7), measurements)
    np.testing.assert_allclose(
        whitening_filter(model).posterior_initial_covariance(7), posterior[0, :, 0], rtol=1e-8, atol=1e-10
    )
    block = model.initial_covariance.copy()
    block[:4, 4:] = block[4:, :4] = 0.0
    model = replace(model, initial_covariance=block)
    _, posterior = posterior_states(model, np.zeros(7), measurements)
    np.testing.assert_allclose(
        whitening_filter(model).posterior_initial_covariance(4), posterior[0, :4, 0, :4], rtol=1e-8, atol=1e-10
    )


@given(st.integers(0, 1000), st.integers(1, 6), st.integers(1, 4))
def test_solve_lower(seed, size, width):
    rng = np.random.default_rng(seed)
    lower = np.tril(rng.normal(size=(size, size)))
    np.fill_diagonal(lower, 1.0 + rng.random(size))
    right = rng.normal(size=(size, width))
    solution = right.copy()
    solve_lower(lower + np.triu(np.ones((size, size)), 1), solution)  # elements above the diagonal are not read
    np.testing.assert_allclose(lower @ solution, right, rtol=1e-9, atol=1e-9 * np.abs(solution).max())


@given(st.integers(0, 1000), st.integers(1, 8), st.integers(1, 4))
def test_a_measurement_update_adds_the_information_of_the_measurement(seed, size, rows):
    """Information form: ``P⁺⁻¹ = P⁻¹ + Hᵀ R⁻¹ H`` and ``K = P⁺ Hᵀ R⁻¹``."""
    rng = np.random.default_rng(seed)
    root, noise_root, h = (rng.normal(size=shape) for shape in ((size, size), (rows, rows), (rows, size)))
    prior, noise = root @ root.T + 0.1 * np.eye(size), noise_root @ noise_root.T + 0.1 * np.eye(rows)
    gain, covariance = measurement_update(prior, h, noise)
    expected = np.linalg.inv(np.linalg.inv(prior) + h.T @ np.linalg.solve(noise, h))
    scale = np.abs(expected).max()
    np.testing.assert_allclose(covariance, expected, rtol=1e-8, atol=1e-8 * scale)
    expected_gain = expected @ np.linalg.solve(noise, h).T
    np.testing.assert_allclose(gain, expected_gain, rtol=1e-8, atol=1e-8 * np.abs(expected_gain).max())
    np.testing.assert_array_equal(covariance, covariance.T)


def test_an_update_by_nearly_exact_measurements_leaves_no_negative_variance():
    """The variances of the shorter ``P - K H P`` are its rounding errors; states that are known stay known."""
    prior = np.zeros((4, 4))
    prior[:3, :3] = 1e6 * (np.eye(3) + 0.9)
    h, noise = np.array([[1.0, 0.7, -0.3, 2.0], [0.2, 1.0, 1.0, 0.0], [0.5, -0.4, 1.0, 0.3]]), 1e-12 * np.eye(3)
    gain, covariance = measurement_update(prior, h, noise)
    shorter = prior - gain @ h @ prior
    assert np.linalg.eigvalsh(0.5 * (shorter + shorter.T))[0] < -1e-12
    inverse = np.linalg.inv(h[:, :3])
    np.testing.assert_allclose(covariance[:3, :3], inverse @ noise @ inverse.T, rtol=1e-9)
    assert not covariance[3].any() and not gain[3].any()
