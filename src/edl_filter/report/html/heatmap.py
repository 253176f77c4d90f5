"""Where the model fails: the map of channels by flight regimes, and each cell's residual against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from edl_filter.report.decimate import extremes
from edl_filter.report.html.blocks import Block, Command, HeatCell, HeatMap, Note, Residuals, Scale, Section
from edl_filter.report.html.colours import LEAST, MOST, cell_colours, gradient
from edl_filter.report.html.commands import diagnose
from edl_filter.report.html.plotting import axis, event_marks, layout, packed
from edl_filter.report.html.source import Source
from edl_filter.report.html.words import readable
from edl_filter.report.terminal.diagnosis import number, onset_text

FIXED = "constraints"
#: Bins of all channels' residuals together, and of one channel at most: the page must stay small.
_ALL_BINS, _BINS = 4800, 800
_FIXED_NOTE = (
    "A constraint's number tells how it fits the path that is dead-reckoned from the estimated start; the plot of its "
    "cell shows what the filter met when it used it."
)
_KEY, _TITLE = "where", "Where the model fails"


def heatmap(source: Source) -> Section:
    """The map with the plot that its cells fill, or how to get one."""
    told = source.diagnosis
    if not told.get("map"):
        return Section(
            _KEY,
            _TITLE,
            [Note("This run has not been diagnosed, so there is no map yet. To get one:"), Command(diagnose(source))],
        )
    cells = told["map"]
    worst = max((c["normalised_rms"] for c in cells if c["normalised_rms"] is not None), default=1.0)
    blocks: list[Block] = [
        Note(_counted(told)),
        Note(
            "Each number is the RMS of measured less predicted over its stated sigma: 1 where the model holds. A cell "
            "with a thick outline and a ▲ fails. Click a cell to see its residual against time.",
            "muted",
        ),
        _flight_map(cells, worst),
        _fixed_map(cells, worst),
        *([Note(_FIXED_NOTE, "muted")] if _fixed_names(cells) else []),
        Scale(gradient(), f"{LEAST:g}", number(max(MOST, worst))),
    ]
    if told.get("onsets"):
        blocks.append(Note(onset_text(told)))
    blocks.append(Residuals(_payload(source, cells)))
    if not source.residuals:
        blocks.append(
            Note("The residuals against time are missing (residuals.nc); diagnose again to see them.", "muted")
        )
    return Section(_KEY, _TITLE, [b for b in blocks if not isinstance(b, HeatMap) or b.rows])


def _counted(told: Mapping[str, Any]) -> str:
    failing, whole = len(told["where"]), len(told["map"])
    if not failing:
        return f"None of the {whole} cells fails: model and measurement agree to the noise."
    return f"{failing} of {whole} cells fail. Worst: {_sentence(told['where'][0])}"


def _flight_map(cells: Sequence[Mapping[str, Any]], worst: float) -> HeatMap:
    flight = [(k, c) for k, c in enumerate(cells) if c["regime"] != FIXED]
    channels = list(dict.fromkeys(c["channel"] for _, c in flight))
    regimes: dict[str, tuple[float, float]] = {}
    for _, c in sorted(flight, key=lambda item: item[1]["t0_s"]):
        t0, t1 = regimes.get(c["regime"], (c["t0_s"], c["t1_s"]))
        regimes[c["regime"]] = (min(t0, c["t0_s"]), max(t1, c["t1_s"]))
    at = {(c["channel"], c["regime"]): _cell(k, c, worst) for k, c in flight}
    rows = [(_words(name), [at.get((name, r), HeatCell()) for r in regimes]) for name in channels]
    heads = [(r, f"{t0:.0f}–{t1:.0f} s") for r, (t0, t1) in regimes.items()]
    return HeatMap("channel", heads, rows)


def _fixed_map(cells: Sequence[Mapping[str, Any]], worst: float) -> HeatMap:
    """Constraints in one row: they belong to no regime."""
    fixed = [(k, c) for k, c in enumerate(cells) if c["regime"] == FIXED]
    row = [_cell(k, c, worst) for k, c in fixed]
    heads = [(_words(c["channel"]), _span(c["t0_s"], c["t1_s"])) for _, c in fixed]
    return HeatMap("constraint", heads, [("all uses", row)] if row else [])


def _span(t0: float, t1: float) -> str:
    return f"{t0:.0f} s" if round(t0) == round(t1) else f"{t0:.0f}–{t1:.0f} s"


def _cell(index: int, cell: Mapping[str, Any], worst: float) -> HeatCell:
    rms = cell["normalised_rms"]
    if rms is None:
        return HeatCell()
    ground, ink = cell_colours(rms, worst)
    text = f"{rms:.2f}" if rms < 10.0 else f"{rms:.1f}" if rms < 100.0 else f"{rms:.0f}"
    return HeatCell(index, text, ground, ink, bool(cell["fails"]), _sentence(cell))


def _sentence(cell: Mapping[str, Any]) -> str:
    return readable(str(cell["sentence"]).replace(cell["channel"], _words(cell["channel"]), 1))


def _words(name: str) -> str:
    return name.replace("_", " ")


def _payload(source: Source, cells: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the script needs to draw any cell."""
    span = _whole(source)
    shapes, notes = event_marks(source.events, span)
    return {
        "cells": [
            {"channel": c["channel"], "regime": c["regime"], "t0": c["t0_s"], "t1": c["t1_s"], "text": _sentence(c)}
            for c in cells
        ],
        "first": _first(cells),
        "channels": _channels(source),
        "constraints": {name: _uses(source, name) for name in _fixed_names(cells)},
        "onsets": {o["channel"]: o["time_s"] for o in source.diagnosis.get("onsets", [])},
        "span": span,
        "shapes": shapes,
        "notes": notes,
        "layout": layout(420, top=74) | {"xaxis": axis(source.time_label), "yaxis": axis("")},
    }


def _first(cells: Sequence[Mapping[str, Any]]) -> int:
    """The cell that is shown before any is clicked: the worst of the flight's."""
    flight = [k for k, c in enumerate(cells) if c["regime"] != FIXED and c["normalised_rms"] is not None]
    return max(flight or [0], key=lambda k: (cells[k]["fails"], cells[k]["normalised_rms"] or 0.0))


def _whole(source: Source) -> list[float]:
    if not source.residuals:
        return [0.0, 1.0]
    time = source.residuals["time"]
    return [float(time[0]), float(time[-1])]


def _channels(source: Source) -> dict[str, Any]:
    """Each channel against time: residual and one sigma in its unit, with the peaks of both and of their ratio."""
    found = source.residuals
    if not found:
        return {}
    time = np.asarray(found["time"], float)
    bins = min(_BINS, _ALL_BINS // max(len(found["channel"]), 1))
    made = {}
    for k, name in enumerate(found["channel"]):
        residual, sigma, ratio = (np.asarray(found[v][k], float) for v in ("residual", "sigma", "normalised"))
        if not np.isfinite(residual).any():
            continue
        kept = np.unique(np.concatenate([extremes(v, bins) for v in (residual, sigma, ratio)]))
        made[str(name)] = {
            "unit": readable(str(found["unit"][k])),
            "x": packed(time[kept]),
            "y": packed(residual[kept]),
            "sigma": packed(sigma[kept]),
        }
    return made


def _fixed_names(cells: Sequence[Mapping[str, Any]]) -> list[str]:
    return [c["channel"] for c in cells if c["regime"] == FIXED]


def _uses(source: Source, name: str) -> dict[str, Any] | None:
    """Innovations of a constraint in sigmas: by time where it is used often, by component where it is used once."""
    group = f"constraints/{name}"
    time, innovation, sigma = (source.get(group, v) for v in ("time", "innovation", "innovation_sigma"))
    if time is None or innovation is None or sigma is None:
        return None
    parts = source.text(group, "component")
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sigma > 0.0, innovation / sigma, np.nan)
    once = len(time) == 1
    return {
        "once": once,
        "parts": parts if len(parts) == ratio.shape[1] else [str(k) for k in range(ratio.shape[1])],
        "time": packed(time),
        "values": [packed(column) for column in ratio.T],
    }
