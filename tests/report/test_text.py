"""Number formats and labels."""

import pytest
from contents import diagnosis, hypothesis, screened

from edl_filter.report.text import (
    below_interval,
    chance,
    constraint_verdict,
    event_label,
    gain_text,
    information_text,
    limited_probability_sentence,
    number,
    parameters_text,
    readable,
    sigmas_text,
    undetectable_sentence,
    with_sigma,
)
from edl_filter.results.schema import DiagnosisContent
from edl_filter.results.schema.diagnosis import Estimate
from edl_filter.results.schema.summary import ConstraintSummary


@pytest.mark.parametrize(
    ("estimate", "sigma", "text"),
    [
        (129.00042, 0.013, "129.000 ± 0.013"),
        (128.9714, 0.013, "128.971 ± 0.013"),
        (1.753e-3, 2e-7, "(1.75300 ± 0.00020)e-3"),
        (0.67936, 1.6e-7, "0.67936000 ± 0.00000016"),
        (3.0, None, "3"),
        (0.01, 5.0, "0.0 ± 5.0"),
        (0.011241, 1e-4, "0.01124 ± 0.00010"),
        (-12345.6, 132.3, "-12346 ± 132"),
        (4.2828e13, 2e9, "(4.28280 ± 0.00020)e13"),
        (129.0, 1e-12, "129 ± 1e-12"),
    ],
)
def test_estimates_have_the_digits_that_they_deserve(estimate, sigma, text):
    assert with_sigma(estimate, sigma) == text


def test_numbers_for_people():
    assert [number(x) for x in (0.91234, 1073.4, 6.4e7, None, float("nan"))] == ["0.912", "1073", "6.4e+07", "–", "–"]


def test_a_gain_that_is_rounding_is_zero():
    assert [gain_text(x) for x in (-2.9e-11, 0.0, 0.02, -196.06, None)] == ["0", "0", "0.02", "-196", "–"]
    assert [chance(x) for x in (1.0, 0.25, 1e-7)] == ["> 0.999", "0.250", "< 0.001"]
    assert parameters_text({"a": {"estimate": None, "sigma": 0.0, "unit": "s"}}) == ""


def test_parameters_of_models_and_of_plain_data_have_the_same_text():
    plain = {"estimate": 1.5, "sigma": 0.02, "unit": "m"}
    assert parameters_text({"dy": Estimate(**plain)}) == parameters_text({"dy": plain}) == "dy 1.500 ± 0.020 m"


def test_components_over_their_sigmas():
    assert sigmas_text([1.0, -4.0, None], [2.0, 2.0, 1.0]) == "+0.5  -2.0  –"
    assert sigmas_text([1.0, -6.0, 0.0, 0.0], [2.0, 2.0, 0.0, float("inf")]) == "≤ 3.0"


def test_why_something_else_is_more_probable_than_a_larger_gain():
    def sentence(**changes):
        something = diagnosis()["something_else"] | {"probability": 0.9, "gain": -768.0}
        ranking = [hypothesis(**({"probability": 0.01, "explained_share": 0.011} | changes))]
        return limited_probability_sentence(DiagnosisContent.of(diagnosis(something_else=something, ranking=ranking)))

    assert "remnant_torque explains 1 % of the misfit" in sentence()
    assert sentence(probability=0.95) == "" and sentence(gain=5.0) == "" and sentence(score_gain=5.0) == ""


def test_events_have_short_labels():
    assert [event_label(n) for n in ("parachute_deploy", "Mach 15", "own_event")] == [
        "parachute",
        "Mach 15",
        "own event",
    ]


def test_powers_of_units_are_raised():
    assert readable("0.1 rad/s^2 and 3 kg m^-3.") == "0.1 rad/s² and 3 kg m⁻³."


def test_negative_numbers_have_a_minus_and_words_keep_their_hyphens():
    assert readable("x -0.5 m, (-1.2 ± 0.1)e-5, on-board 2011-03") == "x −0.5 m, (−1.2 ± 0.1)e-5, on-board 2011-03"


@pytest.mark.parametrize(
    ("nis", "verdict", "below"),
    [(3.0, "✓ accepted", False), (20.0, "▲ outside", False), (0.01, "▲ below", True)],
)
def test_a_constraint_that_agrees_too_well_does_not_disagree(nis, verdict, below):
    constraint = ConstraintSummary.of(
        {"source": "s", "components": ["a (m)"] * 3, "uses": 1, "accepted_uses": 1, "accepted": True, "time_s": 0.0,
         "innovation": [0.0] * 3, "innovation_sigma": [1.0] * 3, "nis": nis, "dof": 3,
         "nis_interval_99_9": [0.0153, 17.7], "consistent": 0.0153 <= nis <= 17.7, "left_out": [0.0] * 3,
         "left_out_sigma": [1.0] * 3, "left_out_nis": 0.0, "left_out_dof": 3, "information_nats": 1.0,
         "left_out_information_nats": 0.5}
    )  # fmt: skip
    assert constraint_verdict(constraint)[0] == verdict
    assert below_interval(constraint) == below


def test_information_has_two_decimals_below_ten_nats():
    assert [information_text(x) for x in (0.0062, 7.694, 211.93, None, float("nan"))] == [
        "0.01",
        "7.69",
        "211.9",
        "–",
        "–",
    ]


def test_effects_that_the_flight_does_not_show_at_a_plausible_size():
    mixed = {"wind": screened(30.0, 20.0), "mass": screened(), "drift": screened(None, 1.0), "jet": screened(3.0, 2.4)}
    sentence = undetectable_sentence(DiagnosisContent.of(diagnosis(screening=mixed)))
    assert sentence.startswith(
        "Not detectable at a plausible size on this flight (detectable over plausible size): jet"
    )
    assert sentence.endswith("jet (1.25), wind (1.5), drift.")
    assert undetectable_sentence(DiagnosisContent.of(diagnosis())) == ""


def test_sigmas_that_explain_everything():
    nothing = {"wind": screened(30.0, 20.0), "drift": screened(None, 1.0)}
    sentence = undetectable_sentence(DiagnosisContent.of(diagnosis(screening=nothing)))
    assert sentence.startswith("With these sigmas nothing could be found: no effect is detectable at a plausible size.")
    assert sentence.endswith("wind (1.5), drift.")
