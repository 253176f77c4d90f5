"""What the page displays of a result: warnings, events, trajectory, constraints, residual map, residuals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from edl_filter.errors import InputError
from edl_filter.report.html.residual_map import constraint_payload, residual_axes, residual_payload
from edl_filter.report.plotly_renderer import plotly_figure
from edl_filter.report.residual_map import (
    MOST,
    cell_colours,
    cell_sentence,
    gradient,
    map_cells,
    rms_text,
    worst_rms,
)
from edl_filter.report.sentences import warnings
from edl_filter.report.text import constraint_verdict
from edl_filter.report.trajectory import altitude_velocity
from edl_filter.results.files import REPORT, finite, read_summary
from edl_filter.results.reader import ResultReader
from edl_filter.results.schema import DiagnosisContent, Summary
from edl_filter.results.schema.summary import ConstraintSummary
from edl_filter.serve.safety import inside

#: Height of the plot of the trajectory, pixels, and bins of the plot of a residual.
_HEIGHT, _BINS = 660, 1500
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
        ``trajectory`` (the figure of altitude and velocity), ``report`` (whether there is one).

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


def _trajectory(folder: Path) -> dict[str, Any] | None:
    with ResultReader.open(folder) as reader:
        if not reader.has("trajectory:altitude", "trajectory:speed"):
            return None
        return dict(finite(plotly_figure(altitude_velocity(reader), _HEIGHT)))


def map_view(diagnosis: DiagnosisContent) -> dict[str, Any]:
    """The residual map as the report draws it.

    Returns
    -------
    dict
        ``channels`` and ``regimes`` in order, ``worst`` (normalised RMS at the end of the scale), ``gradient`` (CSS of
        the scale), ``drawn`` (for each cell of the map ``background``, ``ink``, ``text``, ``sentence``; empty without
        an RMS).
    """
    cells = diagnosis.map
    channels, regimes, _ = map_cells(cells)
    worst = max(MOST, worst_rms(cells))
    drawn: list[dict[str, str]] = []
    for cell in cells:
        rms = cell.normalised_rms
        if rms is None:
            drawn.append({})
            continue
        background, ink = cell_colours(rms, worst)
        drawn.append({"background": background, "ink": ink, "text": rms_text(rms), "sentence": cell_sentence(cell)})
    return {"channels": channels, "regimes": regimes, "worst": worst, "gradient": gradient(), "drawn": drawn}


def residual_view(root: Path, name: str, channel: str) -> dict[str, Any]:
    """Data of the plot of a channel's residual, or of a constraint's innovations, against time.

    Parameters
    ----------
    root : Path
        The served folder.
    name : str
        Folder of the result, relative to it.
    channel : str
        Channel or constraint of the residual map.

    Returns
    -------
    dict
        ``axes`` (of `residual_axes`), ``channel`` (of `residual_payload`) and ``uses`` (of `constraint_payload`), of
        which those are None that do not exist.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        There is no diagnosis, or none of such a channel.
    """
    folder = inside(root, name)
    with ResultReader.open(folder) as reader:
        diagnosis = reader.diagnosis
        if diagnosis is None:
            raise InputError(f"{name}: found no diagnosis; diagnose the result first.")
        accepted = list(dict.fromkeys(cell.channel for cell in diagnosis.map))
        if channel not in accepted:
            raise InputError(f"residual: found {channel!r}; accepted: {', '.join(accepted)}.")
        return {
            "axes": finite(residual_axes(reader, diagnosis)),
            "channel": residual_payload(reader, channel, _BINS),
            "uses": constraint_payload(reader, channel),
        }
