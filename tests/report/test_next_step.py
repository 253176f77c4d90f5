"""The next step after a diagnosis."""

from pathlib import Path

import contents

from edl_filter.report.next_step import NextStep, next_step
from edl_filter.results.schema import DiagnosisContent


def step(mission="m.yaml", folder="out", **changes):
    return next_step(DiagnosisContent.of(contents.diagnosis(**changes)), mission, Path(folder))


def test_a_missing_effect_is_added_and_refitted():
    missing = step()
    assert missing.sentence == "Next: add remnant_torque to the model and refit it:"
    assert missing.commands == (
        "edl-filter add m.yaml remnant_torque --from out",
        "edl-filter run m+remnant_torque.yaml -o out+remnant_torque",
    )


def test_a_shipped_mission_an_imu_and_a_file_of_effects_are_in_the_commands():
    first = contents.hypothesis(imu="second imu")
    own = {"remnant_torque": "my effect.py"}
    add, run = step("builtin:mer_a", "my results/a", ranking=[first], own_effects=own).commands
    assert add == (
        "edl-filter add builtin:mer_a remnant_torque --from 'my results/a' --imu 'second imu' --file 'my effect.py'"
    )
    assert run == "edl-filter run mer_a+remnant_torque.yaml -o 'my results/a+remnant_torque'"


def test_the_first_of_several_names_is_tried():
    undecided = step(verdict="undecided")
    assert "the most probable effect" in undecided.sentence and undecided.commands == step().commands


def test_what_no_name_explains_is_written_as_an_effect():
    for changes in ({"verdict": "unknown"}, {"verdict": "undecided", "ranking": []}):
        assert step(**changes).commands == ("edl-filter diagnose out --file my_effect.py",)


def test_a_clean_flight_needs_nothing():
    assert step(verdict="clean") == NextStep()
