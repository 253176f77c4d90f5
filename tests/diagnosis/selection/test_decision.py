"""Probabilities and verdicts of constructed rankings; the channels that a hypothesis reduces."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from decision_checks import check_verdict, implied_verdict
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration
from edl_filter.diagnosis.selection import decision
from edl_filter.diagnosis.selection import ranking as ranking_module
from edl_filter.diagnosis.selection.decision import (
    decide,
    group_indistinguishable,
    hypothesis_rms,
    most_reduced_channel,
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

SETTINGS = DecisionSettings()
COST, COST_IN_NOISE = SETTINGS.named_gain_nats, SETTINGS.named_gain_in_excess_noise_nats
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
    expected_cost = settings.named_gain_in_excess_noise_nats if is_noisy(ranking) else settings.named_gain_nats
    assert verdict.required_gain == expected_cost
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
    changed = [
        hypothesis_of(h.name, h.gain, h.score_gain, at_floor=at_floor) for h in reversed(ranking.hypotheses)
    ]  # fmt: skip
    again = decide(
        ranking_of(*changed, unmodelled_gain=1e7, noise=ranking.excess_noise_gain, settings=ranking.case.settings)
    )
    assert (again.verdict, again.none, again.something_else) == pytest.approx(
        (verdict.verdict, verdict.none, verdict.something_else)
    )


@given(rankings(noise=(10.1, 1e5)), st.floats(0.0, SETTINGS.named_explained_share, exclude_max=True))
def test_a_name_that_explains_a_part_has_at_most_the_odds_of_that_part(ranking, explained_share):
    """All names are reduced by the same evidence, so that their order is that of their gains."""
    hypotheses = [
        hypothesis_of(h.name, h.gain, h.score_gain, at_floor=False, explained_share=explained_share)
        for h in ranking.hypotheses
    ]
    settings, noise = ranking.case.settings, ranking.excess_noise_gain
    before, verdict = (decide(ranking_of(*h, noise=noise, settings=settings)) for h in (ranking.hypotheses, hypotheses))
    largest = max(explained_share, 1e-3)
    assert all(e.probability <= largest + settings.approximation_error + 1e-9 for e in verdict.entries)
    assert [e.hypothesis.name for e in verdict.entries] == [e.hypothesis.name for e in before.entries]


@pytest.mark.parametrize(("explained_share", "outcome"), [(0.1, "unknown"), (0.3, "undecided"), (0.39, "undecided")])
def test_the_limit_is_that_of_the_first_name(explained_share, outcome):
    weak = hypothesis_of("wind", 700.0, at_floor=False, explained_share=explained_share)
    second = hypothesis_of("mass", 695.0, at_floor=False)
    verdict = decide(ranking_of(weak, second, noise=1e6))
    assert verdict.verdict == outcome
    odds = verdict.entries[0].probability / verdict.something_else
    assert odds == pytest.approx(explained_share / (1.0 - explained_share), rel=0.1)
    for strong in (replace(weak, at_floor=True), replace(weak, explained_share=SETTINGS.named_explained_share)):
        assert decide(ranking_of(strong, second, noise=1e6)).verdict == "missing"


def test_a_first_name_without_a_complement_has_the_odds_of_its_part():
    """Whether a second effect explains the rest decides between the first of two effects and a resemblance."""
    first = hypothesis_of("wind", 700.0, at_floor=False, explained_share=0.5)
    assert decide(ranking_of(replace(first, complemented=True), noise=1e6)).verdict == "missing"
    verdict = decide(ranking_of(replace(first, complemented=False), noise=1e6))
    assert verdict.verdict == "undecided"
    assert verdict.entries[0].probability == pytest.approx(verdict.something_else, rel=1e-6)


def test_a_nuisance_parameter_that_is_not_credible_excludes_that_nothing_is_missing():
    """The flight is not clean, and a name needs no more evidence than about a model that holds."""
    named, weak = hypothesis_of("wind", 18.0), hypothesis_of("mass", 2.0)
    assert decide(ranking_of(weak)).verdict == "clean"
    assert decide(ranking_of(weak, nuisance=15.0)).verdict == "unknown"
    verdict = decide(ranking_of(named, weak, nuisance=15.0))
    assert (verdict.verdict, verdict.required_gain) == ("missing", SETTINGS.named_gain_nats)
    assert decide(ranking_of(named, noise=15.0)).verdict == "unknown"  # beside noise of unknown form it needs more


def test_a_slightly_incredible_nuisance_parameter_excludes_an_acceleration_too():
    """Any evidence against the stated sigma is that for something else, however small it is."""
    verdict = decide(ranking_of(nuisance=0.5, unmodelled_gain=900.0))
    weight = np.exp([-0.5, 0.0])
    expected = (1.0 - ERROR) * weight / weight.sum() + ERROR / 2.0
    assert [verdict.none, verdict.something_else] == pytest.approx(expected.tolist())


def test_a_name_with_little_evidence_is_not_raised_to_the_odds_of_what_it_explains():
    """Nor reduced: its evidence is below these odds."""
    weak = hypothesis_of("wind", COST_IN_NOISE - 2.0, at_floor=False, explained_share=0.35)
    verdict = decide(ranking_of(weak, noise=1e6))
    alone = decide(ranking_of(replace(weak, at_floor=True), noise=1e6))
    assert verdict.entries[0].probability == alone.entries[0].probability
    assert verdict.something_else == alone.something_else > 0.8


def test_the_odds_of_a_name_that_explains_all_are_finite():
    first = replace(hypothesis_of("wind", 700.0, at_floor=False, explained_share=1.0), complemented=False)
    verdict = decide(ranking_of(first, noise=1e6))
    assert verdict.entries[0].probability == pytest.approx((1.0 - ERROR) * 0.999 + ERROR / 3.0, rel=1e-9)


def test_the_odds_are_those_of_the_best_of_several_names():
    """The second name of a hypothesis has no part in its evidence."""
    column = np.ones(5)
    best = hypothesis_of("mass", 700.0, explained=column, at_floor=False, explained_share=0.5)
    second = hypothesis_of("wind", 699.0, explained=column, at_floor=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(decision, "best_discriminator", lambda *_: None)
        verdict = decide(ranking_of(replace(best, complemented=False), second, noise=1e6))
    assert verdict.entries[0].same_as == ("wind",)
    assert verdict.entries[0].probability == pytest.approx(verdict.something_else, rel=1e-6)


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


def test_an_undecided_flight_names_the_three_most_probable():
    """With their probabilities; names of one hypothesis together."""
    column = np.ones(5)
    pair = [hypothesis_of("mass", COST, explained=column), hypothesis_of("density_scale", COST - 1, explained=column)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(decision, "best_discriminator", lambda *_: None)
        verdict = decide(ranking_of(*pair, hypothesis_of("wind", COST - 2.0), unmodelled_gain=COST - 1.0))
    assert verdict.verdict == "undecided" and verdict.leader is None
    p = probabilities(np.array([0.0, -1.0, 0.0, -2.0]), ERROR)
    assert verdict.sentence == (
        f"Undecided: nothing is missing (probability {p[0]:.2f}), mass or density_scale ({p[2]:.2f}), "
        f"something outside the catalogue ({p[1]:.2f})."
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
    """Its evidence is minus that for the noise, over which all gains are; an acceleration adds nothing to it."""
    verdict = decide(ranking_of(hypothesis_of("wind", gain), unmodelled_gain=unmodelled, noise=11.0))
    weight = np.exp([-11.0, 0.0, gain - COST_IN_NOISE])
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
    assert verdict_with(noise=9.0, excess_noise_nats=9.5) == "missing"
    assert verdict_with(noise=9.0, excess_noise_nats=8.5) == "unknown"
    assert verdict_with(noise=9.0, excess_noise_nats=8.5, named_gain_in_excess_noise_nats=7.0) == "missing"


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
        without = replace(without, case=SimpleNamespace(settings=SETTINGS, mission=None))
        rankings = [without, ranking_of(*seconds)]
        calls = []

        def next_ranking(case, *_):
            calls.append(case)
            return rankings[len(calls) - 1]

        monkeypatch.setattr(ranking_module, "_rank", next_ranking)
        monkeypatch.setattr(ranking_module, "candidate_instances", lambda *_: [])
        monkeypatch.setattr(ranking_module, "load_case", lambda mission, effects: effects)
        return ranking_module.rank(without.case, [find_effect("wind")]).hypotheses, calls

    return run


@pytest.mark.parametrize(("share", "at_floor"), [(0.19, False), (0.7, False), (0.98, False), (0.5, True)])
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
        ([hypothesis_of("mass", 5.0, at_floor=False, explained_share=0.8)], True),
        ([hypothesis_of("mass", 5.0, at_floor=False, explained_share=0.0), hypothesis_of("gyro_bias", 3.0)], True),
    ],
)
def test_a_second_effect_that_reaches_the_noise_complements_the_first(ranked, seconds, complemented):
    hypotheses, calls = ranked(0.5, seconds)
    assert [h.name for h in hypotheses] == ["wind", "mass"]
    assert hypotheses[0].complemented is complemented
    assert [a.name for a in calls[1]] == ["gravity_oblateness", "wind"]  # the case has the first effect in its model
