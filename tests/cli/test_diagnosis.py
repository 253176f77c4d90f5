"""`edl-filter effects` and `edl-filter add`: what they print and write."""

import json
from pathlib import Path

import pytest
from command_checks import assert_input_error
from contents import diagnosis, hypothesis
from user_effects import BUMP

from edl_filter.effects.registry import catalogue
from edl_filter.mission import Mission, shipped_mission


def write_diagnosis(**changes):
    """Write a diagnosis that ranks one effect, into the folder out."""
    Path("out").mkdir(exist_ok=True)
    Path("out/diagnosis.json").write_text(json.dumps(diagnosis(ranking=[hypothesis(**changes)])))


def test_the_catalogue_is_a_table(cli):
    result = cli("effects")
    assert result.exit_code == 0
    for name in catalogue():
        assert f" {name} " in result.stdout
    assert "\x1b" not in result.stdout


def test_one_effect_in_detail(cli):
    output = cli("effects", "remnant_torque").stdout
    for part in ("Shows: From t0 on", "AAS 06-087", "t0", "± 0.0015", "add MISSION remnant_torque"):
        assert part in output
    assert_input_error(
        cli("effects", "remnant_torqe"), "found no effect 'remnant_torqe'; nearest accepted: remnant_torque"
    )


def test_effects_as_json(cli):
    listing = json.loads(cli("effects", "--json").stdout)
    assert [e["name"] for e in listing["effects"]] == list(catalogue())
    wind = json.loads(cli("effects", "wind", "--json").stdout)
    assert wind["parameters"][0] | {"description": ""} == {
        "name": "east", "unit": "m/s", "description": "", "kind": "size", "sigma": 40.0, "low": -300.0, "high": 300.0,
        "default": 0.0,
    }  # fmt: skip


def test_add_writes_a_mission_with_the_effect(cli):
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
    """A long name must be separated from its comment."""
    assert cli("add", "builtin:practice_mer", name, "-o", "m.yaml").exit_code == 0
    assert [e.name for e in Mission.load("m.yaml").effects] == [name]


def test_a_second_effect_is_appended_and_a_file_is_replaced_only_if_it_is_the_mission(cli):
    cli("add", "builtin:practice_mer", "mass", "-o", "m.yaml", "--set", "k=0.01")
    text = Path("m.yaml").read_text()
    assert_input_error(
        cli("add", "builtin:practice_mer", "wind", "-o", "m.yaml"), "m.yaml: found a file; nothing is overwritten"
    )
    assert Path("m.yaml").read_text() == text
    result = cli("add", "m.yaml", "gyro_bias", "-o", "m.yaml", "--imu", "secondary")
    assert "All sizes of gyro_bias are zero: the effect is off until" in result.stdout
    assert Path("m.yaml").read_text().startswith(text)
    mass, bias = Mission.load("m.yaml").active_effects()
    assert (mass.name, bias.name, bias.imu) == ("mass", "gyro_bias", "secondary")
    assert cli("add", "m.yaml", "wind").stdout.startswith("Written: m+wind.yaml")
    assert_input_error(
        cli("add", "m.yaml", "wind"), "m+wind.yaml: found a file; nothing is overwritten: name another with -o."
    )


def test_values_of_set_take_precedence_over_those_of_a_diagnosis(cli):
    write_diagnosis()
    result = cli(
        "add", "builtin:practice_mer", "remnant_torque", "--from", "out", "--set", "Cl=1e-6", "--set", "Cm=0.002"
    )
    assert result.exit_code == 0, result.output
    assert result.stdout.endswith("-o out+remnant_torque\n")  # next to the result, as diagnose prints it
    (torque,) = Mission.load("practice_mer+remnant_torque.yaml").active_effects()
    assert torque.values == {"Cl": 1e-6, "Cm": 2e-3, "Cn": 0.0, "t0": 183.12346, "t1": float("inf")}


def test_an_alternative_of_a_hypothesis_has_its_own_estimates(cli):
    write_diagnosis(alternatives={"com_offset": {"parameters": {"dy": {"estimate": 4e-3, "sigma": 1e-4, "unit": "m"}}}})
    result = cli("add", "builtin:practice_mer", "com_offset", "--from", "out")
    assert result.exit_code == 0, result.output
    (offset,) = Mission.load("practice_mer+com_offset.yaml").active_effects()
    assert offset.values == {"dx": 0.0, "dy": 4e-3, "dz": 0.0}


@pytest.mark.parametrize(
    ("effect", "text", "message"),
    [
        ("wind", None, "out/diagnosis.json: found no estimate of wind; it has estimates of remnant_torque."),
        ("com_offset", None, "found no estimate of com_offset; it has estimates of remnant_torque."),
        ("wind", "{", "out/diagnosis.json: found no JSON (Expecting property name"),
        ("wind", "{}", "out/diagnosis.json: verdict: found nothing; expected a required key"),
        (
            "wind",
            json.dumps(diagnosis(ranking=[hypothesis(effect="wind", parameters={"east": 3})])),
            "out/diagnosis.json: ranking.0.parameters.east: found 3; expected a section of keys",
        ),
        ("wind", "", "out/diagnosis.json: found no JSON (Expecting value"),
    ],
)
def test_a_diagnosis_without_estimates_is_refused(cli, effect, text, message):
    write_diagnosis()
    if text is not None:
        Path("out/diagnosis.json").write_text(text)
    assert_input_error(cli("add", "builtin:practice_mer", effect, "--from", "out"), message)
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
        (("builtin:practice_mer", "bump", "--file", "bump.py"), "bump.py: there is no such file"),
    ],
)
def test_wrong_effects_and_options_are_refused(cli, arguments, message):
    assert_input_error(cli("add", *arguments), message)
    assert list(Path().iterdir()) == []


def test_an_effect_of_a_file_is_listed(cli):
    Path("bump.py").write_text(BUMP)
    output = cli("effects", "--file", "bump.py").stdout
    assert " bump " in output and "a ± 0.1 m/s^2" in output


def test_add_rebases_relative_paths_to_the_new_folder(cli):
    Path("old/data").mkdir(parents=True)
    Path("old/data/flight.h5").touch()
    Path("old/bump.py").write_text(BUMP)
    text = shipped_mission("practice_mer").read_text().replace("builtin:practice_06 ", "data/flight.h5 ")
    Path("old/m.yaml").write_text(text)
    assert cli("add", "old/m.yaml", "bump", "--file", "old/bump.py", "-o", "old/first.yaml").exit_code == 0
    assert Mission.load("old/first.yaml").effects[0].file == "bump.py"
    result = cli("add", "old/first.yaml", "mass", "-o", "new/deep/second.yaml")
    assert result.exit_code == 0, result.output
    second = Mission.load("new/deep/second.yaml")
    assert second.telemetry.path == "../../old/data/flight.h5" and second.telemetry_path().is_file()
    assert second.effects[0].file == "../../old/bump.py" and second.active_effects()[0].name == "bump"
