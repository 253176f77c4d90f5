"""`validate`: all problems of a mission or a flight file, and everything that a run refuses."""

import shutil
from pathlib import Path

import h5py
import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.problems import mission_problems
from edl_filter.workflow.run import run_mission
from edl_filter.workflow.validate import validated_flight_file, validated_mission

MISSION = "builtin:practice_mer"


def problems_of(check, *arguments):
    """Lines of the message with which a check refuses its arguments."""
    with pytest.raises(InputError) as refused:
        check(*arguments)
    lines = str(refused.value).splitlines()
    if len(lines) == 1:
        return lines
    assert lines[0] == f"{len(lines) - 1} problems:"
    return [line.removeprefix("  ") for line in lines[1:]]


def test_sections_files_and_effects_are_checked_though_another_section_is_wrong(tmp_path):
    text = shipped_mission("practice_mer").read_text()
    for old, new in (
        ("mass: 832.0 ", "mass: -1 "), ("alpha: 0.5", "alfa: 0.5"), ("builtin:mars_reference ", "none.csv "),
        ("builtin:practice_06 ", "gone.h5 "),
        ("initial_state:", "effects: [{name: wnd}, {name: wind, parameters: {est: 1, east: 4000}}]\ninitial_state:"),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    starts = (
        "filter.alfa: found an unknown key", "vehicle.mass: found -1", "effects.0.name: found 'wnd'",
        "effects.1.parameters.est: found an unknown key", "effects.1.parameters.east: found 4000",
        "telemetry.path: found 'gone.h5'", "atmosphere.table: found 'none.csv'",
    )  # fmt: skip
    messages = problems_of(validated_mission, path)
    assert len(messages) == len(starts)
    for message, start in zip(messages, starts, strict=True):
        assert message.startswith(f"{path}: {start}")


def test_a_problem_of_set_names_it():
    assert mission_problems(MISSION, ["vehicle.mass=-1", "filter.alpha=7"]) == [
        "--set vehicle.mass: found -1.0; expected kg between 1 and 100000",
        "--set filter.alpha: found 7.0; expected a number between 0.1 and 1",
    ]


@pytest.mark.parametrize("name", ["mer_a", "mer_b", "practice_mer", "practice_phoenix"])
def test_shipped_missions_have_no_problems(name):
    assert mission_problems(f"builtin:{name}") == []


@pytest.mark.parametrize(
    ("changes", "messages"),
    [
        (("name: [",), ["--set name: [: found no KEY=VALUE"]),
        (("planet.name=venus",), ["the flight is of mars, the mission's planet is venus"]),
        (("vehicle.inertia=null",), ["vehicle.inertia: found nothing; aerodynamics needs it"]),
        (
            ("postflight.windows=[{name: a, start_s: 900, end_s: 950}]",),
            ["postflight.windows: 'a', 900 to 950 s, holds no sample"],
        ),
        (
            ("constraints.pre_entry_zero_force={start_s: -900, end_s: -800, sigma: 0.1}",
             "constraints.steady_descent={start_s: 2000, end_s: 2001, horizontal_sigma: 3, vertical_sigma: 0.1}",
             "vehicle.parachute.drag_coefficient=0.4"),
            ["constraints.pre_entry_zero_force: no telemetry between -900 and -800 s",
             "constraints.steady_descent: no telemetry between 2000 and 2001 s"],
        ),
        (
            ("effects=[{name: mass, parameters: {k: 0.1}}, {name: mass, parameters: {k: 0.2}}]",),
            ["effects: found mass twice"],
        ),
        (
            ("effects=[{name: gyro_bias, imu: third, parameters: {bx: 1e-5}}]", "aerodynamics.continuum=builtin:none"),
            ["builtin:none", "third"],
        ),
    ],
)  # fmt: skip
def test_what_a_run_refuses_is_listed(changes, messages):
    listed = problems_of(validated_mission, MISSION, changes)
    assert len(listed) == len(messages)
    for line, message in zip(listed, messages, strict=True):
        assert message in line
    with pytest.raises(InputError) as refused:
        _ = run_mission(Mission.load(MISSION, changes)).groups  # the post-flight layer is computed on demand
    assert any(message in str(refused.value) for message in messages)


def test_an_output_folder_that_cannot_be_written_is_listed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("results").touch()
    assert problems_of(validated_mission, MISSION, ["vehicle.inertia=null"]) == [
        f"{shipped_mission('practice_mer')}: vehicle.inertia: found nothing; aerodynamics needs it for the moments.",
        "results/practice_mer: cannot be written (Not a directory).",
    ]


def test_all_parts_of_a_flight_file_are_checked(builtin_flight, tmp_path):
    path = Path(shutil.copy(builtin_flight, tmp_path / "flight.h5"))
    with h5py.File(path, "a") as file:
        file["initial/attitude"][0] = 2.0
        file["constraints/landing/position_sigma"][0] = 0.0
        file["altimeter"].attrs["sigma"] = -1.0
        del file["imu/secondary"].attrs["gyro_noise"]
    starts = ("/imu/secondary", "/initial/attitude has norm", "/constraints/landing/position_sigma", "/altimeter")
    messages = problems_of(validated_flight_file, path)
    assert len(messages) == len(starts)
    for message, start in zip(messages, starts, strict=True):
        assert message.startswith(f"{path}: {start}")
    assert problems_of(validated_mission, MISSION, [f"telemetry.path={path}"]) == messages


def test_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mission, telemetry = validated_mission(MISSION)
    assert (mission.name, len(telemetry.driving.time)) == ("practice_mer", 2910)
    assert list(tmp_path.iterdir()) == []
