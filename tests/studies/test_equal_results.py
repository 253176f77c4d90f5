"""The comparison of two results of one input."""

import json

import equal_results
import h5py
import numpy as np
import pytest


def write(folder, values, summary):
    folder.mkdir()
    with h5py.File(folder / "result.nc", "w") as file:
        file.create_group("trajectory").create_dataset("velocity", data=values)
        file["events/event"] = ["landing"]
    (folder / "summary.json").write_text(
        json.dumps({"timing_s": {"filter": np.random.default_rng().random()}} | summary)
    )
    return folder


def test_a_component_is_compared_with_its_own_largest_value(tmp_path):
    values = np.array([[1e6, 2.0], [1e3, -4.0], [0.0, np.nan]])
    changed = values + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    changed[0, 1] += 1e-6
    a, b = write(tmp_path / "a", values, {"nis": 2.0}), write(tmp_path / "b", changed, {"nis": 2.0})
    out = equal_results.compare(a, b)
    assert set(out) == {"result.nc", "summary.json"}
    assert out["result.nc"] == {"trajectory/velocity": pytest.approx(1e-6), "events/event": 0.0}
    assert out["summary.json"] == {"/nis": 0.0}  # without the computing times, which differ


@pytest.mark.parametrize(
    "changed", [np.zeros((2, 2)), np.array([[1.0, np.nan], [3.0, 4.0]]), np.array([[1.0, np.inf], [3.0, 4.0]])]
)
def test_another_shape_or_place_without_a_number_is_no_small_difference(tmp_path, changed):
    values = np.array([[1.0, 2.0], [3.0, 4.0]]) if changed.any() else np.zeros((3, 2))
    a, b = write(tmp_path / "a", values, {}), write(tmp_path / "b", changed, {})
    assert equal_results.compare(a, b)["result.nc"]["trajectory/velocity"] == np.inf


def test_the_exit_code_says_whether_the_difference_is_within_the_tolerance(tmp_path, monkeypatch, capsys):
    a = write(tmp_path / "a", np.ones((3, 2)), {"nis": 1.0, "verdict": "holds"})
    b = write(tmp_path / "b", np.ones((3, 2)), {"nis": 1.0 + 1e-7, "verdict": "holds"})
    c = write(tmp_path / "c", np.ones((3, 2)), {"nis": 1.0, "verdict": "fails"})
    for compared, tolerance, code, text in (
        (b, "1e-6", 0, "largest relative difference 1e-07"),
        (b, "1e-9", 1, "1e-07  /nis"),
        (c, "1", 1, "inf  /verdict"),
    ):
        monkeypatch.setattr("sys.argv", ["equal_results.py", str(a), str(compared), "--tolerance", tolerance])
        with pytest.raises(SystemExit) as stop:
            equal_results.main()
        assert int(stop.value.code) == code and text in capsys.readouterr().out
