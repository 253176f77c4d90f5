"""Sequences of sparse matrices against dense ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from linear_problems import from_dense

from edl_filter.estimation.block_sparse import (
    BlockSparse,
    from_blocks,
    merge,
    row_pattern,
    transform_rows,
    transpose_in_place,
)


def random_matrices(seed, size, share, count=5):
    """Dense matrices ``(count, size, size)`` of which `share` of the elements are not zero."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, size, size)) * (rng.random((count, size, size)) < share)


def dense(matrices):
    return np.array([matrices[k] for k in range(len(matrices))])


def assert_sorted_by_row(matrices):
    places = list(zip(matrices.row, matrices.column, strict=True))
    assert places == sorted(set(places))


matrices_of_any_density = given(st.integers(0, 1000), st.integers(1, 8), st.floats(0.0, 1.0))


@matrices_of_any_density
def test_blocks_keep_every_element(seed, n, share):
    expected = random_matrices(seed, n, share)
    matrices = from_dense(expected)
    assert len(matrices) == 5 and matrices.values.shape[1] == np.count_nonzero(expected.any(axis=0))
    assert_sorted_by_row(matrices)
    np.testing.assert_array_equal(dense(matrices), expected)


@matrices_of_any_density
def test_transposed(seed, n, share):
    expected = random_matrices(seed, n, share)
    transposed = from_dense(expected).transposed
    assert_sorted_by_row(transposed)
    assert transposed.values.flags.c_contiguous
    np.testing.assert_array_equal(dense(transposed), np.swapaxes(expected, 1, 2))


def test_blocks_at_one_place_add_up():
    a, b = np.ones((3, 2, 2)), np.arange(3.0)[:, None, None] * np.eye(2)
    matrices = from_blocks(4, [(slice(1, 3), slice(2, 4), a), (slice(1, 3), slice(2, 4), b)])
    expected = np.zeros((4, 4))
    expected[1:3, 2:4] = 1.0 + 2.0 * np.eye(2)
    np.testing.assert_array_equal(matrices[2], expected)


@given(st.integers(0, 1000), st.lists(st.tuples(*4 * [st.integers(0, 3)]), min_size=1, max_size=4))
def test_from_blocks_is_the_sum_of_the_blocks(seed, places):
    """Blocks of every size, which may overlap."""
    rng, expected, blocks = np.random.default_rng(seed), np.zeros((2, 6, 6)), []
    for row, column, height, width in places:
        rows, columns = slice(row, row + height), slice(column, column + width)
        block = rng.normal(size=(2, height, width))
        blocks.append((rows, columns, block))
        expected[:, rows, columns] += block
    matrices = from_blocks(6, blocks)
    assert_sorted_by_row(matrices)
    np.testing.assert_allclose(dense(matrices), expected, atol=1e-15)


def test_merge_has_the_elements_of_both():
    a = from_dense(np.full((2, 2, 2), 3.0))
    b = from_blocks(5, [(slice(3, 5), slice(0, 2), np.ones((2, 2, 2)))])
    merged = merge(a, b, 5)
    np.testing.assert_array_equal(merged[1][:2, :2], 3.0)
    np.testing.assert_array_equal(merged[1][3:, :2], 1.0)
    assert np.count_nonzero(merged[1]) == 8
    assert_sorted_by_row(merged)


@given(st.integers(0, 1000), st.integers(1, 6), st.floats(0.0, 1.0), st.integers(0, 3))
def test_merge_is_the_sum_of_disjoint_patterns(seed, n, share, larger):
    """Each place belongs to one of the two at random; the sum may be of a larger order."""
    values = random_matrices(seed, n, share)
    first = np.random.default_rng(seed + 1).random((n, n)) < 0.5
    merged = merge(from_dense(values * first), from_dense(values * ~first), n + larger)
    assert merged.size == n + larger
    assert_sorted_by_row(merged)
    np.testing.assert_array_equal(dense(merged), np.pad(values, ((0, 0), (0, larger), (0, larger))))


@given(st.integers(0, 1000), st.integers(1, 8), st.floats(0.0, 1.0))
def test_row_pattern_lists_the_elements_of_each_row(seed, n, share):
    expected = random_matrices(seed, n, share)
    rows, first, columns, values = row_pattern(from_dense(expected))
    rebuilt = np.zeros_like(expected)
    for i, row in enumerate(rows):
        part = slice(first[i], first[i + 1])
        assert part.stop > part.start
        rebuilt[:, row, columns[part]] = values[:, part]
    np.testing.assert_array_equal(rebuilt, expected)


@given(st.integers(0, 1000), st.integers(1, 8), st.integers(1, 5), st.floats(0.0, 1.0))
def test_transform_rows_is_the_product_with_identity_plus_increment(seed, n, width, share):
    """In place, although rows that are changed are sources of others."""
    increments = random_matrices(seed, n, share, count=2)
    p = np.random.default_rng(seed + 1).normal(size=(n, width))
    rows, first, columns, values = row_pattern(from_dense(increments))
    for k in range(2):
        expected = (np.eye(n) + increments[k]) @ p
        transform_rows(p, rows, first, columns, values[k], np.empty((len(rows), width)))
        np.testing.assert_allclose(p, expected, rtol=1e-13, atol=1e-13)
        p = expected


@given(st.integers(0, 8))
def test_transpose_in_place(n):
    p = np.random.default_rng(n).normal(size=(n, n))
    expected = p.T.copy()
    transpose_in_place(p)
    np.testing.assert_array_equal(p, expected)


def test_matrices_without_elements():
    empty = BlockSparse(3, np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((4, 0)))
    assert len(empty) == 4
    np.testing.assert_array_equal(empty[2], np.zeros((3, 3)))
    matrices = from_blocks(3, [(slice(0, 3), slice(0, 3), np.zeros((4, 3, 3)))])
    assert len(matrices) == 4 and matrices.values.shape == (4, 0)
    assert len(from_blocks(3, [])) == 0
