"""Compiled rotations of scalars: their limits of small angles in exact arithmetic, and against `rotations`."""

from fractions import Fraction
from math import factorial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotation_kernels, rotations

EPSILON = np.finfo(float).eps
#: Angles (rad) of both sides of each limit between closed form and series (2e-4 for the quaternion), and zero.
ANGLES = (0.0, 1e-300, 1e-160, 1e-9, 1e-5, 1.99e-4, 2.01e-4, 1e-3, 1.9e-3, 0.03, 0.04, 0.1, 0.3, 0.5)
AXES = np.array([[1.0, 0.0, 0.0], [2.0, -1.0, 2.0], [0.0, 3.0, -4.0]]) / np.array([[1.0], [3.0], [5.0]])
seeds = st.integers(0, 2**32 - 1)


def series(square, first):
    """``Σ (-square)ᵏ / (2 k + first)!``: with ``first`` 0 cos(x), with 1 sin(x) / x, of ``square = x²``, exact."""
    return sum((-square) ** k / factorial(2 * k + first) for k in range(8))


def exact_square(phi):
    """Square of a vector's length, exact."""
    return sum(Fraction(float(v)) ** 2 for v in phi)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("axis", AXES)
def test_quaternion_of_a_small_rotation(axis, angle):
    """To rounding on both sides of the limit, and at zero."""
    phi = angle * axis
    square = exact_square(phi) / 4
    q = rotation_kernels.quaternion(*phi)
    expected = [float(series(square, 1) / 2 * Fraction(float(v))) for v in phi] + [float(series(square, 0))]
    np.testing.assert_allclose(q, expected, rtol=2.0 * EPSILON, atol=0.0)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rotation_vector_of_a_small_rotation(axis, angle, sign):
    phi = angle * axis
    square = exact_square(phi) / 4
    q = [float(series(square, 1) / 2 * Fraction(float(v))) for v in phi] + [float(series(square, 0))]
    back = rotation_kernels.rotation_vector(*(sign * np.array(q)))
    np.testing.assert_allclose(back, phi, rtol=4.0 * EPSILON, atol=0.0)


@pytest.mark.parametrize("angle", ANGLES)
def test_coefficients_of_the_right_jacobian(angle):
    """The closed form at the limit, 0.03 rad, loses three digits to the difference of nearly equal numbers."""
    square = Fraction(angle * angle)
    first, second = rotation_kernels.right_jacobian_coefficients(angle * angle)
    assert first == pytest.approx(float(series(square, 2)), rel=1e-12)
    assert second == pytest.approx(float(series(square, 3)), rel=1e-12)


@given(seeds)
def test_scalars_are_the_rows_of_rotations(seed):
    rng = np.random.default_rng(seed)
    p, q = rotations.normalise(rng.standard_normal((2, 4)))
    phi, matrix = rng.standard_normal(3), np.empty((3, 3))
    np.testing.assert_array_equal(rotation_kernels.product(p, q), rotations.multiply(p, q))
    np.testing.assert_array_equal(rotation_kernels.quaternion(*phi), rotations.from_rotation_vector(phi))
    np.testing.assert_array_equal(rotation_kernels.rotation_vector(*q), rotations.to_rotation_vector(q))
    np.testing.assert_array_equal(rotation_kernels.direction_cosines(*q), rotations.to_matrix(q).ravel())
    rotation_kernels.fill_matrix(q, matrix)
    np.testing.assert_array_equal(matrix, rotations.to_matrix(q))
    np.testing.assert_array_equal(rotation_kernels.right_jacobian_elements(*phi), rotations.right_jacobian(phi).ravel())


@given(seeds)
def test_product_is_that_of_the_product_matrix(seed):
    """The matrix of the left factor, written out by hand."""
    p, q = np.random.default_rng(seed).standard_normal((2, 4))
    np.testing.assert_allclose(rotation_kernels.product(p, q), rotations.product_matrix(p) @ q, rtol=0.0, atol=1e-14)


def test_products_of_the_units():
    """Hamilton's ``i j = k``, ``j k = i``, ``k i = j``, and ``i² = -1``."""
    i, j, k = (tuple(row) for row in np.eye(4)[:3].tolist())
    assert rotation_kernels.product(i, j) == k
    assert rotation_kernels.product(j, k) == i
    assert rotation_kernels.product(k, i) == j
    assert rotation_kernels.product(i, i) == (0.0, 0.0, 0.0, -1.0)
