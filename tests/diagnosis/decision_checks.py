"""Whether verdict, probabilities and ranking of a diagnosis contradict each other.

`tests/conftest.py` applies these checks to every decision and every ``diagnosis.json`` content of the test session.
"""

import sys

import pytest

SENTENCES = {"clean": "The flight is clean", "missing": "Missing: ", "unknown": "Something is missing"}


def largest(names, none, something_else):
    """The verdict of the largest of three groups of probabilities; a tie is decided for the simpler hypothesis."""
    best = max(names, default=0.0)
    if none >= max(best, something_else):
        return "clean"
    return "unknown" if something_else >= best else "missing"


def check_probabilities(verdict, names, none, something_else):
    """Probabilities sum to one, names are in their order, and the verdict is that of the most probable hypothesis."""
    probabilities = [*names, none, something_else]
    assert all(0.0 <= p <= 1.0 for p in probabilities), probabilities
    assert abs(sum(probabilities) - 1.0) <= 1e-9, sum(probabilities)
    assert list(names) == sorted(names, reverse=True), names
    assert verdict == largest(names, none, something_else), (verdict, names, none, something_else)
    first_leads = bool(names) and names[0] > max(none, something_else)
    assert (verdict == "missing") == first_leads, (verdict, names, none, something_else)


def check_verdict(verdict):
    """A `Verdict`: its numbers, and the leader that follows from them."""
    probabilities = [e.probability for e in verdict.entries]
    check_probabilities(verdict.verdict, probabilities, verdict.none, verdict.something_else)
    assert (verdict.leader is not None) == (verdict.verdict == "missing")
    if verdict.leader is not None:
        assert verdict.leader.name == verdict.entries[0].hypothesis.name
    assert verdict.sentence.startswith(SENTENCES[verdict.verdict]), verdict.sentence


def check_content(content):
    """The content of a ``diagnosis.json``: the same, and the sentence names what is ranked first."""
    ranking = content["ranking"]
    check_probabilities(
        content["verdict"],
        [e["probability"] for e in ranking],
        content["none"],
        content["something_else"]["probability"],
    )
    assert content["sentence"].startswith(SENTENCES[content["verdict"]]), content["sentence"]
    if content["verdict"] == "missing":
        names = " or ".join((ranking[0]["label"], *ranking[0]["same_as"]))
        assert content["sentence"].startswith(f"Missing: {names} (gain"), content["sentence"]
    else:
        assert content["partner"] is None
    named = [name for e in ranking for name in (e["label"], *e["same_as"])]
    assert len(named) == len(set(named)), named  # every effect, of every IMU, is in one hypothesis


def _checked(function, check):
    def wrapper(*arguments, **named):
        result = function(*arguments, **named)
        check(result)
        return result

    wrapper.__wrapped__ = function
    return wrapper


def check_all_diagnoses(patch: pytest.MonkeyPatch):
    """Wrap `decide` and `diagnosis_content`, wherever they have been imported, so that every result is checked."""
    from edl_filter.diagnosis import diagnosis_json
    from edl_filter.diagnosis.selection import decision

    for function, check in (
        (decision.decide, check_verdict),
        (diagnosis_json.diagnosis_content, check_content),
    ):
        wrapper = _checked(function, check)
        for module in list(sys.modules.values()):
            if vars(module).get(function.__name__) is function:
                patch.setattr(module, function.__name__, wrapper)
