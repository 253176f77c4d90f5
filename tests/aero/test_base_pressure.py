"""Base pressure: the cubic, its limits, tables with it, and the thesis's ratio to the forebody's pressure."""

import numpy as np
import pytest

from edl_filter.aero.base_pressure import (
    COEFFICIENTS,
    add_base_pressure,
    base_pressure_coefficient,
    with_base_pressure,
)
from edl_filter.aero.body import sphere_cone
from edl_filter.aero.newtonian import newtonian_table
from edl_filter.aero.surrogate import phoenix_surrogate


def test_cubic_at_printed_mach_numbers():
    mach = [1.5, 2.0, 3.0, 5.0, 8.8, 10.0]
    np.testing.assert_allclose(
        base_pressure_coefficient(mach), [-0.3351, -0.2244, -0.1064, -0.0308, -0.0002, 0.0029], atol=5e-5
    )


def test_zero_above_mach_10_and_constant_below_1_5():
    assert base_pressure_coefficient(10.01) == 0.0
    assert base_pressure_coefficient(0.5) == base_pressure_coefficient(1.5)


def test_base_pressure_increases_the_axial_force():
    assert add_base_pressure(1.3, 2.0) == pytest.approx(1.3 + 0.2244, abs=1e-4)


def test_table_follows_the_cubic_between_its_nodes():
    forebody = newtonian_table(sphere_cone("MER"))
    whole_body, mach = with_base_pressure(forebody), np.linspace(0.4, 12.0, 400)
    for alpha in (0.0, 0.2):
        expected = add_base_pressure(forebody.lookup(mach, alpha)[0], mach)
        np.testing.assert_allclose(whole_body.lookup(mach, alpha)[0], expected, atol=2e-4)
        np.testing.assert_allclose(whole_body.lookup(mach, alpha)[1:3], forebody.lookup(mach, alpha)[1:3], atol=1e-12)


def test_newtonian_with_base_pressure_is_near_the_phoenix_table():
    """CA within 6 % of the surrogate's; at Mach 2 and 5 the base contributes 14 and 2 %."""
    whole_body = with_base_pressure(newtonian_table(sphere_cone("Phoenix")))
    for mach in (2.0, 5.0, 15.0):
        assert whole_body.lookup(mach, 0.0)[0] == pytest.approx(phoenix_surrogate().lookup(mach, 0.0)[0], rel=0.06)


def test_ratio_of_base_to_forebody_pressure():
    """At zero angle; thesis, Appendix A: 10 % at Mach 1.9, 0.6 % at Mach 22.3 (the cubic gives 0.75 %)."""
    mach, heat_capacity_ratio = np.array([1.9, 22.3]), 1.33
    ca = phoenix_surrogate().lookup(mach, 0.0)[0]
    cp_base = np.polynomial.Polynomial(COEFFICIENTS)(1.0 / mach)
    dynamic_over_static = 0.5 * heat_capacity_ratio * mach**2
    ratio = (1.0 + dynamic_over_static * cp_base) / (1.0 + dynamic_over_static * (ca + cp_base))
    assert ratio[0] == pytest.approx(0.10, abs=0.003)
    assert ratio[1] == pytest.approx(0.0075, abs=5e-4)
    assert cp_base[0] == pytest.approx(base_pressure_coefficient(1.9), rel=1e-14)
