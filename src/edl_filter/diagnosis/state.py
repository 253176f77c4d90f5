"""The state of a flight in sentences: how much fails, the verdict, what the leading effect reduces; qualifications."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from edl_filter.diagnosis.residual_analysis.residual_map import CONSTRAINTS, Cell, failing_cells, residual_map
from edl_filter.diagnosis.selection.decision import (
    Entry,
    Verdict,
    hypothesis_rms,
    most_reduced_channel,
)
from edl_filter.diagnosis.selection.hypothesis import Hypothesis
from edl_filter.results.verdicts import CLEAN, MISSING


@dataclass(frozen=True)
class Improvement:
    """What remains to fail with an effect in the model.

    Attributes
    ----------
    cells, failing : int
        Cells of the residual map with the effect, and how many of them fail.
    """

    cells: int
    failing: int


def improvement_with(hypothesis: Hypothesis) -> Improvement:
    """The residual map with a hypothesis in the model, summarised."""
    cells = residual_map(hypothesis.model, hypothesis.normalised)
    return Improvement(len(cells), len(failing_cells(cells)))


def state_sentences(
    cells: Sequence[Cell], verdict: Verdict, errors: Mapping[str, float], proxy: str | None, minimum_rms: float
) -> tuple[str, ...]:
    """The state of a flight, the most important sentence first.

    Parameters
    ----------
    cells : sequence of Cell
        The residual map.
    verdict : Verdict
        Probabilities and verdict.
    errors : mapping
        Channel → normalised RMS of the model as it is.
    proxy : str, optional
        For what the mission's aerodynamic database is a proxy; None where it is the vehicle's own.
    minimum_rms : float
        Normalised RMS below which no cell fails (`DecisionSettings.cell_minimum_rms`): of a clean flight, the reason is
        given why a cell with a larger one does not fail.
    """
    failing = failing_cells(list(cells))
    sentences = [_count_sentence(cells, failing), verdict.sentence]
    if verdict.entries and verdict.verdict != CLEAN and failing:
        sentences.append(_leader_sentence(verdict.entries[0], errors, verdict.verdict == MISSING, len(cells)))
    if verdict.verdict == CLEAN:
        sentences += _reasons(cells, failing, verdict.required_gain, minimum_rms)
    if proxy:
        sentences.append(
            f"The aerodynamic database is a proxy: {proxy}. What fails in lateral forces and moments, and a name that "
            "acts on them, may be an error of the proxy."
        )
    return tuple(sentences)


def _count_sentence(cells: Sequence[Cell], failing: Sequence[Cell]) -> str:
    if not failing:
        return f"None of the {len(cells)} cells of the residual map fails."
    worst = failing[0]
    verb = "fails" if len(failing) == 1 else "fail"
    return (
        f"{len(failing)} of {len(cells)} cells of the residual map {verb}, worst {_place(worst)} at "
        f"{worst.rms:.3g} sigmas."
    )


def _leader_sentence(entry: Entry, errors: Mapping[str, float], named: bool, cells: int) -> str:
    """What an effect reduces; one that is not named may reduce nothing, and is compared with the others.

    The map about a reconstruction with the effect may compare more or less of the flight than the present `cells`.
    """
    h = entry.hypothesis
    after, improvement = hypothesis_rms(h), improvement_with(h)
    channel = most_reduced_channel(h, dict(errors), after)
    remaining = "no cell fails"
    if improvement.failing:
        remaining = f"{improvement.failing} of {improvement.cells} cells still fail"
        if improvement.cells != cells:
            remaining = f"{improvement.failing} of the {improvement.cells} cells in the map of that model fail"
    subject = "With it" if named else f"With {h.label}, the most probable effect,"
    if f"{errors[channel]:.3g}" == f"{after[channel]:.3g}":
        return f"{subject} {remaining}, and the error of no channel falls."
    return (
        f"{subject} {remaining}; over the flight {_in_words(channel)} falls from {errors[channel]:.3g} to "
        f"{after[channel]:.3g} sigmas."
    )


def _reasons(cells: Sequence[Cell], failing: Sequence[Cell], required_gain: float, minimum_rms: float) -> list[str]:
    """Why a flight is clean although a cell fails or has a large normalised RMS."""
    reasons = []
    if failing:
        reasons.append(
            f"It is clean although {'a cell fails' if len(failing) == 1 else 'cells fail'}, because no effect and no "
            f"additional noise gains the {required_gain:.3g} nats that are required."
        )
    passing = [cell for cell in cells if not cell.fails]
    largest = max(passing, key=lambda cell: cell.rms, default=None)
    if largest is not None and largest.rms > minimum_rms:
        reasons.append(
            f"The largest normalised RMS that does not fail, {largest.rms:.3g} of {_place(largest)}, "
            f"is of {largest.count} number{'s' * (largest.count != 1)} only: chance allows up to "
            f"{largest.limit:.3g}."
        )
    return reasons


def _place(cell: Cell) -> str:
    channel = _in_words(cell.channel)
    return channel if cell.regime == CONSTRAINTS else f"{channel} in {cell.regime}"


def _in_words(name: str) -> str:
    return name.replace("_", " ")
