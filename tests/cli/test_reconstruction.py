"""Commands: what they print, their exit codes, and that wrong input leaves nothing behind."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from edl_filter import __version__
from edl_filter.cli import app
from edl_filter.mission import shipped_mission
from edl_filter.results import write_outputs

EXAMPLES = Path(__file__).parent.parent / "docs" / "examples"
COMMANDS = (
    "run", "validate", "convert", "simulate", "export", "fetch", "demo", "effects", "add",
    "diagnose", "compare", "improve", "identifiability", "serve",
)  # fmt: skip


@pytest.fixture
def cli(tmp_path, monkeypatch):
    """Run a command in an empty folder, without real data in sight."""
    monkeypatch.delenv("EDL_FILTER_DATA", raising=False)
    monkeypatch.setenv("EDL_FILTER_CACHE", str(tmp_path / "cache"))
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    return lambda *args: CliRunner().invoke(app, [str(a) for a in args])


def refused(result, *parts):
    """Exit code 2, one message, no traceback, nothing on standard output, nothing written."""
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
    for part in parts:
        assert part in result.stderr
    assert [p for p in Path().rglob("*") if p.suffix in (".nc", ".json", ".png", ".h5")] == []
    assert not Path("out").exists()


def changed(name, old, new):
    """A shipped mission with one change, in the current folder."""
    text = shipped_mission(name).read_text()
    assert old in text
    Path("mission.yaml").write_text(text.replace(old, new, 1))
    return "mission.yaml"


def test_version(cli):
    result = cli("--version")
    assert result.exit_code == 0
    assert result.stdout.strip() == f"edl-filter {__version__}"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(cli, command):
    result = cli(command, "--help")
    assert result.exit_code == 0
    assert f"Example: edl-filter {command}" in result.stdout


def test_cli_imports_nothing_heavy():
    code = (
        "import sys, edl_filter.cli; "
        "print([m for m in ('numpy','numba','xarray','pydantic','scipy','matplotlib','h5py') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("command", [[], *([name] for name in sorted(COMMANDS))])
def test_help_comes_at_once(command):
    call = [sys.executable, "-c", "from edl_filter.cli import main; main()", *command, "--help"]
    taken = []
    for _ in range(4):
        begin = os.times()
        subprocess.run(call, capture_output=True, check=True)
        end = os.times()
        # processor time of the child: what the machine does besides does not count
        taken.append(end.children_user + end.children_system - begin.children_user - begin.children_system)
    assert min(taken) < 0.3


def test_run_writes_and_prints(cli):
    result = cli("run", "builtin:practice_mer", "-o", "out", "--no-figures")
    assert result.exit_code == 0, result.output
    assert {p.name for p in Path("out").iterdir()} == {"result.nc", "summary.json", "report.html", "tables"}
    for part in ("parachute deploy", "rest gravity", "Entry state: moved by", "result.nc", "Peak deceleration"):
        assert part in result.stdout
    assert "\x1b" not in result.output


def test_run_json_is_one_object(cli):
    result = cli("run", "builtin:practice_mer", "-o", "out", "--no-figures", "--json")
    told = json.loads(result.stdout)
    assert result.stderr == ""
    outputs = told.pop("outputs")
    assert told == json.loads(Path("out/summary.json").read_text())
    assert Path(outputs["result"]).is_file()
    assert Path(outputs["report"]).is_file()


def test_set_changes_the_mission(cli):
    result = cli("run", "builtin:practice_mer", "-o", "out", "--no-figures", "--set", "constraints.landing=null")
    assert result.exit_code == 0, result.output
    assert "landing" not in json.loads(Path("out/summary.json").read_text())["constraints"]


def test_validate_says_what_is_there(cli, builtin_flight):
    mission = cli("validate", "builtin:practice_mer")
    assert mission.exit_code == 0
    assert "the mission practice_mer, nothing wrong" in mission.stdout
    flight = cli("validate", builtin_flight)
    assert "a flight file, nothing wrong" in flight.stdout
    assert "altimeter: 261 heights" in flight.stdout
    assert "driving IMU (primary): 2910 samples, 0.00 to 363.75 s (flight file)" in flight.stdout
    assert "gap" not in flight.stdout


def test_validate_real_mission(cli, mer_folder):
    result = cli("validate", "builtin:mer_a", "--set", f"telemetry.path={mer_folder}")
    assert result.exit_code == 0, result.output
    assert "SCLK 126462085.400" in result.stdout
    assert ": 0 rows" not in result.stdout


def test_convert_the_example(cli):
    result = cli("convert", EXAMPLES / "imu_log.csv", "--spec", EXAMPLES / "imu_log.spec.yaml", "-o", "f.h5")
    assert result.exit_code == 0, result.output
    assert cli("validate", "f.h5").exit_code == 0


def test_export(cli, practice_06):
    write_outputs(practice_06, "out", figures=False)
    result = cli("export", "out", "--to", "csv", "-o", "t.csv")
    assert result.stdout.strip() == "Written: t.csv"
    assert Path("t.csv").read_text().startswith("time [s],utc,")


def test_unknown_key(cli):
    path = changed("practice_mer", "filter:\n", "filter:\n  alfa: 0.3\n")
    refused(cli("run", path, "-o", "out"), "mission.yaml", "filter.alfa")


def test_unknown_key_in_set(cli):
    refused(cli("run", "builtin:practice_mer", "--set", "filter.alfa=1", "-o", "out"), "filter.alfa")


def test_yaml_that_is_not_yaml(cli):
    Path("mission.yaml").write_text("name: [1, 2\nplanet: }")
    refused(cli("run", "mission.yaml", "-o", "out"), "mission.yaml", "YAML")


def test_no_such_mission(cli):
    refused(cli("run", "nowhere.yaml", "-o", "out"), "nowhere.yaml")


def test_no_data_folder(cli):
    refused(cli("run", "builtin:mer_a", "-o", "out"), "edl-filter fetch mer-imu", "EDL_FILTER_DATA")


def test_a_data_folder_that_does_not_exist(cli):
    result = cli("run", "builtin:mer_a", "-o", "out", "--set", "telemetry.path=gone")
    refused(result, "telemetry.path", "gone")


@pytest.fixture
def volume(mer_folder, tmp_path):
    """A copy of Spirit's tables."""
    copy = tmp_path / "volume" / "DATA"
    copy.mkdir(parents=True)
    for source in mer_folder.rglob("2*.*"):
        shutil.copy(source, copy)
    return copy


def test_missing_table(cli, volume):
    (volume / "2HIGHRATE.TAB").unlink()
    result = cli("run", "builtin:mer_a", "-o", "out", "--set", f"telemetry.path={volume.parent}")
    refused(result, "2HIGHRATE.TAB")


def test_truncated_table(cli, volume):
    table = volume / "2TRANSFORMED.TAB"
    table.write_bytes(table.read_bytes()[:100_001])
    result = cli("run", "builtin:mer_a", "-o", "out", "--set", f"telemetry.path={volume.parent}")
    refused(result, "2TRANSFORMED.TAB")


def test_label_that_disagrees_with_its_table(cli, volume):
    label = volume / "2HIGHRATE.LBL"
    text = label.read_bytes()
    assert text.count(b"= 2495") >= 1
    label.write_bytes(text.replace(b"= 2495", b"= 2496"))
    result = cli("run", "builtin:mer_a", "-o", "out", "--set", f"telemetry.path={volume.parent}")
    refused(result, "2HIGHRATE", "2496")


def test_the_other_rover(cli, mer_folder):
    changes = ("--set", f"telemetry.path={mer_folder}", "--set", "telemetry.spacecraft=1")
    refused(cli("run", "builtin:mer_a", "-o", "out", *changes), "telemetry.spacecraft", "MER-B Opportunity")


def test_a_flight_that_ends_within_highrate(cli, mer_folder):
    nothing = [f"constraints.{name}=null" for name in ("landing", "rest", "steady_descent")]
    changes = (f"telemetry.path={mer_folder}", "telemetry.end_s=310", *nothing)
    result = cli("run", "builtin:mer_a", "-o", "out", "--no-figures", *(a for c in changes for a in ("--set", c)))
    assert result.exit_code == 0, result.output
    assert "parachute deploy" in result.stdout


@pytest.mark.parametrize(
    ("key", "place", "value", "message"),
    [
        ("imu/primary/specific_force", (17, 1), float("nan"), "/imu/primary/specific_force row 17 holds nan"),
        ("imu/primary/time", 9, 1.0, "/imu/primary/time row 9 is 1.000000 s after 1.125000 s; time must increase"),
        ("initial/attitude", 0, 2.0, "/initial/attitude has norm"),
        ("initial/covariance", (4, 4), -1.0, "/initial/covariance has -1 on its diagonal, row 4"),
        ("initial/position", slice(None), 3522.2, "/initial/position is 6100.63; m between 100000 and 1e+09 is needed"),
        ("constraints/landing/position_sigma", 0, 0.0, "/constraints/landing/position_sigma"),
    ],
)
def test_wrong_numbers_in_a_flight_file(cli, builtin_flight, tmp_path, key, place, value, message):
    import h5py

    path = shutil.copy(builtin_flight, tmp_path / "flight.h5")
    with h5py.File(path, "a") as file:
        file[key][place] = value
    refused(cli("validate", path), "flight.h5", message)
    refused(cli("run", "builtin:practice_mer", "-o", "out", "--set", f"telemetry.path={path}"), "flight.h5", message)


def test_outputs_that_cannot_be_written(cli, practice_06, monkeypatch):
    Path("file").touch()
    monkeypatch.setattr("edl_filter.reconstruction.reconstruct", lambda mission: practice_06)
    refused(cli("run", "builtin:practice_mer", "-o", "file"), "file: cannot be written (File exists)")
    Path("here/result.nc").mkdir(parents=True)
    result = cli("run", "builtin:practice_mer", "-o", "here")
    assert (result.exit_code, result.stderr) == (2, "edl-filter: here/result.nc: cannot be written (it is a folder).\n")
    assert [p.name for p in Path("here").iterdir()] == ["result.nc"]
    shutil.rmtree("here")
    log = EXAMPLES / "imu_log.csv", "--spec", EXAMPLES / "imu_log.spec.yaml"
    refused(cli("convert", *log, "-o", "."), "it is a folder")
    refused(cli("convert", *log, "-o", "file/flight.h5"), "file/flight.h5: cannot be written")
    write_outputs(practice_06, "../result", figures=False)
    refused(cli("export", "../result", "--to", "csv", "-o", "."), "it is a folder")
    refused(cli("export", "../result", "--to", "csv", "-o", "file/t.csv"), "file/t.csv: cannot be written")


def test_a_disk_that_fails_names_the_file(cli, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("edl_filter.telemetry.flight_file._write_tree", full)
    result = cli("convert", EXAMPLES / "imu_log.csv", "--spec", EXAMPLES / "imu_log.spec.yaml", "-o", "f.h5")
    refused(result, "f.h5: cannot be written (No space left on device)")
    assert list(Path().iterdir()) == []


def test_a_part_of_a_result(cli, practice_06):
    import h5py

    write_outputs(practice_06, "../result", figures=False)
    with h5py.File("../result/result.nc", "a") as file:
        del file["trajectory"]
    refused(cli("export", "../result", "--to", "csv", "-o", "t.csv"), "/trajectory is missing")
    assert not Path("t.csv").exists()


@pytest.mark.parametrize("command", ["validate", "run"])
def test_a_reader_that_goes_away_is_no_fault(command, tmp_path):
    call = [sys.executable, "-m", "edl_filter.cli", command, "builtin:practice_mer"]
    call += ["-o", str(tmp_path), "--no-figures"] if command == "run" else []
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        said = process.stderr.read()
    assert (process.returncode, said) == (0, "")


def test_not_a_flight_file(cli):
    Path("text.h5").write_text("no HDF5")
    assert "text.h5" in cli("validate", "text.h5").stderr
    Path("text.h5").rename("flight.bin")
    refused(cli("run", "builtin:practice_mer", "-o", "out", "--set", "telemetry.path=flight.bin"), "flight.bin")


def test_phoenix_says_what_it_needs(cli):
    refused(cli("run", "builtin:phoenix", "-o", "out"), "telemetry.path")


def test_no_result(cli):
    refused(cli("export", "none.nc", "--to", "csv"), "none.nc: no such result")


def test_bad_log(cli):
    result = cli("convert", "none.csv", "--spec", EXAMPLES / "imu_log.spec.yaml", "-o", "f.h5")
    refused(result, "none.csv")


def test_fetch_of_something_else(cli):
    refused(cli("fetch", "phoenix"), "'phoenix'", "mer-imu")


def test_usage_errors_exit_2(cli):
    refused(cli("run"), "Missing argument")
    refused(cli("run", "a", "--nonsense"), "--nonsense")
    refused(cli("export", "a", "--naif-id", "x", "--to", "csv"), "naif-id")


def test_a_fault_of_ours_exits_1(cli, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("edl_filter.mission.Mission.load", broken)
    result = cli("run", "builtin:practice_mer")
    assert result.exit_code == 1
    assert "ZeroDivisionError: oops" in result.stderr
    assert "--debug" in result.stderr
    assert "Traceback" not in result.stderr
    shown = cli("--debug", "run", "builtin:practice_mer")
    assert shown.exit_code == 1
    assert "Traceback" in shown.stderr


def test_debug_shows_where_input_was_refused(cli):
    result = cli("--debug", "run", "nowhere.yaml")
    assert result.exit_code == 2
    assert "Traceback" in result.stderr and "nowhere.yaml" in result.stderr


def test_simulate_writes_a_flight_that_runs_can_read(cli):
    result = cli("simulate", "builtin:mer", "-o", "flight.h5", "--seed", "7", "--set", "name=seventh")
    assert result.exit_code == 0, result.output
    assert result.stdout == "Written: flight.h5\n"
    result = cli("validate", "flight.h5")
    assert result.exit_code == 0 and "nothing wrong" in result.stdout


def test_simulate_refuses_what_it_cannot_fly(cli):
    refused(cli("simulate", "builtin:beagle", "-o", "flight.h5"), "builtin:beagle", "mer, phoenix")
    refused(cli("simulate", "nowhere.yaml", "-o", "flight.h5"), "nowhere.yaml")
    wrong = cli("simulate", "builtin:mer", "-o", "flight.h5", "--set", "entry.flight_path_angle_deg=20")
    refused(wrong, "has not reached the parachute's dynamic pressure")
