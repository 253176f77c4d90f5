"""Sentences about a result: warnings, recoveries, the landing."""

import pytest

from edl_filter.report.sentences import landing_sentence, recovery_sentence, warnings
from edl_filter.results import Result
from edl_filter.results.schema import Summary
from edl_filter.results.schema.summary import Landing, RecoverySummary


@pytest.fixture(scope="module")
def content(practice_06):
    """Content of the shipped flight's summary."""
    return Result(practice_06).summary()


def test_a_trustworthy_result_says_what_was_left_out(content):
    summary = Summary.of(content)
    assert summary.trustworthy and summary.headline is None and summary.recovery is None and not summary.causes
    assert warnings(summary) == []

    def with_uses(name, accepted):
        changed = summary.constraints[name].model_copy(update={"accepted_uses": accepted, "accepted": False})
        return summary.model_copy(update={"constraints": summary.constraints | {name: changed}})

    assert warnings(with_uses("altimeter", 251)) == []  # 10 of 261
    (sentence,) = warnings(with_uses("altimeter", 223))
    assert sentence == "Altimeter: 38 of 261 uses contradict all other data and were left out."
    (sentence,) = warnings(with_uses("parachute", 0))
    assert sentence.startswith("Parachute: 1 of 1 uses")


def test_an_untrustworthy_result_has_one_headline(content):
    headline = "Do not trust this result: landing contradicts all other data."
    summary = Summary.of(content | {"trustworthy": False, "headline": headline})
    rejected = {
        name: c.model_copy(update={"accepted_uses": 0, "accepted": False}) for name, c in summary.constraints.items()
    }
    assert warnings(summary.model_copy(update={"constraints": rejected})) == [headline]


@pytest.mark.parametrize(
    ("cause", "text"),
    [
        ("gap", "the samples that stand for lost ones between 100 and 101 s"),
        ("entry_state", "7 times the stated sigmas of the entry state"),
        ("process_noise", "noise of all samples before that"),
        (None, "and no additional noise explains it"),
    ],
)
def test_a_recovery_says_when_why_and_by_how_much(cause, text):
    recovery = RecoverySummary(
        time_s=344.25, constraints=("landing", "rest_velocity"), readings=2, nis=115.0, free_nis=0.0, directions=6,
        cause=cause, size=7.0, force_noise_m_s2=6.2, rate_noise_rad_s=0.037, start_s=100.0, end_s=101.0, gain_nats=50.0,
    )  # fmt: skip
    sentence = recovery_sentence(recovery)
    assert sentence.startswith("At 344.2 s landing and rest velocity contradicted the state of the filter")
    assert text in sentence


LANDING = Landing(
    landed=True, time_s=1.0, lat_deg=-14.569, lon_deg=175.47, radius_m=3.39e6, miss_m=5.0, sigma_m=40.0
)  # fmt: skip


def test_latitude_has_its_hemisphere():
    assert landing_sentence(LANDING).startswith("Landing: 14.5690 S 175.4700 E, 5 ± 40 m from the site.")


def test_a_record_without_a_landing_has_no_miss():
    place = "14.5690 S 175.4700 E (± 40 m)."
    ended = LANDING.model_copy(update={"landed": False, "miss_m": None})
    assert landing_sentence(ended) == f"The record ends at 1.00 s, before the landing, over {place}"
    assert landing_sentence(LANDING.model_copy(update={"miss_m": None})) == f"Landing: {place}"
