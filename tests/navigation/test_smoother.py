"""The smoother against Rauch, Tung and Striebel's, and both against least squares over all epochs at once."""

import numpy as np
import pytest
import twins

from edl_filter.navigation.filter import forward
from edl_filter.navigation.smoother import smooth


def compare(smoothed, means, covariances, tolerance):
    for state, found, mean, covariance in zip(smoothed.states, smoothed.covariance, means, covariances, strict=True):
        sigma = np.sqrt(np.diag(covariance))
        assert np.max(np.abs(twins.linear_vector(state) - mean) / sigma) < tolerance
        assert np.max(np.abs(twins.linear_block(found) - covariance) / np.outer(sigma, sigma)) < tolerance


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_the_textbook_on_a_linear_problem(seed):
    case = twins.linear(seed)
    smoothed = smooth(forward(case.problem))
    means, covariances, _ = twins.kalman(case.mean, case.covariance, case.steps)
    compare(smoothed, *twins.rauch_tung_striebel(means, covariances, case.steps), 1e-9)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_least_squares_over_all_epochs(seed):
    case = twins.linear(seed)
    smoothed = smooth(forward(case.problem))
    compare(smoothed, *twins.least_squares(case.mean, case.covariance, case.steps), 1e-9)


def test_ends_where_the_filter_ends_and_knows_more_before():
    way = forward(twins.linear().problem)
    smoothed = smooth(way)
    np.testing.assert_array_equal(smoothed.covariance[-1], way.nodes[-1].covariance)
    np.testing.assert_array_equal(smoothed.states[-1].nav, way.nodes[-1].state.nav)
    np.testing.assert_array_equal(smoothed.time, [n.time for n in way.nodes])
    first = twins.linear_block(way.nodes[0].covariance) - twins.linear_block(smoothed.covariance[0])
    assert np.all(np.linalg.eigvalsh(first) > 0.0)


def test_may_stop_early_on_the_way_back():
    way = forward(twins.linear().problem)
    whole, part = smooth(way), smooth(way, 4)
    np.testing.assert_array_equal(part.covariance, whole.covariance[4:])
    np.testing.assert_array_equal(part.time, whole.time[4:])
    np.testing.assert_array_equal(part.states[0].nav, whole.states[4].nav)
