"""The reconstruction in a result, for the page: warnings, events, trajectory, constraints, report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from edl_filter.errors import InputError
from edl_filter.results.files import REPORT, finite, read_summary
from edl_filter.results.reader import ResultReader
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
        ``warnings`` (sentences, those about trust first), ``events`` (name → numbers), ``landing``, ``constraints``
        (name → uses, accepted_uses, nis, dof, accepted), ``trajectory`` (``time`` s, ``altitude`` m, ``speed`` m/s,
        lists of one length), ``report`` (whether there is one).

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    """
    folder = inside(root, name)
    try:
        summary = read_summary(inside(root, f"{name}/summary.json")).model_dump(mode="json")
    except InputError as error:  # the result itself can be displayed
        summary = {"headline": None, "events": {}, "constraints": {}}
        problems = [str(error)]
    else:
        problems = []
    constraints = {
        key: {k: c.get(k) for k in ("uses", "accepted_uses", "nis", "dof", "accepted")}
        for key, c in summary["constraints"].items()
    }
    return {
        "warnings": [*_trust_warnings(summary), *problems, *_sample_warnings(summary)],
        "events": {n: {k: event.get(k) for k in _EVENT_KEYS} for n, event in summary["events"].items()},
        "landing": summary.get("landing"),
        "constraints": constraints,
        "trajectory": _trajectory(folder),
        "report": (folder / REPORT).is_file(),
    }


def _trust_warnings(summary: dict[str, Any]) -> list[str]:
    """Why a result is not to be trusted, then the causes that a run with the repaired record confirms."""
    if summary["headline"] is None:
        return []
    causes = [c["sentence"] for c in summary.get("causes", ()) if c.get("consistent")]
    further = [f"Also consistent with the data: {sentence}." for sentence in causes[1:]]
    return [summary["headline"], *further]


def _sample_warnings(summary: dict[str, Any]) -> list[str]:
    findings, notes = summary.get("sample_findings") or [], summary.get("notes") or []
    count = len(findings)
    lost = [f"{count} finding{'s' * (count != 1)} about samples; the report lists them."] if count else []
    return [*lost, *map(str, notes)]


def _trajectory(folder: Path) -> dict[str, list[float | None]] | None:
    with ResultReader.open(folder) as reader:
        altitude, speed = reader.trajectory("altitude"), reader.trajectory("speed")
        if altitude is None or speed is None:
            return None
        time = reader.time
        k = np.unique(np.linspace(0, len(time) - 1, min(_POINTS, len(time))).round().astype(int))
        return {"time": finite(time[k]), "altitude": finite(altitude[k]), "speed": finite(speed[k])}
