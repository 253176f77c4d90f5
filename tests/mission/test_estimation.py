"""Initial state: covariances from sigmas, and stated covariances."""

import json
import math

import numpy as np
import pytest
from shipped_missions import error_of, load, mission_data

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.mission import Mission


def test_attitude_error_is_larger_about_the_sun_line():
    m = load("mer_a")
    attitude = rotations.from_rotation_vector([0.3, -1.1, 0.7])
    p = m.initial_state.covariance_matrix(attitude, m.planet.j2000_from_inertial_matrix)
    assert np.array_equal(p[:6, :6], np.diag([1e6] * 3 + [1.0] * 3))
    inertial = m.planet.j2000_from_inertial_matrix.T @ m.initial_state.sun_direction
    sun = rotations.rotate(rotations.conjugate(attitude), inertial)
    across = np.cross(sun, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(sun, [1.0, 0.0, 0.0]))
    assert math.sqrt(sun @ p[6:, 6:] @ sun) == pytest.approx(math.radians(0.5))
    assert math.sqrt(across @ p[6:, 6:] @ across) == pytest.approx(math.radians(0.1))


def test_a_stated_covariance_replaces_the_sigmas():
    p = np.diag([1e6] * 3 + [1.0] * 3 + [1e-6] * 3)
    stated = mission_data()
    state = stated["initial_state"]
    for key in ("position_sigma", "velocity_sigma", "attitude_sigma_deg"):
        del state[key]
    mission = Mission.from_dict(stated | {"initial_state": state | {"covariance": p}})
    assert np.array_equal(mission.initial_state.covariance_matrix([0, 0, 0, 1]), p)
    p[0, 1] = p[1, 0] = 2e6
    for wrong, expected in (
        (p, "not positive definite"),
        (np.diag([0.0] + [1.0] * 8), "not positive definite"),
        (np.eye(9) + np.eye(9, k=1) / 2, "not symmetric"),
        (np.eye(6), "expected 9 rows of 9 numbers"),
    ):
        with pytest.raises(InputError, match=expected):
            Mission.from_dict(stated | {"initial_state": state | {"covariance": wrong}})
    assert "both this and covariance" in error_of("initial_state.covariance=" + json.dumps(np.eye(9).tolist()))
