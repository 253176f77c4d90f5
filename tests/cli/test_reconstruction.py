"""`run` and `validate`: what they write and print, and that wrong input leaves no files."""

import json
import shutil
from pathlib import Path

import h5py
import pytest
from command_checks import assert_input_error, assert_refused, changed_mission

from edl_filter.results import Result
from edl_filter.workflow.run import write_outputs

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


def test_run_writes_files_and_prints_a_summary(cli):
    result = cli("run", "builtin:practice_mer", "-o", "out", "--no-figures")
    assert result.exit_code == 0, result.output
    assert {p.name for p in Path("out").iterdir()} == {
        "result.nc",
        "summary.json",
        "report.html",
        "plotly.min.js",
        "tables",
    }
    for part in ("parachute deploy", "rest gravity", "Entry state: moved by", "result.nc", "Peak deceleration"):
        assert part in result.stdout
    assert "\x1b" not in result.output


def test_run_json_prints_one_object(cli):
    result = cli("run", "builtin:practice_mer", "-o", "out", "--no-figures", "--json")
    summary = json.loads(result.stdout)
    assert result.stderr == ""
    outputs = summary.pop("outputs")
    assert summary == json.loads(Path("out/summary.json").read_text())
    assert Path(outputs["result"]).is_file()
    assert Path(outputs["report"]).is_file()


def test_figures_on_demand(cli, practice_06):
    write_outputs(Result(practice_06), "out", figures=False)
    result = cli("figures", "out", "--format", "svg")
    assert result.exit_code == 0, result.output
    names = {p.name for p in Path("out/figures").iterdir()}
    assert {"altitude_velocity.svg", "force_coefficients.svg"} <= names
    assert not any(name.endswith(".png") for name in names)
    assert f"({len(names)} files)" in result.stdout


def test_figures_need_a_result(cli):
    assert_input_error(cli("figures", "nowhere"), "nowhere", "edl-filter run")
    Path("empty").mkdir()
    assert_input_error(cli("figures", "empty"), "result.nc")


def test_set_changes_the_mission(cli):
    result = cli("run", "builtin:practice_mer", "-o", "out", "--no-figures", "--set", "constraints.landing=null")
    assert result.exit_code == 0, result.output
    assert "landing" not in json.loads(Path("out/summary.json").read_text())["constraints"]


def test_validate_prints_the_contents(cli, builtin_flight):
    mission = cli("validate", "builtin:practice_mer")
    assert mission.exit_code == 0
    assert "mission practice_mer, usable; 1 finding about samples." in mission.stdout
    flight = cli("validate", builtin_flight)
    assert "flight file, usable; 1 finding about samples." in flight.stdout
    for output in (mission.stdout, flight.stdout):
        assert "primary force, 344.250 to 363.750 s: force at rest that is not constant" in output
    assert "altimeter: 261 heights" in flight.stdout
    assert "driving IMU (primary): 2910 samples, 0.00 to 363.75 s (flight file)" in flight.stdout
    assert "gap" not in flight.stdout


def test_validate_a_mission_with_real_telemetry(cli, mer_folder):
    result = cli("validate", "builtin:mer_a", "--set", f"telemetry.path={mer_folder}")
    assert result.exit_code == 0, result.output
    assert "SCLK 126462085.400" in result.stdout and "mission mer_a, no errors found." in result.stdout
    assert ": 0 rows" not in result.stdout


def test_an_unknown_key_is_refused(cli):
    path = changed_mission("practice_mer", "filter:\n", "filter:\n  alfa: 0.3\n")
    assert_refused(cli("run", path, "-o", "out"), "mission.yaml", "filter.alfa")


def test_an_unknown_key_of_set_is_refused(cli):
    assert_refused(cli("run", "builtin:practice_mer", "--set", "filter.alfa=1", "-o", "out"), "filter.alfa")


def test_invalid_yaml_is_refused(cli):
    Path("mission.yaml").write_text("name: [1, 2\nplanet: }")
    assert_refused(cli("run", "mission.yaml", "-o", "out"), "mission.yaml", "YAML")


def test_a_missing_mission_is_refused(cli):
    assert_refused(cli("run", "nowhere.yaml", "-o", "out"), "nowhere.yaml")


def test_the_package_has_the_rovers_telemetry(cli):
    result = cli("validate", "builtin:mer_b")
    assert result.exit_code == 0, result.output
    assert "mer_b.h5: the numbers of 1TRANSFORMED.TAB and 1HIGHRATE.TAB, unchanged, in compact form." in result.stdout


def test_a_volume_at_hand_is_preferred(cli, mer_folder, tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "mer_imu").symlink_to(mer_folder)
    monkeypatch.setenv("EDL_FILTER_DATA", str(tmp_path / "data"))
    result = cli("validate", "builtin:mer_b")
    assert result.exit_code == 0, result.output
    assert "SCLK" in result.stdout and "mer_b.h5" not in result.stdout


@pytest.mark.parametrize(
    ("path", "messages"),
    [
        ("builtin:mer_b", ("mer_b.h5: has the tables 1HIGHRATE, 1TRANSFORMED (MER-B Opportunity", "not 2TRANSFORMED")),
        ("builtin:mer_c", ("telemetry.path: found 'builtin:mer_c'; the package ships", "mer_a, mer_b")),
        ("builtin:practice_06", ("practice_06.h5: attribute format is 'edl-flight'; 'edl-mer-tables' is needed",)),
    ],
)
def test_wrong_data_of_the_package_are_refused(cli, path, messages):
    assert_refused(cli("run", "builtin:mer_a", "-o", "out", "--set", f"telemetry.path={path}"), *messages)


def test_a_rovers_tables_are_no_flight_file(cli):
    result = cli("run", "builtin:practice_mer", "-o", "out", "--set", "telemetry.path=builtin:mer_a")
    assert_refused(result, "mer_a.h5: attribute format is 'edl-mer-tables'; 'edl-flight' is needed")


@pytest.mark.slow
def test_demo_reconstructs_spirit(cli, spirit, monkeypatch):
    missions = []

    def run_mission(mission, *args):
        missions.append(mission)
        return Result(spirit)

    monkeypatch.setattr("edl_filter.workflow.run.run_mission", run_mission)
    result = cli("demo", "-o", "demo-results")
    assert result.exit_code == 0, result.output
    assert [mission.name for mission in missions] == ["mer_a"]
    assert result.stdout.splitlines()[-1] == "Look at demo-results/figures/altitude_velocity.png first."
    assert Path("demo-results/figures/altitude_velocity.png").is_file()


def test_a_missing_telemetry_folder_is_refused(cli):
    result = cli("run", "builtin:mer_a", "-o", "out", "--set", "telemetry.path=gone")
    assert_refused(result, "telemetry.path", "gone")


@pytest.fixture
def volume(mer_folder, tmp_path):
    """A copy of Spirit's tables."""
    copy = tmp_path / "volume" / "DATA"
    copy.mkdir(parents=True)
    for source in mer_folder.rglob("2*.*"):
        shutil.copy(source, copy)
    return copy


def test_a_missing_table_is_refused(cli, volume):
    (volume / "2HIGHRATE.TAB").unlink()
    result = cli("run", "builtin:mer_a", "-o", "out", "--set", f"telemetry.path={volume.parent}")
    assert_refused(result, "2HIGHRATE.TAB")


def test_a_truncated_table_is_refused(cli, volume):
    table = volume / "2TRANSFORMED.TAB"
    table.write_bytes(table.read_bytes()[:100_001])
    result = cli("run", "builtin:mer_a", "-o", "out", "--set", f"telemetry.path={volume.parent}")
    assert_refused(result, "2TRANSFORMED.TAB")


def test_a_label_inconsistent_with_its_table_is_refused(cli, volume):
    label = volume / "2HIGHRATE.LBL"
    text = label.read_bytes()
    assert text.count(b"= 2495") >= 1
    label.write_bytes(text.replace(b"= 2495", b"= 2496"))
    result = cli("run", "builtin:mer_a", "-o", "out", "--set", f"telemetry.path={volume.parent}")
    assert_refused(result, "2HIGHRATE", "2496")


def test_telemetry_of_the_other_rover_is_refused(cli, mer_folder):
    changes = ("--set", f"telemetry.path={mer_folder}", "--set", "telemetry.spacecraft=1")
    assert_refused(cli("run", "builtin:mer_a", "-o", "out", *changes), "telemetry.spacecraft", "MER-B Opportunity")


def test_telemetry_that_ends_within_highrate(cli, mer_folder):
    unused_constraints = [f"constraints.{name}=null" for name in ("landing", "rest", "steady_descent")]
    changes = (f"telemetry.path={mer_folder}", "telemetry.end_s=310", *unused_constraints)
    result = cli("run", "builtin:mer_a", "-o", "out", "--no-figures", *(a for c in changes for a in ("--set", c)))
    assert result.exit_code == 0, result.output
    assert "parachute deploy" in result.stdout


@pytest.mark.parametrize(
    ("key", "index", "value", "message"),
    [
        ("initial/attitude", 0, 2.0, "/initial/attitude has norm"),
        ("initial/covariance", (4, 4), -1.0, "/initial/covariance has -1 on its diagonal, row 4"),
        ("initial/position", slice(None), 3522.2, "/initial/position is 6100.63; m between 100000 and 1e+09 is needed"),
        ("constraints/landing/position_sigma", 0, 0.0, "/constraints/landing/position_sigma"),
    ],
)
def test_wrong_values_in_a_flight_file_are_refused(cli, builtin_flight, tmp_path, key, index, value, message):
    path = shutil.copy(builtin_flight, tmp_path / "flight.h5")
    with h5py.File(path, "a") as file:
        file[key][index] = value
    assert_refused(cli("validate", path), "flight.h5", message)
    assert_refused(
        cli("run", "builtin:practice_mer", "-o", "out", "--set", f"telemetry.path={path}"), "flight.h5", message
    )


def test_outputs_that_cannot_be_written_are_refused(cli, practice_06, monkeypatch):
    Path("file").touch()
    monkeypatch.setattr("edl_filter.pipeline.reconstruct.reconstruct", lambda mission: practice_06)
    assert_refused(cli("run", "builtin:practice_mer", "-o", "file"), "file: cannot be written (File exists)")
    Path("folder/result.nc").mkdir(parents=True)
    result = cli("run", "builtin:practice_mer", "-o", "folder")
    assert (result.exit_code, result.stderr) == (
        2,
        "edl-filter: folder/result.nc: cannot be written (it is a folder).\n",
    )
    assert [p.name for p in Path("folder").iterdir()] == ["result.nc"]
    shutil.rmtree("folder")
    log = EXAMPLES / "imu_log.csv", "--spec", EXAMPLES / "imu_log.spec.yaml"
    assert_refused(cli("convert", *log, "-o", "."), "it is a folder")
    assert_refused(cli("convert", *log, "-o", "file/flight.h5"), "file/flight.h5: cannot be written")
    write_outputs(Result(practice_06), "../result", figures=False)
    assert_refused(cli("export", "../result", "--to", "csv", "-o", "."), "it is a folder")
    assert_refused(cli("export", "../result", "--to", "csv", "-o", "file/t.csv"), "file/t.csv: cannot be written")


def test_a_file_that_is_no_flight_file_is_refused(cli):
    Path("text.h5").write_text("no HDF5")
    assert "text.h5" in cli("validate", "text.h5").stderr
    Path("text.h5").rename("flight.bin")
    assert_refused(cli("run", "builtin:practice_mer", "-o", "out", "--set", "telemetry.path=flight.bin"), "flight.bin")


def test_phoenix_telemetry_is_refused(cli):
    assert_refused(cli("run", "builtin:phoenix", "-o", "out"), "telemetry.path")


def test_a_result_that_is_not_to_be_trusted_has_exit_code_3(cli, builtin_flight):
    shutil.copy(builtin_flight, "flight.h5")
    with h5py.File("flight.h5", "r+") as file:
        site = file["constraints/landing"]
        site["position"][...] = site["position"][()] + [5e4, 0.0, 0.0]
    result = cli("run", "builtin:practice_mer", "-o", "out", "--no-figures", "--set", "telemetry.path=flight.h5")
    assert result.exit_code == 3, result.output
    assert result.stdout.startswith("Do not trust this result: landing contradicts all other data. Likeliest cause:")
    assert result.stdout.count("Do not trust") == 1
    summary = json.loads(Path("out/summary.json").read_text())
    assert summary["trustworthy"] is False
    assert summary["causes"][0]["sentence"] == "the measurement 'landing'"
    page = Path("out/report.html").read_text()
    assert "Do not trust this result: landing contradicts all other data." in page


@pytest.mark.slow
def test_swapped_axes_are_refused_with_their_cause(cli, builtin_flight):
    shutil.copy(builtin_flight, "flight.h5")
    with h5py.File("flight.h5", "r+") as file:
        for imu in file["imu"].values():
            imu["specific_force"][...] = imu["specific_force"][()][:, [1, 0, 2]]
    for command in (["run", "builtin:practice_mer", "-o", "out"], ["validate", "builtin:practice_mer"]):
        result = cli(*command, "--set", "telemetry.path=flight.h5")
        assert_input_error(
            result, "flight.h5: IMU primary: during the deceleration", "x and y exchanged in the accelerometers"
        )
    assert not Path("out").exists()


def test_a_run_says_what_it_replaces(cli, practice_06, monkeypatch):
    monkeypatch.setattr("edl_filter.workflow.run.run_mission", lambda *args: Result(practice_06))
    arguments = ("run", "builtin:practice_mer", "-o", "out", "--no-figures")
    assert "earlier" not in cli(*arguments).stdout
    Path("out/diagnosis.json").write_text("{}")
    again = cli(*arguments)
    assert "out holds an earlier result; it is replaced." in again.stdout
    assert "out holds the diagnosis of the earlier result; it is removed (diagnosis.json)." in again.stdout
    assert not Path("out/diagnosis.json").exists()


def test_an_interrupted_run_says_what_it_has_kept(cli, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("edl_filter.workflow.run.run_mission", interrupt)
    result = cli("run", "builtin:practice_mer", "-o", "out")
    assert result.exit_code == 130
    assert result.stderr == "edl-filter: interrupted. Nothing was written; what out held before is unchanged.\n"
    assert not Path("out").exists()


@pytest.mark.slow
def test_figures_have_the_stated_formats(cli):
    result = cli("run", "builtin:practice_mer", "-o", "out", "--format", "svg, pdf")
    assert result.exit_code == 0, result.output
    figures = Path("out/figures")
    stems = [{p.stem for p in figures.glob(f"*.{kind}")} for kind in ("svg", "pdf")]
    assert stems[0] == stems[1] and "altitude_velocity" in stems[0]
    assert len(list(figures.iterdir())) == 2 * len(stems[0])
    result = cli("run", "builtin:practice_mer", "-o", "out", "--no-figures")
    assert result.exit_code == 0 and not figures.exists()  # those of the earlier run are removed
    refused = cli("run", "builtin:practice_mer", "--format", "png,gif")
    assert_input_error(refused, "--format: found 'gif'; accepted are png")
