"""Sparse matrices against whole ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.diagnosis.sparse import dense, joined, sparse


@given(st.integers(0, 1000), st.integers(1, 8), st.floats(0.0, 1.0))
def test_there_and_back(seed, n, share):
    rng = np.random.default_rng(seed)
    whole = rng.normal(size=(5, n, n)) * (rng.random((n, n)) < share)
    found = dense(whole)
    assert len(found) == 5 and found.values.shape[1] == np.count_nonzero(whole.any(axis=0))
    assert np.all(np.diff(found.row) >= 0)
    np.testing.assert_array_equal([found[k] for k in range(5)], whole)


def test_blocks_at_one_place_add_up():
    a, b = np.ones((3, 2, 2)), np.arange(3.0)[:, None, None] * np.eye(2)
    found = sparse(4, [(slice(1, 3), slice(2, 4), a), (slice(1, 3), slice(2, 4), b)])
    expected = np.zeros((4, 4))
    expected[1:3, 2:4] = 1.0 + 2.0 * np.eye(2)
    np.testing.assert_array_equal(found[2], expected)


def test_joined_has_both():
    a, b = dense(np.full((2, 2, 2), 3.0)), sparse(5, [(slice(3, 5), slice(0, 2), np.ones((2, 2, 2)))])
    found = joined(a, b, 5)
    np.testing.assert_array_equal(found[1][:2, :2], 3.0)
    np.testing.assert_array_equal(found[1][3:, :2], 1.0)
    assert np.count_nonzero(found[1]) == 8 and np.all(np.diff(found.row) >= 0)
