"""Positions of labels above a row of marks, so that neither labels nor their leaders overlap.

All lengths are in points (1/72 inch) along the axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Position:
    """Position of one label: its row, 0 the lowest, and the beginning of its text."""

    row: int
    start: float


def place_labels(marks: Sequence[float], widths: Sequence[float], span: float, gap: float = 4.0) -> list[Position]:
    """Positions in as few rows as possible.

    A leader rises from each mark to its label and must not cross another label. Labels are to the left of their leader
    where possible, else to its right, else across it, and within the axis if they fit.

    Parameters
    ----------
    marks : sequence of float
        Positions of the marks, increasing, from 0 to `span`.
    widths : sequence of float
        Widths of the labels.
    span : float
        Length of the axis.
    gap : float
        Least distance between a label and anything else.

    Returns
    -------
    list of Position
        One for each mark.
    """
    for rows in range(1, len(marks) + 1):
        positions = _search(marks, widths, span, gap, rows, [])
        if positions is not None:
            return positions
    return [Position(row, _within(m, w, span)) for row, (m, w) in enumerate(zip(marks, widths, strict=True))]


def _search(
    marks: Sequence[float], widths: Sequence[float], span: float, gap: float, rows: int, chosen: list[Position]
) -> list[Position] | None:
    """Positions of all labels after the chosen ones, or None if there are none in this number of rows."""
    i = len(chosen)
    if i == len(marks):
        return chosen
    mark, width = marks[i], widths[i]
    for row in range(rows):
        for start in (mark - width - gap / 2, mark + gap / 2, _within(mark, width, span)):
            inside = start >= -gap and start + width <= span + gap
            trial = Position(row, start)
            if (inside or width > span) and not any(
                _overlap(marks[k], widths[k], chosen[k], mark, width, trial, gap)
                or _overlap(mark, width, trial, marks[k], widths[k], chosen[k], gap)
                for k in range(i)
            ):
                positions = _search(marks, widths, span, gap, rows, [*chosen, trial])
                if positions is not None:
                    return positions
    return None


def _within(mark: float, width: float, span: float) -> float:
    """Beginning of a label across its mark, moved inside the axis."""
    return min(max(mark - width / 2, 0.0), max(span - width, 0.0))


def _overlap(
    mark_a: float, width_a: float, a: Position, mark_b: float, width_b: float, b: Position, gap: float
) -> bool:
    """Whether label a overlaps label b in the same row, or the leader of a crosses the lower label b."""
    if a.row == b.row:
        return a.start < b.start + width_b + gap and b.start < a.start + width_a + gap
    return a.row > b.row and b.start - gap / 2 < mark_a < b.start + width_b + gap / 2
