"""The error-state UKF against an ordinary Kalman filter, and against filterpy used plainly."""

import numpy as np
import pytest
import twins
from filterpy.kalman import MerweScaledSigmaPoints

from edl_filter import rotations
from edl_filter.navigation import initial as entry_state
from edl_filter.navigation.constraints import Altimeter, LandingSite, RestGravity, RestVelocity
from edl_filter.navigation.filter import EntryErrors, Settings, forward, pose
from edl_filter.navigation.layout import Layout, State
from edl_filter.navigation.ukf import ErrorStateUKF, MerwePoints
from edl_filter.telemetry.record import InitialState, SensorErrors

ALL = SensorErrors(0.02, 1e-3, 2e-3, 1e-4, 1e-3)


def short_descent(settings):
    """Ten seconds of a braking, turning vehicle with every sensor error; curved constraints, four epochs with none."""
    rng = np.random.default_rng(21)
    nav = np.array([3.39e6, 2e5, -3e5, -200.0, 900.0, 300.0, 0.1, -0.3, 0.4, 0.5])
    nav[6:] = rotations.normalise(nav[6:])
    covariance = twins.random_covariance(rng, [300.0, 500.0, 400.0, 4.0, 3.0, 5.0, 0.02, 0.03, 0.02])
    start = InitialState(0.0, nav[:3], nav[3:6], nav[6:], covariance)
    s = twins.samples(
        np.full(80, 0.125),
        [-25.0, 1.0, -3.0] + 4.0 * rng.standard_normal((80, 3)),
        [0.3, -0.2, 0.1] + 0.2 * rng.standard_normal((80, 3)),
        force_noise=0.1,
        rate_noise=1e-3,
    )
    planet = twins.MARS
    radius = np.linalg.norm(nav[:3])
    far = nav[:3] + 10.0 * nav[3:6]
    known = [
        Altimeter(3.3, 600.0, 50.0, radius - 2000.0),
        RestVelocity(5.0, 400.0, planet),
        RestGravity(5.0, np.array([1.0, -2.5, 2.0]), 0.8, planet),
        LandingSite(10.0, planet.rotation.to_fixed(10.0, far), 200.0**2 * np.eye(3), planet),
    ]
    return pose(s, start, EntryErrors(), (ALL,), known, planet, settings)


def test_equals_a_kalman_filter_on_a_linear_problem():
    case = twins.linear()
    way = forward(case.problem)
    means, covariances, nis = twins.kalman(case.mean, case.covariance, case.steps)
    assert len(way.nodes) == len(means)
    for node, mean, covariance in zip(way.nodes, means, covariances, strict=True):
        sigma = np.sqrt(np.diag(covariance))
        assert np.max(np.abs(twins.linear_vector(node.state) - mean) / sigma) < 1e-9
        assert np.max(np.abs(twins.linear_block(node.covariance) - covariance) / np.outer(sigma, sigma)) < 1e-9
    assert all(f.accepted for f in way.fused)
    single = [f.innovation.nis for f in way.fused if f.constraint.time != 4.0]  # at 4 s two are met at once
    assert single == pytest.approx([x for x, s in zip(nis, case.steps, strict=True) if len(s.measured) == 3], rel=1e-8)
    both = sum(f.innovation.nis for f in way.fused if f.constraint.time == 4.0)
    assert both == pytest.approx(
        next(x for x, s in zip(nis, case.steps, strict=True) if len(s.measured) == 6), rel=1e-8
    )


@pytest.mark.parametrize(("alpha", "kappa"), [(0.5, 0.0), (0.1, 3.0), (1.0, 0.0)])
def test_equals_plain_filterpy_on_a_nonlinear_problem(alpha, kappa):
    """Same mathematics, one Python call a sigma point: equal to 1e-6 of a sigma."""
    problem = short_descent(Settings(alpha, 2.0, kappa, longest_interval=2.0, gate_probability=1.0))
    way = forward(problem)
    start, covariance = entry_state.start(problem.layout, problem.initial, problem.entry, ALL, problem.planet)
    wanted, nis = twins.plain_filter(problem, start, covariance)
    assert len(way.nodes) == len(wanted)
    for node, (state, cov) in zip(way.nodes, wanted, strict=True):
        sigma = np.sqrt(np.diag(cov))
        assert np.max(np.abs(node.state.minus(state)) / sigma) < 1e-6
        assert np.max(np.abs(node.covariance - cov) / np.outer(sigma, sigma)) < 1e-6
    assert [f.innovation.nis for f in way.fused] == pytest.approx(nis, rel=1e-6)
    # and the constraints did something: positions and attitudes are known better than by dead reckoning
    dead = forward(pose(problem.samples, problem.initial, problem.entry, (ALL,), [], problem.planet, problem.settings))
    gain = np.sqrt(np.diag(way.nodes[-1].covariance) / np.diag(dead.nodes[-1].covariance))
    assert np.all(gain[:3] < 0.6)


def test_sigma_points_are_filterpys():
    rng = np.random.default_rng(0)
    x, p = rng.standard_normal(5), twins.random_covariance(rng, np.arange(1.0, 6.0))
    ours, theirs = MerwePoints(5, 0.3, 2.0, 1.0), MerweScaledSigmaPoints(5, 0.3, 2.0, 1.0)
    np.testing.assert_allclose(ours.sigma_points(x, p), theirs.sigma_points(x, p), rtol=1e-14)
    np.testing.assert_array_equal(ours.Wm, theirs.Wm)


def test_prediction_keeps_the_vector_at_zero_and_the_reference_at_the_mean():
    problem = short_descent(Settings(longest_interval=2.0))
    start, covariance = entry_state.start(problem.layout, problem.initial, problem.entry, ALL, problem.planet)
    ukf = ErrorStateUKF(problem.layout, start, covariance, problem.planet)
    arrival = ukf.advance(problem.samples.part(0, 20))
    assert not ukf.x.any()
    assert arrival.state is ukf.state
    assert np.linalg.norm(ukf.state.nav[6:10]) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_array_equal(ukf.P, ukf.P.T)
    np.testing.assert_allclose(ukf.sigmas_f[0], 0.0, atol=1e-12)


def test_cross_covariance_is_that_of_many_drawn_states():
    """Errors before a step with errors after it, for the smoother: drawn states through the scalar twin."""
    problem = short_descent(Settings())
    layout, p = problem.layout, problem.planet
    start, covariance = entry_state.start(layout, problem.initial, problem.entry, ALL, p)
    ukf = ErrorStateUKF(layout, start, covariance, p)
    part = problem.samples.part(0, 16)
    arrival = ukf.advance(part)
    rng = np.random.default_rng(4)
    x = rng.multivariate_normal(np.zeros(layout.size), covariance, 1500, method="cholesky")
    after = np.empty_like(x)
    for i, error in enumerate(x):
        nav, errors = twins.full_state(start, error)
        maps = twins.undo_errors(layout, errors)
        nav = twins.propagate(nav, *maps, part.interval, part.force, part.rate, p.mu, p.j2, p.gravity_radius)
        after[i] = State(nav, errors).minus(arrival.state)
    found = x.T @ after / len(x)
    scale = np.outer(np.sqrt(np.diag(covariance)), np.sqrt(np.diag(arrival.covariance)))
    assert np.max(np.abs(found - arrival.cross) / scale) < 5 * np.sqrt(2 / len(x))


def test_replacing_states_is_a_linear_step():
    layout = Layout.of((ALL,), {})
    rng = np.random.default_rng(2)
    covariance = twins.random_covariance(rng, np.ones(layout.size))
    state = State(np.array([1.0, 2, 3, 4, 5, 6, 0, 0, 0, 1]), np.zeros(layout.size))
    ukf = ErrorStateUKF(layout, state, covariance, twins.MARS)
    f, q = rng.standard_normal((2, layout.size, layout.size))
    errors = np.arange(layout.size) * 1.0
    arrival = ukf.replace(f, q @ q.T, errors)
    np.testing.assert_allclose(arrival.cross, covariance @ f.T)
    np.testing.assert_allclose(ukf.P, f @ covariance @ f.T + q @ q.T)
    np.testing.assert_array_equal(ukf.state.errors, errors)
    np.testing.assert_array_equal(ukf.state.nav, state.nav)
    spread = ukf.sigmas_f - ukf.sigmas_f[0]
    np.testing.assert_allclose((spread * ukf.Wc[:, None]).T @ spread, ukf.P, rtol=1e-9, atol=1e-9)
