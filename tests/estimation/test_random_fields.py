"""Smooth random fields: variance, correlation, reproducibility."""

import numpy as np
import pytest

from edl_filter.estimation.random_fields import (
    covariance_root,
    smooth_field,
    smooth_profile,
    squared_exponential_correlation,
)

DRAWS = 2000
ONE_LENGTH = np.exp(-0.5)


def test_the_correlation_is_that_of_a_normal_spectral_density():
    """The Fourier transform of the spectral density (Rasmussen and Williams 2006, section 4.2.1), by quadrature."""
    frequency, weight = np.polynomial.hermite.hermgauss(60)
    distance = np.linspace(-5.0, 5.0, 42).reshape(6, 7)
    expected = np.cos(np.sqrt(2.0) * distance[..., None] * frequency) @ weight / np.sqrt(np.pi)
    np.testing.assert_allclose(squared_exponential_correlation(distance), expected, atol=1e-13)
    assert squared_exponential_correlation(np.array(0.0)) == 1.0


def test_a_field_has_unit_variance_and_is_correlated_over_its_lengths():
    """Five standard errors of a variance and of a correlation of so many draws are 0.16 and 0.11 at most."""
    first, second = np.array([0.0, 0.5, 1.0]), np.array([0.0, 6.0, 12.0])
    random = np.random.default_rng(1)
    fields = np.array([smooth_field(random, first, 0.5, second, 6.0) for _ in range(DRAWS)])
    covariance = np.cov(fields.reshape(DRAWS, -1).T)
    axis = np.exp(-0.5 * np.subtract.outer([0.0, 1.0, 2.0], [0.0, 1.0, 2.0]) ** 2)
    assert np.abs(covariance - np.kron(axis, axis)).max() < 0.16
    assert covariance[0, 1] == pytest.approx(ONE_LENGTH, abs=0.11)
    assert np.abs(fields.mean(axis=0)).max() < 5.0 / np.sqrt(DRAWS)


def test_a_profile_has_unit_variance_and_is_correlated_over_its_length():
    random = np.random.default_rng(2)
    points = np.array([0.0, 10e3, 50e3])
    covariance = np.cov(np.array([smooth_profile(random, points, 10e3) for _ in range(DRAWS)]).T)
    expected = [[1.0, ONE_LENGTH, 0.0], [ONE_LENGTH, 1.0, 0.0], [0.0, 0.0, 1.0]]
    assert np.abs(covariance - expected).max() < 0.16


def test_the_root_is_one_of_the_correlation_also_where_that_is_singular():
    points = np.linspace(0.0, 1.0, 40)
    root = covariance_root(points, 5.0)
    expected = np.exp(-0.5 * (np.subtract.outer(points, points) / 5.0) ** 2)
    np.testing.assert_allclose(root @ root.T, expected, atol=1e-12)
    assert covariance_root(points, 5.0) is root and not root.flags.writeable
