"""Gravity against the gradient of its potential and against closed forms."""

import platform

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from edl_filter.planet.gravity import gravity, gravity_vector, potential

MU, J2, RE = 4.282837e13, 1.960454e-3, 3396190.0

positions = st.tuples(st.floats(3.3e6, 4.0e7), st.floats(-np.pi / 2, np.pi / 2), st.floats(-np.pi, np.pi)).map(
    lambda s: s[0] * np.array([np.cos(s[1]) * np.cos(s[2]), np.cos(s[1]) * np.sin(s[2]), np.sin(s[1])])
)


def reference_potential(position, mu, j2, re):
    """mu/r (1 - J2 (re/r)^2 P2(sin latitude)), also for complex arguments."""
    x, y, z = position
    r = (x * x + y * y + z * z) ** 0.5
    return mu / r * (1 - j2 * (re / r) ** 2 * (3 * (z / r) ** 2 - 1) / 2)


def reference_gradient(position, mu, j2, re):
    """Gradient by complex-step differentiation, exact to rounding."""
    step = 1e-10
    return np.array([reference_potential(position + 1j * step * e, mu, j2, re).imag / step for e in np.eye(3)])


@given(positions)
def test_acceleration_is_the_gradient_of_the_potential(position):
    g = gravity_vector(position, MU, J2, RE)
    np.testing.assert_allclose(g, reference_gradient(position, MU, J2, RE), rtol=0, atol=1e-14 * np.linalg.norm(g))
    assert potential(position, MU, J2, RE) == pytest.approx(reference_potential(position, MU, J2, RE), rel=1e-15)


@settings(deadline=None)  # the first call compiles
@given(positions)
def test_kernel_equals_the_array_form(position):
    g = gravity_vector(position, MU, J2, RE)
    np.testing.assert_allclose(gravity(*position, MU, J2, RE), g, rtol=0, atol=1e-15 * np.linalg.norm(g))


@given(positions)
def test_point_mass(position):
    r = np.linalg.norm(position)
    expected = -MU * position / r**3
    np.testing.assert_allclose(gravity_vector(position, MU, 0.0, RE), expected, atol=1e-15 * MU / r**2)


@given(positions, st.floats(-np.pi, np.pi))
def test_symmetric_about_the_axis_and_the_equator(position, angle):
    rotation = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    g = gravity_vector(position, MU, J2, RE)
    np.testing.assert_allclose(gravity_vector(rotation @ position, MU, J2, RE), rotation @ g, atol=1e-14)
    mirror = np.array([1.0, 1.0, -1.0])
    np.testing.assert_array_equal(gravity_vector(mirror * position, MU, J2, RE), mirror * g)


def test_closed_forms_at_equator_and_pole():
    # Along the axes the field is mu/r^2 (1 + 3/2 J2) and mu/r^2 (1 - 3 J2) at r = re
    equator = gravity_vector([RE, 0.0, 0.0], MU, J2, RE)
    pole = gravity_vector([0.0, 0.0, RE], MU, J2, RE)
    np.testing.assert_allclose(equator, [-MU / RE**2 * (1 + 1.5 * J2), 0.0, 0.0], rtol=1e-15)
    np.testing.assert_allclose(pole, [0.0, 0.0, -MU / RE**2 * (1 - 3 * J2)], rtol=1e-15)


def test_array_shapes():
    points = np.array([RE, 1.0e5, -2.0e5]) + np.zeros((2, 4, 3))
    g = gravity_vector(points, MU, J2, RE)
    assert g.shape == (2, 4, 3)
    assert potential(points, MU, J2, RE).shape == (2, 4)
    np.testing.assert_array_equal(g[1, 3], gravity_vector(points[1, 3], MU, J2, RE))


@pytest.fixture(scope="module")
def loop():
    """The compiled kernel in a loop over points."""

    @njit(error_model="numpy")
    def loop(x, out, mu, j2, re):
        for j in range(x.shape[1]):
            gx, gy, gz = gravity(x[0, j], x[1, j], x[2, j], mu, j2, re)
            out[0, j] = gx
            out[1, j] = gy
            out[2, j] = gz

    return loop


def test_kernel_in_a_loop_is_the_function(loop):
    x = np.random.default_rng(1).normal(3.4e6, 1e5, (3, 24))
    out = np.empty_like(x)
    loop(x, out, MU, J2, RE)
    np.testing.assert_allclose(out.T, gravity_vector(x.T, MU, J2, RE), rtol=1e-14)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="only x86-64 names its packed square root sqrtpd")
def test_kernel_inlines_to_simd_in_a_loop(loop):
    x = np.ones((3, 24))
    loop(x, np.empty_like(x), MU, J2, RE)
    (assembly,) = loop.inspect_asm().values()
    assert "sqrtpd" in assembly
