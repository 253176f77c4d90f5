"""A torque that changes on the way: the first change is in the model, the second is named, and both are refitted."""

import pytest

from edl_filter import Mission
from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.ranking import rank
from edl_filter.diagnosis.settle import settle
from edl_filter.diagnosis.verdict import judge
from edl_filter.effects.catalogue import effect_named
from edl_filter.effects.effect import Active
from edl_filter.effects.loading import find_effect
from edl_filter.mission.having import text_with
from edl_filter.mission.naming import write_mission
from edl_filter.simulation import Scenario, simulate

FIRST = {"Cl": 0.0, "Cm": 8e-4, "Cn": -5e-4, "t0": 120.0}
SECOND = {"Cl": 2e-6, "Cm": -6e-4, "Cn": 9e-4, "t0": 180.0}


def test_the_second_change_is_named_beside_the_first(tmp_path):
    both = Active(effect_named("remnant_torque"), FIRST), Active(find_effect("remnant_torque_2"), SECOND)
    path = simulate(Scenario.load("builtin:mer"), both, 12).write(tmp_path / "flight.h5")
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
    found = judge(rank(load_case(mission, both[:1]), [effect_named("remnant_torque"), effect_named("mass")]))
    assert found.verdict == "missing" and found.leader.name == "remnant_torque_2"
    # and both are a mission file that runs, refitted together
    text, _ = text_with(mission, found.entries[0].hypothesis.refit.effects)
    settled = settle(Mission.load(write_mission(mission, text, tmp_path / "both.yaml")))
    for active, true in zip(settled.reconstruction.effects, (FIRST, SECOND), strict=True):
        sigma = settled.sigma[active.name]
        for name, value in true.items():
            assert active.values[name] == pytest.approx(value, abs=4.0 * sigma[name]), (active.name, name)
