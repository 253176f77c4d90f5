"""Corrections for the rotation within a sample, against closed forms and quadrature."""

import numpy as np
import pytest

from edl_filter.navigation.rotation_corrections import (
    gauss_legendre,
    rotation_corrections,
)


def test_nodes_integrate_polynomials_exactly():
    x, weights = gauss_legendre(5)
    for power in range(10):
        assert weights @ x**power == pytest.approx(1.0 / (power + 1), rel=1e-13)


@pytest.mark.parametrize(
    ("nu", "missed"), [(0.43, 1.51e-5), (1.0, 6.73e-4), (1.5, 6.03e-3), (2.0, 3.875e-2), (2.5, 0.2078)]
)
def test_classical_coning_is_missed_by_the_stated_part(nu, missed):
    """The exact coefficient of Δθ² is ``(ν - sin ν) / (4 (1 - cos ν))``; as in the module's docstring."""
    n = 120
    index = np.arange(n)
    angle = np.column_stack((np.cos(nu * index), np.sin(nu * index), np.zeros(n)))
    _, coning = rotation_corrections(index + 1.0, np.ones(n), np.zeros((n, 3)), angle)
    exact = (nu - np.sin(nu)) / (4.0 * (1.0 - np.cos(nu)))
    assert (exact - coning[n // 2, 2]) / exact == pytest.approx(missed, rel=0.02)


def test_corrections_are_the_integrals_of_their_definition():
    """``½ ∫ α × ω`` and ``½ ∫ (α × f + v × ω) + Δθ × (Δθ × Δv) / 24`` of polynomials, by dense quadrature."""
    rng = np.random.default_rng(2)
    n, h = 9, 0.125
    edges = h * np.arange(n + 1.0)
    rates, forces = ([np.polynomial.Polynomial(rng.standard_normal(5)) for _ in range(3)] for _ in range(2))
    rate, force = (np.column_stack([np.diff(p.integ()(edges)) / h for p in q]) for q in (rates, forces))
    to_force, to_rate = rotation_corrections(edges[1:], np.full(n, h), force, rate)
    x, weights = np.polynomial.legendre.leggauss(20)
    for i in range(n):
        t = edges[i] + 0.5 * h * (x + 1.0)
        w, f = (np.column_stack([p(t) for p in q]) for q in (rates, forces))
        alpha, v = (np.column_stack([p.integ()(t) - p.integ()(edges[i]) for p in q]) for q in (rates, forces))
        coning = 0.25 * weights @ np.cross(alpha, w)
        sculling = 0.25 * weights @ (np.cross(alpha, f) + np.cross(v, w))
        rotation = h**2 / 24.0 * np.cross(rate[i], np.cross(rate[i], force[i]))
        np.testing.assert_allclose(to_rate[i], coning, rtol=1e-6, atol=1e-11)
        np.testing.assert_allclose(to_force[i], sculling + rotation, rtol=1e-6, atol=1e-11)


def test_lengths_of_intervals_may_change():
    """A sample of 51 increments among those of 50: a quartic rate is still integrated exactly."""
    interval = np.where(np.arange(20) == 9, 0.1275, 0.125)
    edges = np.concatenate(([0.0], np.cumsum(interval)))
    x, y = np.polynomial.Polynomial([0.2, 0.1, -0.3, 0.05, 0.02]), np.polynomial.Polynomial([0.1, -0.4, 0.2, 0.1])
    rate = np.column_stack((np.diff(x.integ()(edges)), np.diff(y.integ()(edges)), 0.0 * interval)) / interval[:, None]
    _, to_rate = rotation_corrections(edges[1:], interval, np.zeros((20, 3)), rate)
    for i in (8, 9, 10):
        a = edges[i]
        integrand = (x.integ() - x.integ()(a)) * y - (y.integ() - y.integ()(a)) * x
        expected = 0.5 * (integrand.integ()(edges[i + 1]) - integrand.integ()(a)) / interval[i]
        assert to_rate[i, 2] == pytest.approx(expected, rel=1e-6)
