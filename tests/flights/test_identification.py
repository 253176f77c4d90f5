"""What is found in practice flights is what was put in."""

import pytest

from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.ranking import rank
from edl_filter.diagnosis.remainder import describe
from edl_filter.diagnosis.rounds import linearise
from edl_filter.diagnosis.verdict import judge
from edl_filter.diagnosis.where import failures, survey
from edl_filter.effects.catalogue import effect_named
from edl_filter.mission import Mission

#: practice/answers.json: the misalignment, rad, and the jet's frequency (Hz) and span (s).
MISALIGNED = {"mx": 0.0, "my": 0.01127612, "mz": 0.00712172}
JET, JET_SPAN = 0.679365, (63.537, 164.025)


def case(path):
    return load_case(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]))


def test_the_misalignment_of_practice_04(practice):
    ranking = rank(case(practice(4)), [effect_named(n) for n in ("accelerometer_misalignment", "gyro_bias")])
    verdict = judge(ranking)
    assert verdict.verdict == "missing" and verdict.leader.name == "accelerometer_misalignment"
    found = verdict.entries[0].hypothesis.refit.parameters("accelerometer_misalignment")
    for name, true in MISALIGNED.items():
        value, sigma = found[name]
        assert 0.0 < sigma < (1e-2 if name == "mx" else 1e-3), name  # a turn about the force's axis hardly shows
        assert value == pytest.approx(true, abs=3.0 * sigma), name


def test_a_jet_that_no_effect_knows_is_described(practice):
    linear = linearise(case(practice(8)))
    left = describe(linear)
    assert left.channel == "moment_y" and left.unit == "N m"
    assert left.frequency == pytest.approx(JET, abs=0.01)
    assert (left.t0, left.t1) == (pytest.approx(JET_SPAN[0], abs=8.0), pytest.approx(JET_SPAN[1], abs=8.0))
    assert "it oscillates at 0.68" in left.description
    worst = failures(survey(linear))[0]
    assert worst.channel == "moment_y" and worst.t0 < JET_SPAN[1] and worst.t1 > JET_SPAN[0]
