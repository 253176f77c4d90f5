"""Probabilities and verdicts of constructed rankings; the channels that a hypothesis reduces; a second effect."""

from types import SimpleNamespace

import numpy as np
import pytest
from decision_checks import check_verdict, largest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration
from edl_filter.diagnosis.selection import decision
from edl_filter.diagnosis.selection.decision import (
    decide,
    explains_its_channel,
    find_joint_effect,
    group_indistinguishable,
    most_reduced_channel,
    reduces_its_channel,
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
NAMES = ("wind", "mass", "gyro_bias", "com_offset", "density_scale")


def hypothesis_of(name, gain, score=None, explained=None, at_floor=True):
    """A fitted effect with what the decision needs of it; columns of different names are orthogonal."""
    own = np.zeros(len(NAMES))
    own[NAMES.index(name)] = 1.0
    effects = (EffectInstance(find_effect("gravity_oblateness"), {}), EffectInstance(find_effect(name), {}))
    return Hypothesis(
        key=(name, None),
        fit=SimpleNamespace(effects=effects),
        whiten=None,
        gain=gain,
        score_gain=gain if score is None else score,
        at_floor=at_floor,
        explained=own if explained is None else np.asarray(explained, float),
        case=None,
        model=None,
        null=NullModelFit(0.0, 0.0, 0.0),
    )


def ranking_of(*hypotheses, unmodelled_gain=0.0, noise=0.0, exact=False, settings=SETTINGS):
    case = SimpleNamespace(exact_database=exact, settings=settings)
    return Ranking(case, None, {}, list(hypotheses), UnmodelledAcceleration(), unmodelled_gain, noise)


@pytest.fixture(autouse=True)
def joint(monkeypatch):
    """Gains of a name together with an unmodelled acceleration: their sum, unless a test says otherwise."""
    gains = {}

    def joint_gain(ranking, h):
        return gains.get(h.name, h.gain + max(0.0, ranking.unmodelled_gain))

    monkeypatch.setattr(decision, "joint_gain", joint_gain)
    return gains


@pytest.fixture
def channel_rules(monkeypatch):
    """Set what the rules about channels say of every hypothesis."""

    def set_rules(explains=True, reduces=True):
        monkeypatch.setattr(decision, "explains_its_channel", lambda *_: explains)
        monkeypatch.setattr(decision, "reduces_its_channel", lambda *_: reduces)

    return set_rules


# --- the verdict as a function of the probabilities -----------------------------------------------------------------

probabilities = st.lists(st.floats(0.0, 1.0), min_size=2, max_size=7).filter(lambda p: sum(p) > 1e-3)


@given(probabilities, st.randoms())
def test_the_verdict_is_that_of_the_most_probable_hypothesis(weights, random):
    total = sum(weights)
    none, something_else, *names = (w / total for w in weights)
    verdict = verdict_of(names, none, something_else)
    assert verdict == largest(names, none, something_else)
    best = max((none, something_else, *names))
    of_best = {
        "clean": none == best, "unknown": something_else == best, "missing": bool(names) and max(names) == best
    }  # fmt: skip
    assert of_best[verdict]
    assert list(of_best).index(verdict) == list(of_best.values()).index(True)  # ties: the simpler hypothesis
    # the order of the names and a common factor do not matter
    shuffled = list(names)
    random.shuffle(shuffled)
    assert verdict_of(shuffled, none, something_else) == verdict
    assert verdict_of([0.5 * p for p in names], 0.5 * none, 0.5 * something_else) == verdict


@given(probabilities)
def test_names_that_are_not_the_most_probable_do_not_matter(weights):
    none, something_else, *names = weights
    best = [max(names)] if names else []
    assert verdict_of(names, none, something_else) == verdict_of(best, none, something_else)


def test_no_name_was_tried():
    assert verdict_of([], 0.6, 0.4) == "clean" and verdict_of([], 0.4, 0.6) == "unknown"


# --- probabilities of constructed rankings --------------------------------------------------------------------------

candidates = st.lists(
    st.tuples(st.sampled_from(NAMES), st.floats(-1e4, 1e6), st.floats(-1e4, 1e6), st.booleans()),
    max_size=5,
    unique_by=lambda t: t[0],
)


@st.composite
def rankings(draw, gains=candidates, noise=(0.0, 1e5), unmodelled=(-1e3, 1e6)):
    """Rankings with gains of a strategy, and evidences between bounds."""
    hypotheses = [hypothesis_of(*h[:3], at_floor=h[3]) for h in draw(gains)]
    noise_gain, unmodelled_gain = draw(st.floats(*noise)), draw(st.floats(*unmodelled))
    return ranking_of(*hypotheses, unmodelled_gain=unmodelled_gain, noise=noise_gain, exact=draw(st.booleans()))


def decide_with_rules(ranking, explains, reduces, joint_gain, partner=None):
    """The verdict with given answers of what depends on a flight."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(decision, "explains_its_channel", lambda *_: explains)
        patch.setattr(decision, "reduces_its_channel", lambda *_: reduces)
        patch.setattr(decision, "joint_gain", lambda *_: joint_gain)
        return decide(ranking, partner)


rules = (st.booleans(), st.booleans(), st.floats(-1e3, 2e6))


@given(rankings(), *rules)
def test_verdict_probabilities_and_ranking_do_not_contradict_each_other(ranking, explains, reduces, joint_gain):
    verdict = decide_with_rules(ranking, explains, reduces, joint_gain)
    check_verdict(verdict)
    assert sorted(e.hypothesis.name for e in verdict.entries) == sorted(h.name for h in ranking.hypotheses)
    if verdict.verdict == "missing":
        leader = verdict.entries[0].hypothesis
        assert min(leader.gain, leader.score_gain) > COST


small = st.lists(
    st.tuples(st.sampled_from(NAMES), st.floats(-10.0, 30.0), st.floats(-10.0, 30.0), st.booleans()),
    max_size=5,
    unique_by=lambda t: t[0],
)


@given(rankings(small, (0.0, 30.0), (-10.0, 40.0)), st.booleans(), st.booleans(), st.floats(-10, 60))
def test_also_where_all_evidences_are_close(ranking, explains, reduces, joint_gain):
    """Where probabilities are far from zero and one."""
    verdict = decide_with_rules(ranking, explains, reduces, joint_gain)
    check_verdict(verdict)
    if verdict.verdict == "missing":
        leader = verdict.entries[0].hypothesis
        noisy = ranking.excess_noise_gain > SETTINGS.excess_noise_nats
        assert min(leader.gain, leader.score_gain) > (COST_IN_NOISE if noisy else COST)


@given(rankings(small, (0.0, 10.0), (-10.0, 40.0)), *rules)
def test_a_name_with_little_evidence_is_never_above_a_probable_clean_verdict(ranking, explains, reduces, joint_gain):
    """Gain and held-out gain must both exceed the prior cost, or the name is less probable than no effect."""
    verdict = decide_with_rules(ranking, explains, reduces, joint_gain)
    for e in verdict.entries:
        if min(e.hypothesis.gain, e.hypothesis.score_gain) < COST:
            assert e.probability <= verdict.none
    if verdict.none > 0.5:
        assert verdict.verdict == "clean" and all(e.probability < verdict.none for e in verdict.entries)


@given(rankings(noise=(10.1, 1e5)), *rules)
def test_in_excess_noise_names_that_are_not_accepted_are_below_something_else(ranking, explains, reduces, joint_gain):
    """By the prior cost at least: those that leave excess variance, apart from the best if it is accepted."""
    verdict = decide_with_rules(ranking, explains, reduces, joint_gain)
    best = max((h.gain for h in ranking.hypotheses), default=0.0)
    exact, unmodelled = ranking.case.exact_database, max(0.0, ranking.unmodelled_gain)
    for e in verdict.entries:
        h = e.hypothesis
        explains_a_part = h.gain > SETTINGS.partial_gain_share * unmodelled and (explains or not exact)
        accepted = h.gain == best and (h.gain >= unmodelled or explains_a_part) and (reduces or not exact)
        if not (h.at_floor or accepted):
            assert e.probability <= verdict.something_else * np.exp(-COST_IN_NOISE) * (1.0 + 1e-9)
            assert verdict.verdict != "missing" or e is not verdict.entries[0]


def test_a_clean_flight():
    verdict = decide(ranking_of(hypothesis_of("wind", -3.0), hypothesis_of("mass", 2.0)))
    assert verdict.verdict == "clean" and verdict.leader is None
    assert verdict.sentence.startswith("The flight is clean")
    assert [e.hypothesis.name for e in verdict.entries] == ["mass", "wind"]


def test_without_names_the_prior_odds_remain():
    verdict = decide(ranking_of())
    assert verdict.verdict == "clean" and verdict.entries == []
    assert verdict.none == pytest.approx(1.0 / (1.0 + np.exp(-COST)))


def test_a_missing_effect_is_named():
    verdict = decide(ranking_of(hypothesis_of("wind", 40.0), hypothesis_of("mass", 3.0), unmodelled_gain=10.0))
    assert verdict.verdict == "missing"
    assert verdict.leader.name == "wind"  # and not the effect that is in the model already
    assert verdict.sentence == "Missing: wind (gain 40 nats)."
    assert verdict.entries[0].probability > 0.999 and verdict.entries[0].same_as == ()


def test_something_else_that_no_effect_explains():
    verdict = decide(ranking_of(hypothesis_of("wind", 3.0), unmodelled_gain=80.0))
    assert verdict.verdict == "unknown" and verdict.leader is None
    assert verdict.something_else > 0.999
    assert decide(ranking_of(hypothesis_of("wind", 3.0), noise=50.0)).verdict == "unknown"


def test_probabilities_are_the_normalised_evidences():
    """No effect has 0; something else and each effect their gains less the prior cost; the smaller of two gains."""
    gains = {"wind": (9.0, 10.0), "mass": (7.0, 7.0), "gyro_bias": (3.0, 0.5)}
    hypotheses = [hypothesis_of(n, *g) for n, g in gains.items()]
    verdict = decide(ranking_of(*hypotheses, unmodelled_gain=3.0))
    weight = {n: np.exp(min(g) - COST) for n, g in gains.items()} | {"none": 1.0, "else": np.exp(3.0 - COST)}
    total = sum(weight.values())
    assert verdict.none == pytest.approx(1.0 / total)
    assert verdict.something_else == pytest.approx(weight["else"] / total)
    for e in verdict.entries:
        assert e.probability == pytest.approx(weight[e.hypothesis.name] / total)


def test_in_excess_noise_no_effect_is_the_model_at_the_stated_noise():
    """Its evidence is minus that for the noise; something else is the noise alone, or an unmodelled acceleration."""
    for unmodelled, gain in ((-4.0, 2.0), (13.0, 14.0)):
        verdict = decide(ranking_of(hypothesis_of("wind", gain), unmodelled_gain=unmodelled, noise=11.0))
        something_else = 1.0 + np.exp(unmodelled - COST_IN_NOISE)
        total = np.exp(-11.0) + something_else + np.exp(gain - COST_IN_NOISE)
        if something_else < np.exp(gain - COST_IN_NOISE):
            assert verdict.verdict == "missing"
        assert verdict.none == pytest.approx(np.exp(-11.0) / total)
        assert verdict.something_else == pytest.approx(something_else / total)


@pytest.mark.parametrize(("noise", "required"), [(0.0, COST), (100.0, COST_IN_NOISE)])
def test_a_name_needs_a_gain_and_a_held_out_gain(noise, required):
    for gain, score, named in (
        (required + 0.1, required + 0.1, True),
        (required - 0.1, 1e3, False),
        (1e3, required - 0.1, False),
        (1e3, -5.0, False),
    ):
        verdict = decide(ranking_of(hypothesis_of("mass", gain, score), noise=noise))
        assert (verdict.verdict == "missing") == named, (gain, score)


def test_the_thresholds_are_settings():
    hypothesis = hypothesis_of("mass", 8.0)
    settings = SETTINGS.model_copy(update={"named_gain_nats": 9.0})
    assert decide(ranking_of(hypothesis)).verdict == "missing"
    assert decide(ranking_of(hypothesis, settings=settings)).verdict == "clean"
    settings = SETTINGS.model_copy(update={"excess_noise_nats": 5.0})
    assert decide(ranking_of(hypothesis, noise=7.0)).verdict == "missing"
    assert decide(ranking_of(hypothesis, noise=7.0, settings=settings)).verdict == "unknown"


# --- acceptance of a name -------------------------------------------------------------------------------------------


def test_a_name_that_explains_little_of_what_an_unmodelled_acceleration_explains_is_not_accepted():
    """Unless it leaves hardly any excess variance; an accepted name is evaluated together with the acceleration."""
    for gain, at_floor, named in ((60.0, False, True), (40.0, False, False), (40.0, True, True)):
        verdict = decide(ranking_of(hypothesis_of("mass", gain, at_floor=at_floor), unmodelled_gain=1000.0))
        assert (verdict.verdict == "missing") == named, (gain, at_floor)


def test_an_accepted_name_has_its_joint_evidence_with_the_unmodelled_acceleration(joint):
    """It must be more probable than the acceleration alone."""
    joint["mass"] = 1003.0
    verdict = decide(ranking_of(hypothesis_of("mass", 60.0), unmodelled_gain=1000.0))
    odds = verdict.entries[0].probability / verdict.something_else
    assert verdict.verdict == "missing" and np.log(odds) == pytest.approx(3.0)
    joint["mass"] = 997.0
    verdict = decide(ranking_of(hypothesis_of("mass", 60.0), unmodelled_gain=1000.0))
    assert verdict.verdict == "unknown" and verdict.entries[0].probability == pytest.approx(np.exp(-3.0), rel=0.06)


def test_a_name_without_enough_gain_of_its_own_is_not_helped_by_the_acceleration(joint):
    joint["mass"] = 5000.0
    assert decide(ranking_of(hypothesis_of("mass", COST - 0.1), unmodelled_gain=50.0)).verdict == "unknown"


@pytest.mark.parametrize(
    ("exact", "explains", "verdict"), [(True, True, "missing"), (True, False, "unknown"), (False, False, "missing")]
)
def test_with_an_exact_database_a_name_must_explain_its_channel(channel_rules, exact, explains, verdict):
    channel_rules(explains=explains)
    hypothesis = hypothesis_of("mass", 60.0, at_floor=False)
    assert decide(ranking_of(hypothesis, unmodelled_gain=1000.0, noise=1e4, exact=exact)).verdict == verdict


@pytest.mark.parametrize(
    ("reduces", "at_floor", "verdict"),
    [(False, False, "unknown"), (True, False, "missing"), (False, True, "missing")],
)
def test_with_an_exact_database_a_name_that_leaves_the_model_failing_must_reduce_its_channel(
    channel_rules, reduces, at_floor, verdict
):
    """Also where nothing exceeds its gain: what it leaves is another effect, or the name is wrong."""
    channel_rules(reduces=reduces)
    hypothesis = hypothesis_of("mass", 60.0, at_floor=at_floor)
    result = decide(ranking_of(hypothesis, unmodelled_gain=5.0, noise=1e4, exact=True))
    assert result.verdict == verdict
    assert result.provisional is (hypothesis if verdict == "unknown" else None)


def test_only_a_name_with_enough_gain_and_an_exact_database_is_provisional(channel_rules):
    channel_rules(reduces=False)
    weak, strong = (hypothesis_of("mass", gain, at_floor=False) for gain in (11.0, 60.0))
    assert decide(ranking_of(weak, noise=1e4, exact=True)).provisional is None
    assert decide(ranking_of(strong, unmodelled_gain=1e4, noise=1e4)).provisional is None  # a database with an error
    verdict = decide(ranking_of(strong, noise=1e4, exact=True))
    assert verdict.provisional is strong and verdict.leader is None


def test_a_second_effect_that_explains_the_rest_leaves_nothing_for_something_else(channel_rules):
    channel_rules(reduces=False)
    strong, partner = hypothesis_of("mass", 60.0, at_floor=False), hypothesis_of("wind", 500.0)
    verdict = decide(ranking_of(strong, unmodelled_gain=900.0, noise=1e4, exact=True), partner)
    assert verdict.leader.name == "mass" and verdict.provisional is None and verdict.partner is partner
    assert verdict.something_else == 0.0 and verdict.entries[0].probability > 0.999
    assert verdict.sentence == "Missing: mass (gain 60 nats). With wind in addition, model and measurement agree."


@given(
    st.floats(COST_IN_NOISE + 0.1, 1e4),
    st.floats(COST_IN_NOISE + 0.1, 1e4),
    st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(-1e2, 1e4), st.booleans()), max_size=4),
    st.floats(-1e2, 1e4),
    st.floats(20.0, 1e4),
)
def test_the_sentence_names_the_second_effect_with_the_name_that_it_was_fitted_with(
    gain, score, shares, unmodelled, noise
):
    """Which is the provisional one. Another name may lead: one that leaves no excess variance alone."""
    best = hypothesis_of("mass", gain, score, at_floor=False)
    others = [
        hypothesis_of(name, 0.99 * share * gain, other_score, at_floor=at_floor)
        for name, (share, other_score, at_floor) in zip(NAMES[2:] + NAMES[:1], shares, strict=False)
    ]
    ranking = ranking_of(best, *others, unmodelled_gain=unmodelled, noise=noise, exact=True)
    first = decide_with_rules(ranking, False, False, 0.0)
    assert first.provisional is (best if first.verdict == "unknown" else None)
    partner = hypothesis_of("density_scale", 500.0)
    verdict = decide_with_rules(ranking, False, False, 0.0, partner)
    check_verdict(verdict)
    assert verdict.verdict == "missing" and verdict.something_else == 0.0 and verdict.provisional is None
    leads = verdict.entries[0].hypothesis is best
    assert verdict.partner is (partner if leads else None)
    assert ("With density_scale in addition" in verdict.sentence) == leads
    if not any(h.at_floor for h in others):
        assert leads and all(e.probability == 0.0 for e in verdict.entries[1:])


def test_a_name_that_leads_alone_needs_no_second_effect(channel_rules):
    """The name with the largest gain is not accepted, and another one leaves no excess variance."""
    channel_rules(reduces=False)
    best, alone = hypothesis_of("mass", 60.0, 20.0, at_floor=False), hypothesis_of("wind", 50.0)
    verdict = decide(ranking_of(best, alone, noise=1e4, exact=True))
    assert verdict.leader.name == "wind" and verdict.provisional is None


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
    verdict = decide(ranking_of(*pair, hypothesis_of("com_offset", 29.0)))
    assert [(e.hypothesis.name, e.same_as) for e in verdict.entries] == [
        ("density_scale", ("mass",)),
        ("com_offset", ()),
    ]
    assert verdict.sentence == "Missing: density_scale or mass (gain 30 nats)."
    assert verdict.entries[0].discriminated_by == {"mass": text} and verdict.entries[1].discriminated_by == {}


def test_evidence_distinguishes_names_with_one_column():
    column = np.ones(5)
    for difference, groups in ((SETTINGS.separable_gain_nats - 0.1, 1), (SETTINGS.separable_gain_nats + 0.1, 2)):
        pair = [
            hypothesis_of("mass", 30.0, explained=column),
            hypothesis_of("wind", 30.0 - difference, explained=column),
        ]
        assert len(group_indistinguishable(pair, SETTINGS)) == groups


@given(st.lists(st.tuples(st.sampled_from(NAMES), st.floats(0.0, 20.0), st.integers(0, 3)), unique_by=lambda t: t[0]))
def test_every_hypothesis_is_in_one_group_best_first(drawn):
    columns = np.array([[1.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    hypotheses = [hypothesis_of(n, g, explained=columns[c]) for n, g, c in drawn]
    groups = group_indistinguishable(hypotheses, SETTINGS)
    assert sorted(id(h) for g in groups for h in g) == sorted(id(h) for h in hypotheses)
    first_gains = [g[0].gain for g in groups]
    assert first_gains == sorted(first_gains, reverse=True)
    for g in groups:
        assert [h.gain for h in g] == sorted((h.gain for h in g), reverse=True)


# --- channels that a hypothesis reduces -----------------------------------------------------------------------------


def with_channel_rms(monkeypatch, before, after):
    """A model and a hypothesis with given RMS by channel."""
    model, own_model = SimpleNamespace(settings=SETTINGS), SimpleNamespace(settings=SETTINGS)
    monkeypatch.setattr(decision, "normalised_innovations", lambda _: np.zeros(0))
    monkeypatch.setattr(decision, "_normalised_with", lambda _: np.zeros(0))
    monkeypatch.setattr(decision, "rms_by_channel", lambda m, _: before if m is model else after)
    return model, SimpleNamespace(model=own_model)


@pytest.mark.parametrize(
    ("before", "after", "explained"),
    [
        ({"force_x": 10.0, "moment_y": 50.0}, {"force_x": 1.0, "moment_y": 50.0}, True),
        ({"force_x": 3.0, "moment_y": 80.0}, {"force_x": 1.0, "moment_y": 20.0}, False),  # moment y falls by more
        ({"force_x": 10.0, "moment_y": 50.0}, {"force_x": 12.0, "moment_y": 15.0}, False),  # nine tenths, still fails
        ({"force_x": 1.6}, {"force_x": 1.4}, False),  # fails no longer, but by a small change
        ({"force_x": 1.2}, {"force_x": 1.0}, False),  # nothing failed
        ({"force_x": 9.0}, {}, False),  # no longer compared
    ],
)
def test_the_channel_with_the_largest_factor_must_come_to_its_noise(monkeypatch, before, after, explained):
    assert explains_its_channel(*with_channel_rms(monkeypatch, before, after)) == explained


@pytest.mark.parametrize(("after", "reduced"), [(15.0, True), (17.0, False)])
def test_the_channel_with_the_largest_difference_must_fall_to_a_fifth(monkeypatch, after, reduced):
    """Force y comes to its noise in both cases."""
    pair = with_channel_rms(monkeypatch, {"moment_x": 80.0, "force_y": 9.0}, {"moment_x": after, "force_y": 1.0})
    assert reduces_its_channel(*pair) == reduced
    assert explains_its_channel(*pair)


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


# --- a second effect; whole flights with two effects are in the study (`make study`) ---------------------------------

FITTED = (EffectInstance(find_effect("mass"), {"k": -0.07}),)


def first_hypothesis(name, instance, effects):
    settings = SimpleNamespace(mission="flight", settings=SETTINGS)
    return SimpleNamespace(
        key=(name, None), label=name, instance=instance, case=settings, fit=SimpleNamespace(effects=effects)
    )


def second_hypothesis(at_floor, estimate, sigma):
    """A second effect, and the estimate of the first in the joint fit."""
    fit = SimpleNamespace(parameters=lambda key: {("mass", None): {"k": (estimate, sigma)}}[key])
    return SimpleNamespace(key=("wind", None), at_floor=at_floor, fit=fit)


@pytest.mark.parametrize(
    ("named", "at_floor", "estimate", "is_partner"),
    [
        (True, True, -0.07, True),
        (False, True, -0.07, False),  # nothing is named about the model that has the first
        (True, False, -0.07, False),  # something is left that neither explains
        (True, True, -0.002, False),  # the second explains everything, and the first was wrong
    ],
)
def test_a_second_effect_is_named_leaves_nothing_and_needs_the_first(
    monkeypatch, named, at_floor, estimate, is_partner
):
    cases, messages = [], []
    second = second_hypothesis(at_floor, estimate, 1e-3)
    verdict = SimpleNamespace(leader=named or None, entries=[SimpleNamespace(hypothesis=second)])
    monkeypatch.setattr(decision, "load_case", lambda mission, effects: cases.append((mission, effects)))
    monkeypatch.setattr(decision, "rank", lambda case, effects, progress: progress("screening"))
    monkeypatch.setattr(decision, "decide", lambda _: verdict)
    first = first_hypothesis("mass", FITTED[0], FITTED)
    assert find_joint_effect(first, (), messages.append) is (second if is_partner else None)
    assert cases == [("flight", FITTED)] and messages == ["with mass: screening"]


def test_another_effect_of_the_same_kind_is_no_second_effect(monkeypatch):
    """Two of one kind may imitate what neither is."""
    wind_2, ranked = find_effect("wind_2"), []
    monkeypatch.setattr(decision, "load_case", lambda mission, effects: None)
    monkeypatch.setattr(decision, "rank", lambda case, effects, progress: ranked.extend(effects))
    monkeypatch.setattr(decision, "decide", lambda _: SimpleNamespace(leader=None, entries=[]))
    first = first_hypothesis("wind_2", EffectInstance(wind_2, {}), ())
    effects = [find_effect("wind"), find_effect("mass"), wind_2]
    assert find_joint_effect(first, effects, lambda _: None) is None
    assert [e.name for e in ranked] == ["mass"]
