"""`edl-filter effects` and `edl-filter add`: what they print and write, and that a mission's text stays as it was."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.effects.catalogue import catalogue
from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.adding import add_effect
from edl_filter.mission.appending import append_entry, seen_from
from edl_filter.mission.text import parse


@pytest.fixture
def cli(tmp_path, monkeypatch):
    """Run a command in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda *args: CliRunner().invoke(app, [str(a) for a in args])


def refused(result, *parts):
    assert result.exit_code == 2, result.output
    assert result.stdout == "" and "Traceback" not in result.stderr
    for part in parts:
        assert part in result.stderr


def diagnosis(**changes):
    entry = {"effect": "remnant_torque", "same_as": ["com_offset"], "probability": 0.9, "parameters": {
        "Cm": {"estimate": 1.5e-3, "sigma": 1e-4, "unit": ""},
        "t0": {"estimate": 183.123456789, "sigma": 2.0, "unit": "s"},
    }}  # fmt: skip
    Path("out").mkdir(exist_ok=True)
    Path("out/diagnosis.json").write_text(json.dumps({"verdict": "missing", "ranking": [entry | changes]}))


def test_the_catalogue_is_a_table(cli):
    result = cli("effects")
    assert result.exit_code == 0
    for name in catalogue():
        assert f" {name} " in result.stdout
    assert "\x1b" not in result.stdout


def test_one_effect_in_detail(cli):
    told = cli("effects", "remnant_torque").stdout
    for part in (
        "Shows: From one moment on",
        "AAS 06-087",
        "t0",
        "± 0.0015",
        "add MISSION remnant_torque",
    ):
        assert part in told
    refused(cli("effects", "remnant_torqe"), "found no effect 'remnant_torqe'; nearest accepted: remnant_torque")


def test_effects_as_json(cli):
    told = json.loads(cli("effects", "--json").stdout)
    assert [e["name"] for e in told["effects"]] == list(catalogue())
    wind = json.loads(cli("effects", "wind", "--json").stdout)
    assert wind["parameters"][0] | {"description": ""} == {
        "name": "east", "unit": "m/s", "description": "", "kind": "size", "sigma": 40.0, "low": -300.0, "high": 300.0,
        "default": 0.0,
    }  # fmt: skip


def test_add_writes_a_mission_that_runs_with_the_effect(cli):
    result = cli("add", "builtin:practice_mer", "com_offset", "--set", "dy=4e-3")
    assert result.exit_code == 0, result.output
    assert result.stdout == (
        "Written: practice_mer+com_offset.yaml\n"
        "Next: edl-filter run practice_mer+com_offset.yaml -o results/practice_mer+com_offset\n"
    )
    text = Path("practice_mer+com_offset.yaml").read_text()
    assert text.startswith(shipped_mission("practice_mer").read_text())
    (offset,) = Mission.load("practice_mer+com_offset.yaml").active_effects()
    assert offset.values == {"dx": 0.0, "dy": 4e-3, "dz": 0.0} and not offset.fixed


@pytest.mark.parametrize("name", catalogue())
def test_every_effect_of_the_catalogue_can_be_added(cli, name):
    """A long name must not run into its comment."""
    assert cli("add", "builtin:practice_mer", name, "-o", "m.yaml").exit_code == 0
    assert [e.name for e in Mission.load("m.yaml").effects] == [name]


def test_a_second_effect_comes_after_the_first_and_in_place_only_if_asked(cli):
    cli("add", "builtin:practice_mer", "mass", "-o", "m.yaml", "--set", "k=0.01")
    before = Path("m.yaml").read_text()
    refused(cli("add", "builtin:practice_mer", "wind", "-o", "m.yaml"), "m.yaml: found a file; nothing is overwritten")
    assert Path("m.yaml").read_text() == before
    result = cli("add", "m.yaml", "gyro_bias", "-o", "m.yaml", "--imu", "secondary")
    assert "All sizes of gyro_bias are zero: it is off until" in result.stdout
    assert Path("m.yaml").read_text().startswith(before)
    mass, bias = Mission.load("m.yaml").active_effects()
    assert (mass.name, bias.name, bias.imu) == ("mass", "gyro_bias", "secondary")
    assert cli("add", "m.yaml", "wind").stdout.startswith("Written: m+wind.yaml")
    refused(cli("add", "m.yaml", "wind"), "m+wind.yaml: found a file; nothing is overwritten: name another with -o.")


def test_starting_values_come_from_a_diagnosis_and_set_goes_before_them(cli):
    diagnosis()
    result = cli(
        "add", "builtin:practice_mer", "remnant_torque", "--from", "out", "--set", "Cl=1e-6", "--set", "Cm=0.002"
    )
    assert result.exit_code == 0, result.output
    assert result.stdout.endswith("-o out+remnant_torque\n")  # beside the result, as diagnose says
    (torque,) = Mission.load("practice_mer+remnant_torque.yaml").active_effects()
    assert torque.values == {"Cl": 1e-6, "Cm": 2e-3, "Cn": 0.0, "t0": 183.12346, "t1": float("inf")}


def test_a_name_that_cannot_be_told_from_the_first_has_its_own_estimates(cli):
    diagnosis(alternatives={"com_offset": {"parameters": {"dy": {"estimate": 4e-3, "sigma": 1e-4, "unit": "m"}}}})
    result = cli("add", "builtin:practice_mer", "com_offset", "--from", "out")
    assert result.exit_code == 0, result.output
    (offset,) = Mission.load("practice_mer+com_offset.yaml").active_effects()
    assert offset.values == {"dx": 0.0, "dy": 4e-3, "dz": 0.0}


@pytest.mark.parametrize(
    ("effect", "text", "message"),
    [
        ("wind", None, "out/diagnosis.json: found no estimate of wind; it has estimates of remnant_torque."),
        ("com_offset", None, "found no estimate of com_offset; it has estimates of remnant_torque."),
        ("wind", "{", "out/diagnosis.json: Expecting property name"),
        ("wind", "{}", "found no ranking of effects with estimates (KeyError('ranking') is missing)"),
        ("wind", '{"ranking": [{"effect": "wind", "parameters": {"east": 3}}]}', "found no ranking of effects"),
        ("wind", "", "out/diagnosis.json: Expecting value"),
    ],
)
def test_a_diagnosis_that_does_not_help(cli, effect, text, message):
    diagnosis()
    if text is not None:
        Path("out/diagnosis.json").write_text(text)
    refused(cli("add", "builtin:practice_mer", effect, "--from", "out"), message)
    assert sorted(p.name for p in Path().iterdir()) == ["out"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("builtin:practice_mer", "winds"), "found no effect 'winds'; nearest accepted: wind"),
        (("nowhere.yaml", "wind"), "nowhere.yaml"),
        (("builtin:practice_mer", "wind", "--from", "none"), "none: found no diagnosis; expected a folder in which"),
        (
            ("builtin:practice_mer", "wind", "--set", "est=1"),
            "effects.0.parameters.est: found an unknown key",
        ),
        (("builtin:practice_mer", "wind", "--set", "east=999"), "east: found 999; expected m/s between -300 and 300"),
        (("builtin:practice_mer", "wind", "--set", "east"), "--set east: found no PARAMETER=NUMBER"),
        (("builtin:practice_mer", "wind", "--set", "east=much"), "--set east=much: found no PARAMETER=NUMBER"),
        (("builtin:practice_mer", "wind", "--imu", "primary"), "effects.0.imu: found 'primary'; expected none"),
        (("builtin:practice_mer", "mine", "--file", "mine.py"), "mine.py: there is no such file"),
    ],
)
def test_what_cannot_be_added(cli, arguments, message):
    refused(cli("add", *arguments), message)
    assert list(Path().iterdir()) == []


USER = """
from edl_filter.effects import Effect, Parameter

class Mine(Effect):
    name = "mine"
    parameters = (Parameter("a", "m/s^2", "how much", 0.1, low=-1.0, high=1.0),)
"""


def test_files_stay_found_from_another_folder(cli):
    Path("there/data").mkdir(parents=True)
    Path("there/data/flight.h5").touch()
    Path("there/mine.py").write_text(USER)
    text = shipped_mission("practice_mer").read_text().replace("builtin:practice_06 ", "data/flight.h5 ")
    Path("there/m.yaml").write_text(text)
    assert cli("add", "there/m.yaml", "mine", "--file", "there/mine.py", "-o", "there/one.yaml").exit_code == 0
    assert Mission.load("there/one.yaml").effects[0].file == "mine.py"
    result = cli("add", "there/one.yaml", "mass", "-o", "here/deep/two.yaml")
    assert result.exit_code == 0, result.output
    two = Mission.load("here/deep/two.yaml")
    assert two.telemetry.path == "../../there/data/flight.h5" and two.telemetry_path().is_file()
    assert two.effects[0].file == "../../there/mine.py" and two.active_effects()[0].name == "mine"


def test_a_list_in_brackets_or_empty_is_taken_on():
    for effects in ("[]", "[{name: mass}]", "", "[ {name: mass}, # one\n  {name: wind} ]"):
        text = f"name: a\neffects: {effects}\nlast: 1  # stays\n"
        new = parse(append_entry(text, "effects", {"name": "new"}, ["name: new"], "m"), "m")
        assert new == parse(text, "m") | {"effects": [*(parse(text, "m")["effects"] or []), {"name": "new"}]}


NAMES = st.sampled_from(["a", "b", "c"])
VALUES = st.integers() | st.none() | st.text("ab #:\n", max_size=6) | st.lists(st.integers(), max_size=2)
ENTRIES = st.lists(st.dictionaries(NAMES, VALUES | st.dictionaries(NAMES, VALUES, max_size=2), max_size=3), min_size=1)


@given(st.dictionaries(NAMES, VALUES, min_size=1), ENTRIES, st.dictionaries(NAMES, VALUES), st.integers(0, 2))
def test_appending_changes_nothing_else(before, entries, after, comments):
    import yaml

    def dumped(data):
        return yaml.safe_dump(data, sort_keys=False, default_flow_style=False) if data else ""

    text = dumped(before) + dumped({"effects": entries}) + "# about what follows\n\n" * comments
    text += dumped({f"z{k}": v for k, v in after.items()})
    expected = parse(text, "m")
    expected["effects"] = [*expected["effects"], {"name": "new", "parameters": {"k": 1}}]
    new = append_entry(text, "effects", expected["effects"][-1], ["name: new", "parameters:", "  k: 1  # said"], "m")
    assert parse(new, "m") == expected
    assert new.count("# about") == comments


def test_paths_that_need_no_change_stay(tmp_path):
    text = "a: builtin:x\nb: /abs\nc: ~/home\nd: rel/x.csv # said\ne: [{f: one.py}, {f: 3}]\n"
    keys = ("a", "b", "c", "d", "e.*.f", "g.h")
    assert seen_from(text, keys, tmp_path, tmp_path, "m") == text
    moved = seen_from(text, keys, tmp_path, tmp_path / "sub", "m")
    assert moved == text.replace("rel/x.csv", '"../rel/x.csv"').replace("one.py", '"../one.py"')


def test_an_effect_of_a_file_is_written_with_its_file(cli):
    Path("mine.py").write_text(USER)
    told = cli("effects", "--file", "mine.py").stdout
    assert " mine " in told and "a ± 0.1 m/s^2" in told
    path = add_effect("builtin:practice_mer", "mine", Path("m.yaml"), ["a=0.5"], file="mine.py")
    (mine,) = Mission.load(path).active_effects()
    assert mine.values == {"a": 0.5}
    with pytest.raises(InputError, match=r"effects.0.parameters.a: found 2; expected m/s\^2 between -1 and 1"):
        add_effect("builtin:practice_mer", "mine", Path("x/m.yaml"), ["a=2"], file="mine.py")
