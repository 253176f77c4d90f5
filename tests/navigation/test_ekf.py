"""The error-state EKF against an ordinary Kalman filter, against the UKF, and its Jacobians against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import twins
from short_flights import AIR
from twins import ALL, FULL, TIME, points, short_descent

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import reading_jacobian
from edl_filter.navigation import constraints as models
from edl_filter.navigation.ekf import DIFFERENCE_STEPS, ErrorStateEKF, linearized_measurement
from edl_filter.navigation.filter import Settings, run_filter
from edl_filter.navigation.initial import initial_estimate
from edl_filter.navigation.layout import UNITS, State, sigma_states

MARS = twins.MARS


def with_method(problem, method):
    return replace(problem, settings=replace(problem.settings, method=method))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_a_kalman_filter_and_the_ukf_on_a_linear_problem(seed):
    """To 1e-9 of a sigma: means, covariances, innovations and the smoother's cross-covariances."""
    case = twins.linear(seed)
    extended = run_filter(with_method(case.problem, "ekf"))
    unscented = run_filter(with_method(case.problem, "ukf"))
    means, covariances, _ = twins.kalman(case.mean, case.covariance, case.steps)
    assert len(extended.nodes) == len(unscented.nodes) == len(means)
    for node, twin, mean, covariance in zip(extended.nodes, unscented.nodes, means, covariances, strict=True):
        sigma = np.sqrt(np.diag(covariance))
        scale = np.outer(sigma, sigma)
        assert np.max(np.abs(twins.linear_vector(node.state) - mean) / sigma) < 1e-9
        assert np.max(np.abs(twins.linear_block(node.covariance) - covariance) / scale) < 1e-9
        assert np.max(np.abs(twins.linear_block(node.covariance - twin.covariance)) / scale) < 1e-9
        if node.transition is not None:
            change = node.transition.cross_covariance - twin.transition.cross_covariance
            assert np.max(np.abs(twins.linear_block(change)) / scale) < 1e-9
    nis = [[f.innovation.nis for f in p.fused] for p in (extended, unscented)]
    assert nis[0] == pytest.approx(nis[1], rel=1e-8)


def test_is_close_to_the_ukf_on_a_nonlinear_problem():
    """Attitude sigmas of a degree, curved constraints: the second order is a small part of a sigma."""
    problem = short_descent(Settings(longest_interval=2.0, gate_probability=1.0))
    extended, unscented = (run_filter(with_method(problem, method)) for method in ("ekf", "ukf"))
    for node, twin in zip(extended.nodes, unscented.nodes, strict=True):
        sigma = np.sqrt(np.diag(twin.covariance))
        assert np.max(np.abs(node.state.minus(twin.state)) / sigma) < 0.2
        assert np.max(np.abs(np.sqrt(np.diag(node.covariance)) / sigma - 1.0)) < 0.05
    # with a hundredth of the sigmas the two agree much better: the difference is of second order
    small = replace(problem, initial=replace(problem.initial, covariance=1e-4 * problem.initial.covariance))
    extended, unscented = (run_filter(with_method(small, method)) for method in ("ekf", "ukf"))
    change = extended.nodes[-1].state.minus(unscented.nodes[-1].state)
    assert np.max(np.abs(change) / np.sqrt(np.diag(unscented.nodes[-1].covariance))) < 0.02


def test_covariances_stay_symmetric_and_positive_definite():
    """After a measurement a million times better than the prediction, and another of the same."""
    problem = short_descent(Settings(longest_interval=2.0))
    start, covariance = initial_estimate(problem.layout, problem.initial, problem.entry, ALL, problem.planet)
    ekf = ErrorStateEKF(problem.layout, start, covariance, problem.planet)
    ekf.predict(problem.samples.part(0, 40))
    site = MARS.rotation.to_fixed(5.0, ekf.state.nav[:3])
    for _ in range(2):
        for c in (models.RestVelocity(5.0, 1e-5, MARS), models.LandingSite(5.0, site, 1e-8 * np.eye(3), MARS)):
            ekf.update(c, ekf.innovation(c))
            np.testing.assert_array_equal(ekf.covariance, ekf.covariance.T)
            sigma = np.sqrt(np.diag(ekf.covariance))
            assert np.all(np.linalg.eigvalsh(ekf.covariance / np.outer(sigma, sigma)) > 0.0)
    ekf.predict(problem.samples.part(40, 80))
    np.linalg.cholesky(ekf.covariance)


def test_an_innovation_changes_nothing():
    problem = short_descent(Settings())
    start, covariance = initial_estimate(problem.layout, problem.initial, problem.entry, ALL, problem.planet)
    ekf = ErrorStateEKF(problem.layout, start, covariance, problem.planet)
    innovation = ekf.innovation(problem.constraints[0])
    assert ekf.state is start
    np.testing.assert_array_equal(ekf.covariance, covariance)
    total = innovation.predicted_covariance + innovation.noise_covariance
    assert innovation.nis == pytest.approx(innovation.residual @ np.linalg.inv(total) @ innovation.residual)


# Jacobians of the constraints


def reference(seed=0):
    """A state some kilometres above the ground, with every sensor error."""
    nav, errors = points(1, seed)
    full = errors[:, 0].copy()
    full[:9], full[-3:] = 0.0, 0.0
    return State(nav[:, 0], full)


def blocks(values):
    """A Jacobian (m, n) from its blocks by name."""
    rows = len(next(iter(values.values())))
    out = np.zeros((rows, FULL.size))
    for name, block in values.items():
        out[:, FULL[name]] = block
    return out


def test_jacobian_of_the_altimeter_is_the_unit_vector():
    state = reference()
    _, jacobian = linearized_measurement(models.Altimeter(TIME, 0.0, 1.0, 3.39e6), state, FULL)
    up = state.nav[:3] / np.linalg.norm(state.nav[:3])
    np.testing.assert_allclose(jacobian, blocks({"position": up[None]}), atol=1e-9)


def test_jacobian_of_the_landing_site_is_the_rotation():
    state = reference()
    site = models.LandingSite(TIME, np.zeros(3), np.eye(3), MARS)
    predicted, jacobian = linearized_measurement(site, state, FULL)
    a = MARS.prime_meridian_at_epoch + MARS.rotation_rate * TIME
    turn = np.array([[np.cos(a), np.sin(a), 0.0], [-np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(jacobian, blocks({"position": turn}), atol=1e-9)
    np.testing.assert_allclose(predicted, turn @ state.nav[:3], rtol=1e-12)


def test_jacobian_of_the_velocity_at_rest():
    _, jacobian = linearized_measurement(models.RestVelocity(TIME, 1.0, MARS), reference(), FULL)
    spin = rotations.cross_matrix([0.0, 0.0, MARS.rotation_rate])
    np.testing.assert_allclose(jacobian, blocks({"position": -spin, "velocity": np.eye(3)}), atol=1e-8)


def test_jacobian_of_the_zero_force_is_the_bias():
    zero = models.ZeroSpecificForce(TIME, np.zeros(3), np.ones(3))
    _, jacobian = linearized_measurement(zero, reference(), FULL)
    np.testing.assert_allclose(jacobian, blocks({"accelerometer_bias": np.eye(3)}), atol=1e-10)


def test_jacobian_of_the_onboard_attitude_is_the_inverse_right_jacobian():
    state, turn = reference(), np.array([0.3, -0.2, 0.4])
    telemetered = rotations.multiply(state.nav[10:], rotations.conjugate(rotations.from_rotation_vector(turn)))
    predicted, jacobian = linearized_measurement(models.OnboardAttitude(TIME, telemetered, 1.0), state, FULL)
    np.testing.assert_allclose(predicted, turn, atol=1e-12)
    expected = blocks({"onboard_attitude": np.linalg.inv(rotations.right_jacobian(turn))})
    np.testing.assert_allclose(jacobian, expected, atol=1e-9)


def sensor_blocks(state, force, rate):
    """Derivatives of the readings by the sensor errors and by the attitude."""
    errors = {name: state.errors[FULL[name]] for name in reading_jacobian(np.zeros((1, 3)), np.zeros((1, 3)))}
    jacobian = {name: block[0] for name, block in reading_jacobian(force[None], rate[None], errors).items()}
    # the inertial vector is fixed: an attitude error phi turns its body components v by v × phi
    misaligned = rotations.to_matrix(rotations.from_rotation_vector(errors["accelerometer_misalignment"]))
    by_force = (1.0 + errors["accelerometer_scale"])[:, None] * (misaligned @ rotations.cross_matrix(force))
    by_rate = (1.0 + errors["gyro_scale"])[:, None] * rotations.cross_matrix(rate)
    return jacobian, by_force, by_rate


def test_jacobian_of_the_gravity_at_rest():
    state, duration = reference(), 20.0
    spin = np.array([0.0, 0.0, MARS.rotation_rate])
    expected = blocks({"position": -rotations.cross_matrix(spin), "velocity": np.eye(3)})
    constraint = models.RestGravity(TIME, duration, 1.0, MARS)
    predicted, differenced = linearized_measurement(constraint, state, FULL)
    np.testing.assert_allclose(differenced, expected / duration, atol=1e-9)
    np.testing.assert_allclose(predicted, (state.nav[3:6] - np.cross(spin, state.nav[:3])) / duration, rtol=1e-9)


def test_jacobian_of_the_rate_at_rest():
    state = reference()
    rate = rotations.rotate(rotations.conjugate(state.nav[6:10]), np.array([0.0, 0.0, MARS.rotation_rate]))
    jacobian, _, by_attitude = sensor_blocks(state, np.zeros(3), rate)
    _, differenced = linearized_measurement(models.RestRate(TIME, np.zeros(3), 1.0, MARS), state, FULL)
    expected = blocks({n: b for n, b in jacobian.items() if n.startswith("gyro")} | {"attitude": by_attitude})
    np.testing.assert_allclose(differenced, expected, atol=1e-9)


@pytest.mark.parametrize(
    "constraint",
    [models.DynamicPressure(TIME, 700.0, 20.0, 0.1, MARS, AIR), models.SteadyDescent(TIME, 40.0, 10.0, 0.1, MARS, AIR)],
)
def test_jacobians_in_the_air_are_slopes_of_fourth_order(constraint):
    """Against the five-point formula with other steps, one state at a time."""
    state = reference(3)
    state.nav[3:6] = np.cross([0.0, 0.0, MARS.rotation_rate], state.nav[:3]) - 80.0 * state.nav[:3] / 3.4e6
    state.nav[3:6] += [50.0, -30.0, 20.0]
    _, jacobian = linearized_measurement(constraint, state, FULL)

    def predicted(delta):
        return constraint.predict(*sigma_states(state, delta[None], 1), FULL)[0]

    for name, columns in FULL.slices.items():
        for k in range(columns.start, columns.stop):
            step = 3.0 * DIFFERENCE_STEPS[name] * np.eye(FULL.size)[k]
            far, near = predicted(2.0 * step) - predicted(-2.0 * step), predicted(step) - predicted(-step)
            slope = (8.0 * near - far) / (12.0 * step[k])
            np.testing.assert_allclose(jacobian[:, k], slope, rtol=1e-5, atol=1e-7)


def test_every_state_has_a_step():
    assert set(DIFFERENCE_STEPS) == set(UNITS)
