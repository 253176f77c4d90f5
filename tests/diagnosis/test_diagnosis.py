"""The content of ``diagnosis.json``, and the checks that the test session applies to every diagnosis."""

import copy
import json

import numpy as np
import pytest
from decision_checks import check_content, check_probabilities

from edl_filter.diagnosis import diagnosis as diagnosis_module
from edl_filter.diagnosis.diagnosis import Diagnosis, diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.selection import decision
from edl_filter.effects.registry import find_effect
from edl_filter.mission import Mission
from edl_filter.mission.decision_settings import DecisionSettings

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def diagnosis():
    """The shipped flight with 5 % too much mass in the mission, and the names that this may have."""
    mission = Mission.load("builtin:practice_mer", ["vehicle.mass=873.6"])
    return diagnose(load_case(mission), [find_effect("mass"), find_effect("axial_force_scale")])


@pytest.fixture(scope="module")
def content(diagnosis):
    return diagnosis.content()


def test_it_is_plain_json_with_every_number(diagnosis, content):
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    assert content["verdict"] == diagnosis.verdict.verdict == "missing"
    assert content["sentence"] == diagnosis.verdict.sentence
    assert len(content["map"]) == len(diagnosis.cells) and content["where"][0]["fails"]
    assert content["errors"] == pytest.approx(diagnosis.errors, nan_ok=True)
    assert content["something_else"]["probability"] == diagnosis.verdict.something_else
    assert content["settings"] == json.loads(json.dumps(diagnosis.ranking.case.settings.model_dump()))


def test_an_entry_has_estimates_correlations_and_errors(diagnosis, content):
    first, entry = content["ranking"][0], diagnosis.verdict.entries[0]
    h = entry.hypothesis
    assert (first["effect"], first["imu"], first["label"]) == (*h.key, h.label)
    assert first["same_as"] == list(entry.same_as)
    assert first["probability"] == entry.probability
    assert (first["gain"], first["score_gain"]) == (h.gain, h.score_gain)
    for name, (value, sigma) in h.fit.parameters(h.key).items():
        assert first["parameters"][name] == {"estimate": value, "sigma": sigma, "unit": ""}
    assert first["error_before"] == diagnosis.errors[first["channel"]] > first["error_after"]
    assert first["errors_after"][first["channel"]] == first["error_after"]
    assert set(first["alternatives"]) == set(first["same_as"]) == set(first["discriminated_by"])
    for pair, value in first["correlations"].items():
        assert ", " in pair and -1.0 <= value <= 1.0


# --- checks of the test session -------------------------------------------------------------------------------------


def test_every_diagnosis_of_the_session_is_checked():
    for function in (Diagnosis.content, decision.decide, diagnosis_module.decide):
        assert hasattr(function, "__wrapped__")


def changed(content, **changes):
    out = copy.deepcopy(content)
    for key, value in changes.items():
        where = out
        *path, last = key.split("__")
        for part in path:
            where = where[int(part) if part.isdigit() else part]
        where[last] = value
    return out


def test_a_content_that_contradicts_itself_is_recognised(content):
    check_content(content)
    for changes in (
        {"verdict": "clean"},
        {"verdict": "undecided", "sentence": "Undecided: mass (0.97)."},
        {"settings__decided_probability": 0.999},
        {"verdict": "unknown", "sentence": "Something is missing that no effect of the catalogue explains."},
        {"none": content["none"] + 1e-6},
        {"ranking__0__probability": 0.4},
        {"ranking__0__probability": 0.0, "none": 1.0, "something_else__probability": 0.0},
        {"ranking__0__probability": None},
        {"sentence": "Missing: wind (gain 9 nats)."},
        {"ranking": []},
    ):
        with pytest.raises((AssertionError, TypeError)):
            check_content(changed(content, **changes))


EXACT = DecisionSettings(approximation_error=0.0).model_dump()
APPROXIMATE = DecisionSettings(approximation_error=0.1).model_dump()


@pytest.mark.parametrize(
    ("verdict", "names", "none", "something_else", "settings", "consistent"),
    [
        ("missing", [0.8, 0.1], 0.05, 0.05, EXACT, True),
        ("clean", [0.06, 0.01], 0.9, 0.03, EXACT, True),
        ("unknown", [], 0.1, 0.9, EXACT, True),
        ("undecided", [0.6, 0.1], 0.2, 0.1, EXACT, True),
        ("missing", [0.6, 0.1], 0.2, 0.1, EXACT, False),  # not sufficient
        ("undecided", [0.8, 0.1], 0.05, 0.05, EXACT, False),  # sufficient
        ("missing", [0.1, 0.8], 0.05, 0.05, EXACT, False),  # not in the order of probability
        ("missing", [0.06, 0.01], 0.9, 0.03, EXACT, False),  # the flight is clean
        ("missing", [0.8, 0.1], 0.1, 0.05, EXACT, False),  # the sum is not one
        ("missing", [1.2], -0.2, 0.0, EXACT, False),
        ("clean", [], np.nan, 1.0, EXACT, False),
        ("clean", [], 0.95, 0.05, APPROXIMATE, True),
        ("clean", [], 0.96, 0.04, APPROXIMATE, False),  # more certain than the approximation allows
    ],
)
def test_probabilities_that_contradict_the_verdict_are_recognised(
    verdict, names, none, something_else, settings, consistent
):
    if consistent:
        check_probabilities(verdict, names, none, something_else, settings)
    else:
        with pytest.raises(AssertionError):
            check_probabilities(verdict, names, none, something_else, settings)
