"""The shipped flight as it is read, for the tests of this folder."""

import pytest

from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_atmosphere, read_telemetry


@pytest.fixture(scope="module")
def inputs():
    """Mission, telemetry, planet, atmosphere of the shipped flight."""
    mission = Mission.load("builtin:practice_mer")
    telemetry = read_telemetry(mission)
    return mission, telemetry, mission.planet_model(telemetry.prime_meridian_at_epoch), read_atmosphere(mission)
