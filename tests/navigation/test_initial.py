"""The initial estimate: effect of an error of epoch, frame or on-board attitude, against finite changes."""

import numpy as np
import pytest
import twins

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import initial as entry_state
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.layout import Layout
from edl_filter.telemetry.record import InitialState

MARS = twins.MARS
FIRST = SensorErrors(accelerometer_bias=0.01, gyro_bias=1e-4)
SECOND = SensorErrors(accelerometer_bias=0.02, accelerometer_scale=1e-3)


def stated():
    covariance = twins.random_covariance(np.random.default_rng(0), [10, 20, 30, 1, 2, 3, 0.01, 0.02, 0.03])
    q = rotations.normalise([0.1, 0.2, -0.3, 0.8])
    return InitialState(5.0, np.array([3.5e6, 1e5, -2e5]), np.array([-900.0, 5000.0, 800.0]), q, covariance)


def test_jacobian_of_the_epoch_is_the_motion_itself():
    """A state stated for a time too early by τ: at its nominal time the vehicle is τ further on, in free fall."""
    s = stated()

    def rest(_):
        return np.zeros(3)

    nav = np.concatenate((s.position, s.velocity, s.inertial_from_body))
    later = twins.integrate(nav, rest, rest, [0.0, 0.1], MARS)[-1]
    earlier = twins.integrate(nav, rest, rest, [0.0, -0.1], MARS)[-1]
    np.testing.assert_allclose(entry_state.epoch_jacobian(s, MARS), (later - earlier)[:6] / 0.2, rtol=1e-5)


def test_jacobian_of_the_frame_is_a_rotation_of_position_and_velocity():
    s = stated()
    phi = 1e-6 * np.array([1.0, -2.0, 0.5])
    q = rotations.from_rotation_vector(phi)
    change = np.concatenate(
        (rotations.rotate(q, s.position) - s.position, rotations.rotate(q, s.velocity) - s.velocity)
    )
    np.testing.assert_allclose(entry_state.frame_jacobian(s) @ phi, change, rtol=1e-5, atol=2e-5)


def test_initial_estimate_without_further_errors_is_the_stated_one():
    s = stated()
    layout = Layout.of((FIRST,), {})
    state, covariance = entry_state.initial_estimate(layout, s, EntryErrors(), FIRST, MARS)
    np.testing.assert_array_equal(state.nav, np.concatenate((s.position, s.velocity, s.inertial_from_body)))
    assert not state.errors.any()
    expected = np.zeros((15, 15))
    expected[:9, :9] = s.covariance
    expected[9:, 9:] = np.diag([1e-4] * 3 + [1e-8] * 3)
    np.testing.assert_allclose(covariance, expected, rtol=1e-12)


def test_covariance_is_that_of_drawn_starts():
    """Epoch, frame and the other errors drawn independently, and combined by their finite effects."""
    s = stated()
    entry = EntryErrors(0.4, 1e-5, rotations.normalise([0.0, 0.1, 0.2, 0.9]), 2e-3)
    layout = Layout.of((FIRST,), entry.states)
    state, covariance = entry_state.initial_estimate(layout, s, entry, FIRST, MARS)
    np.testing.assert_array_equal(state.nav[10:], entry.onboard_attitude)
    rng = np.random.default_rng(1)
    runs = 20000
    x = np.zeros((runs, layout.size))
    x[:, :9] = rng.multivariate_normal(np.zeros(9), s.covariance, runs)
    x[:, layout["accelerometer_bias"]] = 0.01 * rng.standard_normal((runs, 3))
    x[:, layout["gyro_bias"]] = 1e-4 * rng.standard_normal((runs, 3))
    tau, phi = 0.4 * rng.standard_normal(runs), 1e-5 * rng.standard_normal((runs, 3))
    x[:, layout["entry_epoch"]], x[:, layout["entry_frame"]] = tau[:, None], phi
    x[:, layout["onboard_attitude"]] = 2e-3 * rng.standard_normal((runs, 3))
    x[:, :3] += tau[:, None] * s.velocity + np.cross(phi, s.position)
    x[:, 3:6] += tau[:, None] * MARS.gravity(s.position) + np.cross(phi, s.velocity)
    root = np.linalg.cholesky(covariance)
    ratio = np.linalg.solve(root, np.linalg.solve(root, x.T @ x / runs).T)
    assert np.max(np.abs(ratio - np.eye(layout.size))) < 5 * np.sqrt(2 / runs)


@pytest.mark.parametrize(
    ("entry", "names"),
    [
        (EntryErrors(), []),
        (EntryErrors(epoch_sigma=0.1), ["entry_epoch"]),
        (EntryErrors(frame_sigma=0.1), ["entry_frame"]),
        (EntryErrors(onboard_attitude=np.array([0, 0, 0, 1.0])), ["onboard_attitude"]),
    ],
)
def test_an_error_without_sigma_is_no_state(entry, names):
    assert list(entry.states) == names


ONBOARD = {"onboard_attitude": rotations.normalise([0.0, 0.1, 0.2, 0.9]), "onboard_sigma": 2e-3}


@pytest.mark.parametrize(
    ("sigmas", "names"),
    [
        ({"onboard_rate_sigma": 3e-5}, ["onboard_rate", "onboard_attitude"]),
        ({"onboard_mounting_sigma": 4e-4}, ["onboard_mounting", "onboard_attitude"]),
        (
            {"onboard_rate_sigma": 3e-5, "onboard_mounting_sigma": 4e-4},
            ["onboard_rate", "onboard_mounting", "onboard_attitude"],
        ),
    ],
)
def test_errors_behind_an_onboard_attitude_are_independent_states_of_three_axes(sigmas, names):
    entry = EntryErrors(**ONBOARD, **sigmas)
    assert entry.states == dict.fromkeys(names, 3)
    layout = Layout.of((FIRST,), entry.states)
    _, covariance = entry_state.initial_estimate(layout, stated(), entry, FIRST, MARS)
    assert layout.size == 15 + 3 * len(names)
    expected = {"onboard_attitude": 2e-3} | {n.removesuffix("_sigma"): v for n, v in sigmas.items()}
    for name in names:
        rest = np.delete(np.arange(layout.size), np.arange(layout.size)[layout[name]])
        np.testing.assert_allclose(covariance[layout[name], layout[name]], expected[name] ** 2 * np.eye(3), rtol=1e-12)
        assert not covariance[layout[name], rest].any()


def test_without_an_onboard_attitude_its_errors_are_no_states():
    assert EntryErrors(onboard_rate_sigma=3e-5, onboard_mounting_sigma=4e-4).states == {}


def test_prior_of_an_instrument_that_lacks_a_state():
    """The other instrument's state stays, with a negligible variance, and the covariance is positive definite."""
    layout = Layout.of((FIRST, SECOND), {})
    first, second = (entry_state.sensor_prior(layout, e) for e in (FIRST, SECOND))
    names = ("accelerometer_bias", "accelerometer_scale", "gyro_bias")
    assert [n for n in layout.slices if n in names] == list(names)
    np.testing.assert_allclose(np.sqrt(np.diag(first)), np.repeat([0.01, 1e-12, 1e-4], 3))
    np.testing.assert_allclose(np.sqrt(np.diag(second)), np.repeat([0.02, 1e-3, 1e-12], 3))
    np.linalg.cholesky(first)
