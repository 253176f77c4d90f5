"""PCHIP against scipy's."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from edl_filter.aero.pchip import pchip_coefficients, piecewise_cubic


@pytest.mark.parametrize("count", [2, 3, 5, 40])
def test_it_is_scipys(count):
    rng = np.random.default_rng(count)
    nodes = np.cumsum(rng.uniform(0.1, 2.0, count))
    values = np.round(rng.normal(size=(count, 4, 3)), 1)  # with steps of zero
    at = np.concatenate((nodes, rng.uniform(nodes[0], nodes[-1], 50)))
    coefficients = pchip_coefficients(nodes, values)
    np.testing.assert_allclose(
        piecewise_cubic(nodes, coefficients, at), PchipInterpolator(nodes, values)(at), atol=1e-13
    )


def test_it_has_no_extremum_between_nodes():
    nodes = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    at = np.linspace(0.0, 4.0, 401)
    curve = piecewise_cubic(nodes, pchip_coefficients(nodes, np.array([0.0, 0.0, 1.0, 1.0, 0.5])), at)
    assert curve.min() == 0.0 and curve.max() == 1.0
    assert np.all(np.diff(curve[100:200]) > 0.0)
