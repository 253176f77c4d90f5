"""The reconstruction in a result, for the page: warnings, events, trajectory, constraints, report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from edl_filter.errors import InputError
from edl_filter.report.sentences import warnings
from edl_filter.report.text import constraint_verdict
from edl_filter.results.files import REPORT, finite, read_summary
from edl_filter.results.reader import ResultReader
from edl_filter.results.schema import Summary
from edl_filter.results.schema.summary import ConstraintSummary
from edl_filter.serve.safety import inside

#: Greatest number of points of a curve.
_POINTS = 600
#: Keys of an event in ``summary.json`` that the page shows.
_EVENT_KEYS = (
    "time_s", "altitude_m", "altitude_sigma_m", "velocity_m_s", "velocity_sigma_m_s", "mach", "dynamic_pressure_pa",
    "flight_path_deg", "alpha_total_deg",
)  # fmt: skip


def overview(root: Path, name: str) -> dict[str, Any]:
    """Return the reconstruction in a result.

    Parameters
    ----------
    root : Path
        The served folder.
    name : str
        Folder of the result, relative to it.

    Returns
    -------
    dict
        ``warnings`` (sentences, those about trust first), ``notes`` (sentences about the telemetry), ``events`` (name →
        numbers), ``landing``, ``constraints`` (name → uses, accepted_uses, nis, dof, verdict and tone of the report),
        ``trajectory`` until the landing (``time`` s, ``altitude`` m, ``speed`` m/s, lists of one length), ``report``
        (whether there is one).

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    """
    folder = inside(root, name)
    try:
        content = read_summary(inside(root, f"{name}/summary.json"))
    except InputError as error:  # the result itself can be displayed
        summary: dict[str, Any] = {"events": {}}
        constraints: dict[str, Any] = {}
        doubts = [str(error)]
    else:
        summary = content.model_dump(mode="json")
        constraints = {name: _constraint(c) for name, c in content.constraints.items()}
        doubts = [*warnings(content), *_further_causes(content), *_sample_warnings(content)]
    return {
        "warnings": doubts,
        "notes": [str(note) for note in summary.get("notes") or ()],
        "events": {n: {k: event.get(k) for k in _EVENT_KEYS} for n, event in summary["events"].items()},
        "landing": summary.get("landing"),
        "constraints": constraints,
        "trajectory": _trajectory(folder),
        "report": (folder / REPORT).is_file(),
    }


def _constraint(constraint: ConstraintSummary) -> dict[str, Any]:
    verdict, tone = constraint_verdict(constraint)
    numbers = constraint.model_dump(mode="json", include={"uses", "accepted_uses", "nis", "dof"})
    return numbers | {"verdict": verdict, "tone": tone}


def _further_causes(summary: Summary) -> list[str]:
    """Causes after the first, which the headline names, that a run with the repaired record confirms."""
    if summary.headline is None:
        return []
    causes = [cause.sentence for cause in summary.causes if cause.consistent]
    return [f"Also consistent with the data: {sentence}." for sentence in causes[1:]]


def _sample_warnings(summary: Summary) -> list[str]:
    count = len(summary.sample_findings)
    return [f"{count} finding{'s' * (count != 1)} about samples; the report lists them."] if count else []


def _trajectory(folder: Path) -> dict[str, list[float | None]] | None:
    with ResultReader.open(folder) as reader:
        altitude, speed = reader.trajectory("altitude"), reader.trajectory("speed")
        if altitude is None or speed is None:
            return None
        time = reader.time
        first, last = np.searchsorted(time, reader.span(), side="left")
        last = min(last, len(time) - 1)
        k = np.unique(np.linspace(first, last, min(_POINTS, last - first + 1)).round().astype(int))
        return {"time": finite(time[k]), "altitude": finite(altitude[k]), "speed": finite(speed[k])}
