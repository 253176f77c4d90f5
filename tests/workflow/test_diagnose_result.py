"""`edl-filter diagnose` on the shipped flight: it is clean, broken effects do not stop it, wrong input is told."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.mission import Mission, shipped_mission
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


def refused(result, *parts):
    assert result.exit_code == 2, result.output
    assert result.stdout == "" and "Traceback" not in result.stderr
    for part in parts:
        assert part in result.stderr


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Result of the shipped flight."""
    folder = tmp_path_factory.mktemp("clean")
    assert call("run", "builtin:practice_mer", "-o", folder / "result", "--no-figures").exit_code == 0
    (folder / "mine.py").write_text(BROKEN)
    return folder


@pytest.fixture
def copy(clean, tmp_path, monkeypatch):
    """A copy of it to spoil, and the current folder beside it."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(clean / "result", "result", ignore=shutil.ignore_patterns("diagnosis*"))
    return Path("result/result.nc")


def test_the_shipped_flight_is_clean_and_broken_effects_are_named(clean):
    result = call("diagnose", clean / "result", "--file", clean / "mine.py", "--effect", "raises", "--effect", "flat",
                  "--effect", "push", "--effect", "gyro_bias", "--effect", "com_offset", "--json")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    told = json.loads(result.stdout)
    assert told["verdict"] == "clean" and told["where"] == [] and told["next"] == []
    assert (
        "AttributeError: 'Flow' object has no attribute 'no_such_thing' (mine.py, line 10)" in told["failed"]["raises"]
    )
    assert "gave an array of shape (3,) for force; expected" in told["failed"]["flat"]
    assert {"push", "gyro_bias", "com_offset"} <= told["undecided"].keys()
    for channel, rms in told["errors"].items():
        if channel.startswith(("force", "moment", "secondary")):
            assert 0.8 < rms < 1.2, channel
    kept = json.loads((clean / "result" / "diagnosis.json").read_text())
    assert kept == {k: v for k, v in told.items() if k not in ("outputs", "next")}
    assert [Path(p).name for p in told["outputs"]] == [
        "diagnosis.json", "report.html", "diagnosis_heatmap.png", "diagnosis_ranking.png",
    ]  # fmt: skip
    assert all(Path(p).is_file() for p in told["outputs"])
    summary = json.loads((clean / "result" / "summary.json").read_text())
    assert summary["residuals"]["moment_y"]["overall"] == told["errors"]["moment_y"]
    assert "Mach 15 to 5" in summary["residuals"]["moment_y"] and "landing: x (m)" not in told["errors"]
    # residuals against time are those that the errors are the RMS of
    root = read_groups(clean / "result" / "residuals.nc")["/"].variables
    names, normalised = list(root["channel"].values), root["normalised"].values
    assert names[:4] == ["force_x", "force_y", "force_z", "moment_x"]
    assert list(root["unit"].values[[0, 3]]) == ["m/s^2", "rad/s^2"]
    for name, values in zip(names, normalised, strict=True):
        assert np.sqrt(np.nanmean(values**2)) == pytest.approx(told["errors"][name], rel=1e-9)
    np.testing.assert_allclose(root["residual"].values / root["sigma"].values, normalised, rtol=1e-9)
    assert normalised.shape == (len(names), len(root["time"].values))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--effect", "remnant_torqe"), "--effect: found no effect 'remnant_torqe'; nearest accepted: remnant_torque"),
        (("--effect", "mine", "--file", "none.py"), "none.py: there is no such file"),
    ],
)
def test_an_effect_that_is_not_there(copy, arguments, message):
    refused(call("diagnose", "result", *arguments), message)
    assert not Path("result/diagnosis.json").exists()


def test_no_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(call("diagnose", "nowhere"), "nowhere: no such result; expected the result.nc that 'edl-filter run' writes")


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("format_version", 7, "it is a result of version 7; this edl-filter reads version 1. Run the mission again."),
        ("edl_filter_version", "3.2.1", "found a result of edl-filter 3.2.1; this is"),
        ("effects", None, "found no 'effects' among its attributes"),
        ("effects", "{", "found no JSON among its attributes"),
        (
            "input_sha256",
            "{}",
            "its telemetry has changed since (another sha256); run the mission again: edl-filter run",
        ),
    ],
)
def test_a_result_from_elsewhere(copy, attribute, value, message):
    with h5py.File(copy, "r+") as file:
        del file.attrs[attribute]
        if value is not None:
            file.attrs[attribute] = value
    refused(call("diagnose", copy, "--effect", "wind"), str(copy), message)
    assert not Path("result/diagnosis.json").exists()


def test_a_mission_without_aerodynamics(copy):
    assert (
        call("run", "builtin:practice_mer", "-o", "bare", "--set", "aerodynamics=null", "--no-figures").exit_code == 0
    )
    refused(call("diagnose", "bare"), "bare/result.nc: aerodynamics: found nothing; a diagnosis compares the flight")


def test_a_result_remembers_its_mission_wherever_one_stands(copy, builtin_flight, monkeypatch):
    Path("there").mkdir()
    shutil.copy(builtin_flight, "there/flight.h5")
    text = shipped_mission("practice_mer").read_text().replace("builtin:practice_06 ", "flight.h5 ")
    Path("there/m.yaml").write_text(text)
    changes = ("--set", "vehicle.mass=840", "--set", "effects=[{name: mass, fixed: true, parameters: {k: 0.01}}]")
    assert call("run", "there/m.yaml", "-o", "out", "--no-figures", "--no-refit", *changes).exit_code == 0
    result = Path("out").resolve()
    monkeypatch.chdir("there")
    opened = reopen(result)
    assert opened.mission.telemetry_path().is_file()
    assert opened.mission.vehicle.mass == 840.0
    (mass,) = opened.effects
    assert mass.fixed and mass.values == {"k": 0.01}


def test_a_list_entry_can_be_set():
    changes = ["effects=[{name: wind}, {name: mass, parameters: {k: 0.01}}]", "effects.1.parameters.k=0.02"]
    assert Mission.load("builtin:practice_mer", changes).effects[1].parameters == {"k": 0.02}
    result = call(
        "validate", "builtin:practice_mer", "--set", "effects=[{name: wind}]", "--set", "effects.1.fixed=true"
    )
    refused(result, "--set effects.1.fixed: effects has 1 entries; the first is effects.0.")
