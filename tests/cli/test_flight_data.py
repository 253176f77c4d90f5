"""`convert`, `export`, `fetch` and `simulate`: what they write, and wrong input."""

from pathlib import Path

import h5py
import pytest
from command_checks import assert_input_error, assert_refused
from mer_volume import contents

from edl_filter.io.csv_table import package_data
from edl_filter.results import Result
from edl_filter.workflow.run import write_outputs

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.mark.parametrize("command", ["convert", "simulate"])
def test_an_existing_file_is_replaced_only_with_force(cli, command):
    arguments = {
        "convert": (EXAMPLES / "imu_log.csv", "--spec", EXAMPLES / "imu_log.spec.yaml"),
        "simulate": ("builtin:nothing",),
    }[command]
    Path("f.h5").write_text("precious")
    assert_input_error(cli(command, *arguments, "-o", "f.h5"), "f.h5: found a file; --force replaces it.")
    assert Path("f.h5").read_text() == "precious"
    if command == "convert":
        assert cli(command, *arguments, "-o", "f.h5", "--force").exit_code == 0
        assert Path("f.h5").stat().st_size > 1000


def test_convert_the_example_of_the_documentation(cli):
    result = cli("convert", EXAMPLES / "imu_log.csv", "--spec", EXAMPLES / "imu_log.spec.yaml", "-o", "f.h5")
    assert result.exit_code == 0, result.output
    assert cli("validate", "f.h5").exit_code == 0


def test_export(cli, practice_06):
    write_outputs(Result(practice_06), "out", figures=False)
    result = cli("export", "out", "--to", "csv", "-o", "t.csv")
    assert result.stdout.strip() == "Written: t.csv"
    assert Path("t.csv").read_text().startswith("time [s],utc,")


def test_an_export_replaces_a_file_only_when_forced(cli, practice_06):
    write_outputs(Result(practice_06), "out", figures=False)
    Path("out/trajectory.csv").write_text("mine")
    assert_input_error(cli("export", "out", "--to", "csv"), "trajectory.csv: found a file; --force replaces it")
    assert Path("out/trajectory.csv").read_text() == "mine"
    assert cli("export", "out", "--to", "csv", "--force").exit_code == 0
    assert Path("out/trajectory.csv").read_text().startswith("time [s],utc,")


def test_a_full_disk_is_reported_with_the_file(cli, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("edl_filter.telemetry.flight_file_writer._write_tree", full)
    result = cli("convert", EXAMPLES / "imu_log.csv", "--spec", EXAMPLES / "imu_log.spec.yaml", "-o", "f.h5")
    assert_refused(result, "f.h5: cannot be written (No space left on device)")
    assert list(Path().iterdir()) == []


def test_an_incomplete_result_is_refused(cli, practice_06):
    write_outputs(Result(practice_06), "../result", figures=False)
    with h5py.File("../result/result.nc", "a") as file:
        del file["trajectory"]
    assert_refused(cli("export", "../result", "--to", "csv", "-o", "t.csv"), "/trajectory is missing")
    assert not Path("t.csv").exists()


def test_a_missing_result_is_refused(cli):
    assert_refused(cli("export", "none.nc", "--to", "csv"), "none.nc: no such result")


def test_a_missing_log_is_refused(cli):
    result = cli("convert", "none.csv", "--spec", EXAMPLES / "imu_log.spec.yaml", "-o", "f.h5")
    assert_refused(result, "none.csv")


def test_an_unknown_data_set_is_refused(cli):
    assert_refused(cli("fetch", "phoenix"), "'phoenix'", "mer-imu")


def test_fetch_recognises_the_originals_and_writes_the_packages_files(cli, mer_originals, tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "mer_imu").symlink_to(mer_originals)
    monkeypatch.setenv("EDL_FILTER_DATA", str(tmp_path / "data"))
    result = cli("fetch", "mer-imu", "--compact", "compact")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines() == [
        "All tables are there, with the right checksums; nothing is downloaded.",
        f"MER telemetry: {tmp_path / 'data' / 'mer_imu'}", "Written: compact/mer_a.h5", "Written: compact/mer_b.h5"
    ]  # fmt: skip
    for name in ("mer_a", "mer_b"):
        assert contents(f"compact/{name}.h5") == contents(package_data(f"{name}.h5"))


def test_simulate_writes_a_valid_flight_file(cli):
    result = cli("simulate", "builtin:mer", "-o", "flight.h5", "--seed", "7", "--set", "name=seventh")
    assert result.exit_code == 0, result.output
    assert result.stdout == "Written: flight.h5\n"
    result = cli("validate", "flight.h5")
    assert result.exit_code == 0 and "no errors found" in result.stdout


def test_wrong_scenarios_are_refused(cli):
    assert_refused(cli("simulate", "builtin:beagle", "-o", "flight.h5"), "builtin:beagle", "mer, phoenix")
    assert_refused(cli("simulate", "nowhere.yaml", "-o", "flight.h5"), "nowhere.yaml")
    result = cli("simulate", "builtin:mer", "-o", "flight.h5", "--set", "entry.flight_path_angle_deg=20")
    assert_refused(result, "has not reached the parachute's dynamic pressure")
