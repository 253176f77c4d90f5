"""Screening of the readings of one instrument."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.mission import Mission
from edl_filter.navigation.filter import run_filter
from edl_filter.pipeline.reconstruct import reconstruct


@pytest.fixture(scope="module")
def spirit():
    return reconstruct(Mission.load("builtin:mer_a"), leave_one_out=False).problem


@pytest.mark.parametrize("method", ["ukf", "ekf"])
@pytest.mark.parametrize("degrees", [0.05, 1.0])
def test_a_wrong_first_attitude_does_not_reject_the_others(spirit, method, degrees):
    """The first reading determines the error of the on-board attitude; neither position nor velocity is measured."""
    first = next(c for c in spirit.constraints if c.name == "onboard_attitude")
    turn = rotations.from_rotation_vector(np.radians([degrees, 0.0, 0.0]))
    wrong = replace(first, inertial_from_body=rotations.multiply(first.inertial_from_body, turn))
    constraints = tuple(wrong if c is first else c for c in spirit.constraints)
    settings = replace(spirit.settings, method=method)
    uses = run_filter(replace(spirit, constraints=constraints, settings=settings)).fused
    assert [u.constraint for u in uses if not u.accepted] == [wrong]
