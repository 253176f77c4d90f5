"""Effects that a mission lists."""

import math

import pytest
from shipped_missions import error_of, load
from user_effects import BUMP

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.yaml_text import parse


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        (
            "{name: gyro_bais}",
            "effects.0.name: found 'gyro_bais'; expected the name of an effect; nearest accepted: gyro_bias",
        ),
        (
            "{name: wind, parameters: {est: 1}}",
            "effects.0.parameters.est: found an unknown key; expected a parameter of wind; nearest accepted: east",
        ),
        ("{name: mass, parameters: {k: 3}}", "effects.0.parameters.k: found 3; expected between -0.5 and 1"),
        ("{name: mass, parameters: {k: .nan}}", "effects.0.parameters.k: found nan; expected a number, or .inf"),
        ("{name: mass, parameters: {k: '1'}}", "effects.0.parameters.k: found '1' (text); expected a number"),
        ("{name: mass, imu: primary}", "effects.0.imu: found 'primary'; expected none: mass sits in no IMU"),
        ("{name: mass, fixed: 1}", "effects.0.fixed: found 1; expected true or false"),
        ("{name: mass, fixd: true}", "effects.0.fixd: found an unknown key; nearest accepted: effects.0.fixed"),
        ("{parameters: {}}", "effects.0.name: found nothing; expected a required key (name in the catalogue"),
    ],
)
def test_wrong_effects_are_refused(entry, expected):
    assert f"--set {expected}" in error_of(f"effects=[{entry}]", name="practice_mer")


def test_every_wrong_effect_is_counted():
    message = error_of("effects=[{name: wind, parameters: {est: 1, east: 4e3}}, {name: mas}]", name="practice_mer")
    assert message.endswith("(and 2 more problems)") and "effects.0.parameters.est" in message


def test_effects_have_all_parameters_and_the_order_of_the_file():
    torque = "{name: remnant_torque, parameters: {Cm: 1e-3, t0: 120, t1: .inf}, fixed: true}"
    mission = load("practice_mer", f"effects=[{torque}, {{name: gyro_bias, imu: secondary}}]")
    assert Mission.from_dict(parse(mission.text, "reparsed")).effects == mission.effects
    torque, bias = mission.active_effects()
    assert (torque.name, torque.fixed, torque.imu) == ("remnant_torque", True, None)
    assert torque.values == {"Cl": 0.0, "Cm": 1e-3, "Cn": 0.0, "t0": 120.0, "t1": math.inf}
    assert (bias.name, bias.fixed, bias.imu) == ("gyro_bias", False, "secondary")
    assert bias.values == {"bx": 0.0, "by": 0.0, "bz": 0.0}
    assert load("practice_mer").active_effects() == ()


def test_the_file_of_a_users_effect_is_relative_to_the_missions_folder(tmp_path):
    (tmp_path / "bump.py").write_text(BUMP)
    path = tmp_path / "m.yaml"
    text = load("practice_mer").text + "effects: [{name: bump, file: bump.py, parameters: {a: 0.2}}]\n"
    path.write_text(text)
    (bump,) = Mission.load(path).active_effects()
    assert bump.name == "bump" and bump.values == {"a": 0.2}
    for old, new, expected in (
        ("a: 0.2", "a: 2", "m.yaml: effects.0.parameters.a: found 2; expected m/s^2 between -1 and 1."),
        ("name: bump", "name: bumb", "bump.py: found no effect 'bumb'; nearest accepted: bump."),
        ("bump.py", "other.py", "effects.0.file: found 'other.py', but there is no file"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(InputError) as caught:
            Mission.load(path).active_effects()
        assert expected in str(caught.value)
