"""The interpolating spline against scipy's, and against polynomials."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from edl_filter.estimation.interpolating_spline import InterpolatingSpline


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


def test_a_polynomial_of_its_degree_passes_unchanged():
    x = np.array([0.0, 0.4, 1.0, 1.3, 2.0, 2.9, 3.3, 4.0])
    at = np.linspace(0.0, 4.0, 33)
    np.testing.assert_allclose(InterpolatingSpline.through(x, (x**5 - x)[:, None], 5)(at)[:, 0], at**5 - at, atol=1e-10)
