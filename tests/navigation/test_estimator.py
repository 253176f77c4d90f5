"""What the interface of the filters promises, for each of them."""

import numpy as np
import pytest
import twins
from twins import ALL, short_descent

from edl_filter.navigation.compiled_ukf import CompiledUKF
from edl_filter.navigation.constraints import RestVelocity
from edl_filter.navigation.ekf import ErrorStateEKF
from edl_filter.navigation.estimator import Innovation
from edl_filter.navigation.filter import Settings
from edl_filter.navigation.initial import initial_estimate
from edl_filter.navigation.layout import Layout, State
from edl_filter.navigation.ukf import ErrorStateUKF

every_filter = pytest.mark.parametrize("filter_class", [CompiledUKF, ErrorStateUKF, ErrorStateEKF])


@every_filter
def test_cross_covariance_is_that_of_many_drawn_states(filter_class):
    """Errors before a step with errors after it, for the smoother: drawn states through the scalar twin."""
    problem = short_descent(Settings())
    layout, p = problem.layout, problem.planet
    start, covariance = initial_estimate(layout, problem.initial, problem.entry, ALL, p)
    part = problem.samples.part(0, 16)
    transition = filter_class(layout, start, covariance, p).predict(part)
    rng = np.random.default_rng(4)
    x = rng.multivariate_normal(np.zeros(layout.size), covariance, 1500, method="cholesky")
    after = np.empty_like(x)
    for i, error in enumerate(x):
        nav, errors = twins.full_state(start, error)
        maps = twins.undo_errors(layout, errors)
        nav = twins.propagate(nav, *maps, part.interval, part.force, part.rate, p.mu, p.j2, p.gravity_radius)
        after[i] = State(nav, errors).minus(transition.state)
    scale = np.outer(np.sqrt(np.diag(covariance)), np.sqrt(np.diag(transition.covariance)))
    assert np.max(np.abs(x.T @ after / len(x) - transition.cross_covariance) / scale) < 5 * np.sqrt(2 / len(x))


@every_filter
def test_a_transform_is_a_linear_step(filter_class):
    layout = Layout.of((ALL,), {})
    rng = np.random.default_rng(2)
    covariance = twins.random_covariance(rng, np.ones(layout.size))
    state = State(np.array([1.0, 2, 3, 4, 5, 6, 0, 0, 0, 1]), np.zeros(layout.size))
    estimator = filter_class(layout, state, covariance, twins.MARS)
    f, q = rng.standard_normal((2, layout.size, layout.size))
    errors = np.arange(layout.size) * 1.0
    transition = estimator.transform(f, q @ q.T, errors)
    np.testing.assert_allclose(transition.cross_covariance, covariance @ f.T)
    np.testing.assert_allclose(transition.covariance, f @ covariance @ f.T + q @ q.T)
    np.testing.assert_allclose(estimator.covariance, transition.covariance)
    np.testing.assert_array_equal(estimator.state.errors, errors)
    np.testing.assert_array_equal(estimator.state.nav, state.nav)
    if filter_class is not ErrorStateEKF:
        spread = estimator.sigma_points - estimator.sigma_points[0]
        drawn = (spread * estimator.weights[:, None]).T @ spread
        np.testing.assert_allclose(drawn, estimator.covariance, rtol=1e-9, atol=1e-9)


@every_filter
def test_the_jacobian_of_a_linear_measurement_is_exact(filter_class):
    """Velocity relative to the rotating planet is ``v - w x r``: before an update, and after one."""
    layout = Layout.of((ALL,), {})
    sigma = np.concatenate((np.full(3, 100.0), np.ones(layout.size - 3)))
    covariance = twins.random_covariance(np.random.default_rng(5), sigma)
    state = State(np.array([3.4e6, 2e5, 3e5, 4.0, 5, 6, 0, 0, 0, 1]), np.zeros(layout.size))
    estimator = filter_class(layout, state, covariance, twins.MARS)
    constraint = RestVelocity(10.0, 0.5, twins.MARS)
    rate = twins.MARS.rotation_rate  # about z
    expected = np.zeros((3, layout.size))
    expected[:, 3:6], expected[0, 1], expected[1, 0] = np.eye(3), rate, -rate
    for _ in range(2):
        innovation = estimator.innovation(constraint)
        np.testing.assert_allclose(estimator.jacobian(innovation), expected, rtol=1e-6, atol=1e-8)
        estimator.update(constraint, innovation)


def test_the_normalised_innovation_squared_is_over_the_sum_of_both_covariances():
    """In axes in which both are diagonal, it is the sum of the squares over the sums of the variances."""
    rng = np.random.default_rng(3)
    axes, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    predicted, noise, residual = np.array([1.0, 4.0, 9.0]), np.array([3.0, 0.5, 2.0]), np.array([2.0, -1.0, 5.0])
    innovation = Innovation.of(
        axes @ residual, axes @ np.diag(predicted) @ axes.T, axes @ np.diag(noise) @ axes.T, np.zeros((7, 3))
    )
    assert innovation.nis == pytest.approx(np.sum(residual**2 / (predicted + noise)), rel=1e-12)
