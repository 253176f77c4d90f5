"""The ranking on simulated flights: the evidence of a name, also where the model's point moves from the truth.

And on constructed models: the evidences of noise, of a nuisance parameter and of an acceleration.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import Mission
from edl_filter.diagnosis.linear_model.credible_model import credible_model, relinearize_failing_model
from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration
from edl_filter.diagnosis.noise.variance_components import ExcessVariance
from edl_filter.diagnosis.selection import ranking as module
from edl_filter.diagnosis.selection.decision import decide
from edl_filter.diagnosis.selection.hypothesis import fit_hypothesis
from edl_filter.diagnosis.selection.map_fit import NullModelFit, fit_map, fit_null_model
from edl_filter.diagnosis.selection.ranking import fit_unmodelled, nuisance_gain, rank
from edl_filter.diagnosis.selection.screening import marginalize_model_effects, screen
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.estimation.regression import regress
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.simulation import Scenario, simulate

SETTINGS = DecisionSettings()
HIDDEN = {"mx": 4e-3, "my": 2.5e-3, "mz": 1e-3}
CANDIDATES = ("accelerometer_misalignment", "accelerometer_scale", "gyro_bias", "static_instability")

slow = pytest.mark.slow


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


@slow
def test_the_model_fails_only_about_the_smoothed_reconstruction(case):
    """About another point it holds, with the hidden error in a nuisance parameter, many stated sigmas off."""
    settings = case.settings
    failing = linearize(case, settings.linearization_iterations, settings.holds_share)
    alternative = relinearize_failing_model(case, failing)
    assert failing.excess_variance.share > settings.holds_share >= alternative.excess_variance.share
    assert alternative.log_likelihood > failing.log_likelihood + 100.0
    assert alternative.largest_nuisance_sigmas > 10.0


@slow
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


@slow
def test_the_gain_of_a_name_is_the_evidence_that_the_model_with_it_has_more(ranking):
    """The cost of the priors of a model's own effects is on both sides, so it is paid once."""
    h = ranking.hypotheses[0]
    null = fit_null_model(h.model, h.fit.effects)
    assert null.evidence - h.null.evidence == pytest.approx(h.gain, abs=3.0)
    # otherwise the next name would pay for this one as well
    assert null.log_likelihood - null.evidence > ranking.case.settings.named_gain_nats


@slow
def test_effects_that_are_not_fitted_are_not_noise(practice_06):
    """The gain of fitting the model's own effects is neither excess noise nor an unmodelled acceleration."""
    stated = EffectInstance(find_effect("axial_force_scale"), {"k": 0.0015})
    ranking = rank(load_case(practice_06.mission, (stated,)), [])
    assert ranking.model.excess_variance.is_zero
    assert ranking.excess_noise_gain == ranking.unmodelled_gain == 0.0
    assert decide(ranking).verdict == "clean"


@slow
def test_a_scale_error_has_the_same_evidence_in_the_linear_problem_and_with_scaled_readings(practice_06):
    """The determinant of the map of the readings is in the second only: the first has no noise in its columns.

    With the determinant in both, the gains of scale errors of 0.1 % differ by tens of nats.
    """
    model, _ = credible_model(load_case(practice_06.mission, ()))
    assert model.holds
    null, scale = fit_null_model(model, ()), EffectInstance(find_effect("accelerometer_scale"), {})
    whiten = marginalize_model_effects(model, model.stated_noise_filter)
    (screened,) = screen(model, [whiten], [effect_jacobian(model, scale)])
    linear = fit_hypothesis(model.case, model, [(screened[scale.key], whiten)], null)
    scaled = fit_map(model, linear.fit.effects, model.stated_noise_filter, moving=True)
    assert abs(model.case.log_abs_det_jacobian(linear.fit.effects)) > 1.5
    assert linear.gain == pytest.approx(scaled.evidence - null.evidence, abs=0.7)


# --- constructed models ---------------------------------------------------------------------------------------------


def model_off_by(sigmas, count=100, holds=True):
    """A model with a nuisance parameter, of so many, that is off by some sigmas."""
    return SimpleNamespace(
        largest_nuisance_sigmas=sigmas, holds=holds, settings=SETTINGS, state_space=SimpleNamespace(size=count)
    )


@pytest.mark.parametrize("sigmas", [1.5, 3.0, 3.9, 4.9, 5.5, 8.0, 30.0])
@pytest.mark.parametrize("count", [1, 100])
def test_the_evidence_against_a_stated_sigma_is_the_largest_ratio_of_normal_densities(sigmas, count):
    """Less the choice among all parameters; never negative, and zero where the model fails."""
    scales = np.geomspace(1.0, 100.0, 20_000)
    ratio = 0.5 * sigmas**2 - 0.5 * (sigmas / scales) ** 2 - np.log(scales)
    expected = max(ratio.max() - np.log(count), 0.0)
    assert nuisance_gain(model_off_by(sigmas, count)) == pytest.approx(expected, abs=1e-4)
    assert nuisance_gain(model_off_by(sigmas, count, holds=False)) == 0.0


@pytest.mark.parametrize("sigmas", [0.0, 1e-9, 0.1, 1.0])
def test_a_sigma_that_may_be_too_large_is_not_contradicted(sigmas):
    """The most likely one is smaller then, and its density larger without limit."""
    assert nuisance_gain(model_off_by(sigmas, count=1)) == 0.0


@given(st.floats(0.0, 12.0))
def test_the_evidence_against_a_stated_sigma_has_no_step(sigmas):
    """From no credible value to the next one: a thousandth of a sigma is at most 0.012 nats."""
    before, after = (nuisance_gain(model_off_by(z)) for z in (sigmas, sigmas + 1e-3))
    assert 0.0 <= after - before <= 0.0121


def excess_of(penalty):
    return ExcessVariance(np.ones(3) * bool(penalty), np.ones(3, bool), penalty)


@pytest.mark.parametrize(
    ("penalty", "left", "expected"),
    [
        (0.0, 7.0, -60.0),  # without excess variance nothing is estimated beside the acceleration
        (20.0, 7.0, -30.0 - 7.0),
        (20.0, 19.9, -30.0 - 19.9),
        (20.0, 20.1, -50.0),  # excess variance alone, less its own penalty, is more probable
    ],
)
def test_the_evidence_of_an_acceleration_is_less_the_penalty_of_the_noise_that_it_leaves(
    monkeypatch, penalty, left, expected
):
    process = UnmodelledAcceleration(1.0)
    leaves = SimpleNamespace(log_likelihood=lambda white: -30.0)
    monkeypatch.setattr(module, "most_likely_process", lambda likelihood, settings: (process, -60.0))
    monkeypatch.setattr(module, "whitening_filter", lambda state_space: None)
    monkeypatch.setattr(module, "estimate_variance_components", lambda *_: (excess_of(left), leaves))
    model = SimpleNamespace(
        settings=SETTINGS, excess_variance=excess_of(penalty), log_evidence=-50.0,
        state_space_with_unmodelled=str,
        index=None, residual_vector=None, initial_mean=None, failing_excess=None, white_residuals=lambda whiten: None,
    )  # fmt: skip
    unmodelled, evidence = fit_unmodelled(model)
    assert unmodelled is process and evidence == pytest.approx(expected)


def test_noise_and_acceleration_are_over_the_point_with_the_largest_evidence(monkeypatch):
    """The other point has the larger likelihood, but with variances that cost more."""

    def model_with(log_likelihood, penalty, stated):
        return SimpleNamespace(
            case=SimpleNamespace(settings=SETTINGS, effects=(), end=0.0), settings=SETTINGS, holds=False,
            excess_variance=excess_of(penalty), log_likelihood=log_likelihood, log_evidence=log_likelihood - penalty,
            noise_penalty=penalty, fitted_noise_filter=None, stated_noise_filter=None, largest_nuisance_sigmas=9.0,
            white_residuals=lambda whiten: None, release_filters=lambda: None, release=lambda: None, state_space=stated,
            residual_vector=None, initial_mean=None,
        )  # fmt: skip

    models = model_with(-50.0, 2.0, stated=-80.0), model_with(-45.0, 10.0, stated=-300.0)
    monkeypatch.setattr(module, "candidate_instances", lambda *_: [])
    monkeypatch.setattr(module, "credible_model", lambda case: models)
    monkeypatch.setattr(module, "fit_null_model", lambda m, *_: NullModelFit(m.log_evidence, 0.0, 0.0, 0.0, 0.0))
    monkeypatch.setattr(module, "marginalize_model_effects", lambda model, whiten: whiten)
    monkeypatch.setattr(module, "log_likelihood", lambda stated, *_: stated)
    monkeypatch.setattr(module, "scan_jacobians", lambda *_: iter(()))
    monkeypatch.setattr(module, "fit_unmodelled", lambda model: (UnmodelledAcceleration(), -40.0))
    ranking = rank(models[0].case, [])
    assert ranking.excess_noise_gain == pytest.approx(-52.0 + 80.0)
    assert ranking.unmodelled_gain == pytest.approx(-40.0 + 52.0)
    assert ranking.nuisance_gain == 0.0
