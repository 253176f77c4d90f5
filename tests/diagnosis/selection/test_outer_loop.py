"""Two torques that begin at different times: the second is named with the first in the model, then both are fitted."""

import pytest

from edl_filter import Mission
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.selection.decision import decide
from edl_filter.diagnosis.selection.outer_loop import can_fit_effects, fit_effects
from edl_filter.diagnosis.selection.ranking import rank
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import effect_named, find_effect
from edl_filter.errors import InputError
from edl_filter.mission.edit_effects import text_with_effects
from edl_filter.mission.files import write_mission
from edl_filter.simulation import Scenario, simulate

FIRST = {"Cl": 0.0, "Cm": 8e-4, "Cn": -5e-4, "t0": 120.0}
SECOND = {"Cl": 2e-6, "Cm": -6e-4, "Cn": 9e-4, "t0": 180.0}


def test_the_second_torque_is_named_and_both_are_fitted(tmp_path):
    both = (
        EffectInstance(effect_named("remnant_torque"), FIRST),
        EffectInstance(find_effect("remnant_torque_2"), SECOND),
    )
    path = simulate(Scenario.load("builtin:mer"), both, 12).write(tmp_path / "flight.h5")
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
    verdict = decide(rank(load_case(mission, both[:1]), [effect_named("remnant_torque"), effect_named("mass")]))
    assert verdict.verdict == "missing" and verdict.leader.name == "remnant_torque_2"
    # and both are a mission file that runs, in which they are fitted together
    text, _ = text_with_effects(mission, verdict.entries[0].hypothesis.fit.effects)
    fitted = fit_effects(Mission.load(write_mission(mission, text, tmp_path / "both.yaml")))
    for instance, true in zip(fitted.reconstruction.effects, (FIRST, SECOND), strict=True):
        sigma = fitted.sigma[instance.name]
        for name, value in true.items():
            assert instance.values[name] == pytest.approx(value, abs=4.0 * sigma[name]), (instance.name, name)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (["effects=[{name: mass}]"], True),
        (["effects=[{name: mass, fixed: true}]"], False),
        ([], False),
        (["effects=[{name: mass}]", "aerodynamics=null"], False),
    ],
)
def test_what_is_needed_to_fit_effects(changes, expected):
    assert can_fit_effects(Mission.load("builtin:practice_mer", changes)) == expected


def test_an_effect_that_stands_twice_is_refused():
    mission = Mission.load("builtin:practice_mer", ["effects=[{name: gyro_bias}, {name: gyro_bias, imu: primary}]"])
    with pytest.raises(InputError, match="found gyro_bias twice"):
        fit_effects(mission)
