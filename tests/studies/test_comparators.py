"""Methods in use: both selections on simulated libraries, and forward selection with a wrong model."""

import numpy as np
import pytest
from comparators import forward, identified, stepwise, thresholded
from regressors import Regression, regression_of

from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import catalogue, find_effect
from edl_filter.pipeline.reconstruct import reconstruct

METHODS = [forward, thresholded]
NAMES = ("a", "b", "b", "c", "d")


def simulated(weights, noise=1.0, seed=0):
    """Residuals that are a combination of the columns with `weights`, and noise."""
    random = np.random.default_rng(seed)
    library = random.standard_normal((2000, len(weights))) * [1e-3, 1.0, 1.0, 50.0, 1.0]
    return Regression(library @ weights + noise * random.standard_normal(2000), library, NAMES)


@pytest.mark.parametrize("method", METHODS)
def test_true_names_are_in_the_order_of_what_they_explain(method):
    assert method(simulated([0.0, 1.0, 2.0, 0.2, 0.0])) == ["c", "b"]
    assert method(simulated([3e3, 0.0, 0.0, 0.02, 0.0])) == ["a", "c"]


@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_named_if_the_residuals_are_within_their_sigma(method):
    assert method(simulated([0.0, 0.0, 0.5, 0.0, 0.0], noise=0.5)) == []


def test_white_noise_larger_than_stated_is_no_effect():
    assert forward(simulated(np.zeros(5), noise=3.0)) == []


def test_a_column_that_others_replace_is_removed():
    """The sum of two columns enters first; with both of them in the model it explains nothing more."""
    random = np.random.default_rng(1)
    a, b = random.standard_normal((2, 3000))
    library = np.stack((a, b, a + b + random.standard_normal(3000)), axis=1)
    r = Regression(10.0 * (a + b) + random.standard_normal(3000), library, ("a", "b", "sum"))
    assert sorted(forward(r)) == ["a", "b"]


def test_a_flight_is_identified_if_the_first_name_is_true():
    assert identified(["wind", "mass"], ["wind"]) and identified([], [])
    assert not identified(["mass", "wind"], ["wind"])
    assert not identified([], ["wind"]) and not identified(["mass"], [])


def test_every_effect_of_the_catalogue_but_gravity_has_regressors(practice_06):
    r = regression_of(practice_06)
    assert set(r.names) == set(catalogue()) - {"gravity_oblateness"}
    assert np.all(np.isfinite(r.library)) and np.all(np.isfinite(r.residual))
    assert r.residual @ r.residual < len(r.residual) and stepwise(practice_06) == []


WRONG = {
    "wind": {"east": 40.0, "north": 20.0, "h_lo": 8e3, "h_hi": 22e3},
    "atmosphere_rotation": {"k": 1.0},
    "density_wave": {"A": 0.1, "L": 14e3, "phase": 1.0},
    "pitching_moment_scale": {"k": 0.2},
    "normal_force_scale": {"k": 1.0},
    "base_pressure": {"a": 0.3},
    "mass": {"k": 0.1},
    "accelerometer_misalignment": {"my": 8e-3, "mz": -6e-3},
}


@pytest.mark.parametrize("name", WRONG)
def test_an_effect_of_the_model_alone_is_named(practice_06, name):
    """A clean flight and a wrong model differ as a flight with the effect and a clean model, with opposite sign."""
    flight = reconstruct(practice_06.mission, [EffectInstance(find_effect(name), WRONG[name])])
    names = stepwise(flight)
    same = {"mass": ("mass", "density_scale", "axial_force_scale", "accelerometer_scale")}
    assert names[0] in same.get(name, (name,)), names
