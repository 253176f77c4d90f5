"""Where the model fails: the map of channels by flight regimes, and the residual of each cell against time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from edl_filter.report.constraints import in_sigmas
from edl_filter.report.decimate import extremes
from edl_filter.report.html.diagnosis_sections import diagnose_command
from edl_filter.report.html.page import Block, Command, MapButton, MapTable, Note, ResidualPlot, Scale, Section
from edl_filter.report.plotly_renderer import axis_layout, event_marks, layout, packed
from edl_filter.report.residual_map import (
    CONSTRAINTS,
    LEAST,
    MOST,
    cell_colours,
    cell_sentence,
    gradient,
    map_cells,
    rms_text,
    worst_rms,
)
from edl_filter.report.text import number, onset_text, readable, time_label, words
from edl_filter.results.reader import ResultReader
from edl_filter.results.schema import DiagnosisContent
from edl_filter.results.schema.diagnosis import MapCell

#: Bins of all channels' residuals together, and of one channel at most: the page must stay small.
_ALL_BINS, _BINS = 4800, 800
_HEIGHT = 420
_KEY, _TITLE = "where", "Residual map"


def residual_map(reader: ResultReader) -> Section:
    """The map with the plot of the selected cell, or the command that computes it."""
    diagnosis = reader.diagnosis
    if diagnosis is None or not diagnosis.map:
        note = Note("This run has not been diagnosed, so there is no map yet. To get one:")
        return Section(_KEY, _TITLE, [note, Command(diagnose_command(reader))])
    cells = diagnosis.map
    worst = worst_rms(cells)
    blocks: list[Block] = [
        Note(_count_sentence(diagnosis)),
        Note(
            "Each number is the RMS of measured minus predicted over its stated sigma: 1 where the model holds. A cell "
            "with a thick outline and a ▲ fails. Click a cell to see its residual against time.",
            "muted",
        ),
    ]
    if any(cell.regime != CONSTRAINTS for cell in cells):
        blocks.append(_flight_map(cells, worst))
    if any(cell.regime == CONSTRAINTS for cell in cells):
        blocks += [
            _constraint_map(cells, worst),
            Note(
                "A constraint's number states how it agrees with the path that is dead-reckoned from the estimated "
                "start; the plot of its cell shows the filter's innovations.",
                "muted",
            ),
        ]
    blocks.append(Scale(gradient(), f"{LEAST:g}", number(max(MOST, worst))))
    if diagnosis.onsets:
        blocks.append(Note(onset_text(diagnosis.onsets)))
    blocks.append(ResidualPlot(_payload(reader, diagnosis)))
    if reader.residuals is None:
        blocks.append(
            Note("The residuals against time are missing (residuals.nc); diagnose again to see them.", "muted")
        )
    return Section(_KEY, _TITLE, blocks)


def _count_sentence(diagnosis: DiagnosisContent) -> str:
    failing, total = len(diagnosis.where), len(diagnosis.map)
    if not failing:
        return f"None of the {total} cells fails: model and measurement agree to the noise."
    return f"{failing} of {total} cells fail. Worst: {cell_sentence(diagnosis.where[0])}"


def _flight_map(cells: Sequence[MapCell], worst: float) -> MapTable:
    channels, regimes, index = map_cells(cells)
    rows = []
    for channel in channels:
        indices = [index.get((channel, regime)) for regime in regimes]
        rows.append((words(channel), [MapButton() if k is None else _button(k, cells[k], worst) for k in indices]))
    times = [[cells[k] for (_, name), k in index.items() if name == regime] for regime in regimes]
    heads = [
        (name, f"{min(c.t0_s for c in column):.0f}–{max(c.t1_s for c in column):.0f} s")
        for name, column in zip(regimes, times, strict=True)
    ]
    return MapTable("channel", heads, rows)


def _constraint_map(cells: Sequence[MapCell], worst: float) -> MapTable:
    """Constraints in one row, since they belong to no regime."""
    constraints = [(k, cell) for k, cell in enumerate(cells) if cell.regime == CONSTRAINTS]
    row = [_button(k, cell, worst) for k, cell in constraints]
    return MapTable("constraint", [(words(c.channel), _times(c)) for _, c in constraints], [("all uses", row)])


def _times(cell: MapCell) -> str:
    once = round(cell.t0_s) == round(cell.t1_s)
    return f"{cell.t0_s:.0f} s" if once else f"{cell.t0_s:.0f}–{cell.t1_s:.0f} s"


def _button(index: int, cell: MapCell, worst: float) -> MapButton:
    rms = cell.normalised_rms
    if rms is None:
        return MapButton()
    return MapButton(index, rms_text(rms), *cell_colours(rms, worst), cell.fails, cell_sentence(cell))


def _payload(reader: ResultReader, diagnosis: DiagnosisContent) -> dict[str, Any]:
    """Data from which the script draws the residual of any cell."""
    cells = diagnosis.map
    known = [k for k, c in enumerate(cells) if c.normalised_rms is not None]
    series = reader.residuals
    channels = () if series is None else series.channels
    bins = min(_BINS, _ALL_BINS // max(len(channels), 1))
    payloads = {name: residual_payload(reader, name, bins) for name in channels}
    return residual_axes(reader, diagnosis) | {
        "cells": [
            {"channel": c.channel, "regime": c.regime, "t0_s": c.t0_s, "t1_s": c.t1_s, "text": cell_sentence(c)}
            for c in cells
        ],
        "first": max(known or [0], key=lambda k: _precedence(cells[k])),
        "channels": {name: payload for name, payload in payloads.items() if payload is not None},
        "constraints": {c.channel: constraint_payload(reader, c.channel) for c in cells if c.regime == CONSTRAINTS},
    }


def residual_axes(reader: ResultReader, diagnosis: DiagnosisContent) -> dict[str, Any]:
    """What the plots of all residuals have in common, for ``residualFigure`` of the script ``figures.js``.

    Returns
    -------
    dict
        ``span`` (s, s), ``layout``, ``shapes`` and ``notes`` of the events, ``onsets`` (channel → time, s).
    """
    series = reader.residuals
    span = (0.0, 1.0) if series is None else (float(series.time[0]), float(series.time[-1]))
    shapes, notes = event_marks(reader.events, span)
    axes = {"xaxis": axis_layout(f"{time_label(reader.epoch_utc)} (s)"), "yaxis": axis_layout("")}
    return {
        "span": span, "shapes": shapes, "notes": notes, "layout": layout(_HEIGHT, top=74) | axes,
        "onsets": {onset.channel: onset.time_s for onset in diagnosis.onsets},
    }  # fmt: skip


def _precedence(cell: MapCell) -> tuple[bool, bool, float]:
    """Order of the cells whose residual may be plotted first: one that fails, in flight, with the largest RMS."""
    return cell.fails, cell.regime != CONSTRAINTS, cell.normalised_rms or 0.0


def residual_payload(reader: ResultReader, channel: str, bins: int) -> dict[str, Any] | None:
    """A channel against time: residual and one sigma in its unit, with the extremes of both and of their ratio.

    None for a channel that was compared nowhere, or if the result has no residuals. `bins` is the number of bins whose
    extremes remain.
    """
    series = reader.residuals
    if series is None or channel not in series.channels:
        return None
    k = series.index(channel)
    variables = series.residual[k], series.sigma[k], series.normalised[k]
    if not np.isfinite(variables[0]).any():
        return None
    index = np.unique(np.concatenate([extremes(v, bins) for v in variables]))
    return {
        "unit": readable(series.units[k]),
        "x": packed(series.time[index]),
        "y": packed(series.residual[k, index]),
        "sigma": packed(series.sigma[k, index]),
    }


def constraint_payload(reader: ResultReader, name: str) -> dict[str, Any] | None:
    """Innovations of a constraint in sigmas: against time if it is used often, by component if it is used once."""
    group = f"constraints/{name}"
    time, innovation, sigma = (reader.variable(group, v) for v in ("time", "innovation", "innovation_sigma"))
    if time is None or innovation is None or sigma is None:
        return None
    components = reader.text(group, "component")
    ratio = in_sigmas(innovation, sigma)
    return {
        "once": len(time) == 1,
        "parts": components if len(components) == ratio.shape[1] else [str(k) for k in range(ratio.shape[1])],
        "time": packed(time),
        "values": [packed(column) for column in ratio.T],
    }
