"""Missions that the package ships."""

import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission


def test_an_unknown_name_lists_the_shipped_missions():
    with pytest.raises(InputError, match="builtin:mer_c: found no such mission; expected one of mer_a, mer_b"):
        Mission.load("builtin:mer_c")


def test_a_flight_in_place_of_a_mission_is_refused_with_the_mission_that_runs_it():
    advice = "Use builtin:practice_phoenix --set telemetry.path=builtin:unknown_3"
    with pytest.raises(InputError, match=f"found a flight file; expected a mission. {advice}"):
        Mission.load("builtin:unknown_3")
