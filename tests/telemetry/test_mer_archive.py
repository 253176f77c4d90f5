"""The cleaned tables of both rovers, and errors in the files."""

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


# Nominal axes of the rover's IMU in the spacecraft's, v_sc = M v_imu (facts file, section 2a), valid to 0.1 degrees
ROVER_MOUNTING = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


# --- the real files -----------------------------------------------------------------------------------------


def notes_on(tables, word):
    """Notes that contain a word."""
    return [note for note in tables.notes if word in note]


def test_spirit_has_the_known_defects(spirit):
    assert spirit.name == "MER-A Spirit"
    assert len(spirit.transformed.sclk) == 9176 - 44
    assert len(spirit.highrate.sclk) == 2495
    assert notes_on(spirit, "reset") == [
        "2TRANSFORMED.TAB: the velocity register was reset 2 times (SCLK 126462358.625, 126462363.625); "
        "the jumps are removed."
    ]
    assert notes_on(spirit, "gap") == [
        "2TRANSFORMED.TAB: 3 gaps (0.625 s after SCLK 126462354.500, 1.75 s after SCLK 126462499.750, "
        "1.5 s after SCLK 126462516.250).",
        "2HIGHRATE.TAB: 1 gap (0.875 s after SCLK 126462354.375).",
    ]
    assert spirit.notes[0] == ("2TRANSFORMED.TAB: 44 rows with the time of another removed, the fuller row kept.")


def test_opportunity_has_the_known_defects(opportunity):
    assert opportunity.name == "MER-B Opportunity"
    assert len(opportunity.transformed.sclk) == 9050 - 1647
    assert len(opportunity.highrate.sclk) == 2476
    assert notes_on(opportunity, "reset") == [
        "1TRANSFORMED.TAB: the velocity register was reset 2 times (SCLK 128278467.125, 128278472.125); "
        "the jumps are removed."
    ]
    assert notes_on(opportunity, "gap") == [
        "1TRANSFORMED.TAB: 3 gaps (0.75 s after SCLK 128278462.625, 15.75 s after SCLK 128278593.875, "
        "1.25 s after SCLK 128278624.375).",
        "1HIGHRATE.TAB: 1 gap (0.75 s after SCLK 128278462.750).",
    ]


def test_cleaned_tables_have_no_blank_or_clipped_rows(tables):
    t, h = tables.transformed, tables.highrate
    assert np.all(np.diff(t.sclk) > 0.0)
    for q in (t.rover_j2000_from_sc, t.backshell_j2000_from_sc):
        assert not mer_cleaning.blank_quaternions(q).any()
    for v in (t.register, t.backshell_acceleration):
        assert not mer_cleaning.blank_vectors(v).any()
    assert not mer_cleaning.clipped_register(t.register).any()
    assert np.isfinite(t.rover_j2000_from_sc).all()
    # The backshell has values up to its switch-off and none after it
    off = {1: 128278533.5, 2: 126462427.0}[tables.spacecraft]
    for sclk, values in (
        (t.sclk, t.backshell_j2000_from_sc),
        (t.sclk, t.backshell_acceleration),
        (t.sclk, t.backshell_sigma[:, None]),
        (h.sclk, h.backshell_angle_increment),
        (h.sclk, h.backshell_velocity_increment),
    ):
        np.testing.assert_array_equal(np.isfinite(values).all(axis=1), sclk < off)


def test_fullest_row_is_selected_where_duplicates_differ(opportunity):
    # 11 rows of Opportunity have a partly blank or clipped duplicate, whose values are 0 or -512
    t = opportunity.transformed
    assert t.register[np.searchsorted(t.sclk, 128278640.0) :, 2].max() < -600.0
    step = np.linalg.norm(np.diff(t.velocity, axis=0), axis=1) / np.diff(t.sclk)
    assert np.max(step) < 80.0  # m/s²: peak deceleration is 61.5


def test_velocity_is_continuous_and_equals_the_register_before_its_resets(tables):
    t = tables.transformed
    step = np.linalg.norm(np.diff(t.velocity, axis=0), axis=1) / np.diff(t.sclk)
    assert step.max() < 80.0
    before = t.sclk < {1: 128278467.125, 2: 126462358.625}[tables.spacecraft]
    np.testing.assert_array_equal(t.velocity[before], t.register[before])


def test_highrate_rates_are_increments_of_angle(tables):
    t, h = tables.transformed, tables.highrate
    entry = slice(0, 700)  # the 87 s from entry interface + 90 s: spinning, before or just after parachute deployment
    per_second = np.linalg.norm(h.rover_angle_increment[entry], axis=1) / SAMPLE_INTERVAL
    rows = np.flatnonzero((t.sclk >= h.sclk[0]) & (t.sclk <= h.sclk[699]) & (t.rover_j2000_from_sc[:, 3] > 0.1))
    q = t.rover_j2000_from_sc
    rotation = rotations.rotation_vector_between(q[rows[:-1]], q[rows[1:]])
    adjacent = np.diff(rows) == 1
    rate = np.linalg.norm(rotation, axis=1)[adjacent] / np.diff(t.sclk[rows])[adjacent]
    # The mean rates agree within a tenth; in rad/s the values of the column would be eight times too small
    assert np.median(rate) == pytest.approx(np.median(per_second), rel=0.1)


def test_attitude_and_gyros_agree_in_direction(tables):
    t, h = tables.transformed, tables.highrate
    q, errors = t.rover_j2000_from_sc, []
    for i in np.flatnonzero((t.sclk > h.sclk[0]) & (t.sclk < h.sclk[500]))[:-1]:
        between = (h.sclk > t.sclk[i]) & (h.sclk <= t.sclk[i + 1])
        if min(q[i, 3], q[i + 1, 3]) > 0.1:
            rotation = rotations.rotation_vector_between(q[i], q[i + 1])
            errors.append(rotation - ROVER_MOUNTING @ h.rover_angle_increment[between].sum(axis=0))
    # The mounting is off nominal by 0.1 degrees, times rotations of 0.05 rad; a conjugate's error would be 0.1 rad
    assert len(errors) > 100
    assert np.max(np.abs(errors)) < 5e-4


def test_drag_is_along_the_symmetry_axis_and_agrees_with_the_register(tables):
    t = tables.transformed
    before_parachute = t.sclk < tables.highrate.sclk[0] + 60.0
    peak = np.nanargmin(t.backshell_acceleration[before_parachute, 2])
    force = t.backshell_acceleration[peak]
    assert -65.0 < force[2] < -55.0
    assert np.linalg.norm(force[:2]) < 0.05 * abs(force[2])
    # The same force from the rover's register, whose axes are north, east and down at the target
    matrix = {
        2: [[0.42591, -0.61917, 0.65972], [0.89466, 0.17953, -0.40909], [0.13485, 0.76446, 0.63041]],
        1: [[0.44227, -0.43742, 0.78298], [0.88882, 0.09695, -0.44789], [0.12001, 0.89402, 0.43166]],
    }[tables.spacecraft]
    rover = np.array(matrix).T @ (t.velocity[peak + 2] - t.velocity[peak - 2])
    backshell = rotations.rotate(t.backshell_j2000_from_sc[peak], force)
    cosine = rover @ backshell / np.linalg.norm(rover) / np.linalg.norm(backshell)
    assert cosine > np.cos(np.radians(0.6))


# --- bad input ----------------------------------------------------------------------------------------------


def test_unknown_spacecraft_and_empty_folder_raise(tmp_path):
    with pytest.raises(InputError, match=r"spacecraft is 3; 1 \(MER-B Opportunity\) and 2"):
        read_mer_tables(tmp_path, 3)
    with pytest.raises(InputError, match=r"neither DATA/2TRANSFORMED.LBL nor 2TRANSFORMED.LBL is there"):
        read_mer_tables(tmp_path, 2)


def test_table_of_the_other_rover_raises(mer_folder, tmp_path):
    shutil.copytree(mer_folder / "DATA", tmp_path / "DATA")
    label = (tmp_path / "DATA" / "1HIGHRATE.LBL").read_bytes()
    (tmp_path / "DATA" / "2HIGHRATE.LBL").write_bytes(label)
    with pytest.raises(InputError, match=r"HOST_NAME is 'MARS EXPLORATION ROVER 1'; 'MARS EXPLORATION ROVER 2'"):
        read_mer_tables(tmp_path, 2)


def test_decreasing_time_raises(mer_folder, tmp_path):
    shutil.copytree(mer_folder / "DATA", tmp_path / "DATA")
    path = tmp_path / "DATA" / "2HIGHRATE.TAB"
    rows = path.read_bytes().splitlines(keepends=True)
    rows[10], rows[11] = rows[11], rows[10]
    path.write_bytes(b"".join(rows))
    with pytest.raises(InputError, match=r"2HIGHRATE.TAB, row 12: time goes backwards by 0.125 s"):
        read_mer_tables(tmp_path, 2)
