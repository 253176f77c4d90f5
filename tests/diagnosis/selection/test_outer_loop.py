"""What the refit of effects needs; refits themselves are in tests/workflow and tests/flights."""

import pytest

from edl_filter import Mission
from edl_filter.diagnosis.selection.outer_loop import can_fit_effects, fit_effects
from edl_filter.errors import InputError


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
