import shutil

import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry import mer_cleaning
from edl_filter.telemetry.mer_archive import SAMPLE_INTERVAL, read_mer_tables


@pytest.fixture(scope="session")
def opportunity(mer_folder):
    return read_mer_tables(mer_folder, 1)


@pytest.fixture(scope="session")
def spirit(mer_folder):
    return read_mer_tables(mer_folder / "DATA", 2)


@pytest.fixture(params=["spirit", "opportunity"])
def tables(request):
    return request.getfixturevalue(request.param)


# M of facts section 2a: the rover's IMU axes in the spacecraft's, v_sc = M v_imu, nominal to 0.1 degrees
ROVER_MOUNTING = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


# --- each trap by itself ------------------------------------------------------------------------------------


def test_of_twins_the_fuller_stays():
    time = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0])
    values = np.array([[1, 1], [0, 5], [5, 5], [7, 7], [7, -512], [8, 8], [8, 8]], float)
    np.testing.assert_array_equal(np.flatnonzero(mer_cleaning.fuller_rows(time, values)), [0, 2, 3, 5])


def test_blank_and_clipped_rows_are_seen_and_sound_ones_are_not():
    q = np.array([[0, 0, 0, 1], [0.287109, 0, 0, 0.957898], [0.6, 0.0, 0.0, 0.8], [0.6, 0.0, 0.48, 0.64]])
    assert mer_cleaning.blank_quaternions(q).tolist() == [True, True, True, False]
    assert mer_cleaning.blank_vectors(np.array([[0, 0, 0], [0, -0.03, -0.03]])).tolist() == [True, False]
    register = np.array([[31.2, -67.3, -512.0], [31.2, -67.3, -511.9]])
    assert mer_cleaning.clipped_register(register).tolist() == [True, False]


def test_only_the_last_long_run_is_a_switch_off():
    rover = np.arange(120.0).reshape(20, 6)
    back = rover + 1.0
    back[[2, 3]] = rover[[2, 3]]
    back[11:] = rover[11:]
    assert np.flatnonzero(mer_cleaning.backshell_copies(rover, back)).tolist() == list(range(11, 20))
    back[11:14] += 1.0  # now the equal run is six rows only: chance
    assert not mer_cleaning.backshell_copies(rover, back).any()


def test_resets_leave_no_jump_and_lose_their_increment():
    time = 0.25 * np.arange(40)
    steps = np.tile([1.0, -6.0, 0.5], (40, 1))
    true = np.cumsum(steps, axis=0)
    register = true.copy()
    register[15:] -= true[14]  # restarts just after row 14, and again after row 29
    register[30:] -= true[29] - true[14]
    register[4] = np.nan
    resets = mer_cleaning.find_resets(time, register)
    assert resets.tolist() == [15, 30]
    velocity, increment = mer_cleaning.without_resets(register, resets)
    keep = np.arange(40) != 4
    np.testing.assert_allclose(velocity[keep], true[keep], atol=1e-12)
    assert np.flatnonzero(np.isnan(increment[:, 0])).tolist() == [0, 4, 5, 15, 30]
    np.testing.assert_allclose(increment[[1, 14, 16]], steps[:3], atol=1e-12)


def test_a_small_register_before_entry_and_an_impact_are_no_resets():
    register = np.array([[0.3, 0, 0], [0.001, 0, 0], [300.0, 0, 0], [288.0, 0, 0]])
    assert mer_cleaning.find_resets(0.25 * np.arange(4), register).size == 0


def test_quaternions_are_shusters_from_j2000_to_spacecraft():
    rng = np.random.default_rng(3)
    archive = rotations.normalise(rng.standard_normal(4))
    u, w = archive[:3], archive[3]
    shuster = (w**2 - u @ u) * np.eye(3) + 2.0 * np.outer(u, u) - 2.0 * w * rotations.cross_matrix(u)
    v_j2000 = rng.standard_normal(3)
    v_sc = shuster @ v_j2000
    np.testing.assert_allclose(rotations.rotate(mer_cleaning.j2000_from_sc(archive), v_sc), v_j2000, atol=1e-14)


@pytest.mark.parametrize("w", [1.0, 0.3, 0.03, 0.004, 0.001])
def test_rounding_sigma_is_the_spread_of_rounded_quaternions(w):
    rng = np.random.default_rng(11)
    u = rng.standard_normal((20000, 3))
    # scatter the fourth element a little, so that the rounding of the others is random
    fourth = w * (1.0 - 0.01 * rng.random(20000))
    u *= np.sqrt(1.0 - fourth**2)[:, None] / np.linalg.norm(u, axis=1, keepdims=True)
    true = np.column_stack((u, fourth))
    seen = np.round(u, 6)
    seen = np.column_stack((seen, np.sqrt(np.maximum(0.0, 1.0 - np.sum(seen**2, axis=1)))))
    error = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(true), rotations.normalise(seen)))
    rms = np.sqrt(np.mean(error**2))
    sigma = np.sqrt(np.mean(mer_cleaning.rounding_sigma(seen) ** 2))
    assert sigma == pytest.approx(rms, rel=0.05 if w > 0.002 else 0.4)


# --- the real files -----------------------------------------------------------------------------------------


def test_spirit_as_the_facts_say(spirit):
    assert spirit.name == "MER-A Spirit"
    assert len(spirit.transformed.sclk) == 9176 - 44
    assert len(spirit.highrate.sclk) == 2495
    assert spirit.resets == (126462358.625, 126462363.625)
    assert spirit.transformed_gaps == ((126462354.5, 0.625), (126462499.75, 1.75), (126462516.25, 1.5))
    assert spirit.highrate_gaps == ((126462354.375, 0.875),)
    assert spirit.notes[0] == ("2TRANSFORMED.TAB: 44 rows with the time of another removed, the fuller row kept.")


def test_opportunity_as_the_facts_say(opportunity):
    assert opportunity.name == "MER-B Opportunity"
    assert len(opportunity.transformed.sclk) == 9050 - 1647
    assert len(opportunity.highrate.sclk) == 2476
    assert opportunity.resets == (128278467.125, 128278472.125)
    assert opportunity.transformed_gaps == (
        (128278462.625, 0.75),
        (128278593.875, 15.75),
        (128278624.375, 1.25),
    )
    assert opportunity.highrate_gaps == ((128278462.75, 0.75),)


def test_nothing_is_blank_after_cleaning(tables):
    t, h = tables.transformed, tables.highrate
    assert np.all(np.diff(t.sclk) > 0.0)
    for q in (t.rover_j2000_from_sc, t.backshell_j2000_from_sc):
        assert not mer_cleaning.blank_quaternions(q).any()
    for v in (t.register, t.backshell_acceleration):
        assert not mer_cleaning.blank_vectors(v).any()
    assert not mer_cleaning.clipped_register(t.register).any()
    assert np.isfinite(t.rover_j2000_from_sc).all()
    # the backshell is there before its switch-off and nowhere after it
    off = {1: 128278533.5, 2: 126462427.0}[tables.spacecraft]
    for sclk, values in (
        (t.sclk, t.backshell_j2000_from_sc),
        (t.sclk, t.backshell_acceleration),
        (t.sclk, t.backshell_sigma[:, None]),
        (h.sclk, h.backshell_angle_increment),
        (h.sclk, h.backshell_velocity_increment),
    ):
        np.testing.assert_array_equal(np.isfinite(values).all(axis=1), sclk < off)


def test_twins_that_differ_leave_their_fuller_row(opportunity):
    # 11 rows of Opportunity have a partly blank or clipped twin; without care these values are 0 or -512
    t = opportunity.transformed
    assert t.register[np.searchsorted(t.sclk, 128278640.0) :, 2].max() < -600.0
    step = np.linalg.norm(t.velocity_increment[1:], axis=1) / np.diff(t.sclk)
    assert np.nanmax(step) < 80.0  # m/s²: peak deceleration is 61.5


def test_velocity_is_continuous_and_the_resets_are_nan(tables):
    t = tables.transformed
    at = np.isin(t.sclk, tables.resets)
    np.testing.assert_array_equal(np.isnan(t.velocity_increment).any(axis=1), at | (t.sclk == t.sclk[0]))
    step = np.linalg.norm(np.diff(t.velocity, axis=0), axis=1) / np.diff(t.sclk)
    assert step.max() < 80.0
    before = t.sclk < tables.resets[0]
    np.testing.assert_array_equal(t.velocity[before], t.register[before])


def test_highrate_rates_are_increments_of_angle(tables):
    t, h = tables.transformed, tables.highrate
    entry = slice(0, 700)  # the 87 s from entry interface + 90 s: spin, no parachute yet or just
    per_second = np.linalg.norm(h.rover_angle_increment[entry], axis=1) / SAMPLE_INTERVAL
    rows = np.flatnonzero((t.sclk >= h.sclk[0]) & (t.sclk <= h.sclk[699]) & (t.rover_j2000_from_sc[:, 3] > 0.1))
    q = t.rover_j2000_from_sc
    turn = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(q[rows[:-1]]), q[rows[1:]]))
    next_to = np.diff(rows) == 1
    rate = np.linalg.norm(turn, axis=1)[next_to] / np.diff(t.sclk[rows])[next_to]
    # same mean rate within a tenth; read as rad/s the column would be eight times too small
    assert np.median(rate) == pytest.approx(np.median(per_second), rel=0.1)


def test_attitude_turns_with_the_gyros_in_direction_too(tables):
    t, h = tables.transformed, tables.highrate
    q, errors = t.rover_j2000_from_sc, []
    for i in np.flatnonzero((t.sclk > h.sclk[0]) & (t.sclk < h.sclk[500]))[:-1]:
        between = (h.sclk > t.sclk[i]) & (h.sclk <= t.sclk[i + 1])
        if min(q[i, 3], q[i + 1, 3]) > 0.1:
            turn = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(q[i]), q[i + 1]))
            errors.append(turn - ROVER_MOUNTING @ h.rover_angle_increment[between].sum(axis=0))
    # the mounting is off its nominal by 0.1 degrees of 0.05 rad; a conjugate would be wrong by 0.1 rad
    assert len(errors) > 100
    assert np.max(np.abs(errors)) < 5e-4


def test_drag_is_along_the_symmetry_axis_and_against_the_flight(tables):
    t = tables.transformed
    before_parachute = t.sclk < tables.highrate.sclk[0] + 60.0
    peak = np.nanargmin(t.backshell_acceleration[before_parachute, 2])
    force = t.backshell_acceleration[peak]
    assert -65.0 < force[2] < -55.0
    assert np.linalg.norm(force[:2]) < 0.05 * abs(force[2])
    # the same force from the rover's register, turned to J2000 by the fitted axes of the facts (0.6)
    rows = {
        2: [[0.4308, -0.5810, 0.6905], [0.8936, 0.1679, -0.4163], [0.1260, 0.7964, 0.5915]],
        1: [[0.4367, -0.4897, 0.7546], [0.8885, 0.1031, -0.4472], [0.1412, 0.8658, 0.4801]],
    }[tables.spacecraft]
    rover = np.array(rows).T @ (t.velocity[peak + 2] - t.velocity[peak - 2])
    backshell = rotations.rotate(t.backshell_j2000_from_sc[peak], force)
    cosine = rover @ backshell / np.linalg.norm(rover) / np.linalg.norm(backshell)
    assert cosine > np.cos(np.radians(1.5))


# --- bad input ----------------------------------------------------------------------------------------------


def test_other_spacecraft_and_empty_folder(tmp_path):
    with pytest.raises(InputError, match=r"spacecraft is 3; 1 \(MER-B Opportunity\) and 2"):
        read_mer_tables(tmp_path, 3)
    with pytest.raises(InputError, match=r"neither DATA/2TRANSFORMED.LBL nor 2TRANSFORMED.LBL is there"):
        read_mer_tables(tmp_path, 2)


def test_a_table_of_the_other_rover_is_refused(mer_folder, tmp_path):
    shutil.copytree(mer_folder / "DATA", tmp_path / "DATA")
    label = (tmp_path / "DATA" / "1HIGHRATE.LBL").read_bytes()
    (tmp_path / "DATA" / "2HIGHRATE.LBL").write_bytes(label)
    with pytest.raises(InputError, match=r"HOST_NAME is 'MARS EXPLORATION ROVER 1'; 'MARS EXPLORATION ROVER 2'"):
        read_mer_tables(tmp_path, 2)


def test_time_going_backwards_is_refused(mer_folder, tmp_path):
    shutil.copytree(mer_folder / "DATA", tmp_path / "DATA")
    path = tmp_path / "DATA" / "2HIGHRATE.TAB"
    rows = path.read_bytes().splitlines(keepends=True)
    rows[10], rows[11] = rows[11], rows[10]
    path.write_bytes(b"".join(rows))
    with pytest.raises(InputError, match=r"2HIGHRATE.TAB, row 12: time goes backwards by 0.125 s"):
        read_mer_tables(tmp_path, 2)
