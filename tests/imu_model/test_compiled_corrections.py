"""The compiled inverse of the IMU error model against its readable twin in numpy, for every choice of errors."""

from itertools import product

import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.imu_model.compiled_corrections import sensor_correction_maps
from edl_filter.imu_model.sensor_errors import SENSOR_STATES, correction_maps


def readable_maps(errors, count):
    """``A = R(m)ᵀ diag(1 / (1 + s))`` and ``-A b`` of the accelerometers, ``1 / (1 + s)`` and ``-b / (1 + s)``."""

    def get(name):
        return errors.get(name, np.zeros((3, count)))

    scale = 1.0 / (1.0 + get("accelerometer_scale"))
    turn = rotations.to_matrix(rotations.from_rotation_vector(get("accelerometer_misalignment").T))
    inverse = np.transpose(turn, (2, 1, 0)) * scale[None]  # (row, column, set)
    offset = -np.einsum("ijs,js->is", inverse, get("accelerometer_bias"))
    rate = 1.0 / (1.0 + get("gyro_scale"))
    return np.concatenate((inverse.reshape(9, count), offset)), np.concatenate((rate, -rate * get("gyro_bias")))


@pytest.mark.parametrize("present", list(product([False, True], repeat=5)))
def test_maps_are_those_of_the_readable_twin(present):
    """Through the mapping by name, in any order of the names, and any order of the axes in memory."""
    rng = np.random.default_rng(sum(2**k for k, is_present in enumerate(present) if is_present))
    names = [name for name, is_present in zip(SENSOR_STATES, present, strict=True) if is_present]
    errors = {name: 0.3 * rng.standard_normal((7, 3)).T for name in reversed(names)}
    for maps, expected in zip(correction_maps(errors, 7), readable_maps(errors, 7), strict=True):
        assert maps.shape == expected.shape and maps.flags.c_contiguous
        np.testing.assert_allclose(maps, expected, rtol=0.0, atol=4e-15)


def test_rows_are_read_from_their_places():
    """In the vector of a filter, in which the sensor errors follow other states in any order."""
    rng = np.random.default_rng(1)
    vector, places = 0.3 * rng.standard_normal((26, 4)), np.array([20, 9, 23, 15, 12, -1, -1, -1])
    errors = {name: vector[place : place + 3] for name, place in zip(SENSOR_STATES, places[:5], strict=True)}
    for maps, expected in zip(sensor_correction_maps(vector, places), readable_maps(errors, 4), strict=True):
        np.testing.assert_allclose(maps, expected, rtol=0.0, atol=4e-15)
