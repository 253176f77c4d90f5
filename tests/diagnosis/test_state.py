"""The state of a flight in sentences."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis import state
from edl_filter.diagnosis.residual_analysis.residual_map import _cell
from edl_filter.diagnosis.state import Improvement, state_sentences
from edl_filter.mission.decision_settings import DecisionSettings

ENTRY = SimpleNamespace(hypothesis=SimpleNamespace(label="com_offset"))
ERRORS = {"moment_y": 9.0, "force_x": 1.0}


def cell(channel, rms, count=400, regime="Mach 15 to 5"):
    values = np.full(count, rms)
    return _cell(channel, regime, (130.0, 180.0), values, np.ones(count), "N", None, DecisionSettings())


def verdict(name, sentence, entries=()):
    return SimpleNamespace(verdict=name, sentence=sentence, entries=list(entries), required_gain=6.0)


@pytest.fixture(autouse=True)
def leader(monkeypatch):
    """The leader halves moment y and leaves one of three cells failing."""
    monkeypatch.setattr(state, "improvement_with", lambda h: Improvement(3, 1))
    monkeypatch.setattr(state, "hypothesis_rms", lambda h: {"moment_y": 4.5, "force_x": 1.0})
    monkeypatch.setattr(state, "most_reduced_channel", lambda h, before, after: "moment_y")


CELLS = [cell("moment_y", 12.0), cell("moment_y", 3.0, regime="Mach below 3.5"), cell("force_x", 1.0)]


def test_the_first_sentence_says_how_much_fails_and_a_later_one_what_the_leader_mends():
    sentences = state_sentences(
        CELLS, verdict("missing", "Missing: com_offset (gain 894 nats).", [ENTRY]), ERRORS, None, 1.1
    )
    assert sentences == (
        "2 of 3 cells of the residual map fail, worst moment y in Mach 15 to 5 at 12 sigmas.",
        "Missing: com_offset (gain 894 nats).",
        "With it 1 of 3 cells still fail; over the flight moment y falls from 9 to 4.5 sigmas.",
    )


def test_an_undecided_leader_is_named():
    sentences = state_sentences(CELLS, verdict("undecided", "Undecided: …", [ENTRY]), ERRORS, None, 1.1)
    assert sentences[2].startswith("With com_offset, the most probable effect, 1 of 3 cells still fail;")


def test_a_map_with_another_number_of_cells_is_named(monkeypatch):
    monkeypatch.setattr(state, "improvement_with", lambda h: Improvement(4, 3))
    sentence = state_sentences(CELLS, verdict("missing", "Missing.", [ENTRY]), ERRORS, None, 1.1)[2]
    assert sentence.startswith("With it 3 of the 4 cells in the map of that model fail; over")


def test_a_leader_that_leaves_nothing_is_said_to(monkeypatch):
    monkeypatch.setattr(state, "improvement_with", lambda h: Improvement(3, 0))
    assert state_sentences(CELLS, verdict("missing", "Missing.", [ENTRY]), ERRORS, None, 1.1)[2].startswith(
        "With it no cell"
    )


def test_a_leader_that_mends_nothing_is_said_to(monkeypatch):
    monkeypatch.setattr(state, "hypothesis_rms", lambda h: {"moment_y": 8.999, "force_x": 1.0})
    sentence = state_sentences(CELLS, verdict("unknown", "Something is missing.", [ENTRY]), ERRORS, None, 1.1)[2]
    assert sentence == (
        "With com_offset, the most probable effect, 1 of 3 cells still fail, and the error of no channel falls."
    )


def test_a_proxy_is_said_last():
    sentences = state_sentences(
        CELLS, verdict("unknown", "Something is missing."), ERRORS, "Phoenix stands in for MER", 1.1
    )
    assert len(sentences) == 3 and sentences[-1].startswith(
        "The aerodynamic database is a proxy: Phoenix stands in for"
    )


def test_a_clean_flight_has_a_reason_for_a_large_rms():
    cells = [cell("landing", 2.11, 3, "constraints"), cell("force_x", 1.02)]
    assert not any(c.fails for c in cells)
    sentences = state_sentences(cells, verdict("clean", "The flight is clean."), ERRORS, None, 1.1)
    assert sentences[0] == "None of the 2 cells of the residual map fails."
    limit = cells[0].limit
    assert sentences[2] == (
        f"The largest normalised RMS that does not fail, 2.11 of landing, is of 3 numbers only: chance allows up to "
        f"{limit:.3g}."
    )
    assert 3.0 < limit < 4.0  # five sigmas of chance of three numbers
    assert len(state_sentences(cells[1:], verdict("clean", "The flight is clean."), ERRORS, None, 1.1)) == 2
    assert len(state_sentences(cells[1:], verdict("clean", "The flight is clean."), ERRORS, None, 1.01)) == 3


def test_a_clean_flight_with_a_failing_cell_says_why_it_is_clean():
    sentences = state_sentences(CELLS[1:], verdict("clean", "The flight is clean.", [ENTRY]), ERRORS, None, 1.1)
    assert sentences[0].startswith("1 of 2 cells of the residual map fails, worst moment y in Mach below 3.5")
    assert sentences[2].startswith("It is clean although a cell fails, because no effect") and "6 nats" in sentences[2]
