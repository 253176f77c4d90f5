"""The ranking on simulated flights: the evidence of a name, also where the model's point moves from the truth.

And on constructed models: the evidences of noise, of a nuisance parameter and of an acceleration.
"""

from dataclasses import dataclass, field, replace
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
from edl_filter.diagnosis.selection.ranking import Ranking, fit_unmodelled, nuisance_gain, rank
from edl_filter.diagnosis.selection.screening import marginalize_model_effects, screen
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
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
def test_the_gyro_noise_of_a_spinning_vehicle_is_no_unmodelled_acceleration(tmp_path):
    """The moments are predicted at the rates that are measured: gyro noise that two bins share acts as a bias.

    At 30 rpm the gyroscopic term changes a step of the rate by a tenth of the noise, in phase with the spin.
    """
    flight = simulate(Scenario.load("builtin:phoenix", ("entry.spin_rpm=30",)), seed=77).write(tmp_path / "flight.h5")
    model = credible_model(load_case(Mission.load("builtin:practice_phoenix", (f"telemetry.path={flight}",)), ()))[0]
    rows = model.index.bin_rows[:-1, 3:6]
    steps = model.state_space.design[rows[np.all(rows >= 0, axis=1)]]
    before, after = model.nuisance["gyro_noise_before"], model.nuisance["gyro_noise_after"]
    bias = model.nuisance.layout["gyro_bias"]
    assert np.abs(steps[..., bias]).max() > 0.03
    np.testing.assert_allclose(steps[..., before] + steps[..., after], steps[..., bias], atol=1e-9)
    assert model.holds and fit_unmodelled(model)[1] - model.log_evidence < 3.0


@slow
def test_effects_that_are_not_fitted_are_not_noise(practice_06):
    """The gain of fitting the model's own effects is neither excess noise nor an unmodelled acceleration."""
    stated = EffectInstance(find_effect("axial_force_scale"), {"k": 0.0015})
    ranking = rank(load_case(practice_06.mission, (stated,)), [])
    assert ranking.model.excess_variance.is_zero
    assert ranking.excess_noise_gain == pytest.approx(0.0, abs=1e-6)  # rounding of evidences of 10⁵ nats
    assert -1e-6 < ranking.unmodelled_gain < 1.0  # the largest of eight kinds, less the price of their selection
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
    assert abs(model.case.log_abs_det_jacobian(linear.fit.effects)) > 1.0  # more than the tolerance below
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


def test_the_most_likely_acceleration_is_that_of_the_model_with_it(monkeypatch):
    """The likelihood that is compared is that of the state space to which the acceleration is added."""
    processes = {UnmodelledAcceleration(force): -force for force in (3.0, 1.0, 2.0)}

    def most_likely(likelihood, settings):
        best = max(processes, key=likelihood)
        return best, likelihood(best)

    monkeypatch.setattr(module, "most_likely_process", most_likely)
    monkeypatch.setattr(module, "log_likelihood", lambda added, *_: added)
    model = SimpleNamespace(
        settings=SETTINGS, excess_variance=excess_of(0.0), residual_vector=None, initial_mean=None,
        state_space_with_unmodelled=processes.get,
    )  # fmt: skip
    assert fit_unmodelled(model) == (UnmodelledAcceleration(1.0), -1.0)


def test_noise_and_acceleration_are_over_the_point_with_the_largest_evidence(monkeypatch):
    """The other point has the larger likelihood, but with variances that cost more."""

    def model_with(log_likelihood, penalty, stated):
        return SimpleNamespace(
            case=SimpleNamespace(settings=SETTINGS, effects=(), end=0.0), settings=SETTINGS, holds=False,
            excess_variance=excess_of(penalty), log_likelihood=log_likelihood, log_evidence=log_likelihood - penalty,
            noise_penalty=penalty, fitted_noise_filter=None, stated_noise_filter=None, largest_nuisance_sigmas=9.0,
            white_residuals=lambda whiten: None, release_filters=lambda: None, release=lambda: None, state_space=stated,
            residual_vector=None, initial_mean=None, point=SimpleNamespace(constants=()), field=None, units=None,
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


# --- which effects are fitted, and about which point ----------------------------------------------------------------


class Constructed:
    """A model of which is known whether it holds and whether its filters are in memory."""

    def __init__(self, name, holds, log_evidence=0.0, zero_excess=False):
        self.name, self.holds, self.settings = name, holds, SETTINGS
        self.log_evidence, self.excess_variance = log_evidence, SimpleNamespace(share=0.3, is_zero=zero_excess)
        self.fitted_noise_filter, self.stated_noise_filter = "fitted", "stated"
        self.state_space = self.residual_vector = self.initial_mean = None
        self.case = self.field = self.units = None
        self.point, self.largest_nuisance_sigmas = SimpleNamespace(constants=()), 0.0
        self.filters, self.released = True, False

    def release_filters(self):
        self.filters = False

    def release(self):
        self.filters, self.released = False, True


FAILING, HOLDING = Constructed("failing", False), Constructed("holding", True)
#: What an effect explains that no other one of a test does.
DISSIMILAR = np.array([0.0, 1.0])


@dataclass(frozen=True)
class Null:
    """The model without a further effect about a point."""

    point: str
    evidence: float = 0.0

    @property
    def white_log_likelihood(self):
        return self.evidence


NULL, REFERENCE = Null("its own"), Null("the most probable one")


@dataclass(frozen=True)
class Candidate:
    """A hypothesis with only what the ranking reads of it."""

    key: tuple
    gain: float = 0.0
    model: Constructed = FAILING
    at_floor: bool = False
    explained: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0]))
    explained_share: float = 0.0
    own_noise_evidence: float = -np.inf
    stated_noise_fit: object = None
    complemented: bool | None = None
    null: Null = NULL
    projected: bool = False
    case: object = field(default_factory=lambda: SimpleNamespace(settings=SETTINGS))
    score_gain: float = np.inf

    fit = SimpleNamespace(effects=("the first effect",))

    @property
    def conservative_gain(self):
        return min(self.gain, self.score_gain)

    @property
    def name(self):
        return self.key[0]

    label = name

    def with_reference(self, null):
        return replace(self, null=null, gain=self.gain + self.null.evidence - null.evidence)


def named(name, gain=0.0, **more):
    return Candidate((name, None), gain, **more)


def names_of(hypotheses):
    return [h.name for h in hypotheses]


@pytest.mark.parametrize(
    ("share", "seconds", "expected"),
    [
        (0.19, [named("b", at_floor=True)], None),  # it explains too little to be one of two
        (0.2, [named("b", at_floor=True)], True),
        (0.39, [named("b", explained_share=0.95)], False),  # with so little a second one must leave no excess
        (0.4, [named("b", explained_share=0.95)], True),
        (0.5, [named("b", explained_share=0.9)], True),
        (0.5, [named("b", explained_share=0.89)], False),
        (0.5, [named("b", explained_share=0.1), named("c", at_floor=True)], True),
        (0.5, [], False),
        (0.89, [named("b", explained_share=0.9)], True),
        (0.9, [named("b", at_floor=True)], None),  # it explains everything alone
    ],
)
def test_a_second_effect_is_sought_where_the_first_explains_a_part(monkeypatch, share, seconds, expected):
    """With `complemented_explained_share` 0.2, `named_explained_share` 0.4 and `sufficient_share` 0.9."""
    searches = []
    monkeypatch.setattr(module, "candidate_instances", lambda case, effects: (case, effects))

    def second_ranking(case, candidates, progress):
        searches.append((case, candidates))
        return SimpleNamespace(hypotheses=seconds)

    monkeypatch.setattr(module, "_rank", second_ranking)
    case = SimpleNamespace(settings=SETTINGS, reconstruct_with=lambda effects: ("again", effects))
    effects, messages = ["catalogue"], []
    lower = named("lower", 1.0)
    before = Ranking(case, None, {}, [named("first", 9.0, explained_share=share), lower], None, 0.0, 0.0)
    after = module._with_complement(before, effects, messages.append)
    assert after.hypotheses[0] == replace(before.hypotheses[0], complemented=expected)
    assert after.hypotheses[1:] == [lower]
    with_first = ("again", ("the first effect",))
    assert searches == ([] if expected is None else [(with_first, (with_first, effects))])
    assert messages == ([] if expected is None else ["searching for a second effect in addition to first"])


def test_the_second_effect_is_one_in_addition_to_the_name_that_would_be_given(monkeypatch):
    """The held-out gain decides too: the hypothesis with the largest gain may not be the name."""
    monkeypatch.setattr(module, "candidate_instances", lambda *_: [])
    monkeypatch.setattr(module, "_rank", lambda *_: SimpleNamespace(hypotheses=[]))
    case = SimpleNamespace(settings=SETTINGS, reconstruct_with=lambda effects: effects)
    larger, name = named("larger", 9.0, score_gain=1.0, explained_share=0.5), named("name", 5.0, explained_share=0.5)
    after = module._with_complement(Ranking(case, None, {}, [larger, name], None, 0.0, 0.0), [], lambda _: None)
    assert [(h.name, h.complemented) for h in after.hypotheses] == [("larger", None), ("name", False)]


def test_no_second_effect_is_sought_after_none_or_after_a_complete_explanation(monkeypatch):
    monkeypatch.setattr(module, "_rank", lambda *_: pytest.fail("a second ranking"))
    case = SimpleNamespace(settings=SETTINGS, mission="mission")
    for hypotheses in ([], [named("first", 9.0, explained_share=0.5, at_floor=True)]):
        ranking = Ranking(case, None, {}, hypotheses, None, 0.0, 0.0)
        assert module._with_complement(ranking, [], lambda _: None) is ranking
        assert (ranking.nuisance_gain, ranking.failed) == (0.0, {})


def screened_effects(model, gains, explained=None):
    """What was screened with each filter: ``{name: gain}``, and what each explains."""
    explained = explained or {}
    results = [
        {
            (n, None): SimpleNamespace(
                gain=g,
                key=(n, None),
                explained=np.array(explained.get(n, [1.0, 0.0])),
                instance=SimpleNamespace(effect=n),
            )
            for n, g in of_filter.items()
        }
        for of_filter in gains
    ]
    return module._Screened(model, results)


def fit_shortlisted(monkeypatch, screened, outcomes, least=0.0, processes=1):
    """Names of the fitted hypotheses, of those for which a fit was begun, and messages of failed ones.

    `outcomes` are changes of the hypothesis by name, or the message of a failing fit. All is computed in one process.
    """
    monkeypatch.setattr(module, "process_count", lambda: processes)
    monkeypatch.setattr(module, "map_processes", lambda function, items, shared: [function(i) for i in items])
    begun, failed = [], {}

    def fit(case, model, starts, null):
        assert [whiten for _, whiten in starts] == ["fitted", "stated"][: len(starts)]
        key = starts[0][0].key
        begun.append(key[0])
        outcome = outcomes.get(key[0], {})
        if isinstance(outcome, str):
            raise InputError(outcome)
        return Candidate(key, **outcome)

    monkeypatch.setattr(module, "fit_hypothesis", fit)
    monkeypatch.setattr(module, "_filters", lambda model: ["fitted", "stated"][: len(screened.results)])
    messages = []
    case = SimpleNamespace(settings=SETTINGS, effects=())
    fitted = module._fit_shortlist(case, screened, NULL, least, failed, messages.append)
    assert messages == [f"refitting {n}" for n in begun]
    return names_of(fitted), begun, failed


def test_an_effect_is_fitted_if_its_gain_at_any_noise_is_sufficient(monkeypatch):
    screened = screened_effects(FAILING, [{"a": 20.0, "b": 5.0, "c": 5.0}, {"a": 5.0, "b": 20.0, "c": 6.0}])
    assert fit_shortlisted(monkeypatch, screened, {}, least=10.0)[0] == ["a", "b"]


def test_after_an_effect_that_explains_everything_only_similar_ones_are_fitted(monkeypatch):
    """Of a failing model; where the model holds, every effect of the shortlist is."""
    cosine = {"a": [1.0, 0.0], "similar": [0.71, 0.704], "dissimilar": [0.69, 0.724]}
    gains = [{"a": 30.0, "dissimilar": 20.0, "similar": 10.0}]
    outcomes = {"a": {"at_floor": True}}
    failing = fit_shortlisted(monkeypatch, screened_effects(FAILING, gains, cosine), outcomes)
    assert failing[0] == ["a", "similar"]
    holding = fit_shortlisted(monkeypatch, screened_effects(HOLDING, gains, cosine), outcomes)
    assert holding[0] == ["a", "dissimilar", "similar"]
    partial = fit_shortlisted(monkeypatch, screened_effects(FAILING, gains, cosine), {})
    assert partial[0] == ["a", "dissimilar", "similar"]


def test_with_several_processes_the_same_hypotheses_are_fitted(monkeypatch):
    """As many as there are processes, and then all others; a fit that turns out to be needless is not used."""
    cosine = {"a": [1.0, 0.0], "b": [0.0, 1.0], "c": [0.0, 1.0], "d": [1.0, 0.0]}
    screened = screened_effects(FAILING, [{"a": 30.0, "b": 20.0, "c": 15.0, "d": 10.0}], cosine)
    outcomes = {"a": {"at_floor": True}, "b": "its table is empty"}
    assert fit_shortlisted(monkeypatch, screened, outcomes) == (["a", "d"], ["a", "d"], {})
    assert fit_shortlisted(monkeypatch, screened, outcomes, processes=2) == (["a", "d"], ["a", "b", "d"], {})
    every = list("abcd")
    assert fit_shortlisted(monkeypatch, screened, {}, processes=2) == (every, every, {})


def test_similarity_is_that_at_the_stated_noise(monkeypatch):
    """The noise that a failing model shows hides what is missing."""
    similar, at_fitted_noise = np.array([1.0, 0.0, 0.0]), {"a": [0.0, 1.0, 0.0], "b": [0.0, 0.0, 1.0]}
    gains = {"a": 30.0, "b": 20.0}
    screened = screened_effects(FAILING, [gains, gains], {"a": similar, "b": similar})
    screened.results[0].update(screened_effects(FAILING, [gains], at_fitted_noise).results[0])
    assert fit_shortlisted(monkeypatch, screened, {"a": {"at_floor": True}})[0] == ["a", "b"]


def test_an_effect_whose_hooks_fail_is_reported_and_the_next_one_fitted(monkeypatch):
    screened = screened_effects(FAILING, [{"a": 30.0, "b": 20.0, "c": 10.0}])
    outcomes = {"a": "its table is empty", "b": {"explained": np.zeros(2)}}
    fitted, begun, failed = fit_shortlisted(monkeypatch, screened, outcomes)
    assert begun == ["a", "b", "c"]
    assert fitted == ["c"]  # what b explains is outside the flight
    assert failed == {"a": "its table is empty"}


def relinearize(monkeypatch, hypotheses, outcomes=None, nulls=None, better=None, similar=None):
    """Ranked names, what was relinearised with whether it contends, and messages of failed ones.

    `similar` is the similarity to a leader about its reconstruction, by name, or the message of a failing effect.

    `outcomes` are changes of the hypothesis by name, or the message of a failing fit; `nulls` by name the evidence of
    the null model about its own point, where its effect is insignificant, and `better` the name of the most probable.
    """
    asked, failed, messages, models = [], {}, [], []
    about = {n: (Constructed(f"without {n}", True), replace(REFERENCE, evidence=e)) for n, e in (nulls or {}).items()}
    expected = about[better][1] if better else REFERENCE

    def projection(h, leader):
        assert leader.at_floor and leader.model in models and not leader.model.released
        similarity = (similar or {}).get(h.name, 0.0)
        if isinstance(similarity, str):
            raise InputError(similarity)
        return similarity, replace(h, projected=True)

    def with_effect(h, reference, contends, converged):
        assert better or reference == REFERENCE
        assert converged == h.projected
        asked.append((h.name, contends))
        outcome = (outcomes or {}).get(h.name, {})
        if isinstance(outcome, str):
            raise InputError(outcome)
        models.append(Constructed(f"with {h.name}", False))
        return replace(h.with_reference(reference), **({"model": models[-1]} | outcome))

    monkeypatch.setattr(module, "relinearize_with_effect", with_effect)
    monkeypatch.setattr(module, "as_projection", projection)
    monkeypatch.setattr(module, "null_model_about", lambda h, of_case: about.get(h.name))
    case = SimpleNamespace(settings=SETTINGS)
    ranked, most_probable = module._relinearize_leaders(case, hypotheses, REFERENCE, failed, messages.append)
    assert most_probable is (about[better] if better else None)
    assert better is None or not about[better][0].filters  # which are large
    assert all(h.null == expected for h in ranked)
    assert [h.gain for h in ranked] == sorted((h.gain for h in ranked), reverse=True)
    assert messages == [f"refitting {name} about a new reconstruction" for name, _ in asked]
    assert all(m.released for m in models) and not FAILING.released and not HOLDING.released
    return names_of(ranked), asked, failed


def test_nothing_is_relinearised_without_a_hypothesis(monkeypatch):
    assert relinearize(monkeypatch, []) == ([], [], {})


@pytest.mark.parametrize(("model", "contends"), [(FAILING, True), (HOLDING, False)])
def test_the_only_hypothesis_is_relinearised(monkeypatch, model, contends):
    assert relinearize(monkeypatch, [named("a", 50.0, model=model)])[1] == [("a", contends)]
    assert relinearize(monkeypatch, [named("a", 50.0, model=model)], {"a": {"at_floor": True}})[0] == ["a"]


@pytest.mark.parametrize(("gain", "expected"), [(2.9, []), (3.0, [("b", False)]), (50.0, [("b", False)])])
def test_where_the_model_holds_a_leader_is_relinearised_if_it_can_be_named(monkeypatch, gain, expected):
    """From half the prior cost of a name, 6 nats, on; the others cannot overtake it."""
    hypotheses = [named("a", 0.9 * gain, model=HOLDING), named("b", gain, model=HOLDING)]
    ranked, asked, _ = relinearize(monkeypatch, hypotheses)
    assert (ranked, asked) == (["b", "a"], expected)


def test_about_a_failing_model_the_rivals_of_the_leader_are_relinearised(monkeypatch):
    """Those with a quarter of its gain; effects with the largest evidence at other noises before them."""
    leader = named("leader", 100.0, own_noise_evidence=-9.0, explained=DISSIMILAR)
    hypotheses = [named("weak", 24.0), named("close", 26.0), leader]
    assert relinearize(monkeypatch, hypotheses)[1] == [("leader", True), ("close", True)]
    own_noise = [*hypotheses, named("own", 10.0, own_noise_evidence=-5.0)]
    assert relinearize(monkeypatch, own_noise)[1] == [("leader", True), ("own", False), ("close", True)]

    def at_stated_noise(evidence):
        return SimpleNamespace(evidence=evidence)

    stated = [
        named("leader", 100.0, own_noise_evidence=-4.0, explained=DISSIMILAR),
        named("close", 26.0),
        named("worse", 5.0, stated_noise_fit=at_stated_noise(-300.0)),
        named("stated", 2.0, stated_noise_fit=at_stated_noise(-200.0)),
        named("worst", 3.0, stated_noise_fit=at_stated_noise(-400.0)),
    ]
    assert relinearize(monkeypatch, stated)[1] == [("leader", True), ("stated", False), ("close", True)]


def test_a_failing_model_has_no_least_gain(monkeypatch):
    """Gains about a failing model are too small by a factor that is not known."""
    hypotheses = [named("a", 1.0), named("b", 0.1, explained=DISSIMILAR)]
    assert relinearize(monkeypatch, hypotheses)[1] == [("a", True)]


@pytest.mark.parametrize(
    ("model", "at_floor", "cosine", "expected"),
    [
        (FAILING, False, 0.91, ["leader", "same"]),
        (FAILING, False, 0.89, ["leader"]),
        (FAILING, True, 0.91, ["leader"]),  # what the leader explains, the other one cannot explain better
        (HOLDING, False, 0.91, ["leader"]),  # gains about the first point are accurate
    ],
)
def test_an_effect_that_explains_the_same_may_explain_all_about_its_own_reconstruction(
    monkeypatch, model, at_floor, cosine, expected
):
    """An error of the clock of one IMU, say, or of the other one: 0.9 of `same_correlation`."""
    same = np.array([cosine, np.sqrt(1.0 - cosine**2)])
    hypotheses = [named("leader", 100.0, model=model), named("same", 1.0, model=model, explained=same)]
    asked = relinearize(monkeypatch, hypotheses, {"leader": {"at_floor": at_floor}})[1]
    assert [name for name, _ in asked] == expected


@pytest.mark.parametrize(
    ("model", "gain", "similarity", "expected"),
    [
        (FAILING, 200.0, 0.91, ["leader", "same"]),  # about the first point it explains something else
        (FAILING, 200.0, 0.89, ["leader"]),
        (FAILING, 0.5, 0.91, ["leader", "other"]),  # it does not lead about its own point
        (HOLDING, 200.0, 0.91, ["leader"]),
    ],
)
def test_effects_are_compared_with_a_leader_about_its_own_reconstruction(
    monkeypatch, model, gain, similarity, expected
):
    """About a failing model the Jacobians are those of another motion."""
    own = [np.eye(4)[k] for k in range(4)]
    hypotheses = [
        named("leader", 100.0, model=model, explained=own[0]),
        named("other", 24.0, model=model, explained=own[1]),
        named("same", 1.0, model=model, explained=own[2]),
    ]
    outcomes = {"leader": {"at_floor": True, "gain": gain}}
    asked = relinearize(monkeypatch, hypotheses, outcomes, similar={"same": similarity})[1]
    assert [name for name, _ in asked] == expected
    if model is FAILING and gain == 200.0:
        failed = relinearize(monkeypatch, hypotheses, outcomes, similar={"same": "its table ends"})[2]
        assert failed == {"same": "its table ends"}


def test_no_more_than_a_number_of_hypotheses_are_relinearised(monkeypatch):
    """The three of `relinearized_hypotheses`, also where each one that comes to lead has a smaller gain then."""
    hypotheses = [named(n, 100.0 - k) for k, n in enumerate("abcde")]
    outcomes = {n: {"gain": 40.0 - k} for k, n in enumerate("abcde")}
    ranked, asked, _ = relinearize(monkeypatch, hypotheses, outcomes)
    assert asked == [("a", True), ("b", True), ("c", True)]
    assert ranked == ["d", "e", "a", "b", "c"]


def test_one_that_comes_to_lead_is_relinearised_next(monkeypatch):
    hypotheses = [named("a", 100.0), named("b", 60.0), named("c", 30.0, own_noise_evidence=-1.0)]
    ranked, asked, _ = relinearize(monkeypatch, hypotheses, {"a": {"gain": 50.0}, "c": {"gain": 70.0}})
    assert asked == [("a", True), ("b", True), ("c", True)]
    assert ranked == ["c", "b", "a"]


def test_a_leader_that_explains_everything_has_only_similar_rivals(monkeypatch):
    """With 0.7 as the correlation of what both explained about the first point."""
    hypotheses = [
        named("leader", 100.0),
        named("dissimilar", 90.0, explained=np.array([0.69, 0.724])),
        named("similar", 80.0, explained=np.array([0.71, 0.704])),
        named("weak", 10.0, own_noise_evidence=-1.0, explained=np.array([0.0, 1.0])),
    ]
    solved = {"leader": {"at_floor": True, "explained": np.array([0.0, 1.0])}}
    assert relinearize(monkeypatch, hypotheses, solved)[1] == [("leader", True), ("similar", True)]


def test_a_leader_that_only_has_a_better_point_does_not_lead(monkeypatch):
    """Its gain over the null model about that point counts, that of all others too, and its rivals are asked."""
    point = REFERENCE.evidence + 60.0
    hypotheses = [named("leader", 50.0), named("rival", 40.0, explained=np.array([0.0, 1.0])), named("weak", 30.0)]
    solved = {"leader": {"at_floor": True, "gain": 58.0}, "rival": {"gain": 90.0, "at_floor": True}}
    nulls = {"leader": point, "weak": point - 20.0}
    ranked, asked, _ = relinearize(monkeypatch, hypotheses, solved, nulls, "leader")
    assert ranked == ["rival", "leader", "weak"]
    assert [name for name, _ in asked] == ["leader", "rival"]
    worse = {"leader": REFERENCE.evidence - 1.0}
    assert relinearize(monkeypatch, hypotheses, solved, worse)[0][0] == "leader"


def test_a_hypothesis_whose_new_reconstruction_fails_keeps_its_fit(monkeypatch):
    hypotheses = [named("a", 100.0), named("b", 60.0)]
    ranked, asked, failed = relinearize(monkeypatch, hypotheses, {"a": "the flight ends early"})
    assert (ranked, [name for name, _ in asked]) == (["a", "b"], ["a", "b"])
    assert failed == {"a": "the flight ends early"}


def test_gains_where_the_model_holds_are_asked_only_of_complete_explanations(monkeypatch):
    asked = []

    def with_gain(h, case, model, whiten, null):
        asked.append((h.name, case, model, whiten, null))
        return replace(h, gain=99.0)

    monkeypatch.setattr(module, "with_gain_where_model_holds", with_gain)
    monkeypatch.setattr(module, "_filters", lambda model: ["fitted", "stated"])
    screened = module._Screened(HOLDING, [])
    partial, complete = named("a", 5.0), named("b", 4.0, at_floor=True)
    assert module._compare_where_model_holds("case", [partial], screened, NULL) == [partial]
    assert asked == []
    compared = module._compare_where_model_holds("case", [partial, complete], screened, NULL)
    assert compared == [partial, replace(complete, gain=99.0)]
    assert asked == [("b", "case", HOLDING, "fitted", NULL)]


@pytest.mark.parametrize(("zero_excess", "expected"), [(True, ["fitted"]), (False, ["fitted", "stated"])])
def test_the_stated_noise_is_a_filter_of_its_own_only_with_excess_variance(monkeypatch, zero_excess, expected):
    monkeypatch.setattr(module, "marginalize_model_effects", lambda model, whiten: whiten)
    assert module._filters(Constructed("model", zero_excess, zero_excess=zero_excess)) == expected


def test_effects_whose_hooks_fail_in_the_scan_are_not_screened(monkeypatch):
    monkeypatch.setattr(module, "_filters", lambda model: ["fitted", "stated"])
    monkeypatch.setattr(module, "scan_jacobians", lambda model, effects, end, failed: failed.update({"b in imu": "no"}))
    monkeypatch.setattr(module, "screen", lambda *_: [{("a", None): 1, ("b", "imu"): 2}, {("b", "imu"): 3}])
    screened = module._screen(FAILING, [], 0.0, {})
    assert screened.model is FAILING and screened.results == [{("a", None): 1}, {}]


def test_effects_are_offered_that_the_model_lacks():
    """Those of the instruments in the driving IMU and in a checking one."""
    driving, checking = SimpleNamespace(name="A"), SimpleNamespace(name="B")
    present = (EffectInstance(find_effect("mass"), {"k": 0.1}),)
    telemetry = SimpleNamespace(driving=driving, checking=[checking])
    case = SimpleNamespace(reconstruction=SimpleNamespace(telemetry=telemetry), effects=present)
    effects = [find_effect(n) for n in ("mass", "gyro_bias", "axial_force_scale")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "canonical_key", lambda a, record: a.key if record is driving else None)
        offered = [a.key for a in module.candidate_instances(case, effects)]
    assert offered == [("gyro_bias", None), ("axial_force_scale", None), ("gyro_bias", "B")]


@dataclass
class Run:
    """What the steps of a ranking were given."""

    screened: list = field(default_factory=list)
    shortlists: list = field(default_factory=list)
    relinearised: list = field(default_factory=list)
    compared: list = field(default_factory=list)
    null_fits: list = field(default_factory=list)
    messages: list = field(default_factory=list)


def constructed_run(monkeypatch, models, fitted, better=(), evidence_of_process=None, process_about="first"):
    """A ranking about some models, `fitted` the hypotheses about each; only one has its filters in memory.

    The unmodelled acceleration has the given evidence about each model, 0 by default, and is the one about a model.
    """
    processes = evidence_of_process or {}
    run, model = Run(), models[0]
    case = SimpleNamespace(settings=SETTINGS, effects=("own effect",), end=250.0)
    model.case = case
    nulls = {m.name: NullModelFit(m.log_evidence, 0.0, 0.0, m.log_evidence, 0.0) for m in models}

    def use_filters(of_model):
        of_model.filters = True
        assert [m.name for m in (*models, *better[:1]) if m.filters] == [of_model.name]

    def fit_null(m, effects, share):
        use_filters(m)
        run.null_fits.append((m.name, effects, share))
        return nulls[m.name]

    def screen_effects(m, effects, end, failed):
        use_filters(m)
        run.screened.append((m.name, [a.name for a in effects], end))
        return module._Screened(m, [{(m.name, None): 1.0}, {("at the stated noise", None): 2.0}])

    def shortlisted(of_case, screened, null, least, failed, progress):
        use_filters(screened.model)
        evidence = {**{m.name: nulls[m.name].evidence for m in models}, **{n.point: n.evidence for n in better[1:]}}
        assert null.evidence == evidence[screened.model.name] and of_case is case
        run.shortlists.append((screened.model.name, least))
        return fitted[screened.model.name]

    def leaders(of_case, hypotheses, reference, failed, progress):
        run.relinearised.append((names_of(hypotheses), reference.evidence))
        return [replace(h, gain=2.0 * h.gain) for h in hypotheses], better or None

    def compare(of_case, hypotheses, screened, null):
        run.compared.append((names_of(hypotheses), screened.model.name, null is nulls[screened.model.name]))
        return list(hypotheses)

    monkeypatch.setattr(module, "credible_model", lambda of_case: (model, models[1] if len(models) > 1 else None))
    monkeypatch.setattr(module, "fit_null_model", fit_null)
    monkeypatch.setattr(module, "_screen", screen_effects)
    monkeypatch.setattr(module, "_fit_shortlist", shortlisted)
    monkeypatch.setattr(module, "_relinearize_leaders", leaders)
    monkeypatch.setattr(module, "_compare_where_model_holds", compare)
    monkeypatch.setattr(module, "log_likelihood", lambda *_: 0.0)
    monkeypatch.setattr(module, "fit_unmodelled", lambda of: (of.name, processes.get(of.name, 0.0)))
    effects = [EffectInstance(find_effect(n), {}) for n in ("mass", "remnant_torque")]
    ranking = module._rank(SimpleNamespace(settings=SETTINGS), effects, run.messages.append)
    assert ranking.case is case and ranking.model is model and ranking.unmodelled == process_about
    assert [h.gain for h in ranking.hypotheses] == sorted((h.gain for h in ranking.hypotheses), reverse=True)
    assert all(m.released for m in models if m.name in {name for name, _ in run.shortlists})
    assert run.null_fits == [(m.name, ("own effect",), 0.3) for m in models]
    assert run.messages[:2] == [
        "comparing model and measurements",
        "screening the catalogue and an unmodelled acceleration",
    ]
    again = ["screening about the most probable point"] if len(run.shortlists) > len(ranking.screening) else []
    assert run.messages[2:] == again
    return ranking, run


def test_effects_without_places_are_fitted_where_the_model_holds(monkeypatch):
    """Those with places about its first point: the scan of places is too coarse for their whole evidence."""
    assert find_effect("remnant_torque").places and not find_effect("mass").places
    models = [Constructed("first", False, -90.0), Constructed("second", True, -50.0)]
    fitted = {"first": [named("a", 40.0), named("b", 60.0)], "second": [named("c", 55.0, model=models[1])]}
    ranking, run = constructed_run(monkeypatch, models, fitted)
    assert run.screened == [("first", ["remnant_torque"], 250.0), ("second", ["mass"], 250.0)]
    assert run.shortlists == [("first", 0.0), ("second", SETTINGS.rival_gain_share * 120.0)]
    assert run.relinearised == [(["a", "b"], -50.0), (["c"], -50.0)]
    assert run.compared == [(["a", "b"], "second", True)]
    assert names_of(ranking.hypotheses) == ["b", "c", "a"]
    assert list(ranking.screening) == [("first", None), ("second", None)]


def test_a_point_of_a_hypothesis_at_which_the_model_is_more_probable_replaces_the_reference(monkeypatch):
    """For all that is compared with the model: names, an unmodelled acceleration, and the noise that it shows."""
    models = [Constructed("first", False, -90.0), Constructed("second", False, -50.0)]
    better = Constructed("better", True, -20.0), Null("better", 30.0)
    better[0].release_filters()
    fitted = {"first": [named("a", 40.0), named("b", 60.0)], "better": [named("c", 45.0)]}
    ranking, run = constructed_run(monkeypatch, models, fitted, better)
    assert run.shortlists == [("first", 0.0), ("better", 0.0)]
    assert run.relinearised == [(["a", "b"], -50.0), (["c"], 30.0)]
    assert [h.gain for h in ranking.hypotheses] == [90.0, 60.0, 50.0]  # twice what was fitted, over 30 nats
    assert ranking.unmodelled_gain == 20.0 and ranking.excess_noise_gain == -20.0
    assert constructed_run(monkeypatch, models, {"first": []})[0].unmodelled_gain == 50.0


@pytest.mark.parametrize(
    ("gain", "evidence", "about"),
    [(60.0, 25.0, "better"), (60.0, -25.0, "first"), (SETTINGS.named_gain_nats / 4.0, 25.0, "first")],
)
def test_an_acceleration_is_compared_with_a_name_about_the_most_probable_point(monkeypatch, gain, evidence, about):
    """About the first point it would also have to explain what is wrong with the path. Without a name it is not."""
    models = [Constructed("first", False, -90.0)]
    better = Constructed("better", True, -20.0), Null("better", -30.0)
    better[0].release_filters()
    fitted = {"first": [named("a", gain, explained_share=1.0)], "better": []}
    ranking, _ = constructed_run(monkeypatch, models, fitted, better, {"better": evidence}, about)
    assert ranking.unmodelled_gain == {"better": evidence, "first": 0.0}[about] + 20.0


def test_another_point_where_the_model_fails_too_is_screened_if_the_leader_does_not_explain_the_flight(monkeypatch):
    """All effects are fitted about the first point, and about the other one if it explains two thirds of the misfit."""
    models = [Constructed("first", False, -90.0), Constructed("second", False, -30.0)]
    fitted = {"first": [named("a", 40.0), named("b", 60.0)], "second": [named("a", 70.0), named("c", 10.0)]}
    ranking, run = constructed_run(monkeypatch, models, fitted)
    everything = ["mass", "remnant_torque"]
    assert run.screened == [("first", everything, 250.0), ("second", everything, 250.0)]
    assert run.shortlists == [("first", 0.0), ("second", 0.0)]
    assert run.relinearised == [(["a", "b"], -30.0), (["a", "c"], -30.0)]
    # twice what was fitted, over the reference of -30 nats instead of zero
    assert [(h.name, h.gain) for h in ranking.hypotheses] == [("a", 170.0), ("b", 150.0), ("c", 50.0)]
    assert run.compared == []
    assert list(ranking.screening) == [("first", None)]


@pytest.mark.parametrize(("evidence", "share"), [(-30.0, 0.95), (-50.0, 0.2)])
def test_it_is_only_a_reference_after_a_sufficient_explanation_or_if_it_explains_little(monkeypatch, evidence, share):
    models = [Constructed("first", False, -90.0), Constructed("second", False, evidence)]
    fitted = {"first": [replace(named("a", 40.0), explained_share=share)]}
    ranking, run = constructed_run(monkeypatch, models, fitted)
    assert run.screened == [("first", ["mass", "remnant_torque"], 250.0)]
    assert run.relinearised == [(["a"], evidence)]
    assert names_of(ranking.hypotheses) == ["a"]


def test_a_model_that_holds_about_its_first_point_has_no_second(monkeypatch):
    models = [Constructed("first", True, -90.0)]
    ranking, run = constructed_run(monkeypatch, models, {"first": []})
    assert run.screened == [("first", ["mass", "remnant_torque"], 250.0)]
    assert (run.compared, ranking.hypotheses) == ([], [])
