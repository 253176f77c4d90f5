"""Each correction of MER's telemetry on constructed arrays."""

import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.telemetry import mer_cleaning


def test_fullest_row_of_each_time_is_selected():
    time = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0])
    values = np.array([[1, 1], [0, 5], [5, 5], [7, 7], [7, -512], [8, 8], [8, 8]], float)
    np.testing.assert_array_equal(np.flatnonzero(mer_cleaning.select_fullest_rows(time, values)), [0, 2, 3, 5])


def test_blank_and_clipped_rows_are_detected_and_valid_ones_are_not():
    q = np.array([[0, 0, 0, 1], [0.287109, 0, 0, 0.957898], [0.6, 0.0, 0.0, 0.8], [0.6, 0.0, 0.48, 0.64]])
    assert mer_cleaning.blank_quaternions(q).tolist() == [True, True, True, False]
    assert mer_cleaning.blank_vectors(np.array([[0, 0, 0], [0, -0.03, -0.03]])).tolist() == [True, False]
    register = np.array([[31.2, -67.3, -512.0], [31.2, -67.3, -511.9]])
    assert mer_cleaning.clipped_register(register).tolist() == [True, False]


def test_only_a_long_run_at_the_end_is_a_switch_off():
    rover = np.arange(120.0).reshape(20, 6)
    backshell = rover + 1.0
    backshell[[2, 3]] = rover[[2, 3]]
    backshell[11:] = rover[11:]
    assert np.flatnonzero(mer_cleaning.backshell_copies(rover, backshell)).tolist() == list(range(11, 20))
    backshell[11:14] += 1.0  # the run of equal rows is only six long now: a coincidence
    assert not mer_cleaning.backshell_copies(rover, backshell).any()


def test_removing_resets_leaves_no_jump_and_a_missing_increment():
    time = 0.25 * np.arange(40)
    steps = np.tile([1.0, -6.0, 0.5], (40, 1))
    true = np.cumsum(steps, axis=0)
    register = true.copy()
    register[15:] -= true[14]  # restarts just after row 14, and again after row 29
    register[30:] -= true[29] - true[14]
    register[4] = np.nan
    resets = mer_cleaning.find_resets(time, register)
    assert resets.tolist() == [15, 30]
    velocity = mer_cleaning.remove_resets(register, resets)
    valid = np.arange(40) != 4
    np.testing.assert_allclose(velocity[valid], true[valid], atol=1e-12)


def test_small_register_before_entry_and_impact_are_no_resets():
    register = np.array([[0.3, 0, 0], [0.001, 0, 0], [300.0, 0, 0], [288.0, 0, 0]])
    assert mer_cleaning.find_resets(0.25 * np.arange(4), register).size == 0


def test_archive_quaternions_follow_shusters_convention():
    rng = np.random.default_rng(3)
    archive = rotations.normalise(rng.standard_normal(4))
    u, w = archive[:3], archive[3]
    shuster = (w**2 - u @ u) * np.eye(3) + 2.0 * np.outer(u, u) - 2.0 * w * rotations.cross_matrix(u)
    v_j2000 = rng.standard_normal(3)
    v_sc = shuster @ v_j2000
    np.testing.assert_allclose(rotations.rotate(mer_cleaning.j2000_from_sc(archive), v_sc), v_j2000, atol=1e-14)


@pytest.mark.parametrize("w", [1.0, 0.3, 0.03, 0.004, 0.001])
def test_rounding_sigma_is_the_rms_error_of_rounded_quaternions(w):
    rng = np.random.default_rng(11)
    u = rng.standard_normal((20000, 3))
    # The fourth element is varied slightly, so that the rounding errors of the others are random
    fourth = w * (1.0 - 0.01 * rng.random(20000))
    u *= np.sqrt(1.0 - fourth**2)[:, None] / np.linalg.norm(u, axis=1, keepdims=True)
    true = np.column_stack((u, fourth))
    rounded = np.round(u, 6)
    rounded = np.column_stack((rounded, np.sqrt(np.maximum(0.0, 1.0 - np.sum(rounded**2, axis=1)))))
    error = rotations.rotation_vector_between(true, rotations.normalise(rounded))
    rms = np.sqrt(np.mean(error**2))
    sigma = np.sqrt(np.mean(mer_cleaning.rounding_sigma(rounded) ** 2))
    assert sigma == pytest.approx(rms, rel=0.05 if w > 0.002 else 0.4)
