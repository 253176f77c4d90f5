"""Runs, moving means and interpolation of series, against loops over their values."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.estimation.series import finite_rows, interpolate_columns, moving_mean, near_running_median, runs


def test_a_row_is_finite_where_all_its_numbers_are():
    values = np.zeros((4, 2, 3))
    values[1, 0, 2], values[3, 1, 1] = np.nan, -np.inf
    np.testing.assert_array_equal(finite_rows(values), [True, False, True, False])
    np.testing.assert_array_equal(finite_rows(values[:, 0]), [True, False, True, True])


@given(st.lists(st.booleans(), max_size=20))
def test_runs_are_those_of_a_loop(values):
    expected, start = [], 0
    for value, group in groupby(values):
        end = start + len(list(group))
        if value:
            expected.append((start, end))
        start = end
    assert runs(np.array(values, bool)) == expected


def test_moving_means_are_those_of_a_loop():
    """Of one reach, and of a reach for each row; at the ends of fewer rows."""
    rng = np.random.default_rng(3)
    values = rng.standard_normal((30, 2))
    for reach in (4, rng.integers(0, 40, 30)):
        reaches = np.broadcast_to(reach, 30)
        expected = [values[max(i - r, 0) : i + r + 1].mean(axis=0) for i, r in enumerate(reaches)]
        np.testing.assert_allclose(moving_mean(values, reach), expected, rtol=0, atol=1e-14)


def test_moving_mean_keeps_the_sum_of_an_inner_value_and_shortens_at_the_ends():
    x = np.zeros((30, 2))
    x[15, 1] = 9.0
    np.testing.assert_allclose(moving_mean(x, 4)[11:20], np.tile([0.0, 1.0], (9, 1)))
    assert moving_mean(x, 4).sum() == pytest.approx(9.0)
    assert moving_mean(np.arange(30.0)[:, None], 4)[0] == pytest.approx(2.0)


def test_columns_are_interpolated_one_by_one_and_held_at_the_edges():
    knots, values = np.array([0.0, 1.0, 3.0]), np.array([[0.0, 5.0], [2.0, 5.0], [4.0, 9.0]])
    np.testing.assert_array_equal(
        interpolate_columns([-1.0, 0.5, 2.0, 4.0], knots, values), [[0.0, 5.0], [1.0, 5.0], [3.0, 7.0], [4.0, 9.0]]
    )
    np.testing.assert_array_equal(interpolate_columns(2.0, knots, values), [3.0, 7.0])
    assert interpolate_columns(np.zeros((4, 5)), knots, values).shape == (4, 5, 2)


def test_rows_far_from_their_running_median_are_outliers():
    """By a loop over rows and columns; beyond the ends the series is mirrored."""
    rng = np.random.default_rng(1)
    values = np.linspace(0.0, 0.3, 40)[:, None] + 0.01 * rng.standard_normal((40, 2))
    values[[0, 17, 39], [0, 1, 0]] += [0.5, -0.5, 0.5]
    noise = np.full(40, 0.01)
    departure = np.empty((40, 2))
    for i in range(40):
        for k in range(2):
            departure[i, k] = abs(
                values[i, k] - np.median([values[39 - abs(39 - abs(j)), k] for j in range(i - 4, i + 5)])
            )
    limit = [6.0 * (1.4826 * np.median(departure[:, k]) + 0.01) for k in range(2)]
    expected = [all(departure[i, k] <= limit[k] for k in range(2)) for i in range(40)]
    np.testing.assert_array_equal(near_running_median(values, noise, 9, 6.0), expected)
    np.testing.assert_array_equal(np.flatnonzero(~np.array(expected)), [0, 17, 39])


def test_values_most_of_which_are_far_from_their_median_have_no_outliers():
    values = np.random.default_rng(2).standard_normal((50, 3))
    assert near_running_median(values, np.full(50, 1e-6), 9, 0.1).all()
    assert near_running_median(np.zeros((0, 3)), np.zeros(0), 9, 8.0).shape == (0,)
