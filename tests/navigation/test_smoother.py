"""The smoother against Rauch, Tung and Striebel's, and both against least squares over all epochs at once."""

import numpy as np
import pytest
import twins

from edl_filter.navigation.filter import Settings, run_filter
from edl_filter.navigation.smoother import smooth


def compare(smoothed, means, covariances, tolerance):
    for state, smoothed_covariance, mean, covariance in zip(
        smoothed.states, smoothed.covariance, means, covariances, strict=True
    ):
        sigma = np.sqrt(np.diag(covariance))
        assert np.max(np.abs(twins.linear_vector(state) - mean) / sigma) < tolerance
        assert np.max(np.abs(twins.linear_block(smoothed_covariance) - covariance) / np.outer(sigma, sigma)) < tolerance


@pytest.mark.parametrize("method", ["ukf", "ekf"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_the_textbook_on_a_linear_problem(seed, method):
    case = twins.linear(seed, Settings(longest_interval=1.5, gate_probability=1.0, method=method))
    smoothed = smooth(run_filter(case.problem))
    means, covariances, _ = twins.kalman(case.mean, case.covariance, case.steps)
    compare(smoothed, *twins.rauch_tung_striebel(means, covariances, case.steps), 1e-9)


@pytest.mark.parametrize("method", ["ukf", "ekf"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_least_squares_over_all_epochs(seed, method):
    case = twins.linear(seed, Settings(longest_interval=1.5, gate_probability=1.0, method=method))
    smoothed = smooth(run_filter(case.problem))
    compare(smoothed, *twins.least_squares(case.mean, case.covariance, case.steps), 1e-9)


def test_ends_at_the_filters_estimate_and_has_smaller_covariances_before():
    filter_pass = run_filter(twins.linear().problem)
    smoothed = smooth(filter_pass)
    np.testing.assert_array_equal(smoothed.covariance[-1], filter_pass.nodes[-1].covariance)
    np.testing.assert_array_equal(smoothed.states[-1].nav, filter_pass.nodes[-1].state.nav)
    np.testing.assert_array_equal(smoothed.time, [n.time for n in filter_pass.nodes])
    first = twins.linear_block(filter_pass.nodes[0].covariance) - twins.linear_block(smoothed.covariance[0])
    assert np.all(np.linalg.eigvalsh(first) > 0.0)


def test_may_stop_at_a_later_node():
    filter_pass = run_filter(twins.linear().problem)
    complete, part = smooth(filter_pass), smooth(filter_pass, 4)
    np.testing.assert_array_equal(part.covariance, complete.covariance[4:])
    np.testing.assert_array_equal(part.time, complete.time[4:])
    np.testing.assert_array_equal(part.states[0].nav, complete.states[4].nav)
