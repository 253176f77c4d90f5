"""The error model of an IMU: its inverse, the inverse as linear maps, and its Jacobian, against the definition."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import (
    SENSOR_STATES,
    SensorErrors,
    apply_errors,
    correction_maps,
    reading_jacobian,
    remove_errors,
)

seeds = st.integers(0, 2**32 - 1)


def by_definition(value, misalignment, scale, bias):
    """``(1 + s) ∘ (R(m) v) + b`` of one vector, by the direction-cosine matrix."""
    matrix = rotations.to_matrix(rotations.from_rotation_vector(misalignment))
    return np.array([(1.0 + scale[i]) * (matrix[i] @ value) + bias[i] for i in range(3)])


@given(seeds)
def test_readings_are_misaligned_then_scaled_then_biased(seed):
    """Errors large enough that any other order would show."""
    rng = np.random.default_rng(seed)
    values, errors = rng.standard_normal((5, 3)), 0.3 * rng.standard_normal((3, 3))
    expected = [by_definition(v, *errors) for v in values]
    np.testing.assert_allclose(apply_errors(values, *errors), expected, atol=1e-14)


@given(seeds)
def test_errors_may_differ_from_row_to_row(seed):
    rng = np.random.default_rng(seed)
    values, errors = rng.standard_normal((5, 3)), 0.3 * rng.standard_normal((3, 5, 3))
    expected = [by_definition(v, *errors[:, i]) for i, v in enumerate(values)]
    np.testing.assert_allclose(apply_errors(values, *errors), expected, atol=1e-14)


@pytest.mark.parametrize("present", list(product([False, True], repeat=3)))
def test_an_error_that_is_none_is_zero(present):
    rng = np.random.default_rng(0)
    values, errors = rng.standard_normal((5, 3)), 0.3 * rng.standard_normal((3, 3))
    some = [e if is_present else None for e, is_present in zip(errors, present, strict=True)]
    zeros = [e if is_present else np.zeros(3) for e, is_present in zip(errors, present, strict=True)]
    np.testing.assert_array_equal(apply_errors(values, *some), apply_errors(values, *zeros))
    np.testing.assert_array_equal(remove_errors(values, *some), remove_errors(values, *zeros))


@given(seeds)
def test_removing_undoes_applying(seed):
    rng = np.random.default_rng(seed)
    values, errors = rng.standard_normal((5, 3)), 0.3 * rng.standard_normal((3, 3))
    np.testing.assert_allclose(remove_errors(apply_errors(values, *errors), *errors), values, atol=1e-12)


@given(seeds)
def test_maps_are_the_inverse(seed):
    """Another set of errors in every column."""
    rng = np.random.default_rng(seed)
    errors = {name: 0.2 * rng.standard_normal((3, 6)) for name in SENSOR_STATES}
    force_map, rate_map = correction_maps(errors, 6)
    force, rate = rng.standard_normal((2, 3))
    for s in range(6):
        e = {name: values[:, s] for name, values in errors.items()}
        corrected = force_map[:9, s].reshape(3, 3) @ force + force_map[9:, s]
        names = ("accelerometer_misalignment", "accelerometer_scale", "accelerometer_bias")
        np.testing.assert_allclose(corrected, remove_errors(force, *(e[n] for n in names)), atol=1e-13)
        corrected = rate_map[:3, s] * rate + rate_map[3:, s]
        expected = remove_errors(rate, scale=e["gyro_scale"], bias=e["gyro_bias"])
        np.testing.assert_allclose(corrected, expected, atol=1e-13)


def test_maps_without_errors_change_nothing():
    force_map, rate_map = correction_maps({}, 2)
    np.testing.assert_array_equal(force_map, np.tile(np.append(np.eye(3).ravel(), np.zeros(3))[:, None], 2))
    np.testing.assert_array_equal(rate_map, np.tile(np.array([1.0, 1, 1, 0, 0, 0])[:, None], 2))


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_jacobian_is_the_slope_of_the_readings(size):
    """By central differences, at errors of zero and at large ones."""
    rng = np.random.default_rng(4)
    force, rate = rng.standard_normal((2, 4, 3))
    errors = {name: size * rng.standard_normal(3) for name in SENSOR_STATES}
    jacobian = reading_jacobian(force, rate, errors if size else None)
    assert tuple(jacobian) == SENSOR_STATES

    def readings(e):
        names = ("accelerometer_misalignment", "accelerometer_scale", "accelerometer_bias")
        return apply_errors(force, *(e[n] for n in names)), apply_errors(rate, None, e["gyro_scale"], e["gyro_bias"])

    for name, k in product(SENSOR_STATES, range(3)):
        step = 1e-5 * np.eye(3)[k]
        sensor = 0 if name.startswith("accelerometer") else 1
        ahead, behind = (readings(errors | {name: errors[name] + sign * step})[sensor] for sign in (1, -1))
        np.testing.assert_allclose(jacobian[name][:, :, k], (ahead - behind) / 2e-5, atol=1e-9)


def test_sizes_are_in_the_order_of_the_states():
    assert tuple(vars(SensorErrors())) == SENSOR_STATES
    assert all(size == 0.0 for size in vars(SensorErrors()).values())
