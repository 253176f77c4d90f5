"""The ranking on simulated flights: the evidence of a name, also where the model's point moves from the truth."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter import Mission
from edl_filter.diagnosis.linear_model.credible_model import credible_model, relinearize_failing_model
from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.selection.decision import decide
from edl_filter.diagnosis.selection.hypothesis import fit_hypothesis
from edl_filter.diagnosis.selection.map_fit import fit_map, fit_null_model
from edl_filter.diagnosis.selection.ranking import nuisance_gain, rank
from edl_filter.diagnosis.selection.screening import marginalize_model_effects, screen
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.estimation.regression import regress
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.simulation import Scenario, simulate

HIDDEN = {"mx": 4e-3, "my": 2.5e-3, "mz": 1e-3}
CANDIDATES = ("accelerometer_misalignment", "accelerometer_scale", "gyro_bias", "static_instability")


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A vehicle that does not spin. The hidden effect is an error that the filter allows for, but larger."""
    hidden = EffectInstance(find_effect("accelerometer_misalignment"), HIDDEN)
    path = tmp_path_factory.mktemp("flight") / "flight.h5"
    simulate(Scenario.load("builtin:phoenix"), (hidden,), 3).write(path)
    return load_case(Mission.load("builtin:practice_phoenix", [f"telemetry.path={path}"]), ())


@pytest.fixture(scope="module")
def ranking(case):
    return rank(case, [find_effect(n) for n in CANDIDATES])


def test_the_model_fails_only_about_the_smoothed_reconstruction(case):
    """About another point it holds, with the hidden error in a nuisance parameter, many stated sigmas off."""
    settings = case.settings
    failing = linearize(case, settings.linearization_iterations, settings.holds_share)
    alternative = relinearize_failing_model(case, failing)
    assert failing.excess_variance.share > settings.holds_share >= alternative.excess_variance.share
    assert alternative.log_likelihood > failing.log_likelihood + 100.0
    assert alternative.largest_nuisance_sigmas > 10.0


def test_the_evidence_is_that_of_a_linear_fit_at_the_truth(case, ranking):
    """Over the model in which a nuisance parameter absorbs the error."""
    verdict = decide(ranking)
    assert verdict.verdict == "missing" and verdict.leader.name == "accelerometer_misalignment"
    fit = ranking.hypotheses[0].fit
    for name, true in HIDDEN.items():
        sigma = fit.parameter_sigma[fit.names.index((("accelerometer_misalignment", None), name))]
        assert abs(verdict.leader.values[name] - true) < 3.0 * sigma
    model = linearize(case)
    j = effect_jacobian(model, EffectInstance(find_effect("accelerometer_misalignment"), {}))
    x = model.stated_noise_filter(j.rows, j.initial_mean)
    expected = regress(x @ np.array([HIDDEN[n] for n in j.names]), x, j.sigma).gain
    # the noise of this flight changes a log-likelihood ratio by sqrt(2 gain)
    assert abs(ranking.hypotheses[0].gain - expected) < 3.0 * np.sqrt(2.0 * expected)


def test_the_gain_of_a_name_is_the_evidence_that_the_model_with_it_has_more(ranking):
    """The cost of the priors of a model's own effects is on both sides, so it is paid once."""
    h = ranking.hypotheses[0]
    null = fit_null_model(h.model, h.fit.effects)
    assert null.evidence - h.null.evidence == pytest.approx(h.gain, abs=3.0)
    # otherwise the next name would pay for this one as well
    assert null.log_likelihood - null.evidence > ranking.case.settings.named_gain_nats


def test_effects_that_are_not_fitted_are_not_noise(practice_06):
    """The gain of fitting the model's own effects is neither excess noise nor an unmodelled acceleration."""
    stated = EffectInstance(find_effect("axial_force_scale"), {"k": 0.0015})
    ranking = rank(load_case(practice_06.mission, (stated,)), [])
    assert ranking.model.excess_variance.is_zero
    assert ranking.excess_noise_gain == ranking.unmodelled_gain == 0.0
    assert decide(ranking).verdict == "clean"


def test_a_scale_error_has_the_same_evidence_in_the_linear_problem_and_with_scaled_readings(practice_06):
    """The determinant of the map of the readings is in the second only: the first has no noise in its columns.

    With the determinant in both, the gains of scale errors of 0.1 % differ by tens of nats.
    """
    model, _ = credible_model(load_case(practice_06.mission, ()))
    assert model.holds
    null, scale = fit_null_model(model, ()), EffectInstance(find_effect("accelerometer_scale"), {})
    whiten = marginalize_model_effects(model, model.stated_noise_filter)
    screened = screen(model, whiten, [[effect_jacobian(model, scale)]])
    linear = fit_hypothesis(model.case, model, [(screened[scale.key], whiten)], null)
    scaled = fit_map(model, linear.fit.effects, model.stated_noise_filter, moving=True)
    assert abs(model.case.log_abs_det_jacobian(linear.fit.effects)) > 1.5
    assert linear.gain == pytest.approx(scaled.evidence - null.evidence, abs=0.7)


@pytest.mark.parametrize("sigmas", [5.5, 8.0, 30.0])
def test_the_evidence_against_a_stated_sigma_is_the_largest_ratio_of_normal_densities(sigmas):
    settings, state_space = DecisionSettings(), SimpleNamespace(size=100)
    model = SimpleNamespace(largest_nuisance_sigmas=sigmas, holds=True, settings=settings, state_space=state_space)
    scales = np.geomspace(1.0, 100.0, 20_000)
    ratio = 0.5 * sigmas**2 - 0.5 * (sigmas / scales) ** 2 - np.log(scales)
    assert nuisance_gain(model) == pytest.approx(ratio.max() - np.log(100), abs=1e-4)
    assert nuisance_gain(SimpleNamespace(**(vars(model) | {"holds": False}))) == 0.0
    assert nuisance_gain(SimpleNamespace(**(vars(model) | {"largest_nuisance_sigmas": 4.9}))) == 0.0
