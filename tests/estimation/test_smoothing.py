"""Backward recursions against the dense joint Gaussian of all states and measurements."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_problems import joint_measurements, posterior_states, random_model, step_rows, transition

from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.smoothing import (
    precision_weighted_residuals,
    smoothed_joint_covariance,
    smoothed_last_states,
    smoothed_moments,
    smoothed_states,
    smoother_gain,
)


def random_data(model, seed, leading):
    """Measurements ``(R,)``, the initial mean of the first states, and that of all."""
    rng = np.random.default_rng(seed)
    initial_mean = np.zeros(model.size)
    initial_mean[:leading] = rng.normal(size=leading)
    return rng.normal(size=model.row_start[-1]), initial_mean[:leading], initial_mean


def filtered(model, measurements, initial_mean):
    """The whitening filter and the white rows ``(R,)``."""
    whiten = whitening_filter(model)
    return whiten, whiten(measurements[:, None], initial_mean[:, None])[:, 0]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_precision_weighted_residuals_are_those_of_the_joint_covariance(seed):
    model = random_model(seed)
    measurements, leading, initial_mean = random_data(model, seed, 7)
    weighted, diagonal = precision_weighted_residuals(*filtered(model, measurements, leading))
    mean, covariance = joint_measurements(model, initial_mean)
    precision = np.linalg.inv(covariance)
    np.testing.assert_allclose(weighted, precision @ (measurements - mean), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(diagonal, np.diag(precision), rtol=1e-6)


def test_they_give_the_derivative_of_the_likelihood_with_respect_to_a_rows_noise():
    model = random_model()
    measurements = np.random.default_rng(3).normal(size=model.row_start[-1])
    weighted, diagonal = precision_weighted_residuals(*filtered(model, measurements, np.zeros(7)))
    covariance, step = joint_measurements(model, np.zeros(7))[1], 1e-5

    def log_likelihood(c):
        return -0.5 * measurements @ np.linalg.solve(c, measurements) - 0.5 * np.linalg.slogdet(c)[1]

    for i in range(len(measurements)):
        added = np.zeros_like(covariance)
        added[i, i] = step
        derivative = (log_likelihood(covariance + added) - log_likelihood(covariance - added)) / (2.0 * step)
        np.testing.assert_allclose(0.5 * (weighted[i] ** 2 - diagonal[i]), derivative, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(("seed", "leading"), [(3, 7), (4, 7), (5, 3)])
def test_smoothed_states_are_the_posterior_mean(seed, leading):
    """At the beginning and after every step."""
    model = random_model(seed)
    measurements, leading_mean, initial_mean = random_data(model, seed, leading)
    initial, states = smoothed_states(*filtered(model, measurements, leading_mean), leading_mean)
    expected, _ = posterior_states(model, initial_mean, measurements)
    np.testing.assert_allclose(initial, expected[0], atol=1e-8)
    np.testing.assert_allclose(states, expected[1:], atol=1e-8)


@pytest.mark.parametrize(("seed", "size", "moving", "count"), [(4, 5, 5, 2), (5, 5, 5, 5), (6, 7, 3, 6), (7, 6, 2, 1)])
def test_smoothed_last_states_are_posterior_mean_and_covariance(seed, size, moving, count):
    """Of states that move and of constant ones."""
    model = random_model(seed, steps=30, size=size, moving=moving)
    measurements, leading_mean, initial_mean = random_data(model, seed, 3)
    mean, covariance = smoothed_last_states(*filtered(model, measurements, leading_mean), leading_mean, count)
    expected_mean, expected_covariance = posterior_states(model, initial_mean, measurements)
    assert mean.shape == (30, count) and covariance.shape == (30, count, count)
    np.testing.assert_allclose(mean, expected_mean[1:, -count:], atol=1e-9)
    for k in range(30):
        expected = expected_covariance[k + 1, -count:, k + 1, -count:]
        np.testing.assert_allclose(covariance[k], expected, atol=1e-9)


def test_the_two_smoothers_agree():
    model = random_model(8)
    measurements, leading_mean, _ = random_data(model, 8, 7)
    whiten, white = filtered(model, measurements, leading_mean)
    mean, _ = smoothed_last_states(whiten, white, leading_mean, 7)
    np.testing.assert_allclose(mean, smoothed_states(whiten, white, leading_mean)[1], atol=1e-9)


def textbook_smoother(model, measurements, initial_mean):
    """Means, covariances and gains of the Rauch-Tung-Striebel smoother over a textbook filter, from the start."""
    predicted, filtered_moments = [], [(initial_mean, model.initial_covariance)]
    for k, rows in enumerate(step_rows(model)):
        f, h, (x, p) = transition(model, k), model.design[rows], filtered_moments[-1]
        x, p = f @ x, f @ p @ f.T + model.process_noise[k]
        predicted.append((x, p))
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + model.row_noise[rows, : len(h)])
        filtered_moments.append((x + gain @ (measurements[rows] - h @ x), p - gain @ h @ p))
    mean, covariance = filtered_moments[-1]
    means, covariances, gains = [mean], [covariance], []
    for k in range(len(predicted) - 1, -1, -1):
        x, p = filtered_moments[k]
        gains.append(smoother_gain(p @ transition(model, k).T, predicted[k][1]))
        mean, covariance = smoothed_moments(x, p, gains[-1], mean - predicted[k][0], covariance - predicted[k][1])
        means.append(mean)
        covariances.append(covariance)
    return np.array(means[::-1]), np.array(covariances[::-1]), np.array(gains[::-1])


@pytest.mark.parametrize("seed", [3, 4])
def test_the_rauch_tung_striebel_smoother_has_the_posterior_of_the_dense_gaussian(seed):
    """Backwards over a textbook filter; some steps have no measurements."""
    model = random_model(seed, steps=20)
    measurements, _, initial_mean = random_data(model, seed, 7)
    means, covariances, _ = textbook_smoother(model, measurements, initial_mean)
    expected_mean, expected_covariance = posterior_states(model, initial_mean, measurements)
    np.testing.assert_allclose(means, expected_mean, atol=1e-7)
    for k, covariance in enumerate(covariances):
        np.testing.assert_allclose(covariance, expected_covariance[k, :, k], atol=1e-7)
        if k < 20:
            np.testing.assert_array_equal(covariance, covariance.T)


@pytest.mark.parametrize(
    ("seed", "steps"), [(3, (0, 4, 4, 11, 20)), (4, (2, 3, 19)), (5, (20, 20)), (6, (7,)), (7, tuple(range(21)))]
)
def test_functions_of_states_at_several_steps_have_the_covariance_of_the_dense_gaussian(seed, steps):
    """One to three functions a step; twice at one step, at the first, at the last, and at every step."""
    model, rng = random_model(seed, steps=20), np.random.default_rng(seed)
    measurements, _, initial_mean = random_data(model, seed, 7)
    _, covariances, gains = textbook_smoother(model, measurements, initial_mean)
    _, dense = posterior_states(model, initial_mean, measurements)
    designs = [rng.normal(size=(rng.integers(1, 4), 7)) for _ in steps]
    expected = np.block([[a @ dense[i, :, j] @ b.T for j, b in zip(steps, designs, strict=True)]
                         for i, a in zip(steps, designs, strict=True)])  # fmt: skip
    joint = smoothed_joint_covariance(covariances, gains, steps, designs)
    np.testing.assert_allclose(joint, expected, atol=1e-8 * np.abs(expected).max())


def test_no_function_has_a_covariance_of_no_rows():
    assert smoothed_joint_covariance(np.eye(2)[None], np.zeros((0, 2, 2)), [], []).shape == (0, 0)
