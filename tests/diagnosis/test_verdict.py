"""Verdicts on made rankings: what is named, what is not, and how probable each is."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.diagnosis.hypotheses import Hypothesis
from edl_filter.diagnosis.missing import Missing
from edl_filter.diagnosis.ranking import Ranking
from edl_filter.diagnosis.separating import Parting
from edl_filter.diagnosis.verdict import CLEAR, CLEAR_IN_NOISE, PARTED, grouped, judge
from edl_filter.diagnosis.without import Without
from edl_filter.effects import Active
from edl_filter.effects.catalogue import effect_named

NAMES = ("wind", "mass", "gyro_bias", "com_offset", "density_scale")


def hypothesis_of(name, gain, score=None, explained=None, at_floor=True):
    """A refitted effect of which nothing is known but what a verdict asks for."""
    own = np.zeros(len(NAMES))
    own[NAMES.index(name)] = 1.0
    return Hypothesis(
        name=name,
        refit=SimpleNamespace(effects=(Active(effect_named("gravity_oblateness"), {}), Active(effect_named(name), {}))),
        whiten=None,
        gain=gain,
        score_gain=gain if score is None else score,
        at_floor=at_floor,
        explained=own if explained is None else np.asarray(explained, float),
        case=None,
        linear=None,
        without=Without(0.0, 0.0, 0.0),
    )


def ranking_of(*hypotheses, something_else=0.0, noise=0.0, coefficients=1.0):
    case = SimpleNamespace(exact=coefficients == 0.0)
    return Ranking(case, None, {}, list(hypotheses), Missing(), something_else, noise)


def test_a_clean_flight():
    verdict = judge(ranking_of(hypothesis_of("wind", -3.0), hypothesis_of("mass", 2.0)))
    assert verdict.verdict == "clean" and verdict.leader is None
    assert verdict.sentence.startswith("The flight is clean")
    assert [e.hypothesis.name for e in verdict.entries] == ["mass", "wind"]


def test_nothing_was_tried():
    verdict = judge(ranking_of())
    assert verdict.verdict == "clean" and verdict.entries == []
    assert verdict.none == pytest.approx(1.0 / (1.0 + np.exp(-CLEAR)))


def test_a_missing_effect_is_named():
    verdict = judge(ranking_of(hypothesis_of("wind", 40.0), hypothesis_of("mass", 3.0), something_else=10.0))
    assert verdict.verdict == "missing"
    assert verdict.leader.name == "wind"  # and not the one that is in the model already
    assert verdict.sentence == "Missing: wind (gain 40 nats)."
    assert verdict.entries[0].probability > 0.999 and verdict.entries[0].same_as == ()


def test_something_else_that_no_effect_explains():
    verdict = judge(ranking_of(hypothesis_of("wind", 3.0), something_else=80.0))
    assert verdict.verdict == "unknown" and verdict.leader is None
    assert verdict.something_else > 0.999
    assert judge(ranking_of(hypothesis_of("wind", 3.0), noise=50.0)).verdict == "unknown"


def test_probabilities_are_the_evidences():
    """With none at 0, something else at its handicap, and each effect at its gain."""
    gains = {"wind": 4.0, "mass": 1.0, "gyro_bias": -2.0}
    verdict = judge(ranking_of(*(hypothesis_of(n, g) for n, g in gains.items()), something_else=3.0))
    weight = {n: np.exp(g) for n, g in gains.items()} | {"": 1.0, "else": np.exp(3.0 - CLEAR)}
    total = sum(weight.values())
    assert verdict.none == pytest.approx(1.0 / total)
    assert verdict.something_else == pytest.approx(weight["else"] / total)
    for e in verdict.entries:
        assert e.probability == pytest.approx(weight[e.hypothesis.name] / total)


def test_on_a_noisy_flight_none_is_the_model_at_the_stated_noise():
    """It is as far behind as its noise is from what is stated; something else is no worse than the noise itself."""
    verdict = judge(ranking_of(hypothesis_of("wind", 2.0), something_else=-4.0, noise=11.0))
    total = np.exp(-11.0) + 1.0 + np.exp(2.0)
    assert verdict.none == pytest.approx(np.exp(-11.0) / total)
    assert verdict.something_else == pytest.approx(1.0 / total)


@given(
    st.lists(
        st.tuples(st.sampled_from(NAMES), st.floats(-1e4, 1e6), st.floats(-1e4, 1e6), st.booleans()),
        max_size=5,
        unique_by=lambda t: t[0],
    ),
    st.floats(-1e3, 1e6),
    st.floats(0.0, 1e5),
)
def test_probabilities_sum_to_one_and_best_comes_first(tried, something_else, noise):
    verdict = judge(ranking_of(*(hypothesis_of(*t[:3], at_floor=t[3]) for t in tried), something_else=something_else,
                               noise=noise))  # fmt: skip
    found = [e.probability for e in verdict.entries]
    assert verdict.none + verdict.something_else + sum(found) == pytest.approx(1.0)
    assert min([verdict.none, verdict.something_else, *found]) >= 0.0
    assert found == sorted(found, reverse=True)
    assert verdict.verdict in ("clean", "missing", "unknown")
    assert (verdict.leader is None) == (verdict.verdict != "missing")
    if verdict.verdict == "missing":
        best = verdict.entries[0].hypothesis
        assert min(best.gain, best.score_gain) > CLEAR


@pytest.mark.parametrize(("noise", "need"), [(0.0, CLEAR), (100.0, CLEAR_IN_NOISE)])
def test_a_name_needs_a_gain_and_a_held_out_score(noise, need):
    for gain, score, named in (
        (need + 0.1, need + 0.1, True),
        (need - 0.1, 1e3, False),
        (1e3, need - 0.1, False),
        (1e3, -5.0, False),
    ):
        verdict = judge(ranking_of(hypothesis_of("mass", gain, score), noise=noise))
        assert (verdict.verdict == "missing") == named, (gain, score)


def test_a_name_that_leaves_most_to_something_else_is_no_name():
    """Unless next to nothing is left unexplained with it."""
    for gain, at_floor, named in ((60.0, False, True), (40.0, False, False), (40.0, True, True)):
        verdict = judge(ranking_of(hypothesis_of("mass", gain, at_floor=at_floor), something_else=1000.0))
        assert (verdict.verdict == "missing") == named, (gain, at_floor)


@pytest.mark.parametrize(
    ("coefficients", "mends", "verdict"), [(0.0, True, "missing"), (0.0, False, "unknown"), (1.0, False, "missing")]
)
def test_beside_another_it_mends_one_channel_if_the_database_is_exact(monkeypatch, coefficients, mends, verdict):
    monkeypatch.setattr("edl_filter.diagnosis.verdict.mends_its_channel", lambda *_: mends)
    monkeypatch.setattr("edl_filter.diagnosis.verdict.lessens_its_channel", lambda *_: True)
    one = hypothesis_of("mass", 60.0, at_floor=False)
    assert judge(ranking_of(one, something_else=1000.0, noise=1e4, coefficients=coefficients)).verdict == verdict


def test_a_name_that_leaves_an_exact_model_failing_lessens_its_channel_though_nothing_beats_it(monkeypatch):
    """Beside an exact database what is left is another effect, or the name is wrong."""
    for lessens, at_floor, verdict in ((False, False, "unknown"), (True, False, "missing"), (False, True, "missing")):
        monkeypatch.setattr("edl_filter.diagnosis.verdict.lessens_its_channel", lambda *_, x=lessens: x)
        one = hypothesis_of("mass", 60.0, at_floor=at_floor)
        found = judge(ranking_of(one, something_else=5.0, noise=1e4, coefficients=0.0))
        assert found.verdict == verdict
        assert found.doubted is (one if verdict == "unknown" else None)


def test_only_a_name_with_enough_gain_beside_an_exact_database_is_doubted(monkeypatch):
    monkeypatch.setattr("edl_filter.diagnosis.verdict.lessens_its_channel", lambda *_: False)
    weak, strong = (hypothesis_of("mass", gain, at_floor=False) for gain in (11.0, 60.0))
    assert judge(ranking_of(weak, noise=1e4, coefficients=0.0)).doubted is None
    assert judge(ranking_of(strong, something_else=1e4, noise=1e4)).doubted is None  # a database with an error
    found = judge(ranking_of(strong, noise=1e4, coefficients=0.0))
    assert found.doubted is strong and found.leader is None
    partner = hypothesis_of("wind", 500.0)
    stands = judge(ranking_of(strong, something_else=900.0, noise=1e4, coefficients=0.0), partner)
    assert stands.leader.name == "mass" and stands.doubted is None and stands.partner is partner
    assert stands.something_else == 0.0 and stands.entries[0].probability > 0.999  # two names explain it all
    assert stands.sentence == "Missing: mass (gain 60 nats). With wind besides, model and measurement would agree."


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (Parting("knowing the mass", 41.2), "knowing the mass would part them by 41 nats"),
        (None, "no better knowledge of anything else would part them, only a measurement of one of the two itself"),
    ],
)
def test_two_names_for_one_column_are_one_hypothesis(monkeypatch, found, text):
    monkeypatch.setattr("edl_filter.diagnosis.verdict.parting", lambda *_: found)
    column = np.array([3.0, -1.0, 0.5, 2.0, 0.0])
    pair = [
        hypothesis_of("mass", 28.0, explained=column),
        hypothesis_of("density_scale", 30.0, explained=-2.0 * column),
    ]
    verdict = judge(ranking_of(*pair, hypothesis_of("com_offset", 29.0)))
    assert [(e.hypothesis.name, e.same_as) for e in verdict.entries] == [
        ("density_scale", ("mass",)),
        ("com_offset", ()),
    ]
    assert verdict.sentence == "Missing: density_scale or mass (gain 30 nats)."
    assert verdict.entries[0].parted_by == {"mass": text} and verdict.entries[1].parted_by == {}


def test_evidence_parts_names_that_look_alike():
    column = np.ones(5)
    for gain, groups in ((30.0 - PARTED + 0.1, 1), (30.0 - PARTED - 0.1, 2)):
        pair = [hypothesis_of("mass", 30.0, explained=column), hypothesis_of("wind", gain, explained=column)]
        assert len(grouped(pair)) == groups


@given(st.lists(st.tuples(st.sampled_from(NAMES), st.floats(0.0, 20.0), st.integers(0, 3)), unique_by=lambda t: t[0]))
def test_every_hypothesis_is_in_one_group_best_first(tried):
    columns = np.array([[1.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    all_ = [hypothesis_of(n, g, explained=columns[c]) for n, g, c in tried]
    groups = grouped(all_)
    assert sorted(id(h) for g in groups for h in g) == sorted(id(h) for h in all_)
    heads = [g[0].gain for g in groups]
    assert heads == sorted(heads, reverse=True)
    for g in groups:
        assert [h.gain for h in g] == sorted((h.gain for h in g), reverse=True)
