"""Modified Newtonian coefficients against closed forms, published numbers and a slow reference."""

import math

import numpy as np
import pytest
from forebodies import HEMISPHERE, MER, STARDUST, centre_of_pressure
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.aero.body import SphereCone
from edl_filter.aero.newtonian import newtonian_coefficients, rayleigh_pitot_cp_max
from edl_filter.errors import InputError


def reference_coefficients(body, alpha, cp_max, meridian_points, azimuths):
    """The sum as a loop over panels."""
    upstream = np.array([math.cos(alpha), 0.0, math.sin(alpha)])
    force, moment = np.zeros(3), np.zeros(3)
    for centre, normal, area in zip(*body.panels(meridian_points, azimuths), strict=True):
        sine = float(upstream @ normal)
        if sine > 0.0:
            panel_force = -cp_max * sine**2 * area * normal
            force += panel_force
            moment += np.cross(centre, panel_force)
    reference_area = math.pi * body.diameter**2 / 4.0
    return -force[0] / reference_area, -force[2] / reference_area, moment[1] / reference_area / body.diameter


@pytest.mark.parametrize("cp_max", [2.0, 1.94])
def test_sphere(cp_max):
    ca, cn, cm = newtonian_coefficients(HEMISPHERE, 0.0, cp_max)
    assert ca == pytest.approx(cp_max / 2.0, rel=1e-13)
    assert cn == cm == 0.0


def test_sphere_at_an_angle():
    # The force on both hemispheres is along the stream; the rear one equals the front one in a stream from behind
    alpha = math.radians(35.0)
    ca, cn, cm = newtonian_coefficients(HEMISPHERE, [alpha, alpha + math.pi], 1.8, meridian_points=200)
    assert ca[0] - ca[1] == pytest.approx(0.9 * math.cos(alpha), abs=1e-8)
    assert cn[0] - cn[1] == pytest.approx(0.9 * math.sin(alpha), abs=1e-8)
    assert cm[0] - cm[1] == pytest.approx(-0.45 * math.sin(alpha), abs=1e-8)


@pytest.mark.parametrize("half_deg", [10.0, 45.0, 70.0, 90.0])
def test_sharp_cone(half_deg):
    half = math.radians(half_deg)
    body = SphereCone(3.0, 0.0, 0.0, half)
    assert newtonian_coefficients(body, 0.0, 1.9)[0] == pytest.approx(1.9 * math.sin(half) ** 2, rel=1e-12)
    # The whole cone faces the stream while α is below the half-angle
    alpha = 0.6 * half
    ca, cn, cm = newtonian_coefficients(body, alpha, 1.9)
    cosine_squared = math.cos(half) ** 2
    assert ca == pytest.approx(
        1.9 * (math.sin(half) ** 2 * math.cos(alpha) ** 2 + cosine_squared * math.sin(alpha) ** 2 / 2.0), rel=1e-12
    )
    assert cn == pytest.approx(1.9 * cosine_squared * math.sin(alpha) * math.cos(alpha), rel=1e-11, abs=1e-15)
    if half_deg < 90.0:  # the force acts at 2/3 of the length over cos² of the half-angle
        assert centre_of_pressure(cn, cm) == pytest.approx(1.0 / (3.0 * math.tan(half) * cosine_squared), rel=1e-11)


def test_stardust_centre_of_pressure():
    _, cn, cm = newtonian_coefficients(STARDUST, math.radians(0.5))
    assert centre_of_pressure(cn, cm) == pytest.approx(0.72, abs=0.01)


def test_seventy_degree_centre_of_pressure():
    _, cn, cm = newtonian_coefficients(MER, math.radians(16.0))
    assert centre_of_pressure(cn, cm) == pytest.approx(0.906, abs=0.003)


@pytest.mark.parametrize("alpha_deg", [0.0, 16.0, -25.0, 80.0, 140.0])
def test_equals_the_slow_reference(alpha_deg):
    alpha = math.radians(alpha_deg)
    computed = newtonian_coefficients(MER, alpha, 1.85, meridian_points=12)
    np.testing.assert_allclose(computed, reference_coefficients(MER, alpha, 1.85, 12, 400), rtol=0, atol=2e-5)


@pytest.mark.parametrize("body", [MER, STARDUST])
def test_meridian_sums_have_converged(body):
    alpha = np.deg2rad(np.linspace(-40.0, 40.0, 17))
    fine = newtonian_coefficients(body, alpha, meridian_points=300)
    np.testing.assert_allclose(newtonian_coefficients(body, alpha), fine, rtol=0, atol=1e-6)


@given(st.floats(-math.pi, math.pi), st.floats(0.5, 2.0))
def test_symmetry(alpha, cp_max):
    ca, cn, cm = newtonian_coefficients(MER, [alpha, -alpha], cp_max)
    assert ca[0] == ca[1]
    assert cn[0] == -cn[1]
    assert cm[0] == -cm[1]


def test_shapes():
    ca, cn, cm = newtonian_coefficients(MER, np.zeros((4, 1)) + 0.1, np.full(3, 1.9))
    assert ca.shape == cn.shape == cm.shape == (4, 3)


def test_rayleigh_pitot():
    # NACA Report 1135, table II (γ 1.4): total pressure behind the shock over static pressure ahead
    mach, ratio = np.array([1.0, 2.0, 3.0, 5.0, 10.0]), np.array([1.893, 5.640, 12.06, 32.65, 129.2])
    np.testing.assert_allclose(rayleigh_pitot_cp_max(mach, 1.4), (ratio - 1.0) / (0.7 * mach**2), rtol=1e-3)
    # Closed form for large Mach numbers
    g = 1.33
    limit = ((g + 1.0) ** 2 / (4.0 * g)) ** (g / (g - 1.0)) * 4.0 / (g + 1.0)
    assert rayleigh_pitot_cp_max(1e6, g) == pytest.approx(limit, rel=1e-9)


@given(st.floats(1.05, 1.67))
def test_stagnation_pressure_is_continuous_and_increases(gamma):
    below, above = rayleigh_pitot_cp_max([1.0 - 1e-9, 1.0], gamma)
    assert below == pytest.approx(above, rel=1e-7)
    assert rayleigh_pitot_cp_max(1e-6, gamma) == pytest.approx(1.0, rel=1e-9)
    assert np.all(np.diff(rayleigh_pitot_cp_max(np.linspace(0.05, 40.0, 300), gamma)) > 0.0)


@pytest.mark.parametrize(("mach", "gamma", "message"), [(0.0, 1.4, "Mach"), (-2.0, 1.4, "Mach"), (2.0, 1.0, "gamma")])
def test_parameter_out_of_range_raises(mach, gamma, message):
    with pytest.raises(InputError, match=message):
        rayleigh_pitot_cp_max(mach, gamma)
