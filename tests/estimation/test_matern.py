"""Matérn processes of order 3/2 and 5/2 against twins: Bessel form, matrix exponential, explicit covariances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.special import gamma, kv

from edl_filter.estimation.matern import (
    MATERN32_COVARIANCE,
    MATERN52_COVARIANCE,
    matern32_transition,
    matern52_correlation,
    matern52_transition,
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
    whole, noise = matern32_transition(np.array(0.7))
    np.testing.assert_allclose(second @ first, whole, atol=1e-12)
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


# --- order 5/2 ------------------------------------------------------------------------------------------------------

#: Stochastic differential equation of value and two derivatives: ``(d/dr + √5)³ x = white noise``.
DRIFT52 = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(5.0**1.5), -15.0, -3.0 * np.sqrt(5.0)]])
SPECTRAL_DENSITY52 = 16.0 / 3.0 * 5.0**2.5


def correlation52(r):
    """Rasmussen & Williams 2006, eq. 4.17."""
    d = np.sqrt(5.0) * np.abs(r)
    return (1.0 + d + d**2 / 3.0) * np.exp(-d)


@pytest.mark.parametrize("distance", [0.0, 1e-3, 0.03, 0.5, 4.0, 30.0])
def test_transition_of_order_52_is_the_matrix_exponential(distance):
    transition, noise = matern52_transition(np.array(distance))
    np.testing.assert_allclose(transition, expm(DRIFT52 * distance), rtol=0.0, atol=1e-12)
    diffusion = np.diag([0.0, 0.0, SPECTRAL_DENSITY52])
    integral, _ = quad_vec(lambda r: expm(DRIFT52 * r) @ diffusion @ expm(DRIFT52 * r).T, 0.0, distance)
    np.testing.assert_allclose(noise, integral, rtol=0.0, atol=1e-8)


def test_covariance_of_order_52_is_that_of_the_stochastic_differential_equation():
    """The stationary solution of the Lyapunov equation, and the derivatives of the correlation at zero."""
    diffusion = np.diag([0.0, 0.0, SPECTRAL_DENSITY52])
    np.testing.assert_allclose(
        DRIFT52 @ MATERN52_COVARIANCE + MATERN52_COVARIANCE @ DRIFT52.T, -diffusion, rtol=0.0, atol=1e-10
    )
    assert np.linalg.eigvalsh(MATERN52_COVARIANCE).min() > 0.0
    step = 1e-3
    curvature = (correlation52(step) - 2.0 + correlation52(-step)) / step**2
    assert MATERN52_COVARIANCE[1, 1] == pytest.approx(-curvature, rel=1e-3)


@given(st.lists(st.floats(0.0, 12.0), min_size=1, max_size=30))
def test_the_states_of_order_52_have_the_matern_correlation(steps):
    """Values of all pairs of steps, by dense propagation: of random distances, among them none."""
    transition, noise = matern52_transition(np.array(steps))
    covariance = np.zeros((len(steps) + 1, 3, len(steps) + 1, 3))
    covariance[0, :, 0] = MATERN52_COVARIANCE
    for k, (f, q) in enumerate(zip(transition, noise, strict=True)):
        covariance[k + 1, :, : k + 1] = np.einsum("ij,jkl->ikl", f, covariance[k, :, : k + 1])
        covariance[: k + 1, :, k + 1] = np.einsum("ikl->kli", covariance[k + 1, :, : k + 1])
        covariance[k + 1, :, k + 1] = f @ covariance[k, :, k] @ f.T + q
        np.testing.assert_allclose(covariance[k + 1, :, k + 1], MATERN52_COVARIANCE, rtol=0.0, atol=1e-11)
    x = np.concatenate(([0.0], np.cumsum(steps)))
    expected = correlation52(np.subtract.outer(x, x))
    np.testing.assert_allclose(covariance[:, 0, :, 0], expected, rtol=0.0, atol=1e-12)


@given(st.floats(0.0, 20.0))
def test_correlation_of_order_52_is_the_bessel_form(distance):
    assert correlation52(distance) == pytest.approx(float(bessel_correlation(max(distance, 1e-6), 2.5)), abs=1e-10)
    transition, _ = matern52_transition(np.array(distance))
    assert (transition @ MATERN52_COVARIANCE)[0, 0] == pytest.approx(correlation52(distance), abs=1e-13)


@given(st.floats(1e-4, 50.0))
def test_noise_of_order_52_is_a_covariance(distance):
    """To rounding: over a short step it is of fifth order in the value."""
    _, noise = matern52_transition(np.array(distance))
    np.testing.assert_allclose(noise, noise.T, rtol=0.0, atol=1e-13)
    assert np.linalg.eigvalsh(noise).min() > -1e-13


def test_two_steps_of_order_52_are_one_and_many_are_each_by_itself():
    distance = np.array([[0.2, 0.5], [0.0, 0.7]])
    transition, noise = matern52_transition(distance)
    np.testing.assert_allclose(transition[0, 1] @ transition[0, 0], transition[1, 1], rtol=0.0, atol=1e-13)
    both = transition[0, 1] @ noise[0, 0] @ transition[0, 1].T + noise[0, 1]
    np.testing.assert_allclose(both, noise[1, 1], rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(transition[1, 0], np.eye(3))
    for index in np.ndindex(2, 2):
        for many, single in zip((transition, noise), matern52_transition(distance[index]), strict=True):
            np.testing.assert_allclose(many[index], single, rtol=1e-14, atol=1e-15)


def test_correlations_with_a_value_are_those_of_the_state_space_form():
    distance = np.array([0.0, 0.1, 0.7, 2.3])
    covariance = matern52_transition(distance)[0] @ MATERN52_COVARIANCE
    assert np.allclose(matern52_correlation(distance), covariance[..., 0], rtol=0.0, atol=1e-14)
    mirrored = matern52_correlation(-distance)
    assert np.allclose(mirrored * [1.0, -1.0, 1.0], covariance[..., 0], rtol=0.0, atol=1e-14)
