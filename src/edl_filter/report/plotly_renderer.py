"""Figures as plotly takes them, from their descriptions: plain dicts, numbers packed as four-byte floats.

Colours stay roles (``"@blue"``), which the page's script turns into colours of its theme.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.estimation.series import runs
from edl_filter.report.decimate import envelope, reduced
from edl_filter.report.description import (
    FEW_DECADES,
    Axis,
    Band,
    Bars,
    Curve,
    Figure,
    HeatMap,
    Line,
    Panel,
    Region,
    Span,
    Text,
)
from edl_filter.report.text import event_label, readable
from edl_filter.types import Array, BoolArray

Trace = dict[str, Any]

#: Bins of a curve, in which two samples remain.
BINS = 400
#: Name of the annotations that label events.
EVENT = "event"
#: Decades of a logarithmic axis beyond which every second decade has a tick.
_MANY_DECADES = 8.0
#: Powers of ten in positional notation.
_POSITIONAL = (-3, 4)
#: Pixels below the axes for the time label, for a legend, and above them for labels of events.
BELOW, LEGEND_HEIGHT, ABOVE = 46, 34, 74
#: Pixels of one character of a label of an event.
_CHARACTER = 6.5
#: Largest number of pieces into which gaps divide a band; with more it is drawn across its gaps.
_PIECES = 80
#: Distance of stacked panels as a share of the height.
_GAP = 0.035
_SYMBOLS = {
    "circle": "circle", "square": "square", "diamond": "diamond", "star": "star", "triangle": "triangle-up",
    "cross": "x-thin-open", "plus": "cross", "right": "triangle-right", "left": "triangle-left",
    "down": "triangle-down",
}  # fmt: skip


def packed(values: ArrayLike) -> dict[str, str]:
    """Numbers in four bytes each, base64, which plotly reads directly; a number that is not finite is a gap.

    Parameters
    ----------
    values : (N,) array
        In any unit.
    """
    array = np.asarray(values, dtype="<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(array.tobytes()).decode("ascii")}


def plotly_figure(figure: Figure, height: int, bins: int = BINS) -> dict[str, Any]:
    """Data and layout of a figure.

    Parameters
    ----------
    figure : Figure
        Panels in rows and columns; those of a column with a shared x axis have only one.
    height : int
        Height, pixels.
    bins : int
        Number of bins to which each curve is reduced.
    """
    columns = len(figure.widths)
    events = [event_label(name) for panel in figure.panels for name in panel.events]
    above = max([ABOVE, *(round(_CHARACTER * len(label)) + 8 for label in events)]) if events else 12
    legend = any(panel.legend is not None for panel in figure.panels) or figure.legend
    result = layout(height, top=above, legend=legend)
    traces: list[Trace] = []
    shapes: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    tops = _shares(figure.heights)
    k = 0
    for r, row in enumerate(figure.rows):
        for c, panel in enumerate(row):
            k += 1
            y_name = "y" if k == 1 else f"y{k}"
            own_x = not figure.shared_x or r == 0
            number = k if not figure.shared_x else c + 1
            x_name = "x" if number == 1 else f"x{number}"
            result[y_name.replace("y", "yaxis")] = _axis(panel.y) | {
                "domain": tops[r], "automargin": len(figure.panels) == 1, "anchor": x_name,
            }  # fmt: skip
            if panel.aspect != "auto":
                result[y_name.replace("y", "yaxis")] |= {"scaleanchor": x_name}
            if own_x:
                last = (
                    f"y{k + columns * (len(figure.rows) - 1)}" if figure.shared_x and len(figure.rows) > 1 else y_name
                )
                domain = [0.0, 1.0] if len(row) == 1 else _column(figure.widths, c)
                result[x_name.replace("x", "xaxis")] = _axis(panel.x) | {"domain": domain, "anchor": last}
            panel_traces, panel_shapes, panel_annotations = _elements(panel, bins)
            listed = panel.legend is not None or figure.legend
            axes = {"xaxis": x_name, "yaxis": y_name} if k > 1 else {}
            traces += [t | axes | {"showlegend": t["showlegend"] and listed} for t in panel_traces]
            shapes += [_placed(s, x_name, y_name) for s in panel_shapes]
            annotations += [_placed(a, x_name, y_name) for a in panel_annotations]
            if own_x:
                lines, labels = event_marks(panel.events, panel.x.range)
                shapes += [s | {"xref": x_name} for s in lines]
                annotations += [a | {"xref": x_name} for a in labels]
    return {"data": _unique_legend(traces), "layout": result | {"shapes": shapes, "annotations": annotations}}


def layout(height: int, *, top: int = 12, legend: bool = True) -> dict[str, Any]:
    """Layout of a figure without axes; the legend is below the axes.

    Parameters
    ----------
    height, top : int
        Height of the figure and of its upper margin, pixels.
    legend : bool
        Whether there is a legend.
    """
    below = BELOW + (LEGEND_HEIGHT if legend else 0)
    inner = max(height - top - below, 50)
    return {
        "height": height,
        "margin": {"l": 64, "r": 12, "t": top, "b": below},
        "showlegend": legend,
        "legend": {"orientation": "h", "x": 0.0, "xanchor": "left", "y": -BELOW / inner, "yanchor": "top"},
        "hovermode": "closest",
        "font": {"size": 12, "color": "@ink"},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
    }


def axis_layout(title: str) -> dict[str, Any]:
    """Layout of an axis with a title and otherwise the style of the report."""
    return {
        "title": {"text": title, "standoff": 6, "font": {"size": 12}}, "gridcolor": "@grid", "zerolinecolor": "@grid",
        "linecolor": "@muted", "automargin": True, "exponentformat": "power", "ticks": "outside", "ticklen": 4,
        "tickcolor": "@muted",
    }  # fmt: skip


def event_marks(
    events: Mapping[str, float], span: tuple[float, float] | None
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Lines at all events in an interval, and a label above each.

    Parameters
    ----------
    events : mapping
        Name → time, s.
    span : (float, float), optional
        Interval, s.
    """
    inside = {n: t for n, t in events.items() if span is None or span[0] <= t <= span[1]}
    lines: list[dict[str, Any]] = [
        {"type": "line", "x0": t, "x1": t, "xref": "x", "y0": 0, "y1": 1, "yref": "paper", "layer": "below",
         "line": {"color": "@muted", "width": 1, "dash": "dot"}}
        for t in inside.values()
    ]  # fmt: skip
    if not inside:
        return lines, []
    # the page's script moves labels apart that would overlap
    return lines, [
        {"x": t, "xref": "x", "y": 1, "yref": "paper", "yanchor": "bottom", "showarrow": False, "name": EVENT,
         "text": event_label(name), "textangle": -90, "font": {"size": 11, "color": "@muted"}}
        for name, t in sorted(inside.items(), key=lambda event: event[1])
    ]  # fmt: skip


def curve_trace(curve: Curve, bins: int = BINS) -> Trace:
    """A curve, reduced to a number of bins."""
    index = reduced(curve, bins)
    x, y = curve.x[index], curve.y[index]
    mode = "+".join(
        m for m, on in (("lines", curve.width), ("markers", curve.symbol), ("text", any(curve.notes))) if on
    )
    unit = f" {curve.unit}" if curve.unit else ""
    hover = f"%{{y:.4~g}}: %{{x:.5~g}}{unit}" if curve.independent == "y" else f"%{{x:.6~g}}: %{{y:.5~g}}{unit}"
    trace: Trace = {
        "type": "scatter", "mode": mode or "markers", "name": curve.label or " ", "x": packed(x), "y": packed(y),
        "hovertemplate": ("%{hovertext}<br>" if curve.names else "") + hover + "<extra>%{fullData.name}</extra>",
        "showlegend": bool(curve.label), "opacity": curve.opacity,
    }  # fmt: skip
    if curve.label:
        trace["legendgroup"] = curve.label
    if curve.width:
        trace["line"] = {"color": f"@{curve.colour}", "width": max(curve.width, 1.1), "dash": curve.dash or "solid"}
    if curve.symbol:
        trace["marker"] = {"color": f"@{curve.colour}", "size": 1.5 * curve.size, "symbol": _SYMBOLS[curve.symbol]}
    if curve.sigma is not None:
        trace["error_y"] = {"array": packed(curve.sigma[index]), "color": f"@{curve.colour}", "thickness": 1}
    if curve.names:
        trace["hovertext"] = list(curve.names)
    if any(curve.notes):
        rising = len(x) > 1 and float((x[-1] - x[0]) * (y[-1] - y[0])) > 0.0
        trace |= {  # next to the line, not on it
            "text": list(curve.notes), "textposition": "bottom right" if rising else "top right",
            "textfont": {"size": 11, "color": "@ink"}, "cliponaxis": False,
        }  # fmt: skip
    return trace


def band_trace(band: Band, bins: int = BINS) -> Trace:
    """The area of a band, its limits reduced to a number of bins; in pieces where it has gaps."""
    along: list[Array] = []
    across: list[Array] = []
    pieces = _pieces(np.isfinite(band.low) & np.isfinite(band.high) & np.isfinite(band.position))
    share = max(bins // max(len(pieces), 1), 20)
    for piece in pieces:
        low, high = (envelope(band.position[piece], v[piece], share) for v in (band.low, band.high))
        along += [low[0], high[0][::-1], low[0][:1], np.array([np.nan])]
        across += [low[1], high[1][::-1], low[1][:1], np.array([np.nan])]
    x, y = (np.concatenate(v)[:-1] if v else np.zeros(0) for v in (along, across))
    if band.independent == "y":
        x, y = y, x
    group = band.curve or band.label
    return {
        "type": "scatter", "mode": "lines", "name": band.label or " ", "x": packed(x), "y": packed(y),
        "line": {"width": 0, "color": f"@{band.colour}"}, "fill": "toself", "fillcolor": f"@{band.colour}",
        "hoverinfo": "skip", "showlegend": bool(band.label),
    } | ({"legendgroup": group} if group else {})  # fmt: skip


def _pieces(valid: BoolArray) -> list[NDArray[np.intp]]:
    """Indices of the runs of valid samples; all of them as one run if gaps are too many."""
    pieces = [np.arange(a, b) for a, b in runs(valid) if b - a > 1]
    return [np.flatnonzero(valid)] if len(pieces) > _PIECES else pieces


def _shares(heights: Sequence[float]) -> list[list[float]]:
    """Domain of each row, the first at the top."""
    room = 1.0 - _GAP * (len(heights) - 1)
    domains, top = [], 1.0
    for height in heights:
        size = room * height / sum(heights)
        domains.append([max(top - size, 0.0), top])
        top -= size + _GAP
    return domains


def _column(widths: Sequence[float], column: int) -> list[float]:
    gap = 0.08
    room = 1.0 - gap * (len(widths) - 1)
    start = room * sum(widths[:column]) / sum(widths) + gap * column
    return [start, min(start + room * widths[column] / sum(widths), 1.0)]


def _axis(axis: Axis) -> dict[str, Any]:
    result = axis_layout(axis.text.replace("\n", " ")) | {"showgrid": axis.grid}
    if axis.scale == "log":
        result["type"] = "log"
        if axis.ticks is None:  # plotly's own labels of powers are larger than those of other axes
            result |= _log_ticks(axis.range)
    if axis.range is not None:
        result["range"] = [math.log10(v) for v in axis.range] if axis.scale == "log" else list(axis.range)
    if axis.ticks is not None:
        result |= {"tickvals": [p for p, _ in axis.ticks], "ticktext": [label for _, label in axis.ticks]}
    return result


def _log_ticks(limits: tuple[float, float] | None) -> dict[str, Any]:
    """Ticks of a logarithmic axis, with labels of one size."""
    low, high = (-30.0, 30.0) if limits is None else (math.log10(v) for v in limits)
    mantissas = (1, 2, 5) if high - low < FEW_DECADES else (1,)
    step = 2 if limits is not None and high - low > _MANY_DECADES else 1
    powers = range(step * math.floor(low / step), math.ceil(high) + 1, step)
    ticks = [(m, power) for power in powers for m in mantissas]
    return {"tickvals": [m * 10.0**p for m, p in ticks], "ticktext": [_power_text(m, p) for m, p in ticks]}


def _power_text(mantissa: int, power: int) -> str:
    if _POSITIONAL[0] <= power <= _POSITIONAL[1]:
        return f"{mantissa * 10.0**power:g}"
    return readable(f"10^{power}" if mantissa == 1 else f"{mantissa}·10^{power}")


def _placed(item: dict[str, Any], x_name: str, y_name: str) -> dict[str, Any]:
    """A shape or annotation with its references ``"x domain"`` and so on at the axes of its panel."""
    return item | {
        "xref": item["xref"].replace("x", x_name, 1),
        "yref": item["yref"].replace("y", y_name, 1),
    }


def _unique_legend(traces: list[Trace]) -> list[Trace]:
    """Traces of which only the first of each name is in the legend."""
    names: set[str] = set()
    for trace in traces:
        if trace.get("showlegend"):
            trace["showlegend"] = trace["name"] not in names
            names.add(trace["name"])
    return traces


def _elements(panel: Panel, bins: int) -> tuple[list[Trace], list[dict[str, Any]], list[dict[str, Any]]]:
    """Traces, shapes and annotations of a panel, in its own axes."""
    traces: list[Trace] = []
    shapes: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for element in panel.elements:
        if isinstance(element, Curve):
            traces.append(curve_trace(element, bins))
        elif isinstance(element, Band):
            traces.append(band_trace(element, bins))
        elif isinstance(element, Region):
            traces.append(_region(element))
        elif isinstance(element, Bars):
            traces.append(_bars(element))
        elif isinstance(element, Line):
            shapes.append(_line(element, panel))
        elif isinstance(element, Span):
            shapes.append(_span(element))
        elif isinstance(element, Text):
            annotations.append(_text(element, panel))
        elif isinstance(element, HeatMap):
            for cell in element.cells:
                outline = {"color": "@vermillion", "width": 3} if cell.outlined else {"width": 0}
                box = {"x0": cell.column - 0.47, "x1": cell.column + 0.47, "y0": cell.row - 0.45, "y1": cell.row + 0.45}
                shapes.append(
                    {"type": "rect", "xref": "x", "yref": "y", "fillcolor": cell.background, "line": outline} | box
                )
                text = Text(cell.text, cell.column, cell.row)
                annotations.append(_text(text, panel) | {"font": {"size": 11, "color": cell.ink}})
    return traces, shapes, annotations


def _region(region: Region) -> Trace:
    return {
        "type": "scatter", "mode": "lines", "name": region.label or " ", "x": packed(region.x), "y": packed(region.y),
        "line": {"color": f"@{region.colour}", "width": 1.6}, "showlegend": bool(region.label), "hoverinfo": "skip",
    } | ({"fill": "toself", "fillcolor": f"@{region.colour}-band"} if region.filled else {})  # fmt: skip


def _bars(bars: Bars) -> Trace:
    lengths, starts = [b - a for a, b in zip(bars.starts, bars.ends, strict=True)], list(bars.starts)
    along, across = ("x", "y") if bars.horizontal else ("y", "x")
    return {
        "type": "bar", along: lengths, across: list(bars.positions), "base": starts, "width": bars.thickness,
        "orientation": "h" if bars.horizontal else "v", "name": bars.label or " ", "showlegend": bool(bars.label),
        "marker": {"color": [f"@{colour}" for colour in bars.colours]}, "text": list(bars.notes),
        "textposition": "outside", "cliponaxis": False, "textfont": {"color": "@ink"},
        "hovertemplate": "%{text}<extra></extra>",
    }  # fmt: skip


def _line(line: Line, panel: Panel) -> dict[str, Any]:
    along = {"xref": "x", "yref": "y domain", "x0": line.position, "x1": line.position, "y0": 0, "y1": 1}
    if line.axis == "y":
        along = {"xref": "x domain", "yref": "y", "x0": 0, "x1": 1, "y0": line.position, "y1": line.position}
    style = {"color": f"@{line.colour}", "width": max(line.width, 1.0), "dash": line.dash or "solid"}
    return {"type": "line", "layer": "below", "line": style} | along


def _span(span: Span) -> dict[str, Any]:
    if span.axis == "x":
        box = {"xref": "x", "yref": "y domain", "x0": span.low, "x1": span.high, "y0": 0, "y1": 1}
    else:
        box = {"xref": "x domain", "yref": "y", "x0": 0, "x1": 1, "y0": span.low, "y1": span.high}
    return {"type": "rect", "layer": "below", "line": {"width": 0}, "fillcolor": f"@{span.colour}"} | box


def _text(text: Text, panel: Panel) -> dict[str, Any]:
    x = math.log10(text.x) if text.frame[0] == "data" and panel.x.scale == "log" else text.x
    y = math.log10(text.y) if text.frame[1] == "data" and panel.y.scale == "log" else text.y
    return {
        "x": x, "y": y, "xref": "x" if text.frame[0] == "data" else "x domain",
        "yref": "y" if text.frame[1] == "data" else "y domain", "text": text.text.replace("\n", "<br>"),
        "showarrow": False, "xshift": text.offset[0], "yshift": text.offset[1], "xanchor": text.horizontal,
        "yanchor": {"center": "middle"}.get(text.vertical, text.vertical),
        "font": {"size": 11, "color": f"@{text.colour}"},
    }  # fmt: skip
