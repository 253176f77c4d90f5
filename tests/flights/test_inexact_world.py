"""Flights in a world that no table states exactly: clean ones are clean, and what is hidden in one is named.

Tables, air, mass and inertia are drawn as in the study of an inexact world (`benchmarks/studies/inexact_world.py`); the
mission is the nominal one with the sigmas of the draw.
"""

import numpy as np
import pytest
from inexact_world import draw_world

from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.credible_model import credible_model
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.registry import catalogue, find_effect
from edl_filter.simulation import simulate

pytestmark = pytest.mark.effects

SEED = 180
#: m; of the plausible size of the catalogue.
OFFSET = {"dx": 0.0, "dy": 0.004, "dz": -0.003}
#: 1 and s; one sigma of the database's Cm.
TORQUE = {"Cl": 0.0, "Cm": 1e-3, "Cn": -5e-4, "t0": 150.0}
STATED_ASYMMETRY = ("aerodynamics.discrepancy.asymmetry_sigma=1",)


class Asymmetry(Effect):
    """Lateral force and moment that are fixed to the body, smooth functions of the Mach number of random phases."""

    name = "asymmetry"
    parameters = (Parameter("size", "", "rms over one sigma of the database above Mach 10", 1.0),)

    def force_moment(self, p, flow):
        """Of each of CY, CN, Cm and Cn a sum of twelve waves along ln Mach over its correlation length."""
        random = np.random.default_rng(4)
        distance = np.log(flow.mach) / 0.5
        coefficients = []
        for sigma in (0.01 / 3.0, 0.01 / 3.0, 0.003 / 3.0, 0.003 / 3.0):
            frequency, phase = random.normal(size=12), random.uniform(0.0, 2.0 * np.pi, 12)
            waves = np.cos(np.outer(distance, frequency) + phase).sum(axis=1) * np.sqrt(2.0 / 12.0)
            coefficients.append(p["size"] * sigma * waves)
        push = (flow.dynamic_pressure * flow.area)[:, None]
        cy, cn, cm, yaw = coefficients
        zero = np.zeros_like(cy)
        return push * np.stack((zero, cy, -cn), axis=1), push * flow.diameter * np.stack((zero, cm, yaw), axis=1)


ASYMMETRIC = EffectInstance(Asymmetry(), {"size": 1.0})


def diagnosed(vehicle, hidden, folder, changes=()):
    """Diagnosis of a flight in the world of a vehicle, with the whole catalogue."""
    world = draw_world(vehicle, np.random.default_rng(SEED))
    path = simulate(world.scenario(folder), hidden, SEED).write(folder / "flight.h5")
    return diagnose(load_case(world.mission(path, changes), ()), catalogue().values())


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


def test_an_asymmetry_within_what_the_mission_states_is_no_missing_effect(tmp_path):
    """The same flight fails with a mission that states an axisymmetric vehicle."""
    diagnosis = diagnosed("mer", (ASYMMETRIC,), tmp_path, STATED_ASYMMETRY)
    assert diagnosis.verdict.verdict == "clean", diagnosis.verdict.sentence
    assert diagnosis.ranking.model.excess_variance.share < 0.01
    world = draw_world("mer", np.random.default_rng(SEED))
    axisymmetric = credible_model(load_case(world.mission(tmp_path / "flight.h5"), ()))[0]
    assert axisymmetric.excess_variance.share > 0.2


def test_a_torque_that_begins_at_a_time_is_named_beside_a_stated_asymmetry(tmp_path):
    """The asymmetry follows its constant part, so that only its beginning distinguishes it."""
    torque = EffectInstance(find_effect("remnant_torque"), TORQUE)
    diagnosis = diagnosed("mer", (torque, ASYMMETRIC), tmp_path, STATED_ASYMMETRY)
    assert diagnosis.verdict.verdict == "missing", diagnosis.verdict.sentence
    hypothesis = diagnosis.verdict.entries[0].hypothesis
    assert hypothesis.name == "remnant_torque"
    estimates = hypothesis.fit.parameters(("remnant_torque", None))
    for name, true in TORQUE.items():
        estimate, sigma = estimates[name]
        assert abs(estimate - true) < 3.5 * sigma, (name, estimate, sigma)
