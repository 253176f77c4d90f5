"""Contents of `result.nc`."""

import json

import numpy as np
import pytest
from trees import same

from edl_filter import results
from edl_filter.results import Result, netcdf
from edl_filter.workflow.run import write_outputs


def test_every_variable_says_what_it_is(tree):
    for node in tree.subtree:
        for name, variable in node.to_dataset().variables.items():
            assert variable.attrs.get("long_name"), (node.path, name)
            text = variable.dtype.kind in "OUMT"
            assert text or variable.attrs.get("units"), (node.path, name)


def test_groups_and_shapes(tree, practice_06):
    n = len(practice_06.trajectory.time)
    assert tree["trajectory/covariance"].shape == (n, 9, 9)
    assert tree["trajectory/position"].dims == ("time", "axis")
    assert {"driving", "secondary"} == set(tree["imu"].children)
    assert "attitude" not in tree
    assert tree["sensor_errors/primary/accelerometer_bias"].shape == (3,)
    assert tree.attrs["format"] == "edl-result"
    assert tree.attrs["mission_yaml"] == practice_06.mission.text
    assert set(json.loads(tree.attrs["versions"])) >= {"numpy", "numba", "filterpy"}
    assert json.loads(tree.attrs["input_sha256"]) == practice_06.telemetry.files
    assert list(practice_06.telemetry.files) == ["practice_06.h5"]
    names = tree["imu/driving/source"].attrs["flag_meanings"].split()
    assert names == ["flight_file"]


def test_corrected_samples_are_those_of_the_trajectory(tree, practice_06):
    driving = tree["imu/driving"].dataset
    inside = np.isfinite(driving["specific_force"].values[:, 0])
    t = practice_06.trajectory
    times, forces = driving["time"].values[inside], driving["specific_force"].values[inside]
    for time, force in zip(times[::97], forces[::97], strict=True):
        k = int(np.argmin(np.abs(t.time - time)))
        np.testing.assert_array_equal(force, t.specific_force[k])
    assert inside.sum() >= len(driving["time"]) - 1


def test_utc_is_time_since_the_epoch(tree):
    data = tree["trajectory"].dataset
    epoch = np.datetime64(tree.attrs["epoch_utc"], "us")
    seconds = (data["utc"].values - epoch) / np.timedelta64(1, "us") * 1e-6
    np.testing.assert_allclose(seconds, data["time"].values, atol=1e-6)


def test_spirit(spirit, tmp_path):
    written = write_outputs(Result(spirit), tmp_path, figures=False)
    tree = results.read(tmp_path)
    assert sorted(spirit.telemetry.files) == [
        f"DATA/2{name}" for name in ("HIGHRATE.LBL", "HIGHRATE.TAB", "TRANSFORMED.LBL", "TRANSFORMED.TAB")
    ]
    assert set(tree["sensor_errors"].children) == {"backshell", "rover", "register"}
    assert tree["trajectory/sclk"].values[0] == pytest.approx(126462085.4)
    assert tree["attitude/inertial_from_body"].shape[1] == 4
    entry = written["content"]["entry_state"]
    assert entry["rotation_deg"] == pytest.approx(0.26, abs=0.1)
    assert np.linalg.norm(entry["rotation_j2000_deg"]) == pytest.approx(entry["rotation_deg"])
    out = written["content"]["landing"]["left_out"]
    assert out["miss_m"] < 3.0 * out["sigma_m"]
    same(tree, netcdf.tree_of(Result(spirit).groups))
    fit = spirit.comparison["rover"].all
    assert tree["comparison/rover/slope"].sel(window="all").values == pytest.approx(fit.slope)
    assert written["content"]["imu_comparison"]["rover"]["all"]["samples"] == fit.samples
    windows = written["content"]["imu_comparison"]["rover"]["windows"]
    assert [w["end_s"] for w in windows] == [w.end for w in spirit.comparison["rover"].windows]
