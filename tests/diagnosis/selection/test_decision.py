"""Probabilities and verdicts of constructed rankings; the channels that a hypothesis reduces."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from decision_checks import check_verdict, implied_verdict
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration
from edl_filter.diagnosis.selection import decision
from edl_filter.diagnosis.selection import ranking as ranking_module
from edl_filter.diagnosis.selection.decision import (
    decide,
    group_indistinguishable,
    hypothesis_rms,
    most_reduced_channel,
    prior_cost,
    probabilities,
    verdict_of,
)
from edl_filter.diagnosis.selection.disambiguation import Discriminator
from edl_filter.diagnosis.selection.hypothesis import Hypothesis
from edl_filter.diagnosis.selection.map_fit import NullModelFit
from edl_filter.diagnosis.selection.ranking import Ranking
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.results.verdicts import Form

SETTINGS = DecisionSettings()
COST, COST_IN_NOISE = SETTINGS.named_gain_nats, SETTINGS.named_gain_in_excess_noise_nats
NOISE = SETTINGS.excess_noise_nats  # evidence from which the noise is not what is stated
ERROR, REQUIRED = SETTINGS.approximation_error, SETTINGS.decided_probability
NAMES = ("wind", "mass", "gyro_bias", "com_offset", "density_scale")


def hypothesis_of(name, gain, score=None, explained=None, at_floor=True, explained_share=1.0):
    """A fitted effect with what the decision needs of it; columns of different names are orthogonal."""
    own = np.zeros(len(NAMES))
    own[NAMES.index(name)] = 1.0
    effects = (EffectInstance(find_effect("gravity_oblateness"), {}), EffectInstance(find_effect(name), {}))
    return Hypothesis(
        key=(name, None),
        fit=SimpleNamespace(effects=effects),
        normalised=None,
        gain=gain,
        score_gain=gain if score is None else score,
        at_floor=at_floor,
        explained=own if explained is None else np.asarray(explained, float),
        case=None,
        model=None,
        null=NullModelFit(0.0, 0.0, 0.0, 0.0, 0.0),
        explained_share=explained_share,
    )


def ranking_of(*hypotheses, unmodelled_gain=0.0, noise=0.0, nuisance=0.0, settings=SETTINGS):
    case = SimpleNamespace(settings=settings)
    return Ranking(case, None, {}, list(hypotheses), UnmodelledAcceleration(), unmodelled_gain, noise, nuisance)


def is_noisy(ranking):
    return ranking.excess_noise_gain > ranking.case.settings.excess_noise_nats


def cost_of(noise, settings=SETTINGS):
    """Prior cost of a name beside an evidence for excess noise: in proportion between its two values."""
    low, high = settings.named_gain_nats, settings.named_gain_in_excess_noise_nats
    return low + (high - low) * min(noise / settings.excess_noise_nats, 1.0)


@pytest.fixture(autouse=True, scope="module")
def no_discriminator():
    """Constructed hypotheses have no linear model that a discriminating measurement could be computed from."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(decision, "best_discriminator", lambda *_: None)
        yield


# --- the verdict as a function of the probabilities -----------------------------------------------------------------

weights_of_hypotheses = st.lists(st.floats(0.0, 1.0), min_size=2, max_size=7).filter(lambda p: sum(p) > 1e-3)
required_probabilities = st.floats(0.5, 1.0, exclude_min=True)


@given(weights_of_hypotheses, required_probabilities, st.randoms())
def test_the_verdict_is_that_of_the_hypothesis_with_a_sufficient_probability(weights, required, random):
    total = sum(weights)
    none, something_else, *names = (w / total for w in weights)
    verdict = verdict_of(names, none, something_else, required)
    assert verdict == implied_verdict(names, none, something_else, required)
    of_verdict = {"clean": none, "unknown": something_else, "missing": max(names, default=0.0)}
    sufficient = [v for v, p in of_verdict.items() if p >= required]
    assert len(sufficient) <= 1  # above one half there is one at most
    assert verdict == (sufficient[0] if sufficient else "undecided")
    shuffled = list(names)
    random.shuffle(shuffled)
    assert verdict_of(shuffled, none, something_else, required) == verdict


@given(weights_of_hypotheses, required_probabilities, required_probabilities)
def test_a_larger_required_probability_makes_a_verdict_undecided_and_never_another_one(weights, a, b):
    total = sum(weights)
    none, something_else, *names = (w / total for w in weights)
    easier, harder = (verdict_of(names, none, something_else, r) for r in sorted((a, b)))
    assert harder in (easier, "undecided")


@given(weights_of_hypotheses, required_probabilities)
def test_names_that_are_not_the_most_probable_do_not_matter(weights, required):
    none, something_else, *names = weights
    best = [max(names)] if names else []
    assert verdict_of(names, none, something_else, required) == verdict_of(best, none, something_else, required)


def test_the_required_probability_is_sufficient_itself():
    below = np.nextafter(0.8, 0.0)
    for given_verdict, arguments in {
        "clean": lambda p: ([], p, 1.0 - p), "unknown": lambda p: ([], 1.0 - p, p),
        "missing": lambda p: ([1.0 - p, p], 0.0, 0.0),
    }.items():  # fmt: skip
        assert verdict_of(*arguments(0.8), 0.8) == given_verdict
        assert verdict_of(*arguments(below), 0.8) == "undecided"


# --- probabilities from evidence ------------------------------------------------------------------------------------

evidences = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=8)


@given(evidences, st.floats(0.0, 0.5))
def test_probabilities_are_a_mixture_of_normalised_evidence_and_equal_ones(evidence, error):
    p, count = probabilities(np.array(evidence), error), len(evidence)
    assert p.sum() == pytest.approx(1.0, abs=1e-12)
    assert p.min() >= error / count * (1.0 - 1e-12)
    assert p.max() <= (1.0 - error * (count - 1) / count) * (1.0 + 1e-12)
    assert np.all(np.diff(p[np.argsort(evidence)]) >= 0.0)  # in the order of the evidence
    best = max(evidence)
    weights = [np.exp(e - best) for e in evidence]
    expected = [(1.0 - error) * w / sum(weights) + error / count for w in weights]
    np.testing.assert_allclose(p, expected, rtol=1e-12)


@given(evidences, st.floats(0.0, 0.5), st.floats(-1e3, 1e3))
def test_only_differences_of_evidence_matter(evidence, error, constant):
    shifted = probabilities(np.array(evidence) + constant, error)
    np.testing.assert_allclose(shifted, probabilities(np.array(evidence), error), rtol=1e-6)


def test_an_overwhelming_evidence_has_the_probability_that_the_approximation_is_right():
    p = probabilities(np.array([0.0, 1e5, -3.0, 20.0]), 0.02)
    np.testing.assert_allclose(p, [0.005, 0.985, 0.005, 0.005], rtol=1e-12)


# --- probabilities of constructed rankings --------------------------------------------------------------------------

candidates = st.lists(
    st.tuples(st.sampled_from(NAMES), st.floats(-1e4, 1e6), st.floats(-1e4, 1e6), st.booleans()),
    max_size=5,
    unique_by=lambda t: t[0],
)
close_candidates = st.lists(
    st.tuples(st.sampled_from(NAMES), st.floats(-10.0, 30.0), st.floats(-10.0, 30.0), st.booleans()),
    max_size=5,
    unique_by=lambda t: t[0],
)
varied_settings = st.builds(
    lambda error, required, cost, in_noise: SETTINGS.model_copy(
        update={
            "approximation_error": error, "decided_probability": required, "named_gain_nats": cost,
            "named_gain_in_excess_noise_nats": in_noise,
        }
    ),
    st.floats(0.0, 0.5), required_probabilities, st.floats(0.0, 20.0), st.floats(0.0, 60.0),
)  # fmt: skip


@st.composite
def rankings(draw, gains=candidates, noise=(0.0, 1e5), unmodelled=(-1e3, 1e6), settings=varied_settings):
    """Rankings with gains of a strategy, evidences between bounds, and settings."""
    hypotheses = [hypothesis_of(*h[:3], at_floor=h[3]) for h in draw(gains)]
    noise_gain, unmodelled_gain = draw(st.floats(*noise)), draw(st.floats(*unmodelled))
    return ranking_of(*hypotheses, unmodelled_gain=unmodelled_gain, noise=noise_gain, settings=draw(settings))


def check_decision(ranking):
    """The verdict of a ranking, with all that must agree whatever the evidences and the settings are."""
    verdict, settings = decide(ranking), ranking.case.settings
    check_verdict(verdict, ranking)
    assert sorted(e.hypothesis.name for e in verdict.entries) == sorted(h.name for h in ranking.hypotheses)
    assert verdict.required_gain == pytest.approx(cost_of(ranking.excess_noise_gain, settings), rel=1e-12)
    by_evidence = sorted(verdict.entries, key=lambda e: -min(e.hypothesis.gain, e.hypothesis.score_gain))
    assert [e.probability for e in by_evidence] == [e.probability for e in verdict.entries]
    return verdict


@given(rankings())
def test_verdict_probabilities_and_ranking_do_not_contradict_each_other(ranking):
    check_decision(ranking)


@given(rankings(close_candidates, (0.0, 30.0), (-10.0, 40.0)))
def test_also_where_all_evidences_are_close(ranking):
    """Where probabilities are far from zero and one."""
    check_decision(ranking)


@given(rankings(close_candidates, (0.0, 30.0), (-10.0, 20.0), st.just(SETTINGS)))
def test_a_name_that_is_given_has_the_required_gain_and_more_evidence_than_all_others(ranking):
    verdict = decide(ranking)
    if verdict.verdict != "missing":
        return
    first = verdict.entries[0].hypothesis
    gain = min(first.gain, first.score_gain)
    assert gain > verdict.required_gain - 1e-9  # more than none, or than something else in excess noise
    if not is_noisy(ranking):
        assert gain > ranking.unmodelled_gain
    assert all(gain > min(e.hypothesis.gain, e.hypothesis.score_gain) for e in verdict.entries[1:])


@given(rankings(close_candidates, (0.0, 10.0), (-10.0, 40.0)))
def test_a_name_with_little_evidence_is_never_above_none(ranking):
    """Gain and held-out gain must both exceed the prior cost, or the name is less probable than no effect."""
    verdict = decide(ranking)
    for e in verdict.entries:
        if min(e.hypothesis.gain, e.hypothesis.score_gain) < verdict.required_gain:
            assert e.probability <= verdict.none


@given(rankings(noise=(10.1, 1e5)), st.booleans())
def test_in_excess_noise_a_name_needs_evidence_beyond_it(ranking, at_floor):
    """The fitted noise is the alternative; that a name leaves hardly any excess variance does not help it."""
    verdict = decide(ranking)
    for e in verdict.entries:
        if min(e.hypothesis.gain, e.hypothesis.score_gain) < verdict.required_gain:
            assert e.probability <= verdict.something_else
    ranking = replace(ranking, unmodelled_gain=min(ranking.unmodelled_gain, verdict.required_gain))
    changed = [
        hypothesis_of(h.name, h.gain, h.score_gain, at_floor=at_floor) for h in reversed(ranking.hypotheses)
    ]  # fmt: skip
    verdict, again = decide(ranking), decide(replace(ranking, hypotheses=changed))
    assert (again.verdict, again.none, again.something_else) == pytest.approx(
        (verdict.verdict, verdict.none, verdict.something_else)
    )


@pytest.mark.parametrize("contradiction", [{"noise": 1e6}, {"nuisance": 200.0}, {}])
@pytest.mark.parametrize("beyond", [-8.0, 0.0, 8.0])
def test_a_name_that_explains_all_needs_more_evidence_than_an_acceleration(contradiction, beyond):
    """Both leave no excess variance: also where a stated sigma is contradicted, which both of them explain."""
    settings = SETTINGS.model_copy(update={"approximation_error": 0.0})
    ranking = ranking_of(hypothesis_of("wind", 100.0), unmodelled_gain=100.0 - beyond, **contradiction)
    verdict = decide(replace(ranking, case=SimpleNamespace(settings=settings)))
    assert verdict.entries[0].probability / verdict.something_else == pytest.approx(np.exp(beyond), rel=1e-6)


def test_a_name_that_leaves_excess_noise_is_not_compared_with_an_acceleration_that_explains_all():
    """The first of two missing effects explains less than a process that explains both."""
    first = hypothesis_of("wind", 100.0, at_floor=False, explained_share=0.95)
    assert decide(ranking_of(first, unmodelled_gain=300.0, noise=1e6)).verdict == "missing"
    assert decide(ranking_of(replace(first, at_floor=True), unmodelled_gain=300.0, noise=1e6)).verdict == "unknown"


@given(rankings(noise=(10.1, 1e5)), st.floats(0.0, SETTINGS.named_explained_share, exclude_max=True))
def test_a_name_that_explains_a_part_has_at_most_the_likelihood_ratio_of_that_part(ranking, explained_share):
    """All names are reduced by the same evidence, so that their order is that of their gains."""
    hypotheses = [
        hypothesis_of(h.name, h.gain, h.score_gain, at_floor=False, explained_share=explained_share)
        for h in ranking.hypotheses
    ]
    settings, noise = ranking.case.settings, ranking.excess_noise_gain
    before, verdict = (decide(ranking_of(*h, noise=noise, settings=settings)) for h in (ranking.hypotheses, hypotheses))
    ratio = likelihood_ratio(max(explained_share, 1e-3), settings.explained_share_shape)
    largest = ratio / (1.0 + ratio)
    assert all(e.probability <= largest + settings.approximation_error + 1e-9 for e in verdict.entries)
    assert [e.hypothesis.name for e in verdict.entries] == [e.hypothesis.name for e in before.entries]


def likelihood_ratio(share, shape):
    """Density of the explained share of a right name over that of a wrong one, which is uniform."""
    return stats.beta(shape, 1.0).pdf(share)


@pytest.mark.parametrize(
    ("explained_share", "outcome"), [(0.1, "unknown"), (0.5, "unknown"), (0.75, "undecided"), (0.89, "undecided")]
)
def test_the_limit_is_that_of_the_first_name(explained_share, outcome):
    """Something outside the catalogue is there, whether or not the name is right, unless it explains nearly all."""
    settings = SETTINGS.model_copy(update={"approximation_error": 0.0})
    weak = hypothesis_of("wind", 700.0, at_floor=False, explained_share=explained_share)
    weak = replace(weak, complemented=None if explained_share < SETTINGS.complemented_explained_share else False)
    second = hypothesis_of("mass", 675.0, at_floor=False)
    verdict = decide(ranking_of(weak, second, noise=1e6, settings=settings))
    assert verdict.verdict == outcome
    odds = verdict.entries[0].probability / verdict.something_else
    assert odds == pytest.approx(likelihood_ratio(explained_share, SETTINGS.explained_share_shape), rel=1e-6)
    strong = replace(weak, explained_share=SETTINGS.sufficient_share, complemented=None)
    for named in (replace(weak, at_floor=True), replace(weak, complemented=True), strong):
        assert decide(ranking_of(named, second, noise=1e6)).verdict == "missing"


def test_a_nuisance_parameter_that_is_not_credible_excludes_that_nothing_is_missing():
    """The flight is not clean, and a name needs no more evidence than about a model that holds."""
    named, weak = hypothesis_of("wind", 18.0), hypothesis_of("mass", 2.0)
    assert decide(ranking_of(weak)).verdict == "clean"
    assert decide(ranking_of(weak, nuisance=15.0)).verdict == "unknown"
    verdict = decide(ranking_of(named, weak, nuisance=15.0))
    assert (verdict.verdict, verdict.required_gain) == ("missing", SETTINGS.named_gain_nats)
    assert decide(ranking_of(named, noise=15.0)).verdict == "unknown"  # in noise of unknown form it needs more


@pytest.mark.parametrize("stated", ["noise", "nuisance"])
@pytest.mark.parametrize("unmodelled", [-4.0, 2.0])
def test_a_contradicted_sigma_and_an_acceleration_both_contradict_none(stated, unmodelled):
    """Something else is the reference; none is less probable by both, an acceleration beyond its prior cost."""
    gain = {"noise": NOISE, "nuisance": COST}[stated] + 0.5
    cost = COST_IN_NOISE if stated == "noise" else COST
    verdict = decide(ranking_of(**{stated: gain}, unmodelled_gain=cost + unmodelled))
    expected = probabilities(np.array([-0.5 - max(unmodelled, 0.0), 0.0]), ERROR)
    assert [verdict.none, verdict.something_else] == pytest.approx(expected.tolist())


@pytest.mark.parametrize("stated", ["noise", "nuisance"])
@pytest.mark.parametrize("unmodelled", [-4.0, 0.5, 30.0])
def test_the_odds_of_none_have_no_step_where_a_sigma_is_contradicted(stated, unmodelled):
    """Whatever an unmodelled acceleration gains."""
    at_cost = {"noise": NOISE, "nuisance": COST}[stated]
    below, above = (
        decide(ranking_of(**{stated: at_cost + d}, unmodelled_gain=unmodelled + COST_IN_NOISE)) for d in (-1e-7, 1e-7)
    )
    assert below.none == pytest.approx(above.none, abs=1e-6)


@pytest.mark.parametrize(
    ("gains", "contradiction"),
    [
        ({"noise": NOISE + 4.0}, 4.0),
        ({"nuisance": COST + 4.0}, 4.0),
        ({"noise": NOISE + 1.0, "nuisance": COST + 4.0}, 4.0),
        ({"noise": NOISE + 4.0, "nuisance": COST + 1.0}, 4.0),
        ({"noise": NOISE - 1.0, "nuisance": COST - 3.0}, -1.0),
        ({"noise": NOISE - 3.0, "nuisance": COST - 1.0}, -1.0),
        ({"noise": NOISE - 0.5}, -0.5),
        ({"nuisance": COST - 0.5}, -0.5),
    ],
)
def test_a_contradiction_is_the_larger_evidence_against_a_stated_sigma_less_its_prior_cost(gains, contradiction):
    """Below zero it is the evidence of something else, above zero minus that of none; a small acceleration adds none.

    The prior cost of a wrong sigma of the noise is not that of a wrong sigma of a nuisance parameter.
    """
    verdict = decide(ranking_of(hypothesis_of("wind", 0.0), **gains))
    cost = cost_of(gains.get("noise", 0.0))
    expected = probabilities(np.array([-max(contradiction, 0.0), min(contradiction, 0.0), -cost]), ERROR)
    actual = [verdict.none, verdict.something_else, verdict.entries[0].probability]
    assert actual == pytest.approx(expected.tolist(), rel=1e-9)


def test_without_evidence_against_a_sigma_something_else_is_an_acceleration():
    """Also where that is less probable than the model at its own noise, as beside another point of the model."""
    verdict = decide(ranking_of(unmodelled_gain=-4.0))
    expected = probabilities(np.array([0.0, -4.0 - COST]), ERROR)
    assert [verdict.none, verdict.something_else] == pytest.approx(expected.tolist(), rel=1e-9)


def test_an_acceleration_is_the_evidence_of_something_else_where_it_exceeds_a_negative_contradiction():
    """Its prior cost is that of a name: beside a slight evidence for excess noise it is larger than without."""
    for noise, cost in ((0.0, COST), (0.5 * NOISE, 0.5 * (COST + COST_IN_NOISE))):
        verdict = decide(ranking_of(unmodelled_gain=cost - 1.0, noise=noise))
        expected = probabilities(np.array([0.0, -1.0]), ERROR)
        assert [verdict.none, verdict.something_else] == pytest.approx(expected.tolist(), rel=1e-9)


@pytest.mark.parametrize("gains", [
    {"noise": NOISE + 4.0, "unmodelled_gain": -600.0},  # both rovers: an acceleration explains less than the noise
    {"noise": NOISE + 4.0, "unmodelled_gain": 291.0}, {"nuisance": COST + 4.0, "unmodelled_gain": 2.0},
    {"unmodelled_gain": 30.0}, {"unmodelled_gain": -4.0}, {"noise": NOISE - 0.5, "unmodelled_gain": 3.0},
])  # fmt: skip
def test_a_name_is_as_probable_as_something_else_at_its_gain(gains):
    """Else something else would be the most probable with a gain that is smaller than that of a name."""
    gain = decide(ranking_of(hypothesis_of("wind", 1.0), **gains)).something_else_gain
    less, equal, more = (decide(ranking_of(hypothesis_of("wind", gain + d), **gains)) for d in (-1.0, 0.0, 1.0))
    assert equal.entries[0].probability == pytest.approx(equal.something_else, rel=1e-9)
    assert less.entries[0].probability < less.something_else and more.entries[0].probability > more.something_else


@pytest.mark.parametrize("stated", ["noise", "nuisance"])
def test_a_sigma_that_is_as_probable_as_not_leaves_the_flight_undecided(stated):
    """At the prior cost of the contradiction: nothing is missing and something else have equal probabilities."""
    verdict = decide(ranking_of(**{stated: {"noise": NOISE, "nuisance": COST}[stated]}))
    assert verdict.none == verdict.something_else == pytest.approx(0.5) and verdict.verdict == "undecided"


def test_a_name_with_little_evidence_is_not_raised_to_the_odds_of_what_it_explains():
    """Nor reduced: its evidence is below these odds."""
    weak = hypothesis_of("wind", COST_IN_NOISE - 2.0, at_floor=False, explained_share=0.7)
    weak = replace(weak, complemented=False)
    verdict = decide(ranking_of(weak, noise=1e6))
    alone = decide(ranking_of(replace(weak, at_floor=True), noise=1e6))
    assert verdict.entries[0].probability == alone.entries[0].probability
    assert verdict.something_else == alone.something_else > 0.8


def test_the_odds_of_a_name_that_explains_all_are_finite():
    first = replace(hypothesis_of("wind", 700.0, at_floor=False, explained_share=1.0), complemented=False)
    verdict = decide(ranking_of(first, noise=1e6))
    shape = SETTINGS.explained_share_shape
    assert verdict.entries[0].probability == pytest.approx((1.0 - ERROR) * shape / (shape + 1.0) + ERROR / 3.0)


def test_the_odds_are_those_of_the_best_of_several_names():
    """The second name of a hypothesis has no part in its evidence."""
    column = np.ones(5)
    best = hypothesis_of("mass", 700.0, explained=column, at_floor=False, explained_share=0.8)
    second = hypothesis_of("wind", 699.0, explained=column, at_floor=True)
    settings = SETTINGS.model_copy(update={"approximation_error": 0.0})
    verdict = decide(ranking_of(replace(best, complemented=False), second, noise=1e6, settings=settings))
    assert verdict.entries[0].same_as == ("wind",)
    odds = verdict.entries[0].probability / verdict.something_else
    assert odds == pytest.approx(likelihood_ratio(0.8, SETTINGS.explained_share_shape), rel=1e-6)


def test_a_clean_flight():
    verdict = decide(ranking_of(hypothesis_of("wind", -3.0), hypothesis_of("mass", 2.0)))
    assert verdict.verdict == "clean" and verdict.leader is None
    assert verdict.sentence.startswith("The flight is clean")
    assert [e.hypothesis.name for e in verdict.entries] == ["mass", "wind"]


def test_without_names_the_prior_odds_remain():
    verdict = decide(ranking_of())
    assert verdict.verdict == "clean" and verdict.entries == []
    assert verdict.none == pytest.approx((1.0 - ERROR) / (1.0 + np.exp(-COST)) + ERROR / 2.0)


def test_a_missing_effect_is_named():
    verdict = decide(ranking_of(hypothesis_of("wind", 40.0), hypothesis_of("mass", 3.0), unmodelled_gain=10.0))
    assert verdict.verdict == "missing"
    assert verdict.leader.name == "wind"  # and not the effect that is in the model already
    assert verdict.sentence == "Missing: wind (gain 40 nats)."
    assert verdict.entries[0].probability == pytest.approx(1.0 - 0.75 * ERROR, abs=1e-9)  # of four hypotheses
    assert verdict.entries[0].same_as == ()


def test_something_else_that_no_effect_explains():
    for ranking in (
        ranking_of(hypothesis_of("wind", 3.0), unmodelled_gain=80.0),
        ranking_of(hypothesis_of("wind", 3.0), noise=50.0),
    ):
        verdict = decide(ranking)
        assert verdict.verdict == "unknown" and verdict.leader is None
        assert verdict.something_else == pytest.approx(1.0 - 2.0 / 3.0 * ERROR, abs=1e-9)
        assert verdict.sentence == "Something is missing that no effect of the catalogue explains."


def test_an_unknown_flight_has_the_most_likely_acceleration_in_words():
    """Where that contradicts the model, and not where only the noise does."""
    process = UnmodelledAcceleration(0.0, 1e-3, 20.0, form=Form.RATE)
    for gain, noise, stated in ((80.0, 0.0, True), (80.0, 50.0, True), (-600.0, 50.0, False)):
        verdict = decide(replace(ranking_of(unmodelled_gain=gain, noise=noise), unmodelled=process))
        text = " It most likely acts as a moment in proportion to the angular rate (gain 80 nats)."
        assert verdict.sentence == f"Something is missing that no effect of the catalogue explains.{text * stated}"


def test_an_undecided_flight_names_the_three_most_probable(monkeypatch):
    """With their probabilities, names of one hypothesis together; and what distinguishes the first two."""
    measurement = Discriminator("knowing the mass", 41.2)
    monkeypatch.setattr(decision, "best_discriminator", lambda *_: measurement)
    column = np.ones(5)
    pair = [hypothesis_of("mass", COST, explained=column), hypothesis_of("density_scale", COST - 1, explained=column)]
    verdict = decide(ranking_of(*pair, hypothesis_of("wind", COST - 2.0), unmodelled_gain=COST - 1.0))
    assert verdict.verdict == "undecided" and verdict.leader is None
    p = probabilities(np.array([0.0, -1.0, 0.0, -2.0]), ERROR)
    assert verdict.sentence == (
        f"Undecided: nothing is missing (probability {p[0]:.2f}), mass or density_scale ({p[2]:.2f}), "
        f"something outside the catalogue ({p[1]:.2f}). Knowing the mass would distinguish them by 41 nats."
    )


def test_probabilities_are_the_normalised_evidences():
    """No effect has 0; something else and each effect their gains less the prior cost; the smaller of two gains."""
    gains = {"wind": (9.0, 10.0), "mass": (7.0, 7.0), "gyro_bias": (3.0, 0.5)}
    hypotheses = [hypothesis_of(n, *g) for n, g in gains.items()]
    verdict = decide(ranking_of(*hypotheses, unmodelled_gain=3.0))
    weight = {n: np.exp(min(g) - COST) for n, g in gains.items()} | {"none": 1.0, "else": np.exp(3.0 - COST)}
    expected = {n: (1.0 - ERROR) * w / sum(weight.values()) + ERROR / 5.0 for n, w in weight.items()}
    assert verdict.none == pytest.approx(expected["none"])
    assert verdict.something_else == pytest.approx(expected["else"])
    for e in verdict.entries:
        assert e.probability == pytest.approx(expected[e.hypothesis.name])


@pytest.mark.parametrize("gain", [2.0, COST_IN_NOISE + 1.0, COST_IN_NOISE + 9.0])
@pytest.mark.parametrize("unmodelled", [-4.0, 900.0])
def test_in_excess_noise_no_effect_is_the_model_at_the_stated_noise(gain, unmodelled):
    """Its evidence is minus that for the noise beyond the prior cost of another noise, and for an acceleration."""
    named = hypothesis_of("wind", gain, at_floor=False)
    verdict = decide(ranking_of(named, unmodelled_gain=unmodelled, noise=NOISE + 11.0))
    weight = np.exp([-11.0 - max(unmodelled - COST_IN_NOISE, 0.0), 0.0, gain - COST_IN_NOISE])
    expected = (1.0 - ERROR) * weight / weight.sum() + ERROR / 3.0
    actual = [verdict.none, verdict.something_else, verdict.entries[0].probability]
    assert actual == pytest.approx(expected.tolist())
    by_gain = {2.0: "unknown", COST_IN_NOISE + 1.0: "undecided", COST_IN_NOISE + 9.0: "missing"}
    assert verdict.verdict == by_gain[gain]


@pytest.mark.parametrize(("noise", "cost", "otherwise"), [(0.0, COST, "clean"), (100.0, COST_IN_NOISE, "unknown")])
def test_a_name_needs_a_gain_and_a_held_out_gain(noise, cost, otherwise):
    """By log odds of the required probability more than the prior cost; as much less, and it is excluded."""
    for gain, score, expected in (
        (cost + 3.0, cost + 3.0, "missing"),
        (cost + 0.5, 1e3, "undecided"),
        (1e3, cost - 0.5, "undecided"),
        (cost - 3.0, 1e3, otherwise),
        (1e3, cost - 3.0, otherwise),
        (1e3, -5.0, otherwise),
    ):
        assert decide(ranking_of(hypothesis_of("mass", gain, score), noise=noise)).verdict == expected, (gain, score)


def test_the_thresholds_are_settings():
    def verdict_with(noise=0.0, **changes):
        settings = SETTINGS.model_copy(update=changes)
        return decide(ranking_of(hypothesis_of("mass", 10.0), noise=noise, settings=settings)).verdict

    assert verdict_with() == "missing"
    assert verdict_with(named_gain_nats=13.0) == "clean"
    assert verdict_with(decided_probability=0.99) == "undecided"
    assert verdict_with(decided_probability=0.99, approximation_error=0.0, named_gain_nats=3.0) == "missing"
    assert verdict_with(approximation_error=0.5) == "undecided"
    assert verdict_with(noise=9.0, excess_noise_nats=13.0) == "clean"
    assert verdict_with(noise=9.0, excess_noise_nats=6.0) == "unknown"
    for noise in (6.0, 13.0):
        assert verdict_with(noise=9.0, excess_noise_nats=noise, named_gain_in_excess_noise_nats=7.0) == "missing"


# --- continuity at the thresholds -----------------------------------------------------------------------------------

#: Change of an evidence, nats, and the largest change of a probability: a quarter of the cost's, whose slope is 2.
STEP, LARGEST_CHANGE = 1e-6, 1e-6


def gains_about(threshold, largest):
    """Positive gains, and those within a step of a threshold."""
    near = st.floats(-2.0, 2.0).map(lambda steps: threshold + steps * STEP)
    return st.one_of(st.floats(2.0 * STEP, largest), near)


@st.composite
def cases_at_a_threshold(draw):
    """Gains of names, of noise, of a nuisance parameter and of an acceleration that is less than its prior cost."""
    noise, nuisance = draw(gains_about(NOISE, 30.0)), draw(gains_about(COST, 30.0))
    names = [h[:3] for h in draw(close_candidates)]
    unmodelled = cost_of(noise) - 2e-5 - draw(st.floats(0.0, 40.0))
    return {"noise": noise, "nuisance": nuisance, "unmodelled_gain": unmodelled}, names


def probabilities_of(gains, names):
    """Of none, something else and each name, in the order of `names`."""
    verdict = decide(ranking_of(*(hypothesis_of(*n) for n in names), **gains))
    by_name = {e.hypothesis.name: e.probability for e in verdict.entries}
    return np.array([verdict.none, verdict.something_else, *(by_name[n[0]] for n in names)])


@given(cases_at_a_threshold())
def test_no_evidence_has_a_threshold_at_which_a_probability_changes_by_a_step(case):
    """Neither the noise nor a nuisance parameter nor an acceleration nor a name's gain or held-out gain.

    Of positive evidences, an acceleration with less than its prior cost, and names that explain all or are distinct.
    """
    gains, names = case
    before = probabilities_of(gains, names)
    changed = [(gains | {which: gains[which] + STEP}, names) for which in gains]
    for i, (name, gain, score) in enumerate(names):
        for change in ((STEP, 0.0), (0.0, STEP)):
            moved = (name, gain + change[0], score + change[1])
            changed.append((gains, [*names[:i], moved, *names[i + 1 :]]))
    for arguments in changed:
        np.testing.assert_allclose(probabilities_of(*arguments), before, rtol=0.0, atol=LARGEST_CHANGE)


@pytest.mark.parametrize("explained_share", [0.01, 0.5, 1.0])
def test_below_the_prior_cost_of_noise_the_explained_share_does_not_limit_a_name(explained_share):
    weak = replace(hypothesis_of("wind", 700.0, at_floor=False, explained_share=explained_share), complemented=False)
    verdict = decide(ranking_of(weak, hypothesis_of("mass", 3.0), noise=NOISE))
    assert verdict.verdict == "missing" and verdict.entries[0].probability == pytest.approx(1.0 - 0.75 * ERROR)


@given(varied_settings, st.floats(1e-3, 200.0), st.floats(0.0, 1.0), st.floats(1.0, 1e5))
def test_the_prior_cost_is_linear_between_its_values_without_and_in_excess_noise(settings, noise, share, factor):
    """It is constant from `excess_noise_nats` on, and that of a model that holds without evidence for noise."""
    settings = settings.model_copy(update={"excess_noise_nats": noise})
    low, high = settings.named_gain_nats, settings.named_gain_in_excess_noise_nats
    assert prior_cost(0.0, settings) == prior_cost(-1.0, settings) == low
    assert prior_cost(noise, settings) == prior_cost(factor * noise, settings) == high
    expected = (1.0 - share) * low + share * high
    assert prior_cost(share * noise, settings) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(st.lists(st.floats(-5.0, 30.0), min_size=2, max_size=10))
def test_the_prior_cost_never_falls_with_the_evidence_for_noise(gains):
    costs = [prior_cost(g, SETTINGS) for g in sorted(gains)]
    assert costs == sorted(costs)


# --- what would decide an undecided flight --------------------------------------------------------------------------


def end_of_sentence(verdict):
    """The sentence of an undecided verdict after its probabilities."""
    assert verdict.verdict == "undecided" and verdict.sentence.count("). ") == 1
    return verdict.sentence.split("). ")[1]


@pytest.fixture
def compared(monkeypatch):
    """Arguments of every discriminator that is computed, as names; `best` is the discriminator."""
    compared = SimpleNamespace(calls=[], best=Discriminator("a constraint landing 10 times better", 8.6))

    def discriminator(model, *effects):
        compared.calls.append((model, *(None if a is None else a.name for a in effects)))
        return compared.best

    monkeypatch.setattr(decision, "best_discriminator", discriminator)
    return compared


def named(name, gain):
    return replace(hypothesis_of(name, gain), model=f"model of {name}")


def test_a_measurement_decides_between_two_names(compared):
    """About the model of the second one."""
    names = [named("wind", 25.0), named("mass", 24.5), named("gyro_bias", 20.0)]
    text = end_of_sentence(decide(ranking_of(*names)))
    assert text == "A constraint landing 10 times better would distinguish them by 9 nats."
    assert compared.calls == [("model of mass", "wind", "mass")]
    compared.best = None
    assert end_of_sentence(decide(ranking_of(*names))) == "Only a measurement of one of the two would distinguish them."


@pytest.mark.parametrize("gain", [COST - 0.5, COST + 0.5])
def test_a_measurement_decides_between_a_name_and_none(compared, gain):
    """Whichever of the two is more probable: the effect is compared with no effect about its own model."""
    names = [named("wind", gain), named("mass", 2.0)]
    text = end_of_sentence(decide(ranking_of(*names)))
    assert text == "A constraint landing 10 times better would distinguish them by 9 nats."
    assert compared.calls == [("model of wind", "wind", None)]
    compared.best = None
    expected = "No better knowledge of a single nuisance parameter or constraint would distinguish them."
    assert end_of_sentence(decide(ranking_of(*names))) == expected


@pytest.mark.parametrize("change", [-0.5, 0.5])
def test_a_diagnosis_with_the_name_decides_between_it_and_something_else(compared, change):
    """Beside an acceleration, and in excess noise."""
    expected = "A diagnosis of the model with wind would show whether it leaves anything unexplained."
    names = [named("wind", 40.0 + change), named("mass", 2.0)]
    assert end_of_sentence(decide(ranking_of(*names, unmodelled_gain=40.0))) == expected
    names = [named("wind", COST_IN_NOISE + change), named("mass", 2.0)]
    assert end_of_sentence(decide(ranking_of(*names, noise=60.0))) == expected
    assert compared.calls == []


@pytest.mark.parametrize("change", [-0.5, 0.5])
def test_a_calibration_or_an_effect_decides_between_none_and_something_else(compared, change):
    """Beside an acceleration, excess noise, and a nuisance parameter far from its stated value."""
    expected = "A calibration of the sensors' noise, or an effect that explains the residuals, would decide."
    names = [named("wind", 2.0), named("mass", 1.0)]
    for gains in ({"unmodelled_gain": COST + change}, {"noise": NOISE + change}, {"nuisance": COST + change}):
        assert end_of_sentence(decide(ranking_of(*names, **gains))) == expected
    assert compared.calls == []


# --- names that are not distinguished -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("discriminator", "text"),
    [
        (Discriminator("knowing the mass", 41.2), "knowing the mass would distinguish them by 41 nats"),
        (None, "only a measurement of one of the two would distinguish them"),
    ],
)
def test_two_names_with_one_column_are_one_hypothesis(monkeypatch, discriminator, text):
    monkeypatch.setattr(decision, "best_discriminator", lambda *_: discriminator)
    column = np.array([3.0, -1.0, 0.5, 2.0, 0.0])
    pair = [
        hypothesis_of("mass", 28.0, explained=column),
        hypothesis_of("density_scale", 30.0, explained=-2.0 * column),
    ]
    verdict = decide(ranking_of(*pair, hypothesis_of("com_offset", 25.0)))
    assert [(e.hypothesis.name, e.same_as) for e in verdict.entries] == [
        ("density_scale", ("mass",)),
        ("com_offset", ()),
    ]
    assert verdict.sentence == "Missing: density_scale or mass (gain 30 nats)."
    assert verdict.entries[0].discriminated_by == {"mass": text} and verdict.entries[1].discriminated_by == {}


def test_each_further_name_is_compared_with_the_first(monkeypatch):
    """About the model of the further name."""
    compared = []

    def discriminator(model, first, second):
        compared.append((model, first.name, second.name))
        return Discriminator(f"knowing {second.name}", 10.0)

    monkeypatch.setattr(decision, "best_discriminator", discriminator)
    column = np.ones(5)
    gains = {"mass": 30.0, "wind": 29.0, "gyro_bias": 28.0}
    hypotheses = [replace(hypothesis_of(n, g, explained=column), model=f"model of {n}") for n, g in gains.items()]
    entry, *further_entries = decide(ranking_of(*hypotheses)).entries
    assert further_entries == []
    assert compared == [("model of wind", "mass", "wind"), ("model of gyro_bias", "mass", "gyro_bias")]
    text = "knowing {} would distinguish them by 10 nats"
    assert entry.discriminated_by == {n: text.format(n) for n in ("wind", "gyro_bias")}


def test_evidence_distinguishes_names_with_one_column():
    column = np.ones(5)
    for difference, groups in ((SETTINGS.separable_gain_nats - 0.1, 1), (SETTINGS.separable_gain_nats + 0.1, 2)):
        pair = [
            hypothesis_of("mass", 30.0, explained=column),
            hypothesis_of("wind", 30.0 - difference, explained=column),
        ]
        assert len(group_indistinguishable(pair, SETTINGS)) == groups


@given(st.lists(st.tuples(st.sampled_from(NAMES), st.floats(0.0, 20.0), st.integers(0, 3)), unique_by=lambda t: t[0]))
def test_every_hypothesis_is_in_one_group_best_first(examples):
    columns = np.array([[1.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    hypotheses = [hypothesis_of(n, g, explained=columns[c]) for n, g, c in examples]
    groups = group_indistinguishable(hypotheses, SETTINGS)
    assert sorted(id(h) for g in groups for h in g) == sorted(id(h) for h in hypotheses)
    first_gains = [g[0].gain for g in groups]
    assert first_gains == sorted(first_gains, reverse=True)
    for g in groups:
        assert [h.gain for h in g] == sorted((h.gain for h in g), reverse=True)


# --- channels that a hypothesis reduces -----------------------------------------------------------------------------


def test_the_channel_whose_mean_square_falls_most(monkeypatch):
    nan = float("nan")
    names = ["moment_x", "force_x", "force_y", "force_z"]
    monkeypatch.setattr(decision, "channels", lambda _: [(name, "") for name in names])
    before = {"moment_x": 11.1, "force_x": 9.0, "force_y": 8.0, "force_z": nan, "altimeter": 20.0, "landing": nan}
    reduced = [
        most_reduced_channel(SimpleNamespace(model=None), before, dict(zip(before, after, strict=True)))
        for after in (
            (11.1, 1.0, 0.9, 1.0, 1.0, 1.0),
            (12.0, 9.1, 7.9, nan, 1.0, 1.0),
            (12.0, 9.1, 8.1, nan, 1.0, 1.0),  # no channel's falls
            (12.0, 9.1, 8.1, nan, 20.1, nan),
        )
    ]
    assert reduced == ["force_x", "force_y", "altimeter", "force_y"]


def test_a_small_fall_of_a_channel_is_preferred_to_a_large_one_of_a_constraint(monkeypatch):
    monkeypatch.setattr(decision, "channels", lambda _: [("moment_x", ""), ("force_x", "")])
    before = {"moment_x": 1.2, "force_x": 1.2, "landing": 20.0}
    after = {"moment_x": 1.2, "force_x": 1.1, "landing": 1.0}
    assert most_reduced_channel(SimpleNamespace(model=None), before, after) == "force_x"


def test_rms_of_a_hypothesis_are_those_of_channels_and_constraints():
    """Of innovations 3 and 4 in a channel, and 12 in a constraint; other channels have no rows."""
    bin_rows = np.full((2, 6), -1)
    bin_rows[:, 1] = [0, 1]
    model = SimpleNamespace(
        inputs=SimpleNamespace(checking=[], problem=SimpleNamespace(constraints=[SimpleNamespace(name="landing")])),
        index=SimpleNamespace(bin_rows=bin_rows, constraint_rows=(slice(2, 3),)),
    )
    h = replace(hypothesis_of("wind", 1.0), model=model, normalised=np.array([3.0, 4.0, 12.0]))
    rms = {name: value for name, value in hypothesis_rms(h).items() if np.isfinite(value)}
    assert rms == {"force_y": pytest.approx(np.sqrt(12.5)), "landing": 12.0}


@pytest.fixture
def ranked(monkeypatch):
    """Ranks a first hypothesis with a given share; the ranking with it in the model is given, and counted."""

    def run(share, seconds, at_floor=False):
        first = hypothesis_of("wind", 700.0, at_floor=at_floor, explained_share=share)
        without = ranking_of(first, hypothesis_of("mass", 10.0, at_floor=False))
        without = replace(without, case=SimpleNamespace(settings=SETTINGS, reconstruct_with=lambda effects: effects))
        rankings = [without, ranking_of(*seconds)]
        calls = []

        def next_ranking(case, *_):
            calls.append(case)
            return rankings[len(calls) - 1]

        monkeypatch.setattr(ranking_module, "_rank", next_ranking)
        monkeypatch.setattr(ranking_module, "candidate_instances", lambda *_: [])
        return ranking_module.rank(without.case, [find_effect("wind")]).hypotheses, calls

    return run


@pytest.mark.parametrize(("share", "at_floor"), [(0.19, False), (0.9, False), (0.98, False), (0.5, True)])
def test_no_second_effect_is_tried_where_the_first_explains_clearly_more_or_less(ranked, share, at_floor):
    hypotheses, calls = ranked(share, [], at_floor)
    assert len(calls) == 1 and hypotheses[0].complemented is None


@pytest.mark.parametrize(
    ("seconds", "complemented"),
    [
        ([], False),
        ([hypothesis_of("mass", 5.0, at_floor=False, explained_share=0.3)], False),
        ([hypothesis_of("mass", 5.0, at_floor=False, explained_share=0.8)], False),
        ([hypothesis_of("mass", 5.0, at_floor=False, explained_share=0.0), hypothesis_of("gyro_bias", 3.0)], True),
    ],
)
def test_of_two_effects_in_the_same_cells_each_explains_less_than_a_half(ranked, seconds, complemented):
    """The second one has to leave hardly any excess variance then: wrong names explain as much."""
    first, *_ = ranked(0.3, seconds)[0]
    assert first.complemented is complemented
    verdict = decide(ranking_of(first, noise=1e6))
    assert (verdict.verdict == "missing") is complemented


@pytest.mark.parametrize(
    ("seconds", "complemented"),
    [
        ([], False),
        ([hypothesis_of("mass", 5.0, at_floor=False, explained_share=0.3)], False),
        ([hypothesis_of("mass", 5.0, at_floor=False, explained_share=0.95)], True),
        ([hypothesis_of("mass", 5.0, at_floor=False, explained_share=0.0), hypothesis_of("gyro_bias", 3.0)], True),
    ],
)
def test_a_second_effect_that_reaches_the_noise_complements_the_first(ranked, seconds, complemented):
    hypotheses, calls = ranked(0.5, seconds)
    assert [h.name for h in hypotheses] == ["wind", "mass"]
    assert hypotheses[0].complemented is complemented
    assert [a.name for a in calls[1]] == ["gravity_oblateness", "wind"]  # the case has the first effect in its model
