"""Sequences of sparse matrices against dense ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from linear_problems import from_dense

from edl_filter.estimation.block_sparse import (
    FEW_COLUMNS,
    BlockSparse,
    from_blocks,
    merge,
    row_pattern,
    transform_both_sides,
    transform_rows,
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
    sparse = from_dense(expected)
    pattern, rebuilt = row_pattern(sparse), np.zeros_like(expected)
    for row, (begin, end) in zip(pattern.rows, pattern.elements, strict=True):
        assert end > begin
        rebuilt[:, row, pattern.column[begin:end]] += sparse.values[:, begin:end]
    for pair, first in zip(pattern.pairs, pattern.pair_elements, strict=True):
        for row, begin in zip(pair, first, strict=True):
            rebuilt[:, row, pair] += sparse.values[:, begin : begin + 2]
    for row, element in zip(pattern.decays, pattern.decay_elements, strict=True):
        rebuilt[:, row, row] += sparse.values[:, element]
    np.testing.assert_array_equal(rebuilt, expected)


def matrices_of(n, places, seed=0):
    """Two matrices ``(2, n, n)`` with random elements at the given places."""
    out = np.zeros((2, n, n))
    for row, column in places:
        out[:, row, column] = np.random.default_rng((seed, row, column)).normal(size=2)
    return out


def square(*states):
    """Places of all elements between some states."""
    return [(i, j) for i in states for j in states]


#: Places of elements, the pairs among the rows, and the rows that decay.
PATTERNS = {
    "rows that are sources of each other": (square(0, 1, 2), [], []),
    "decays": ([(1, 1), (3, 3)], [], [1, 3]),
    "a decay that is a source of other rows": ([(1, 1), (0, 1), (4, 0), (4, 1)], [], [1]),
    "one source that is another row": ([(1, 3), (3, 3)], [], [3]),
    "adjoining pairs": ([*square(0, 1), *square(2, 3)], [(0, 1), (2, 3)], []),
    "values before derivatives": ([*square(0, 3), *square(1, 4), *square(2, 5)], [(0, 3), (1, 4), (2, 5)], []),
    "a pair that is a source of other rows": ([*square(2, 4), (0, 2), (0, 4), (5, 4)], [(2, 4)], []),
    "a pair, a decay and rows with many sources": ([*square(6, 7), *square(0, 1, 2, 3, 4), (5, 5)], [(6, 7)], [5]),
    "a row with another source is no pair": ([*square(1, 2), (2, 0)], [], []),
    "a row whose partner lacks an element is no pair": ([(1, 1), (1, 2), (2, 2)], [], [2]),
    "two sources neither of which is the row": ([(0, 1), (0, 2), (1, 1), (1, 2), (2, 0), (2, 2)], [], []),
}


@pytest.mark.parametrize("name", PATTERNS)
def test_pairs_have_each_other_and_no_further_source_and_decays_have_themselves(name):
    places, pairs, decays = PATTERNS[name]
    pattern = row_pattern(from_dense(matrices_of(8, places)))
    assert [tuple(pair) for pair in pattern.pairs] == pairs
    assert list(pattern.decays) == decays
    assert set(pattern.rows) == {row for row, _ in places} - set(np.ravel(pairs)) - set(decays)


def assert_transforms_rows(increments, width, seed=1):
    """In place, although rows that are changed are sources of others."""
    p = np.random.default_rng(seed).normal(size=(increments.shape[1], width))
    sparse = from_dense(increments)
    pattern = row_pattern(sparse)
    for k in range(len(increments)):
        expected = p + increments[k] @ p
        transform_rows(p, pattern, sparse.values[k], np.empty((len(pattern.rows), width)))
        np.testing.assert_allclose(p, expected, rtol=1e-13, atol=1e-13)
        p = expected


#: Widths on both sides of `FEW_COLUMNS`, and of the lengths of vector instructions.
WIDTHS = [1, 2, FEW_COLUMNS - 1, FEW_COLUMNS, 8, 23]


@given(st.integers(0, 1000), st.integers(1, 8), st.sampled_from(WIDTHS), st.floats(0.0, 1.0))
def test_transform_rows_is_the_product_with_identity_plus_increment(seed, n, width, share):
    assert_transforms_rows(random_matrices(seed, n, share, count=2), width)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", PATTERNS)
def test_transform_rows_of_each_pattern(name, width):
    assert_transforms_rows(matrices_of(8, PATTERNS[name][0]), width)


@pytest.mark.parametrize("width", WIDTHS)
def test_transform_rows_of_a_step_in_which_rows_do_not_change(width):
    """Their elements are zero in this step and not in the other one."""
    increments = matrices_of(8, [*square(0, 1, 2), (3, 3), *square(5, 6)])
    increments[0, 1], increments[0, 3], increments[0, 5:7] = 0.0, 0.0, 0.0
    assert_transforms_rows(increments, width)


@pytest.mark.parametrize("width", WIDTHS)
def test_transform_rows_by_elements_of_one(width):
    """Sums of rows, as of a position and a displacement."""
    increments = np.zeros((2, 8, 8))
    increments[:, 0, [1, 2]], increments[:, 5, 4], increments[0, 6, 6] = 1.0, 1.0, 1.0
    assert_transforms_rows(increments, width)


@given(st.integers(0, 1000), st.integers(1, 12), st.floats(0.0, 1.0))
def test_transform_both_sides(seed, n, share):
    sparse = from_dense(random_matrices(seed, n, share))
    root = np.random.default_rng(seed + 1).normal(size=(n, n))
    p, out, pattern = root @ root.T, np.full((n, n), np.nan), row_pattern(sparse)
    f = np.eye(n) + sparse[3]
    expected = f @ p @ f.T
    transform_both_sides(p, out, pattern, sparse.values[3], np.empty((len(pattern.rows), n)))
    np.testing.assert_allclose(out, expected, rtol=1e-12, atol=1e-12)


def test_matrices_without_elements():
    empty = BlockSparse(3, np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((4, 0)))
    assert len(empty) == 4
    np.testing.assert_array_equal(empty[2], np.zeros((3, 3)))
    matrices = from_blocks(3, [(slice(0, 3), slice(0, 3), np.zeros((4, 3, 3)))])
    assert len(matrices) == 4 and matrices.values.shape == (4, 0)
    assert len(from_blocks(3, [])) == 0
