"""The error vector: adding and taking differences, sigma points as states, and undoing sensor errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import layout as lay
from edl_filter.navigation.layout import Layout, State

EVERY = SensorErrors(1.0, 1.0, 1.0, 1.0, 1.0)
seeds = st.integers(0, 2**32 - 1)


def full_layout():
    return Layout.of((EVERY,), {"entry_epoch": 1, "onboard_attitude": 3})


def random_state(rng, n, onboard=False):
    nav = np.concatenate((3e6 * rng.standard_normal(3), 3e3 * rng.standard_normal(3), unit_quaternion(rng)))
    errors = np.concatenate((np.zeros(9), rng.standard_normal(n - 9)))
    if onboard:
        nav = np.concatenate((nav, unit_quaternion(rng)))
        errors[-3:] = 0.0
    return State(nav, errors)


def unit_quaternion(rng):
    return rotations.normalise(rng.standard_normal(4))


def test_a_source_without_prior_is_no_state():
    layout = Layout.of((SensorErrors(accelerometer_scale=1e-3), SensorErrors(gyro_bias=1e-6)), {"entry_frame": 3})
    assert list(layout.slices) == [
        "position",
        "velocity",
        "attitude",
        "accelerometer_scale",
        "gyro_bias",
        "entry_frame",
    ]
    assert layout.size == 18
    assert layout["entry_frame"] == slice(15, 18)
    assert layout.sensor == slice(9, 15)
    assert "accelerometer_bias" not in layout


def test_slices_adjoin_and_cover_the_vector():
    layout = full_layout()
    covered = np.concatenate([np.arange(s.start, s.stop) for s in layout.slices.values()])
    np.testing.assert_array_equal(covered, np.arange(layout.size))
    assert set(layout.slices) <= set(lay.UNITS)


def test_the_onboard_attitude_comes_last():
    layout = Layout.of((EVERY,), {"onboard_attitude": 3, "entry_epoch": 1})
    assert layout["onboard_attitude"] == slice(25, 28)
    assert layout.size == 28


def test_the_sensor_slice_covers_all_sensor_states_and_no_other():
    layout = full_layout()
    sensor = [n for n in lay.SENSOR_STATES if n in layout]
    assert len(sensor) == 5
    assert layout.sensor == slice(9, layout[sensor[-1]].stop)
    assert layout.sensor.stop == min(s.start for n, s in layout.slices.items() if n not in sensor and s.start >= 9)


def test_without_sensor_errors_the_sensor_slice_is_empty():
    layout = Layout.of((SensorErrors(),), {})
    assert layout.size == 9
    assert np.zeros(9)[layout.sensor].size == 0


@given(seeds, st.floats(0.0, 3.1), st.booleans())
@settings(max_examples=60)
def test_minus_undoes_plus(seed, angle, onboard):
    rng = np.random.default_rng(seed)
    state = random_state(rng, 20, onboard)
    delta = rng.standard_normal(20)
    delta[6:9] *= angle / np.linalg.norm(delta[6:9])
    delta[-3:] /= np.linalg.norm(delta[-3:])
    moved = state.plus(delta)
    np.testing.assert_allclose(moved.minus(state), delta, rtol=0, atol=5e-9)  # 3e6 m has 5e-10 m of rounding
    np.testing.assert_allclose(moved.minus(state)[6:], delta[6:], rtol=0, atol=1e-11)


@given(seeds, st.booleans())
@settings(max_examples=60)
def test_plus_undoes_minus(seed, onboard):
    rng = np.random.default_rng(seed)
    a, b = random_state(rng, 20, onboard), random_state(rng, 20, onboard)
    again = b.plus(a.minus(b))
    np.testing.assert_allclose(again.nav[:6], a.nav[:6], rtol=0, atol=5e-9)
    for q in range(6, len(a.nav), 4):
        assert abs(again.nav[q : q + 4] @ a.nav[q : q + 4]) == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(again.errors, a.errors, atol=1e-14)


def test_plus_turns_in_body_axes():
    """``true = reference ⊗ exp(error)``: with x along inertial y, an error about body x is about inertial y."""
    attitude = rotations.from_rotation_vector([0, 0, np.pi / 2])
    state = State(np.concatenate((np.zeros(6), attitude)), np.zeros(9))
    moved = state.plus(np.concatenate((np.zeros(6), [0.1, 0, 0])))
    expected = rotations.multiply(rotations.from_rotation_vector([0, 0.1, 0]), attitude)
    np.testing.assert_allclose(moved.nav[6:], expected, atol=1e-15)


def test_plus_does_not_change_its_argument():
    state = random_state(np.random.default_rng(0), 12)
    nav, errors = state.nav.copy(), state.errors.copy()
    state.plus(np.ones(12))
    np.testing.assert_array_equal(state.nav, nav)
    np.testing.assert_array_equal(state.errors, errors)


@given(seeds, st.booleans())
@settings(max_examples=30)
def test_sigma_states_are_the_reference_plus_each_point(seed, onboard):
    rng = np.random.default_rng(seed)
    state = random_state(rng, 15, onboard)
    sigmas = rng.standard_normal((7, 15))
    nav, errors = lay.sigma_states(state, sigmas, 10)
    assert nav.shape == (14 if onboard else 10, 10)
    assert errors.shape == (15, 10)
    for s in range(7):
        single = state.plus(sigmas[s])
        np.testing.assert_allclose(nav[:, s], single.nav, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(errors[9:, s], single.errors[9:], atol=1e-14)
    for s in range(7, 10):
        np.testing.assert_array_equal(nav[:, s], state.nav)
        np.testing.assert_array_equal(errors[:, s], state.errors)


@given(seeds)
@settings(max_examples=30)
def test_attitude_helpers_agree_with_rotations(seed):
    rng = np.random.default_rng(seed)
    q = rotations.normalise(rng.standard_normal(4))
    phi = rng.uniform(-1.7, 1.7, (5, 3))  # shorter than pi
    right = lay.perturbed_attitudes(q, phi)
    np.testing.assert_allclose(right.T, rotations.multiply(q, rotations.from_rotation_vector(phi)), atol=1e-14)
    np.testing.assert_allclose(lay.attitude_errors(q, right), phi, atol=1e-12)


@given(seeds)
@settings(max_examples=40)
def test_maps_undo_misalignment_scale_and_bias(seed):
    """Errors big enough that any other order would show; another set in every column."""
    rng = np.random.default_rng(seed)
    layout = full_layout()
    errors = 0.2 * rng.standard_normal((layout.size, 6))
    force_map, rate_map = lay.sensor_maps(layout, errors)
    for s in range(6):
        force, rate = rng.standard_normal((2, 3))
        e = {name: errors[layout[name], s] for name in lay.SENSOR_STATES}
        turned = rotations.rotate(rotations.from_rotation_vector(e["accelerometer_misalignment"]), force)
        measured = (1 + e["accelerometer_scale"]) * turned + e["accelerometer_bias"]
        corrected = force_map[:9, s].reshape(3, 3) @ measured + force_map[9:, s]
        np.testing.assert_allclose(corrected, force, atol=1e-13)
        measured = (1 + e["gyro_scale"]) * rate + e["gyro_bias"]
        np.testing.assert_allclose(rate_map[:3, s] * measured + rate_map[3:, s], rate, atol=1e-13)


def test_maps_without_sensor_states_change_nothing():
    layout = Layout.of((SensorErrors(),), {"entry_frame": 3})
    force_map, rate_map = lay.sensor_maps(layout, np.ones((12, 2)))
    for s in range(2):
        np.testing.assert_array_equal(force_map[:, s], np.concatenate((np.eye(3).ravel(), np.zeros(3))))
        np.testing.assert_array_equal(rate_map[:, s], [1, 1, 1, 0, 0, 0])
