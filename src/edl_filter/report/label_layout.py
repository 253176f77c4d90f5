"""Places of labels above a row of marks, so that neither labels nor their leaders meet.

All lengths are in points (1/72 inch) along the axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Where one label goes: its row, 0 the lowest, and the left end of its text."""

    row: int
    left: float


def place(marks: Sequence[float], widths: Sequence[float], span: float, gap: float = 4.0) -> list[Place]:
    """Places in as few rows as possible.

    A leader rises from each mark to its label and must not cross another label. Labels stand to the left of
    their leader where they can, else to its right, else across it, and inside the span if they fit.

    Parameters
    ----------
    marks : sequence of float
        Where the marks are, increasing, from 0 to `span`.
    widths : sequence of float
        Of the labels.
    span : float
        Length of the axis.
    gap : float
        Least distance between a label and anything else.

    Returns
    -------
    list of Place
        One for each mark.
    """
    for rows in range(1, len(marks) + 1):
        found = _search(marks, widths, span, gap, rows, [])
        if found is not None:
            return found
    return [Place(row, _within(m, w, span)) for row, (m, w) in enumerate(zip(marks, widths, strict=True))]


def _search(
    marks: Sequence[float], widths: Sequence[float], span: float, gap: float, rows: int, chosen: list[Place]
) -> list[Place] | None:
    i = len(chosen)
    if i == len(marks):
        return chosen
    x, width = marks[i], widths[i]
    for row in range(rows):
        for left in (x - width - gap / 2, x + gap / 2, _within(x, width, span)):
            inside = left >= -gap and left + width <= span + gap
            trial = Place(row, left)
            free = inside or width > span
            if free and all(
                not _meet(marks[k], widths[k], chosen[k], x, width, trial, gap)
                and not _meet(x, width, trial, marks[k], widths[k], chosen[k], gap)
                for k in range(i)
            ):
                found = _search(marks, widths, span, gap, rows, [*chosen, trial])
                if found is not None:
                    return found
    return None


def _within(mark: float, width: float, span: float) -> float:
    """Left end of a label across its mark, moved inside the span."""
    return min(max(mark - width / 2, 0.0), max(span - width, 0.0))


def _meet(mark: float, width: float, a: Place, other_mark: float, other_width: float, b: Place, gap: float) -> bool:
    """Whether label a meets label b in the same row, or a's leader crosses the lower label b."""
    if a.row == b.row:
        return a.left < b.left + other_width + gap and b.left < a.left + width + gap
    return a.row > b.row and b.left - gap / 2 < mark < b.left + other_width + gap / 2
