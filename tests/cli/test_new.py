"""Starting with a mission of your own: `new`, `missions`, ``--dry-run`` and ``--set``."""

import json
import re
from importlib.resources import files
from pathlib import Path

import pytest
from command_checks import assert_input_error

from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.new_mission import template_text
from edl_filter.mission.problems import mission_problems
from edl_filter.mission.shipped import SHIPPED_FLIGHTS

#: What fills in the template for the flight that the package ships.
FILLED_IN = {
    "atmosphere.density_sigma": "0.01", "atmosphere.wind_sigma": "1.0", "telemetry.path": "builtin:practice_06",
    "vehicle.mass": "832.0", "vehicle.mass_sigma": "0.0", "vehicle.diameter": "2.65", "vehicle.centre_of_mass": "0.27",
    "vehicle.inertia.xx": "270.0", "vehicle.inertia.yy": "205.0", "vehicle.inertia.zz": "210.0",
    "vehicle.inertia_sigma": "0.01", "vehicle.parachute.area_diameter": "15.09",
}  # fmt: skip


@pytest.mark.parametrize("name", ["mer_a", "mer_b", "practice_mer", "practice_phoenix"])
def test_a_new_mission_is_the_shipped_one_with_its_comments(cli, name):
    result = cli("new", "--from", f"builtin:{name}", "deep/my flight.yaml")
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("Written: 'deep/my flight.yaml'\nNext: edl-filter validate 'deep/my flight.yaml'")
    path = Path("deep/my flight.yaml")
    new, shipped = Mission.load(path), Mission.load(f"builtin:{name}")
    assert (new.name, str(new.output_directory())) == ("my_flight", "results/my_flight")
    unchanged = set(Mission.model_fields) - {"name", "outputs"}
    assert {k: getattr(new, k) for k in unchanged} == {k: getattr(shipped, k) for k in unchanged}
    assert mission_problems(path) == []
    text = path.read_text()
    assert "# kg m^2" in text and "m^3/s^2" in text
    assert "\noutputs:" not in text  # it had default values only


def test_a_new_mission_passes_validate(cli):
    cli("new", "--from", "builtin:practice_mer", "mine.yaml", "--set", "vehicle.mass=800")
    assert Mission.load("mine.yaml").vehicle.mass == 800.0
    result = cli("validate", "mine.yaml")
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("mine.yaml: mission mine, usable; 1 finding about samples.")


def test_the_template_says_what_to_fill_in_and_is_valid_then(cli):
    result = cli("new", "mine.yaml")
    assert result.stdout.splitlines()[1].startswith("Fill in the values marked FILL IN.")
    assert Path("mine.yaml").read_text().count("FILL IN") == len(FILLED_IN) + 1  # the first line explains it
    listed = cli("validate", "mine.yaml")
    keys = re.findall(r"^  mine\.yaml: (\S+): found nothing", listed.stderr, re.MULTILINE)
    assert listed.exit_code == 2 and sorted(keys) == sorted(FILLED_IN)
    changes = [a for key, value in FILLED_IN.items() for a in ("--set", f"{key}={value}")]
    result = cli("validate", "mine.yaml", *changes)
    assert result.exit_code == 0, result.output


def test_a_file_is_replaced_only_with_force(cli):
    Path("mine.yaml").write_text("precious")
    for source in ((), ("--from", "builtin:practice_mer")):
        assert_input_error(cli("new", *source, "mine.yaml"), "mine.yaml: found a file; --force replaces it.")
    assert Path("mine.yaml").read_text() == "precious"
    assert cli("new", "mine.yaml", "--force").exit_code == 0
    assert Path("mine.yaml").read_text() == template_text().replace("name: my_mission", "name: mine")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--from", "builtin:phoenix", "m.yaml"), "which edl-filter cannot read yet"),
        (("--from", "builtin:nothing", "m.yaml"), "builtin:nothing: found no such mission"),
        (("--set", "vehicle.mass=1", "m.yaml"), "--set: found a change without --from"),
        (("m.txt",), "m.txt: found the suffix '.txt'; expected a mission file, NAME.yaml."),
    ],
)
def test_a_mission_that_cannot_be_begun_is_refused(cli, arguments, message):
    assert_input_error(cli("new", *arguments), message)
    assert list(Path().iterdir()) == []


def test_paths_of_the_source_start_from_the_new_folder(cli):
    Path("old").mkdir()
    Path("old/flight.h5").touch()
    text = shipped_mission("practice_mer").read_text().replace("builtin:practice_06 ", "flight.h5 ")
    Path("old/m.yaml").write_text(text)
    assert cli("new", "--from", "old/m.yaml", "new/m.yaml").exit_code == 0
    assert Mission.load("new/m.yaml").telemetry.path == "../old/flight.h5"


def test_missions_flights_and_scenarios_are_listed(cli):
    text = cli("missions").stdout
    listed = json.loads(cli("missions", "--json").stdout)
    names = [*listed["missions"], *listed["flights"], *listed["scenarios"]]
    assert len(names) == 5 + 4 + 2
    assert all(f"  {name}" in text for name in names)
    shipped = {p.stem for p in Path(str(files("edl_filter") / "data")).glob("*.h5")}
    assert set(SHIPPED_FLIGHTS) == shipped - {"mer_a", "mer_b"}
    for flight in listed["flights"].values():
        arguments = flight["command"].split()[1:]
        assert cli(*arguments, "--dry-run").exit_code == 0


@pytest.mark.slow
def test_a_dry_run_lists_the_files_and_writes_none(cli):
    arguments = ("run", "builtin:practice_mer", "-o", "out")
    planned = json.loads(cli(*arguments, "--dry-run", "--json").stdout)["dry_run"]
    assert not Path("out").exists()
    assert planned["reads"][0] == str(shipped_mission("practice_mer"))
    assert Path(planned["reads"][1]).name == "practice_06.h5"
    assert planned["removes"] == []
    assert cli(*arguments).exit_code == 0
    written = {str(p) for p in Path("out").rglob("*") if p.is_file()}
    assert set(planned["writes"]) <= written <= {*planned["writes"], *planned["writes_if_data"]}
    before = {p: p.stat().st_mtime_ns for p in Path("out").rglob("*")}
    again = cli(*arguments, "--dry-run").stdout
    assert "Would replace or remove:\n  out/result.nc" in again and again.endswith("Nothing was written.\n")
    diagnosis = json.loads(cli("diagnose", "out", "--dry-run", "--json").stdout)["dry_run"]
    assert {p: p.stat().st_mtime_ns for p in Path("out").rglob("*")} == before
    cli("diagnose", "out", "--effect", "mass")
    changed = {str(p) for p in Path("out").rglob("*") if p.is_file() and before.get(p) != p.stat().st_mtime_ns}
    assert set(diagnosis["writes"]) <= changed <= {*diagnosis["writes"], *diagnosis["writes_if_data"]}


def test_a_dry_run_refuses_what_a_run_refuses(cli):
    Path("file").touch()
    assert_input_error(cli("run", "builtin:practice_mer", "-o", "file", "--dry-run"), "file: cannot be written")
    result = cli("run", "builtin:practice_mer", "--set", "atmosphere.table=none.csv", "--dry-run")
    assert_input_error(result, "atmosphere.table: found")
    assert_input_error(cli("diagnose", "nothing", "--dry-run"), "nothing: no such result")


def test_a_new_mission_names_files_of_its_folder_without_the_folder(cli):
    Path("flight.h5").touch()
    assert cli("new", "--from", "builtin:practice_mer", "m.yaml", "--set", "telemetry.path=flight.h5").exit_code == 0
    assert Mission.load("m.yaml").telemetry.path == "flight.h5"


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "sub/m.yaml"), ("run", "sub/m.yaml", "--dry-run"), ("validate", "sub/m.yaml"),
        ("improve", "sub/m.yaml", "-o", "out"), ("identifiability", "sub/m.yaml"),
        ("new", "new.yaml", "--from", "sub/m.yaml"),
    ],
)  # fmt: skip
def test_relative_paths_of_set_start_from_the_current_folder(cli, arguments):
    Path("sub").mkdir()
    Path("sub/m.yaml").write_text(shipped_mission("practice_mer").read_text())
    Path("sub/flight.h5").touch()
    result = cli(*arguments, "--set", "telemetry.path=flight.h5")
    assert_input_error(result, f"telemetry.path: found '{Path('flight.h5').absolute()}', but there is no")
