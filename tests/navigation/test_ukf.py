"""The error-state UKF against an ordinary Kalman filter, and against filterpy with Python callbacks."""

import numpy as np
import pytest
import twins
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from twins import ALL, short_descent

from edl_filter.navigation import initial as entry_state
from edl_filter.navigation.filter import Settings, build_problem, run_filter
from edl_filter.navigation.ukf import ErrorStateUKF, MerwePoints, _Engine


def test_equals_a_kalman_filter_on_a_linear_problem():
    case = twins.linear()
    filter_pass = run_filter(case.problem)
    means, covariances, nis = twins.kalman(case.mean, case.covariance, case.steps)
    assert len(filter_pass.nodes) == len(means)
    for node, mean, covariance in zip(filter_pass.nodes, means, covariances, strict=True):
        sigma = np.sqrt(np.diag(covariance))
        assert np.max(np.abs(twins.linear_vector(node.state) - mean) / sigma) < 1e-9
        assert np.max(np.abs(twins.linear_block(node.covariance) - covariance) / np.outer(sigma, sigma)) < 1e-9
    assert all(f.accepted for f in filter_pass.fused)
    single = [f.innovation.nis for f in filter_pass.fused if f.constraint.time != 4.0]  # at 4 s two are used together
    assert single == pytest.approx([x for x, s in zip(nis, case.steps, strict=True) if len(s.measured) == 3], rel=1e-8)
    both = sum(f.innovation.nis for f in filter_pass.fused if f.constraint.time == 4.0)
    assert both == pytest.approx(
        next(x for x, s in zip(nis, case.steps, strict=True) if len(s.measured) == 6), rel=1e-8
    )


@pytest.mark.parametrize(("alpha", "kappa"), [(0.5, 0.0), (0.1, 3.0), (1.0, 0.0)])
def test_equals_plain_filterpy_on_a_nonlinear_problem(alpha, kappa):
    """Same mathematics, one Python call a sigma point: equal to 1e-6 of a sigma."""
    problem = short_descent(Settings(alpha, 2.0, kappa, longest_interval=2.0, gate_probability=1.0))
    filter_pass = run_filter(problem)
    start, covariance = entry_state.initial_estimate(
        problem.layout, problem.initial, problem.entry, ALL, problem.planet
    )
    expected, nis = twins.plain_filter(problem, start, covariance)
    assert len(filter_pass.nodes) == len(expected)
    for node, (state, cov) in zip(filter_pass.nodes, expected, strict=True):
        sigma = np.sqrt(np.diag(cov))
        assert np.max(np.abs(node.state.minus(state)) / sigma) < 1e-6
        assert np.max(np.abs(node.covariance - cov) / np.outer(sigma, sigma)) < 1e-6
    assert [f.innovation.nis for f in filter_pass.fused] == pytest.approx(nis, rel=1e-6)
    # and the constraints matter: positions are better than by dead reckoning
    dead = run_filter(
        build_problem(problem.samples, problem.initial, problem.entry, (ALL,), [], problem.planet, problem.settings)
    )
    gain = np.sqrt(np.diag(filter_pass.nodes[-1].covariance) / np.diag(dead.nodes[-1].covariance))
    assert np.all(gain[:3] < 0.6)


def test_sigma_points_are_filterpys():
    rng = np.random.default_rng(0)
    x, p = rng.standard_normal(5), twins.random_covariance(rng, np.arange(1.0, 6.0))
    ours, theirs = MerwePoints(5, 0.3, 2.0, 1.0), MerweScaledSigmaPoints(5, 0.3, 2.0, 1.0)
    np.testing.assert_allclose(ours.sigma_points(x, p), theirs.sigma_points(x, p), rtol=1e-14)
    np.testing.assert_array_equal(ours.Wm, theirs.Wm)


def test_the_cross_covariance_of_state_and_measurement_is_filterpys():
    """Also about means that are not zero, of points that are not symmetric."""
    rng = np.random.default_rng(6)
    engine = _Engine(MerwePoints(4, 0.3, 2.0, 1.0))
    points, predicted = rng.standard_normal((9, 4)), rng.standard_normal((9, 2))
    mean, measured = rng.standard_normal(4), rng.standard_normal(2)
    expected = UnscentedKalmanFilter.cross_variance(engine, mean, measured, points, predicted)
    np.testing.assert_allclose(engine.cross_variance(mean, measured, points, predicted), expected, rtol=1e-12)


def test_the_transform_is_that_of_the_settings_without_a_statement():
    problem = short_descent(Settings())
    start, covariance = entry_state.initial_estimate(
        problem.layout, problem.initial, problem.entry, ALL, problem.planet
    )
    ukf, settings = ErrorStateUKF(problem.layout, start, covariance, problem.planet), Settings()
    theirs = MerweScaledSigmaPoints(problem.layout.size, settings.alpha, settings.beta, settings.kappa)
    np.testing.assert_array_equal(ukf.weights, theirs.Wc)
    np.testing.assert_allclose(
        ukf.sigma_points, theirs.sigma_points(np.zeros(problem.layout.size), covariance), rtol=1e-12
    )


def test_after_a_prediction_the_reference_is_the_mean():
    problem = short_descent(Settings(longest_interval=2.0))
    start, covariance = entry_state.initial_estimate(
        problem.layout, problem.initial, problem.entry, ALL, problem.planet
    )
    ukf = ErrorStateUKF(problem.layout, start, covariance, problem.planet)
    transition = ukf.predict(problem.samples.part(0, 20))
    assert not ukf._engine.x.any()
    assert transition.state is ukf.state
    assert np.linalg.norm(ukf.state.nav[6:10]) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_array_equal(ukf.covariance, ukf.covariance.T)
    np.testing.assert_allclose(ukf.sigma_points[0], 0.0, atol=1e-12)
