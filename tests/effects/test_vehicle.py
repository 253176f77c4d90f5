"""Effects on mass, centre of mass and inertia, against numbers worked out by hand."""

import numpy as np
import pytest
from standins import BODY, on

from edl_filter.effects import Body


def test_mass():
    effect, p = on("mass", k=0.05)
    body = effect.vehicle(p, BODY)
    assert body.mass == pytest.approx(873.6, rel=1e-15)  # 832 · 1.05 = 832 + 41.6
    np.testing.assert_array_equal(body.inertia, BODY.inertia)


def test_centre_of_mass():
    """Forward (+x) is towards the nose; 26.5 mm are a hundredth of the diameter of 2.65 m."""
    effect, p = on("com_offset", dx=26.5e-3, dy=-5.3e-3, dz=2.65e-3)
    body = effect.vehicle(p, Body(1.0, np.eye(3), np.array([0.0, 10.6e-3, 0.0])))
    # behind the nose 0.27 - 0.01; to the right (10.6 - 5.3) mm / 2.65 m = 0.002; down 2.65 mm / 2.65 m = 0.001
    np.testing.assert_allclose(body.centre(0.27, 2.65), [0.26, 0.002, 0.001], rtol=1e-13)


@pytest.mark.parametrize(("parameter", "axes"), [("a", (0, 1)), ("b", (0, 2)), ("c", (1, 2))])
def test_products_of_inertia_are_those_of_point_masses(parameter, axes):
    """Two masses of 2 kg at ±(0.5, 0.5) m in a plane have the product 2 · 2 · 0.5 · 0.5 = 1 kg m².

    About the diagonal through them, which is (1, 1)/√2 of the plane, they have no moment of inertia. Without the
    product it would be their moment about either axis, 2 · 2 · 0.25 = 1 kg m².
    """
    effect, p = on("products_of_inertia", **{parameter: 1.0})
    first, second = axes
    diagonal, normal = np.zeros((2, 3))
    diagonal[[first, second]] = np.sqrt(0.5)
    normal[3 - first - second] = 1.0
    moments = np.diag(np.ones(3) + normal)  # 1 about each axis of the plane, 2 about its normal
    inertia = effect.vehicle(p, Body(4.0, moments)).inertia
    np.testing.assert_allclose(inertia @ diagonal, 0.0, atol=1e-15)
    np.testing.assert_allclose(inertia @ normal, 2.0 * normal, atol=1e-15)
    np.testing.assert_array_equal(inertia, inertia.T)
