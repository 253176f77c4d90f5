"""Results: their contents, that reading returns what was written, and that a failure leaves no file."""

import io
import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
import xarray as xr
from rich.console import Console

import edl_filter
from edl_filter import results
from edl_filter.errors import InputError
from edl_filter.report.sentences import landing_sentence, recovery_sentence, warnings
from edl_filter.report.terminal.run import constraints_table, information_table
from edl_filter.report.text import constraint_verdict
from edl_filter.results import Result, files, netcdf
from edl_filter.results.files import finite
from edl_filter.results.schema import Summary
from edl_filter.results.schema.summary import ConstraintSummary, Landing, RecoverySummary
from edl_filter.results.summary import constraint
from edl_filter.workflow.run import write_outputs


@pytest.fixture(scope="module")
def tree(practice_06):
    return Result(practice_06).to_xarray()


@pytest.fixture(scope="module")
def written(practice_06, tmp_path_factory):
    return write_outputs(Result(practice_06), tmp_path_factory.mktemp("run"), figures=False)


def same(a, b, attributes=True):
    assert {n.path for n in a.subtree} >= {n.path for n in b.subtree}
    for node in b.subtree:
        x, y = a[node.path].to_dataset(), node.to_dataset()
        assert set(x.variables) == set(y.variables), node.path
        for name in x.variables:
            assert x[name].dims == y[name].dims, (node.path, name)
            assert x[name].equals(y[name]), (node.path, name)
            if attributes:
                assert {k: np.ravel(v).tolist() for k, v in x[name].attrs.items()} == {
                    k: np.ravel(v).tolist() for k, v in y[name].attrs.items()
                }


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


def test_the_file_comes_back_whole(written, tree):
    same(results.read(written["result"]), tree)
    same(edl_filter.read_result(written["result"].parent), tree)


def test_other_libraries_read_it_alike(written, tree):
    with xr.open_datatree(written["result"], engine="h5netcdf", decode_timedelta=False) as opened:
        same(opened.load(), tree)
    with h5py.File(written["result"]) as file:
        assert file["trajectory/position"].dims[0].keys() == ["time"]
        assert file["trajectory/utc"].dtype == np.int64
        assert file.attrs["format"] == "edl-result"


def test_a_changed_tree_can_be_written_too(tree, tmp_path):
    path = results.write(tree, tmp_path / "again.nc")
    same(results.read(path), tree, attributes=False)


def test_nothing_is_left_of_a_failure(practice_06, tmp_path, monkeypatch):
    def broken(*_):
        raise RuntimeError("disk")

    monkeypatch.setattr("edl_filter.results.hdf5._write_group", broken)
    with pytest.raises(RuntimeError, match="disk"):
        results.write(Result(practice_06).groups, tmp_path / "result.nc")
    assert list(tmp_path.iterdir()) == []


def test_a_failure_keeps_the_old_file(tmp_path):
    path = tmp_path / "summary.json"
    path.write_text("old")
    with pytest.raises(TypeError):
        files.write_json({"a": object()}, path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_cannot_be_created(practice_06, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        results.write(Result(practice_06).groups, tmp_path / "file" / "result.nc")


def test_what_is_no_result(tmp_path, builtin_flight, written):
    with pytest.raises(InputError, match="no such result"):
        results.read(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("text")
    with pytest.raises(InputError, match="no HDF5 file"):
        results.read(tmp_path / "text.nc")
    with pytest.raises(InputError, match="format is 'edl-flight'"):
        results.read(builtin_flight)
    old = tmp_path / "old.nc"
    old.write_bytes(written["result"].read_bytes())
    with h5py.File(old, "a") as file:
        file.attrs["format_version"] = 99
    with pytest.raises(InputError, match="version 99"):
        results.read(old)
    with h5py.File(old, "a") as file:
        file.attrs["format_version"] = netcdf.FORMAT_VERSION
        del file["trajectory"]
    with pytest.raises(InputError, match=r"old\.nc: the group /trajectory is missing"):
        results.read(old)


def test_summary(written, practice_06):
    summary = json.loads(written["summary"].read_text(), parse_constant=lambda c: pytest.fail(f"{c} in JSON"))
    assert set(summary["events"]) >= {"parachute_deploy", "peak_deceleration", "landing", "entry_interface"}
    assert {"time_s", "altitude_m", "velocity_m_s", "mach", "dynamic_pressure_pa"} <= set(
        summary["events"]["parachute_deploy"]
    )
    assert (summary["gas"]["name"], summary["gas"]["constant"]) == ("thesis", 188.92)
    assert summary["gas"]["heat_capacity_ratio_200_k"] == 1.3
    landing = summary["landing"]
    assert landing["miss_m"] < 3.0 * landing["sigma_m"]
    assert landing["left_out"]["miss_m"] < 3.0 * landing["left_out"]["sigma_m"]
    for statement in practice_06.constraint_checks:
        c = summary["constraints"][statement.name]
        assert c["nis"] == pytest.approx(float(statement.nis.sum()))
        assert len(c["innovation"]) == len(c["components"])
    assert summary["residuals"] == {}  # the run has no effects, so that only a diagnosis compares it with its model
    innovation_rms = summary["innovation_rms"]
    assert innovation_rms.keys() == summary["constraints"].keys()
    for name, by_component in innovation_rms.items():
        assert tuple(by_component) == tuple(summary["constraints"][name]["components"])
        assert all(0.0 <= rms < 5.0 for rms in by_component.values())
    assert {"telemetry", "filter", "smoother", "write"} <= set(summary["timing_s"])


def test_landing_and_events_are_stated_in_local_axes(written, practice_06):
    content = written["content"]
    for place in (content["landing"], content["landing"]["left_out"]):
        assert place["miss_m"] == pytest.approx(np.hypot(place["miss_east_m"], place["miss_north_m"]))
        assert place["sigma_m"] == pytest.approx(np.hypot(place["sigma_east_m"], place["sigma_north_m"]))
        assert place["sigma_up_m"] > 0.0
    statement = next(s for s in practice_06.constraint_checks if s.name == "landing")
    out = content["landing"]["left_out"]
    length = np.linalg.norm([out[f"miss_{a}_m"] for a in ("east", "north", "up")])
    assert length == pytest.approx(np.linalg.norm(statement.left_out))
    landed, deployed = content["events"]["landing"], content["events"]["parachute_deploy"]
    assert np.hypot(landed["east_m"], landed["north_m"]) < 200.0
    assert deployed["up_m"] == pytest.approx(deployed["height_above_site_m"], abs=10.0)
    speed = np.linalg.norm([deployed[f"velocity_{a}_m_s"] for a in ("east", "north", "up")])
    assert speed == pytest.approx(deployed["velocity_m_s"], abs=0.1)


def test_what_compares_nothing_has_no_verdict(practice_06):
    row = constraint(replace(practice_06.constraint_checks[0], dof=0))
    assert row["nis_interval_99_9"] is None and row["consistent"] is None
    assert (row["accepted"], row["accepted_uses"], row["uses"]) == (True, 1, 1)
    model = ConstraintSummary.of(row)
    assert constraint_verdict(model) == ("– not judged", "muted")
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(constraints_table({"entry_state": model}))
    assert "nan" not in console.export_text()


def test_a_trustworthy_result_says_what_was_left_out(written):
    summary = Summary.of(written["content"])
    assert summary.trustworthy and summary.headline is None and summary.recovery is None and not summary.causes
    assert warnings(summary) == []

    def with_uses(name, accepted):
        changed = summary.constraints[name].model_copy(update={"accepted_uses": accepted, "accepted": False})
        return summary.model_copy(update={"constraints": summary.constraints | {name: changed}})

    assert warnings(with_uses("altimeter", 251)) == []  # 10 of 261
    (sentence,) = warnings(with_uses("altimeter", 223))
    assert sentence == "Altimeter: 38 of 261 uses contradict all other data and were left out."
    (sentence,) = warnings(with_uses("parachute", 0))
    assert sentence.startswith("Parachute: 1 of 1 uses")


def test_an_untrustworthy_result_has_one_headline(written):
    headline = "Do not trust this result: landing contradicts all other data."
    summary = Summary.of(written["content"] | {"trustworthy": False, "headline": headline})
    rejected = {
        name: c.model_copy(update={"accepted_uses": 0, "accepted": False}) for name, c in summary.constraints.items()
    }
    assert warnings(summary.model_copy(update={"constraints": rejected})) == [headline]


@pytest.mark.parametrize(
    ("cause", "text"),
    [
        ("gap", "the samples that stand for lost ones between 100 and 101 s"),
        ("entry_state", "7 times the stated sigmas of the entry state"),
        ("process_noise", "noise of all samples before that"),
        (None, "and no additional noise explains it"),
    ],
)
def test_a_recovery_says_when_why_and_by_how_much(cause, text):
    recovery = RecoverySummary(
        time_s=344.25, constraints=("landing", "rest_velocity"), readings=2, nis=115.0, free_nis=0.0, directions=6,
        cause=cause, size=7.0, force_noise_m_s2=6.2, rate_noise_rad_s=0.037, start_s=100.0, end_s=101.0, gain_nats=50.0,
    )  # fmt: skip
    sentence = recovery_sentence(recovery)
    assert sentence.startswith("At 344.2 s landing and rest velocity contradicted the state of the filter")
    assert text in sentence


def test_latitude_has_its_hemisphere():
    landing = Landing(time_s=1.0, lat_deg=-14.569, lon_deg=175.47, radius_m=3.39e6, miss_m=5.0, sigma_m=40.0)
    assert landing_sentence(landing).startswith("Landing: 14.5690 S 175.4700 E, 5 ± 40 m from the site.")


def test_old_figures_do_not_stay_beside_a_new_result(practice_06, tmp_path):
    figures = tmp_path / "figures"
    figures.mkdir()
    for name in ("leave_one_out.png", "mine.png"):
        (figures / name).touch()
    write_outputs(Result(practice_06), tmp_path, figures=False)
    assert {p.name for p in figures.iterdir()} == {"mine.png"}
    (figures / "mine.png").rename(figures / "leave_one_out.png")
    write_outputs(Result(practice_06), tmp_path, figures=False)
    assert {p.name for p in tmp_path.iterdir()} == {
        "result.nc",
        "summary.json",
        "report.html",
        "plotly.min.js",
        "tables",
    }


def test_a_failed_writing_leaves_the_earlier_run(practice_06, tmp_path, monkeypatch):
    (tmp_path / "figures").mkdir()
    old = [tmp_path / name for name in ("result.nc", "summary.json", "figures/leave_one_out.png")]
    for path in old:
        path.write_text("old")

    def broken(*_):
        raise RuntimeError("no tables")

    monkeypatch.setattr("edl_filter.results.postflight.tables", broken)
    with pytest.raises(RuntimeError, match="no tables"):
        write_outputs(Result(practice_06), tmp_path, figures=True)
    assert {p for p in tmp_path.rglob("*") if p.is_file()} == set(old)
    assert {p.read_text() for p in old} == {"old"}


def test_the_result_is_complete_before_the_figures(practice_06, tmp_path, monkeypatch):
    complete = []

    def broken(self):
        complete.extend(sorted(p.name for p in tmp_path.iterdir()))
        raise RuntimeError("no font")

    monkeypatch.setattr("edl_filter.report.figure_process.FigureProcess.wait", broken)
    with pytest.raises(RuntimeError, match="no font"):
        write_outputs(Result(practice_06), tmp_path, figures=True)
    assert {"plotly.min.js", "report.html", "result.nc", "summary.json", "tables"} <= set(complete)
    assert results.read(tmp_path).attrs["mission"] == "practice_mer"


def test_what_is_not_finite_becomes_null():
    plain_data = finite(
        {
            "a": [np.inf, 1.0, float("nan")],
            "b": np.array([1.0, -np.inf]),
            "c": None,
            "d": True,
            "e": np.longdouble(2.0),
            "f": np.int64(3),
        }
    )
    assert plain_data == {"a": [None, 1.0, None], "b": [1.0, None], "c": None, "d": True, "e": 2.0, "f": 3}


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


def test_public_names_do_not_depend_on_the_order_of_imports():
    import edl_filter.results.result

    assert edl_filter.reconstruct is edl_filter.results.result.reconstruct
    assert edl_filter.InputError is InputError
    assert set(edl_filter.__all__) <= set(dir(edl_filter))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = edl_filter.nothing


def test_information_gains_are_in_the_summary_and_the_terminal(written, practice_06):
    checks = {s.name: s for s in practice_06.constraint_checks}
    rows = written["content"]["constraints"]
    for name, s in checks.items():
        assert rows[name]["left_out_information_nats"] == pytest.approx(s.left_out_information)
    assert np.isnan(rows["entry_state"]["information_nats"])  # the filter starts with it
    assert rows["altimeter"]["information_nats"] == pytest.approx(checks["altimeter"].information.sum())
    # 261 heights repeat each other and the landing: beyond the others they gain less than in order
    assert 0.0 < rows["altimeter"]["left_out_information_nats"] < rows["altimeter"]["information_nats"]
    assert rows["parachute"]["left_out_information_nats"] < 0.01
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(information_table({n: ConstraintSummary.of(finite(row)) for n, row in rows.items()}))
    text = console.export_text()
    landing = rows["landing"]["left_out_information_nats"]
    assert f"{landing:.2f}" in text and "–" in text and "nan" not in text
