"""Compiled algebra of small matrices against numpy and scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import cholesky, solve_triangular

from edl_filter.estimation.small_matrices import (
    back_substitution,
    matrix_product,
    regression_rows,
    solve_few,
    solve_from_right,
    symmetric_part,
    upper_cholesky,
    weighted_mean,
    weighted_product,
    weighted_square,
)

seeds = st.integers(0, 1000)


def positive(random, n):
    root = random.standard_normal((n, n + 2))
    return root @ root.T


@given(seeds, st.integers(1, 40))
def test_the_cholesky_factor_is_that_of_scipy(seed, n):
    matrix = positive(np.random.default_rng(seed), n)
    factor, valid = upper_cholesky(matrix, 2.5)
    assert valid
    np.testing.assert_allclose(factor, cholesky(2.5 * matrix), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("place", range(6))
def test_a_matrix_that_is_not_positive_has_no_factor(place):
    for wrong in (0.0, -1.0, np.nan):
        matrix = np.eye(6)
        matrix[place, place] = wrong
        assert not upper_cholesky(matrix, 1.0)[1]


def test_the_lower_triangle_is_not_used_and_the_factor_has_none():
    matrix = positive(np.random.default_rng(3), 7)
    factor, _ = upper_cholesky(np.triu(matrix), 1.0)
    np.testing.assert_allclose(factor.T @ factor, matrix, rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(np.tril(factor, -1), 0.0)


@given(seeds, st.integers(1, 40))
def test_sums_over_rows_are_matrix_products(seed, n):
    random = np.random.default_rng(seed)
    a, b = random.standard_normal((2 * n + 1, n)), random.standard_normal((2 * n + 1, 3))
    weights = np.full(2 * n + 1, 0.3)
    weights[0] = -2.0
    np.testing.assert_allclose(weighted_product(a, b, -2.0, 0.3), a.T @ (weights[:, None] * b), atol=1e-12)
    square = weighted_square(a, -2.0, 0.3)
    np.testing.assert_allclose(square, a.T @ (weights[:, None] * a), atol=1e-12)
    np.testing.assert_array_equal(square, square.T)
    np.testing.assert_allclose(weighted_mean(a, -2.0, 0.3), weights @ a, atol=1e-12)
    np.testing.assert_allclose(matrix_product(b.T, a), b.T @ a, atol=1e-12)  # an odd number of products
    np.testing.assert_allclose(matrix_product(b[1:].T, a[1:]), b[1:].T @ a[1:], atol=1e-12)


@given(seeds, st.integers(1, 6))
def test_elimination_is_that_of_numpy(seed, m):
    random = np.random.default_rng(seed)
    matrix, right = random.standard_normal((m, m)), random.standard_normal((m, 4))
    expected = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(solve_few(matrix, right), expected, rtol=1e-8, atol=1e-8 * np.max(np.abs(expected)))


def test_elimination_exchanges_rows():
    swap = np.array([[0.0, 1.0], [1.0, 0.0]])
    np.testing.assert_array_equal(solve_few(swap, np.array([[2.0], [3.0]])), [[3.0], [2.0]])


@pytest.mark.parametrize("n", [1, 24, 37])
def test_substitution_divides_by_the_factored_matrix(n):
    random = np.random.default_rng(n)
    matrix, cross = positive(random, n), random.standard_normal((5, n))
    factor, _ = upper_cholesky(matrix, 1.0)
    np.testing.assert_allclose(solve_from_right(cross, factor) @ matrix, cross, atol=1e-9 * np.max(np.abs(matrix)))


@given(seeds, st.integers(1, 40))
def test_back_substitution_is_that_of_scipy(seed, n):
    """What stands below the diagonal is not used, and the right-hand sides stay as they are."""
    random = np.random.default_rng(seed)
    factor, right = upper_cholesky(positive(random, n), 1.0)[0], random.standard_normal((n, 3))
    before, expected = right.copy(), solve_triangular(factor, right)
    solution = back_substitution(factor + np.tril(np.ones((n, n)), -1), right)
    np.testing.assert_allclose(solution, expected, rtol=1e-8, atol=1e-8 * np.max(np.abs(expected)))
    np.testing.assert_array_equal(right, before)


def test_the_symmetric_part():
    matrix = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(symmetric_part(matrix), 0.5 * (matrix + matrix.T))


@given(seeds, st.integers(1, 20))
def test_a_regression_has_rows_of_the_variables_that_differ(seed, n):
    random = np.random.default_rng(seed)
    covariance, matrix = positive(random, n), random.standard_normal((n, n))
    same = random.random(n) < 0.5
    matrix[same] = np.eye(n)[same]
    cross = matrix @ covariance
    cross[same] = covariance[same]
    rows, index, valid = regression_rows(cross, covariance)
    assert valid
    np.testing.assert_array_equal(index, np.flatnonzero(~same))
    np.testing.assert_allclose(rows, np.linalg.solve(covariance, cross.T).T[~same], rtol=1e-6, atol=1e-6)


def test_a_regression_on_an_indefinite_covariance_is_not_valid():
    rows, index, valid = regression_rows(np.eye(3), np.diag([1.0, 2.0, -1.0]))
    assert not valid and rows.shape == (2, 3)
    np.testing.assert_array_equal(index, [1, 2])
