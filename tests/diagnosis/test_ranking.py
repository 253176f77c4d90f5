"""The ranking on simulated flights: the evidence of a name is what it should be, also where the model leads away."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter import Mission
from edl_filter.diagnosis import diagnose as module
from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.linear import HOLDS
from edl_filter.diagnosis.ranking import rank
from edl_filter.diagnosis.regression import regress
from edl_filter.diagnosis.rounds import followed, linearise
from edl_filter.diagnosis.signatures import signature
from edl_filter.diagnosis.verdict import CLEAR, judge
from edl_filter.diagnosis.without import without_more
from edl_filter.effects.catalogue import effect_named
from edl_filter.effects.effect import Active
from edl_filter.simulation import Scenario, simulate

HIDDEN = {"mx": 4e-3, "my": 2.5e-3, "mz": 1e-3}
TRIED = ("accelerometer_misalignment", "accelerometer_scale", "gyro_bias", "static_instability")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A vehicle that does not spin: what is hidden is an error that the filter itself allows for, only too large."""
    hidden = Active(effect_named("accelerometer_misalignment"), HIDDEN)
    path = simulate(Scenario.load("builtin:phoenix"), (hidden,), 3).write(tmp_path_factory.mktemp("made") / "flight.h5")
    return load_case(Mission.load("builtin:practice_phoenix", [f"telemetry.path={path}"]), ())


@pytest.fixture(scope="module")
def ranking(case):
    return rank(case, [effect_named(n) for n in TRIED])


def test_the_model_fails_only_where_the_reconstruction_put_the_path(case):
    here = linearise(case, rounds=3, until=HOLDS)
    there = followed(case, here)
    assert here.rough[0].share > HOLDS >= there.rough[0].share
    assert there.log_likelihood > here.log_likelihood + 100.0
    assert there.surprise > 10.0  # what is hidden, in the sigmas that the mission states of it


def test_the_evidence_is_that_of_a_linear_fit_at_the_truth(case, ranking):
    """It stands against the model that has taken the error upon itself, by many sigmas."""
    verdict = judge(ranking)
    assert verdict.verdict == "missing" and verdict.leader.name == "accelerometer_misalignment"
    for name, true in HIDDEN.items():
        at = ranking.hypotheses[0].refit.names.index(("accelerometer_misalignment", name))
        sigma = np.sqrt(ranking.hypotheses[0].refit.covariance[at, at])
        assert abs(verdict.leader.values[name] - true) < 3.0 * sigma
    ground = linearise(case)
    s = signature(ground.ground, Active(effect_named("accelerometer_misalignment"), {}))
    x = ground.plain(s.rows, s.start)
    expected = regress(x @ np.array([HIDDEN[n] for n in s.names]), x, s.sigma).gain
    # the noise of this flight moves a log-likelihood ratio by sqrt(2 gain)
    assert abs(ranking.hypotheses[0].gain - expected) < 3.0 * np.sqrt(2.0 * expected)


def test_a_doubted_name_is_diagnosed_again_with_a_partner(case, ranking, monkeypatch):
    """Whatever partner is found stands in the verdict, in its sentence and, with all sizes together, in the content."""
    doubted = replace(ranking, hypotheses=[replace(h, at_floor=False) for h in ranking.hypotheses])
    partner = ranking.hypotheses[0]
    monkeypatch.setattr(module, "rank", lambda *_: doubted)
    monkeypatch.setattr("edl_filter.diagnosis.verdict.lessens_its_channel", lambda *_: False)
    monkeypatch.setattr(
        module, "partner_of", lambda first, candidates, progress: partner if first.name in TRIED else None
    )
    found = module.diagnose(case, [effect_named(n) for n in TRIED])
    assert found.verdict.verdict == "missing" and found.verdict.partner is partner
    told = found.content()
    assert told["partner"]["effect"] == partner.name in told["sentence"]
    assert set(told["partner"]["together"][partner.name]) == set(HIDDEN)
    monkeypatch.setattr(module, "partner_of", lambda *_: None)
    alone = module.diagnose(case, [effect_named(n) for n in TRIED])
    assert alone.verdict.verdict == "unknown" and alone.content()["partner"] is None


def test_what_a_name_gains_is_what_the_model_with_it_has_more(ranking):
    """A model's own effects cost what they cost once: the next gain is over the model with all of that."""
    h = ranking.hypotheses[0]
    base = without_more([h.linear], h.refit.effects)
    assert base.evidence - h.without.evidence == pytest.approx(h.gain, abs=3.0)
    assert base.likelihood - base.evidence > CLEAR  # else the next name would pay for this one as well


def test_effects_that_are_not_refitted_are_no_noise(practice_06):
    """What refitting them would gain is not called noise, nor something else that is missing."""
    stated = Active(effect_named("axial_force_scale"), {"k": 0.0015})
    found = rank(load_case(practice_06.mission, (stated,)), [])
    assert found.linear.rough[0].none
    assert found.noise_evidence == found.something_else == 0.0
    assert judge(found).verdict == "clean"
