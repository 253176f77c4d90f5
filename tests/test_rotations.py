"""Properties of quaternions and rotation vectors, and their relation to Shuster's convention."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from edl_filter import rotations

numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
quaternions = (
    st.tuples(numbers, numbers, numbers, numbers)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 1e-3)
    .map(lambda q: q / np.linalg.norm(q))
)
rotation_angles = st.sampled_from([0.0, 1e-300, 1e-160, 1e-13, 1e-12, 1e-8, 1e-4, 1.0, 3.0, 3.1415926])


def reference_matrix(q):
    """Direction cosines of a quaternion, element by element (Kuipers 1999, section 5.14)."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def matrix_exponential(phi):
    """Exponential of the cross matrix, from its series."""
    term = total = np.eye(3)
    for k in range(1, 40):
        term = term @ rotations.cross_matrix(phi) / k
        total = total + term
    return total


def same_rotation(p, q, tolerance):
    return min(np.linalg.norm(p - q), np.linalg.norm(p + q)) < tolerance


@given(quaternions, vectors)
def test_rotate_equals_the_direction_cosines(q, v):
    np.testing.assert_allclose(rotations.rotate(q, v), reference_matrix(q) @ v, atol=1e-15 * 4)
    np.testing.assert_allclose(rotations.to_matrix(q), reference_matrix(q), atol=1e-15 * 4)


@given(quaternions, vectors)
def test_rotation_preserves_length_and_inverts(q, v):
    rotated = rotations.rotate(q, v)
    assert np.linalg.norm(rotated) == pytest.approx(np.linalg.norm(v), abs=1e-15 * 4)
    np.testing.assert_allclose(rotations.rotate(rotations.conjugate(q), rotated), v, atol=1e-15 * 4)


@given(quaternions, quaternions, vectors)
def test_product_applies_its_right_factor_first(p, q, v):
    product = rotations.multiply(p, q)
    assert np.linalg.norm(product) == pytest.approx(1.0, abs=1e-15 * 4)
    np.testing.assert_allclose(
        rotations.rotate(product, v), rotations.rotate(p, rotations.rotate(q, v)), atol=1e-15 * 8
    )


@given(quaternions, quaternions)
def test_product_matrix_is_the_product(p, q):
    np.testing.assert_allclose(rotations.product_matrix(p) @ q, rotations.multiply(p, q), atol=1e-15 * 4)


@given(quaternions, quaternions, quaternions)
def test_products_form_a_group(p, q, r):
    product_left_first = rotations.multiply(rotations.multiply(p, q), r)
    product_right_first = rotations.multiply(p, rotations.multiply(q, r))
    np.testing.assert_allclose(product_left_first, product_right_first, atol=1e-15 * 4)
    np.testing.assert_allclose(rotations.multiply(q, rotations.conjugate(q)), [0.0, 0.0, 0.0, 1.0], atol=1e-15 * 4)


@given(vectors, rotation_angles)
def test_rotation_vector_round_trip(direction, angle):
    length = np.linalg.norm(direction)
    assume(length > 1e-3)
    phi = angle * direction / length
    q = rotations.from_rotation_vector(phi)
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(rotations.to_rotation_vector(q), phi, rtol=1e-14, atol=1e-15 * angle)
    np.testing.assert_array_equal(rotations.to_rotation_vector(-q), rotations.to_rotation_vector(q))


@given(quaternions, quaternions)
def test_rotation_vector_between_two_attitudes(p, q):
    difference = rotations.from_rotation_vector(rotations.rotation_vector_between(p, q))
    assert same_rotation(rotations.multiply(p, difference), q, 1e-13)


@given(vectors.map(lambda v: 4.0 * v))
def test_quaternion_is_the_matrix_exponential(phi):
    q = rotations.from_rotation_vector(phi)
    np.testing.assert_allclose(rotations.to_matrix(q), matrix_exponential(phi), atol=1e-12)
    assert np.linalg.norm(rotations.to_rotation_vector(q)) <= np.pi + 1e-15


@given(vectors, st.floats(0.0, 1e-5))
def test_small_rotation_is_linear(direction, size):
    phi, v = size * direction, np.array([0.3, -0.7, 0.2])
    expected = v + np.cross(phi, v)
    np.testing.assert_allclose(
        rotations.rotate(rotations.from_rotation_vector(phi), v), expected, atol=2 * size**2 + 1e-15
    )


@given(quaternions)
def test_matrix_round_trip(q):
    assert same_rotation(rotations.from_matrix(rotations.to_matrix(q)), q, 1e-13)


@pytest.mark.parametrize("axis", np.eye(3))
def test_matrix_round_trip_at_180_degrees(axis):
    q = np.append(axis, 0.0)
    assert same_rotation(rotations.from_matrix(rotations.to_matrix(q)), q, 1e-14)


@given(vectors, vectors)
def test_cross_matrix(u, v):
    np.testing.assert_allclose(rotations.cross_matrix(u) @ v, np.cross(u, v), atol=1e-15)


@given(quaternions, quaternions)
def test_shusters_attitude_matrix_is_the_transpose(a_from_b, b_from_c):
    # Shuster 1993 gives the attitude matrix A(q) of the same four numbers as the transpose of to_matrix:
    # his q for "b to a" (the archive's J2000 to spacecraft) is the conjugate of a_from_b in this package, and his
    # product composes in the order of the matrices because its factors are in the opposite order.
    def attitude_matrix(q):
        v, w = q[:3], q[3]
        return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) - 2 * w * rotations.cross_matrix(v)

    np.testing.assert_allclose(attitude_matrix(a_from_b), rotations.to_matrix(a_from_b).T, atol=1e-15 * 4)
    np.testing.assert_allclose(
        attitude_matrix(rotations.multiply(b_from_c, a_from_b)),
        attitude_matrix(a_from_b) @ attitude_matrix(b_from_c),
        atol=1e-15 * 8,
    )


def test_rotation_by_90_degrees_about_z():
    # b is a rotated by +90 degrees about z: the vector with components (1, 0, 0) in b has (0, 1, 0) in a
    q = rotations.from_rotation_vector([0.0, 0.0, np.pi / 2])
    np.testing.assert_allclose(q, [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_allclose(rotations.rotate(q, [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    "call",
    [
        lambda: rotations.multiply(np.zeros((2, 3)), np.zeros((2, 3))),
        lambda: rotations.cross(np.zeros(2), np.zeros(2)),
        lambda: rotations.from_rotation_vector(np.zeros((5, 4))),
        lambda: rotations.to_rotation_vector(np.zeros((5, 3))),
        lambda: rotations.to_matrix(1.0),
    ],
)
def test_wrong_last_axis_raises(call):
    with pytest.raises(ValueError, match=r"expected \(\.\.\., [34]\)"):
        call()


def test_shapes_broadcast():
    rng = np.random.default_rng(3)
    q = rotations.normalise(rng.normal(size=(5, 1, 4)))
    v = rng.normal(size=(7, 3))
    assert rotations.rotate(q, v).shape == (5, 7, 3)
    assert rotations.multiply(q, q[:, 0]).shape == (5, 5, 4)
    assert rotations.to_matrix(q).shape == (5, 1, 3, 3)
    assert rotations.from_rotation_vector(v).shape == (7, 4)
    np.testing.assert_allclose(rotations.rotate(q, v)[2, 4], rotations.rotate(q[2, 0], v[4]))


@given(vectors, st.floats(0.0, 3.0))
def test_right_jacobian_equals_its_series(direction, size):
    """``Σ (-[phi]ₓ)ᵏ / (k + 1)!`` (Sola, Deray & Atchuthan 2018, eq. 143)."""
    phi = size * direction
    term = total = np.eye(3)
    for k in range(1, 40):
        term = -term @ rotations.cross_matrix(phi) / (k + 1)
        total = total + term
    np.testing.assert_allclose(rotations.right_jacobian(phi), total, atol=1e-12)


@given(vectors, vectors)
def test_cross_is_numpys(u, v):
    np.testing.assert_allclose(rotations.cross(u, v), np.cross(u, v), atol=1e-16)


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-3, 0.03, 0.04, 1.0, 3.0])
def test_right_jacobian_is_the_slope_of_the_exponential(angle):
    """``exp(phi + d) = exp(phi) ⊗ exp(J d)``, by central differences, on both sides of the series' end."""
    phi = angle * rotations.normalise([0.3, -0.5, 0.8])
    inverse = rotations.conjugate(rotations.from_rotation_vector(phi))
    slopes = np.empty((3, 3))
    for k, step in enumerate(1e-5 * np.eye(3)):
        ahead, behind = (
            rotations.to_rotation_vector(rotations.multiply(inverse, rotations.from_rotation_vector(phi + d)))
            for d in (step, -step)
        )
        slopes[:, k] = (ahead - behind) / 2e-5
    np.testing.assert_allclose(rotations.right_jacobian(phi), slopes, atol=1e-10)
    assert rotations.right_jacobian(np.zeros((2, 4, 3))).shape == (2, 4, 3, 3)
