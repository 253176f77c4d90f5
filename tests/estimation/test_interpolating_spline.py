"""The interpolating spline against scipy's, and against polynomials."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from edl_filter.estimation.interpolating_spline import InterpolatingSpline, integral_spline, piecewise_integral


@pytest.mark.parametrize(("degree", "count"), [(1, 2), (3, 4), (3, 5), (3, 300), (5, 6), (5, 7), (5, 300)])
def test_it_is_scipys(degree, count):
    rng = np.random.default_rng(count)
    x, y = np.cumsum(rng.uniform(0.5, 1.5, count)), rng.normal(size=(count, 3))
    at = np.concatenate((x, rng.uniform(x[0], x[-1], 200)))
    reference, spline = make_interp_spline(x, y, k=degree), InterpolatingSpline.through(x, y, degree)
    for order in range(degree + 1):
        expected = reference.derivative(order)(at) if order else reference(at)
        np.testing.assert_allclose(spline.derivative(order)(at), expected, atol=1e-10 * np.abs(expected).max())


def test_powers_are_the_polynomials_between_the_abscissae():
    rng = np.random.default_rng(1)
    x, y = np.cumsum(rng.uniform(0.5, 1.5, 40)), rng.normal(size=(40, 2))
    spline = InterpolatingSpline.through(x, y, 5)
    powers, fraction = spline.powers(x[:-1]), rng.uniform(size=39)
    distance = fraction * np.diff(x)
    values = sum(c * distance[:, None] ** k for k, c in enumerate(powers))
    assert powers.shape == (6, 39, 2)
    np.testing.assert_allclose(values, make_interp_spline(x, y, k=5)(x[:-1] + distance), atol=1e-11)


def test_splines_through_several_sets_of_abscissae_in_turn_have_their_own_knots_and_bases():
    rng = np.random.default_rng(2)
    sets = [np.cumsum(rng.uniform(0.5, 1.5, count)) for count in (20, 20, 21)]
    for _ in range(2):
        y = rng.normal(size=(21, 2))
        for x in sets:
            for degree in (3, 5):
                spline = InterpolatingSpline.through(x, y[: len(x)], degree)
                reference = make_interp_spline(x, y[: len(x)], k=degree)
                for at in (x[:-1], 0.5 * (x[1:] + x[:-1])):
                    powers = spline.powers(at)
                    np.testing.assert_allclose(powers[0], reference(at), atol=1e-11)
                    np.testing.assert_allclose(powers[2], 0.5 * reference.derivative(2)(at), atol=1e-9)


def test_abscissae_that_do_not_increase_and_values_that_are_not_finite_are_refused():
    x, y = np.arange(8.0), np.zeros((8, 1))
    with pytest.raises(ValueError):
        InterpolatingSpline.through(x, np.full((8, 1), np.nan), 5)
    with pytest.raises(np.linalg.LinAlgError, match="increase"):
        InterpolatingSpline.through(np.where(x == 5.0, 4.0, x), y, 5)


def test_a_polynomial_of_its_degree_passes_unchanged():
    x = np.array([0.0, 0.4, 1.0, 1.3, 2.0, 2.9, 3.3, 4.0])
    at = np.linspace(0.0, 4.0, 33)
    np.testing.assert_allclose(InterpolatingSpline.through(x, (x**5 - x)[:, None], 5)(at)[:, 0], at**5 - at, atol=1e-10)


@pytest.mark.parametrize(("degree", "order"), [(3, 3), (5, 5)])
def test_a_spline_reproduces_polynomials_and_the_means(degree, order):
    """Rates of one degree less are exact; whatever the rate, its means are those that were measured."""
    rng = np.random.default_rng(0)
    interval = rng.uniform(0.05, 0.2, 12)
    edges = np.concatenate(([3.0], 3.0 + np.cumsum(interval)))
    coefficients = rng.standard_normal(order)
    integral = np.polynomial.Polynomial(coefficients).integ()
    mean = np.column_stack((np.diff(integral(edges)) / interval, rng.standard_normal(12)))
    spline = integral_spline(edges, interval, mean, degree)
    t = np.linspace(edges[0], edges[-1], 50)
    np.testing.assert_allclose(spline.derivative()(t)[:, 0], np.polynomial.Polynomial(coefficients)(t), rtol=1e-7)
    np.testing.assert_allclose(np.diff(spline(edges), axis=0) / interval[:, None], mean, rtol=1e-10)


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_few_samples_have_a_spline_of_lower_degree(count):
    edges = 0.1 * np.arange(count + 1)
    middle = edges[1:] - 0.05
    mean = 2.0 + 3.0 * middle[:, None]
    spline = integral_spline(edges, np.full(count, 0.1), mean)
    np.testing.assert_allclose(spline.derivative()(middle), mean, rtol=1e-9)


def test_without_unknown_intervals_the_piecewise_integral_is_one_spline():
    rng = np.random.default_rng(3)
    interval, mean = rng.uniform(0.9, 1.1, 30), rng.normal(size=(30, 2))
    edges = np.append(0.0, np.cumsum(interval))
    at = np.concatenate((edges, rng.uniform(0.0, edges[-1], 50), [-1.0, edges[-1] + 1.0]))
    whole, pieces = integral_spline(edges, interval, mean), piecewise_integral(edges, interval, mean)
    np.testing.assert_array_equal(pieces(at), whole(np.clip(at, 0.0, edges[-1])))


def test_each_run_of_known_intervals_has_a_spline_of_its_own():
    """The integral of a polynomial within each run, of fewer intervals than the degree too; none in between."""
    edges = np.arange(31.0)
    polynomial = np.polynomial.Polynomial([0.3, -0.2, 0.05, 0.004])
    mean = np.diff(polynomial.integ()(edges))[:, None]
    mean[[8, 9, 20, 23]] = np.nan
    integral = piecewise_integral(edges, np.ones(30), mean)
    for begin, end in ((0, 8), (10, 20), (24, 30)):
        at = np.linspace(begin, end, 23)
        exact = polynomial.integ()(at) - polynomial.integ()(begin)
        np.testing.assert_allclose(integral(at)[:, 0], exact, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.diff(integral(np.array([21.0, 22.0, 23.0])), axis=0), mean[21:23])
    assert not integral(np.array([8.5, 9.999, 20.5, 23.5])).any()
