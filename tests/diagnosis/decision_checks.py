"""Whether verdict, probabilities and ranking of a diagnosis contradict each other.

`tests/conftest.py` applies these checks to every decision and every ``diagnosis.json`` content of the test session.
"""

import sys

import pytest

SENTENCES = {
    "clean": "The flight is clean",
    "missing": "Missing: ",
    "undecided": "Undecided: ",
    "unknown": "Something is missing",
}


def implied_verdict(names, none, something_else, required):
    """The verdict of the hypothesis whose probability is sufficient; a tie is decided for the simpler hypothesis."""
    best = max(names, default=0.0)
    if max(none, something_else, best) < required:
        return "undecided"
    if none >= max(best, something_else):
        return "clean"
    return "unknown" if something_else >= best else "missing"


def check_probabilities(verdict, names, none, something_else, settings):
    """Probabilities sum to one, names are in their order, and the verdict is that of a sufficient probability.

    `settings` are the values of `DecisionSettings`. No probability is above what the share of flights in which the
    approximation says nothing allows, and none below what it leaves to every hypothesis.
    """
    probabilities = [*names, none, something_else]
    count, error = len(probabilities), settings["approximation_error"]
    assert abs(sum(probabilities) - 1.0) <= 1e-9, sum(probabilities)
    assert min(probabilities) >= error / count - 1e-12, probabilities
    assert max(probabilities) <= 1.0 - error * (count - 1) / count + 1e-12, probabilities
    assert list(names) == sorted(names, reverse=True), names
    required = settings["decided_probability"]
    assert verdict == implied_verdict(names, none, something_else, required), (verdict, names, none, something_else)
    assert (verdict == "undecided") == (max(probabilities) < required), (verdict, probabilities)


def check_verdict(verdict, ranking):
    """A `Verdict` of a `Ranking`: its numbers, and the leader that follows from them."""
    probabilities = [e.probability for e in verdict.entries]
    settings = ranking.case.settings.model_dump()
    check_probabilities(verdict.verdict, probabilities, verdict.none, verdict.something_else, settings)
    assert (verdict.leader is not None) == (verdict.verdict == "missing")
    if verdict.leader is not None:
        assert verdict.leader.name == verdict.entries[0].hypothesis.name
    assert verdict.sentence.startswith(SENTENCES[verdict.verdict]), verdict.sentence


def check_content(content, *_):
    """The content of a ``diagnosis.json``: the same, and the sentence names what is ranked first."""
    ranking = content["ranking"]
    check_probabilities(
        content["verdict"],
        [e["probability"] for e in ranking],
        content["none"],
        content["something_else"]["probability"],
        content["settings"],
    )
    assert content["sentence"].startswith(SENTENCES[content["verdict"]]), content["sentence"]
    if content["verdict"] == "missing":
        names = " or ".join((ranking[0]["label"], *ranking[0]["same_as"]))
        assert content["sentence"].startswith(f"Missing: {names} (gain"), content["sentence"]
    named = [name for e in ranking for name in (e["label"], *e["same_as"])]
    assert len(named) == len(set(named)), named  # every effect, of every IMU, is in one hypothesis


def _checked(function, check):
    def wrapper(*arguments, **named):
        result = function(*arguments, **named)
        check(result, *arguments)
        return result

    wrapper.__wrapped__ = function
    return wrapper


def check_all_diagnoses(patch: pytest.MonkeyPatch):
    """Wrap `Diagnosis.content`, and `decide` wherever it has been imported, so that every result is checked."""
    from edl_filter.diagnosis.diagnosis import Diagnosis
    from edl_filter.diagnosis.selection.decision import decide

    patch.setattr(Diagnosis, "content", _checked(Diagnosis.content, check_content))
    wrapper = _checked(decide, check_verdict)
    for module in list(sys.modules.values()):
        if vars(module).get("decide") is decide:
            patch.setattr(module, "decide", wrapper)
