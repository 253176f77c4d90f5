"""Compiled inverse of the IMU error model (`sensor_errors`), for the filters' sigma points.

Its slow readable twin is in tests/imu_model/test_compiled_corrections.py.
"""

import numpy as np
from numba import njit

from edl_filter.rotation_kernels import fill_matrix, quaternion

COMPILED = njit(cache=True, error_model="numpy", nogil=True)


@COMPILED
def sensor_correction_maps(errors, places):
    """The inverse of the error model as linear maps of the readings, one per column.

    Parameters
    ----------
    errors : (n, S) array
        S sets of errors, three rows for each error that there is: m/s², relative, rad, rad/s, relative.
    places : (5,) array of int
        First row of each error in the order of `sensor_errors.SENSOR_STATES`; -1: no such error. Further elements are
        not read.

    Returns
    -------
    force_map : (12, S) array
        ``f = A f_m + c``: A row by row (9), then c (3), m/s².
    rate_map : (6, S) array
        ``w = a ∘ w_m + c``: a (3), then c (3), rad/s.
    """
    count = errors.shape[1]
    force_map, rate_map, matrix = np.zeros((12, count)), np.zeros((6, count)), np.eye(3)
    bias, scale, misalignment, gyro_bias, gyro_scale = places[0], places[1], places[2], places[3], places[4]
    for s in range(count):
        if misalignment >= 0:
            m = errors[misalignment : misalignment + 3, s]
            fill_matrix(quaternion(m[0], m[1], m[2]), matrix)
        for j in range(3):
            factor = 1.0 / (1.0 + errors[scale + j, s]) if scale >= 0 else 1.0
            offset = errors[bias + j, s] if bias >= 0 else 0.0
            for i in range(3):
                entry = matrix[j, i] * factor
                force_map[3 * i + j, s] = entry
                force_map[9 + i, s] -= entry * offset
            factor = 1.0 / (1.0 + errors[gyro_scale + j, s]) if gyro_scale >= 0 else 1.0
            rate_map[j, s] = factor
            rate_map[3 + j, s] = -factor * errors[gyro_bias + j, s] if gyro_bias >= 0 else 0.0
    return force_map, rate_map
