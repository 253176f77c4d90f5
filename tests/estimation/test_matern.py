"""Matérn processes of order 3/2 against twins: Bessel form, matrix exponential, explicit covariances."""

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.special import gamma, kv

from edl_filter.estimation.matern import (
    MATERN32_COVARIANCE,
    matern32_correlation,
    matern32_transition,
    sample_matern32,
)

#: Stochastic differential equation of value and slope: drift, and spectral density of the noise of the slope.
DRIFT = np.array([[0.0, 1.0], [-3.0, -2.0 * np.sqrt(3.0)]])
SPECTRAL_DENSITY = 4.0 * np.sqrt(3.0) ** 3


def bessel_correlation(r, order=1.5):
    """General Matérn correlation (Rasmussen & Williams 2006, eq. 4.14)."""
    z = np.sqrt(2.0 * order) * r
    return 1.0 if r == 0.0 else 2.0 ** (1.0 - order) / gamma(order) * z**order * kv(order, z)


@pytest.mark.parametrize("distance", [0.0, 0.03, 0.5, 4.0])
def test_transition_is_the_matrix_exponential(distance):
    transition, noise = matern32_transition(np.array(distance))
    np.testing.assert_allclose(transition, expm(DRIFT * distance), atol=1e-13)
    diffusion = np.diag([0.0, SPECTRAL_DENSITY])
    integral, _ = quad_vec(lambda r: expm(DRIFT * r) @ diffusion @ expm(DRIFT * r).T, 0.0, distance)
    np.testing.assert_allclose(noise, integral, atol=1e-9)


@pytest.mark.parametrize("distance", [0.0, 0.03, 0.5, 4.0])
def test_stationary_with_the_matern_correlation(distance):
    transition, noise = matern32_transition(np.array(distance))
    np.testing.assert_allclose(transition @ MATERN32_COVARIANCE @ transition.T + noise, MATERN32_COVARIANCE, atol=1e-12)
    assert (transition @ MATERN32_COVARIANCE)[0, 0] == pytest.approx(bessel_correlation(distance))
    d = np.sqrt(3.0) * distance
    assert (transition @ MATERN32_COVARIANCE)[0, 0] == pytest.approx((1.0 + d) * np.exp(-d))
    assert np.linalg.eigvalsh(noise).min() > -1e-12


def test_two_steps_are_one():
    (first, noise_first), (second, noise_second) = (
        matern32_transition(np.array(0.2)),
        matern32_transition(np.array(0.5)),
    )
    combined, noise = matern32_transition(np.array(0.7))
    np.testing.assert_allclose(second @ first, combined, atol=1e-12)
    np.testing.assert_allclose(second @ noise_first @ second.T + noise_second, noise, atol=1e-12)


def test_many_steps_are_each_by_itself():
    distance = np.array([[0.0, 0.1], [0.7, 2.0]])
    transition, noise = matern32_transition(distance)
    for index in np.ndindex(2, 2):
        for many, single in zip((transition, noise), matern32_transition(distance[index]), strict=True):
            np.testing.assert_array_equal(many[index], single)


def test_a_sample_is_the_root_of_the_covariance_times_normal_deviates():
    """The slow twin: element by element from the Bessel form."""
    nodes, step, sigma, length = 12, 700.0, 0.02, 5e3
    correlation = np.empty((nodes, nodes))
    for i in range(nodes):
        for j in range(nodes):
            correlation[i, j] = bessel_correlation(abs(i - j) * step / length)
    root = np.linalg.cholesky(correlation + 1e-9 * np.eye(nodes))
    expected = [
        sigma * sum(root[i, j] * z for j, z in enumerate(np.random.default_rng(4).standard_normal(nodes)))
        for i in range(nodes)
    ]
    sample = sample_matern32(np.random.default_rng(4), nodes, step, sigma, length)
    np.testing.assert_allclose(sample, expected, rtol=1e-6, atol=1e-9)


def test_samples_have_their_size_and_correlation():
    x = np.array([sample_matern32(np.random.default_rng(k), 41, 500.0, 0.02, 10e3) for k in range(4000)])
    np.testing.assert_allclose(x.std(axis=0), 0.02, rtol=0.05)
    for steps in (20, 1):
        d = np.sqrt(3.0) * steps * 500.0 / 10e3
        correlation = np.corrcoef(x[:, 7], x[:, 7 + steps])[0, 1]
        assert correlation == pytest.approx((1.0 + d) * np.exp(-d), abs=0.04 * d)


def test_a_process_is_sampled_at_steps_far_below_its_correlation_length():
    """Its correlation matrix is singular in double precision; the sample is smooth."""
    x = sample_matern32(np.random.default_rng(2), 300, 1.0, 2.0, 1e4)
    assert 0.1 < np.abs(x).max() < 10.0 and np.ptp(x) < 0.3


def test_correlations_of_any_shape_have_value_and_derivative_last():
    distance = np.array([[0.0, 0.1, 0.7], [-0.2, 2.3, 1.0]])
    correlation = matern32_correlation(distance)
    assert correlation.shape == (2, 3, 2)
    for index in np.ndindex(2, 3):
        np.testing.assert_array_equal(correlation[index], matern32_correlation(distance[index]))


def test_correlations_with_a_value_are_those_of_the_state_space_form():
    distance = np.array([0.0, 0.1, 0.7, 2.3])
    covariance = matern32_transition(distance)[0] @ MATERN32_COVARIANCE
    assert np.allclose(matern32_correlation(distance), covariance[..., 0], rtol=0.0, atol=1e-14)
    mirrored = matern32_correlation(-distance)
    assert np.allclose(mirrored * [1.0, -1.0], covariance[..., 0], rtol=0.0, atol=1e-14)
