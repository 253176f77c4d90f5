"""Flights in a world that no table states exactly: clean ones are clean, and what is hidden in one is named.

Tables, air, mass and inertia are drawn as in the study of an inexact world (`benchmarks/studies/inexact_world.py`); the
mission is the nominal one with the sigmas of the draw.
"""

import numpy as np
import pytest
from inexact_world import draw_world

from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import catalogue, find_effect
from edl_filter.simulation import simulate

pytestmark = pytest.mark.effects

SEED = 180
#: m; of the plausible size of the catalogue.
OFFSET = {"dx": 0.0, "dy": 0.004, "dz": -0.003}


def diagnosed(vehicle, hidden, folder):
    """Diagnosis of a flight in the world of a vehicle, with the whole catalogue."""
    world = draw_world(vehicle, np.random.default_rng(SEED))
    path = simulate(world.scenario(folder), hidden, SEED).write(folder / "flight.h5")
    return diagnose(load_case(world.mission(path), ()), catalogue().values())


@pytest.mark.parametrize("vehicle", ["mer", "phoenix"])
def test_a_clean_flight_in_an_inexact_world_is_clean(vehicle, tmp_path):
    diagnosis = diagnosed(vehicle, (), tmp_path)
    assert diagnosis.content()["verdict"] == "clean", diagnosis.verdict.sentence


@pytest.mark.parametrize("vehicle", ["mer", "phoenix"])
def test_a_hidden_offset_of_the_centre_of_mass_is_named_with_its_size(vehicle, tmp_path):
    """It is fixed to the body, which no symmetric table can imitate."""
    diagnosis = diagnosed(vehicle, (EffectInstance(find_effect("com_offset"), OFFSET),), tmp_path)
    assert diagnosis.verdict.verdict == "missing", diagnosis.verdict.sentence
    hypothesis = diagnosis.verdict.entries[0].hypothesis
    assert hypothesis.name == "com_offset"
    for name, (estimate, sigma) in hypothesis.fit.parameters(("com_offset", None)).items():
        assert abs(estimate - OFFSET[name]) < 3.5 * sigma, (name, estimate, sigma)
