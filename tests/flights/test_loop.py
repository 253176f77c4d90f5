"""The loop as a user goes through it: run, diagnose, add, run, diagnose, by commands only.

A fast version: few candidates, one hidden effect. All effects on many flights are for the study.
"""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.mission import Mission


@pytest.fixture
def cli(tmp_path, monkeypatch):
    """Run a command that succeeds, or ends with another exit code that is stated, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments, exit_code=0):
        result = CliRunner().invoke(app, [str(a) for a in arguments])
        assert result.exit_code == exit_code, result.output
        return result.stdout

    return call


def only(*names):
    return [part for name in names for part in ("--effect", name)]


def loop(cli, changes, missing, alternatives):
    """Run, diagnose, add, run, diagnose; gives both diagnoses and the mission at the end."""
    # the misaligned gravity at rest contradicts the other measurements: not to be trusted, exit code 3
    cli("run", "builtin:practice_mer", *changes, "-o", "first", "--no-figures", exit_code=3)
    first = json.loads(cli("diagnose", "first", *only(missing, *alternatives), "--json"))
    for command in first["next"]:
        program, *arguments = command.split()
        assert program == "edl-filter"
        cli(*arguments)
    run = json.loads(Path(f"first+{missing}/summary.json").read_text())["residuals"]
    second = json.loads(cli("diagnose", f"first+{missing}", *only(*alternatives), "--json"))
    assert {channel: by_regime["overall"] for channel, by_regime in run.items()} == second["errors"]  # one answer
    return first, second


def check(first, second, missing):
    assert (first["verdict"], second["verdict"]) == ("missing", "clean"), (first["sentence"], second["sentence"])
    assert first["ranking"][0]["effect"] == missing
    failing = {c["channel"] for c in first["where"]}
    assert failing
    for channel in failing:
        if len([c for c in first["map"] if c["channel"] == channel and c["regime"] != "constraints"]):
            assert 0.8 < second["errors"][channel] < 1.3, channel
    assert second["where"] == [] and second["effects"] == [missing]


@pytest.mark.slow
def test_a_hidden_misalignment_is_identified_and_the_error_falls_to_the_noise(cli, practice):
    changes = ("--set", f"telemetry.path={practice(4)}")
    first, second = loop(cli, changes, "accelerometer_misalignment", ["gyro_bias"])
    check(first, second, "accelerometer_misalignment")
    run = json.loads(Path("first+accelerometer_misalignment/summary.json").read_text())
    assert run["trustworthy"] and run["constraints"]["rest_gravity"]["consistent"]
    mission = Mission.load("first/mission_as_run+accelerometer_misalignment.yaml")
    assert mission.effects[0].name == "accelerometer_misalignment"
    comparison = cli("compare", "first", "first+accelerometer_misalignment")
    assert "Held-out gain of 2 over the one before:" in comparison and "accelerometer_misalignment" in comparison
