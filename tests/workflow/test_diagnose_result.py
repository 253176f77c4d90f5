"""`edl-filter diagnose` on the shipped flight: it is clean; effects whose hooks fail and wrong input are reported."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.mission import Mission, shipped_mission
from edl_filter.results.files import read_diagnosis, read_summary
from edl_filter.results.hdf5 import read_groups
from edl_filter.results.reopen import reopen

BROKEN = """
import numpy as np
from edl_filter.effects import Effect, Parameter

class Raises(Effect):
    name = "raises"
    parameters = (Parameter("a", "N", "how much", 1.0, low=-9.0, high=9.0),)

    def force_moment(self, p, flow):
        return flow.no_such_thing, None

class Flat(Effect):
    name = "flat"
    parameters = (Parameter("a", "N", "how much", 1.0, low=-9.0, high=9.0),)

    def force_moment(self, p, flow):
        return np.zeros(3), np.zeros(3)

class Push(Effect):
    name = "push"
    parameters = (Parameter("a", "N", "how much", 1.0, low=-9.0, high=9.0),)

    def force_moment(self, p, flow):
        force = np.zeros((len(flow.time), 3))
        force[:, 1] = p["a"]
        return force, np.zeros_like(force)
"""


def call(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def assert_refused(result, *parts):
    """The command ends with an input error whose message has these parts."""
    assert result.exit_code == 2, result.output
    assert result.stdout == "" and "Traceback" not in result.stderr
    for part in parts:
        assert part in result.stderr


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Result of the shipped flight."""
    folder = tmp_path_factory.mktemp("clean")
    assert call("run", "builtin:practice_mer", "-o", folder / "result", "--no-figures").exit_code == 0
    (folder / "my_effects.py").write_text(BROKEN)
    return folder


@pytest.fixture
def copy(clean, tmp_path, monkeypatch):
    """A copy of it that may be changed, in the current folder."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(clean / "result", "result", ignore=shutil.ignore_patterns("diagnosis*"))
    return Path("result/result.nc")


def test_the_shipped_flight_is_clean_and_failing_effects_are_reported(clean):
    summary_before = (clean / "result" / "summary.json").read_bytes()
    comparison_before = json.loads(call("compare", clean / "result", clean / "result", "--json").stdout)
    result = call("diagnose", clean / "result", "--file", clean / "my_effects.py", "--effect", "raises",
                  "--effect", "flat", "--effect", "push", "--effect", "gyro_bias", "--effect", "com_offset",
                  "--json")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    printed = json.loads(result.stdout)
    assert printed["verdict"] == "clean" and printed["where"] == [] and printed["next"] == []
    message = "AttributeError: 'FlightCondition' object has no attribute 'no_such_thing' (my_effects.py, line 10)"
    assert message in printed["failed"]["raises"]
    assert "gave an array of shape (3,) for force; expected" in printed["failed"]["flat"]
    assert {"push", "gyro_bias", "com_offset"} <= printed["screening"].keys()
    for channel, rms in printed["errors"].items():
        if channel.startswith(("force", "moment", "secondary")):
            assert 0.8 < rms < 1.2, channel
    content = json.loads((clean / "result" / "diagnosis.json").read_text())
    assert printed["trustworthy"] and printed["headline"] is None
    assert content == {k: v for k, v in printed.items() if k not in ("outputs", "next", "trustworthy", "headline")}
    assert [Path(p).name for p in printed["outputs"]] == [
        "diagnosis.json", "report.html", "diagnosis_heatmap.png", "diagnosis_ranking.png",
    ]  # fmt: skip
    assert all(Path(p).is_file() for p in printed["outputs"])
    assert json.loads(read_diagnosis(clean / "result").model_dump_json(exclude_unset=True)) == content
    summary = (clean / "result" / "summary.json").read_bytes()
    assert summary == summary_before  # a diagnosis changes no number of the run
    assert json.loads(read_summary(clean / "result").model_dump_json(exclude_unset=True)) == json.loads(summary)
    assert json.loads(call("compare", clean / "result", clean / "result", "--json").stdout) == comparison_before | {
        "results": [r | {"verdict": "clean"} for r in comparison_before["results"]]
    }
    # residuals against time are those of which the errors are the RMS
    root = read_groups(clean / "result" / "residuals.nc")["/"].variables
    names, normalised = list(root["channel"].values), root["normalised"].values
    assert names[:4] == ["force_x", "force_y", "force_z", "moment_x"]
    assert list(root["unit"].values[[0, 3]]) == ["m/s^2", "rad/s^2"]
    for name, values in zip(names, normalised, strict=True):
        assert np.sqrt(np.nanmean(values**2)) == pytest.approx(content["errors"][name], rel=1e-9)
    np.testing.assert_allclose(root["residual"].values / root["sigma"].values, normalised, rtol=1e-9)
    assert normalised.shape == (len(names), len(root["time"].values))


@pytest.mark.slow
def test_several_processes_have_the_result_of_one_bit_for_bit(tmp_path):
    """Of a flight whose model fails: effects are fitted, and expensive Jacobians computed, by copies of the process."""
    contents = []
    assert call("run", "builtin:practice_mer", "--set", "vehicle.mass=845", "-o", tmp_path / "result").exit_code == 0
    for workers in ("1", "2"):
        folder = shutil.copytree(tmp_path / "result", tmp_path / workers)
        command = [sys.executable, "-m", "edl_filter", "diagnose", str(folder)]
        subprocess.run(command, check=True, capture_output=True, env=os.environ | {"EDL_FILTER_WORKERS": workers})
        contents.append((folder / "diagnosis.json").read_text().replace(str(folder), ""))
    assert contents[0] == contents[1]
    assert json.loads(contents[0])["verdict"] == "missing"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--effect", "remnant_torqe"), "--effect: found no effect 'remnant_torqe'; nearest accepted: remnant_torque"),
        (("--effect", "mine", "--file", "none.py"), "none.py: there is no such file"),
    ],
)
def test_an_unknown_effect_is_refused(copy, arguments, message):
    assert_refused(call("diagnose", "result", *arguments), message)
    assert not Path("result/diagnosis.json").exists()


def test_a_missing_result_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_refused(
        call("diagnose", "nowhere"), "nowhere: no such result; expected the result.nc that 'edl-filter run' writes"
    )


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("format_version", 7, "it is a result of version 7; this edl-filter reads version 2. Run the mission again."),
        ("edl_filter_version", "3.2.1", "found a result of edl-filter 3.2.1; this is"),
        ("effects", None, "found no 'effects' among its attributes"),
        ("effects", "{", "found no JSON among its attributes"),
        ("trust", None, "found no 'trust' among its attributes"),
        (
            "input_sha256",
            "{}",
            "its telemetry has changed since (another sha256); run the mission again: edl-filter run",
        ),
    ],
)
def test_a_result_that_cannot_be_diagnosed_is_refused(copy, attribute, value, message):
    with h5py.File(copy, "r+") as file:
        del file.attrs[attribute]
        if value is not None:
            file.attrs[attribute] = value
    assert_refused(call("diagnose", copy, "--effect", "wind"), str(copy), message)
    assert not Path("result/diagnosis.json").exists()


def test_a_mission_without_aerodynamics_is_refused(copy):
    assert (
        call("run", "builtin:practice_mer", "-o", "bare", "--set", "aerodynamics=null", "--no-figures").exit_code == 0
    )
    assert_refused(
        call("diagnose", "bare"), "bare/result.nc: aerodynamics: found nothing; a diagnosis compares the flight"
    )


def test_a_result_contains_its_mission_whatever_the_current_folder(copy, builtin_flight, monkeypatch):
    Path("missions").mkdir()
    shutil.copy(builtin_flight, "missions/flight.h5")
    text = shipped_mission("practice_mer").read_text().replace("builtin:practice_06 ", "flight.h5 ")
    Path("missions/m.yaml").write_text(text)
    changes = ("--set", "vehicle.mass=840", "--set", "effects=[{name: mass, fixed: true, parameters: {k: 0.01}}]")
    assert call("run", "missions/m.yaml", "-o", "out", "--no-figures", "--no-refit", *changes).exit_code == 0
    result = Path("out").resolve()
    monkeypatch.chdir("missions")
    reopened = reopen(result)
    assert reopened.mission.telemetry_path().is_file()
    assert reopened.mission.vehicle.mass == 840.0
    (mass,) = reopened.effects
    assert mass.fixed and mass.values == {"k": 0.01}


def test_a_list_entry_can_be_set():
    changes = ["effects=[{name: wind}, {name: mass, parameters: {k: 0.01}}]", "effects.1.parameters.k=0.02"]
    assert Mission.load("builtin:practice_mer", changes).effects[1].parameters == {"k": 0.02}
    result = call(
        "validate", "builtin:practice_mer", "--set", "effects=[{name: wind}]", "--set", "effects.1.fixed=true"
    )
    assert_refused(result, "--set effects.1.fixed: effects has 1 entries; the first is effects.0.")


HIDDEN = """
import numpy as np
from edl_filter.effects import Effect, Parameter

class Push(Effect):
    name = "push"
    summary = "a constant force along y"
    parameters = (Parameter("a", "N", "how much", 100.0, low=-900.0, high=900.0),)

    def force_moment(self, p, flow):
        force = np.zeros((len(flow.time), 3))
        force[:, 1] = p["a"] * (flow.time < 200.0)
        return force, np.zeros_like(force)
"""


@pytest.mark.slow
def test_the_printed_commands_add_an_effect_of_the_users_file_and_run(tmp_path, monkeypatch):
    """The lines after ``Next:`` are parsed as a shell does and run from the folder in which they were printed."""
    monkeypatch.chdir(tmp_path)
    Path("my own").mkdir()
    Path("my own/push effect.py").write_text(HIDDEN)
    effects = "effects=[{name: push, file: my own/push effect.py, parameters: {a: 60}}]"
    assert call("simulate", "builtin:mer", "-o", "my own/flight.h5", "--set", effects).exit_code == 0
    changes = ("--from", "builtin:practice_mer", "--set", "telemetry.path=my own/flight.h5")
    assert call("new", "my own/mission.yaml", *changes).exit_code == 0
    call("run", "my own/mission.yaml", "-o", "my own/result", "--no-figures")
    printed = call("diagnose", "my own/result", "--file", "my own/push effect.py", "--effect", "push").stdout
    lines = [line.strip() for line in printed.split("Next: ")[1].splitlines() if line.startswith("  edl-filter")]
    assert [shlex.split(line)[1] for line in lines] == ["add", "run"]
    assert "--file 'my own/push effect.py'" in lines[0]
    for line, option in zip(lines, ([], ["--no-figures"]), strict=True):
        result = call(*shlex.split(line)[1:], *option)
        assert result.exit_code == 0, result.output
    (push,) = Mission.load("my own/mission+push.yaml").active_effects()
    assert push.values["a"] == pytest.approx(60.0, abs=3.0)
    assert Path("my own/result+push/result.nc").is_file()
