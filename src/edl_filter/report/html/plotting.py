"""Figures as plotly takes them: plain dicts, thinned without losing a peak, numbers packed as four-byte floats."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.report.decimate import envelope
from edl_filter.types import Array, BoolArray

Trace = dict[str, Any]

#: Bins of a curve: twice as many samples stay.
BINS = 400
#: Names of events on figures, the most telling first: where labels would meet, the first stays.
LABELS = {
    "parachute_deploy": "parachute",
    "landing": "landing",
    "peak_deceleration": "peak",
    "entry_interface": "entry",
    "heat_shield_separation": "heat shield",
    "backshell_separation": "backshell",
    "retro_rocket_fire": "rockets",
    "bridle_cut": "bridle cut",
}
#: Least distance of two events' labels, share of the axis.
_APART = 0.06
#: Pixels below the axes for the time label and a legend, and above them for events' names.
_BELOW, ABOVE = 46, 74
#: Pieces into which gaps may cut a band; beyond them it is drawn across its gaps.
_PIECES = 80


def packed(values: ArrayLike) -> dict[str, str]:
    """Numbers in four bytes each, base64; plotly reads them as they are. What is not finite is a gap."""
    array = np.asarray(values, dtype="<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(array.tobytes()).decode("ascii")}


def line(
    x: Array, y: Array, name: str, colour: str, unit: str = "", *, axis: str = "", bins: int = BINS, **more: Any
) -> Trace:
    """A curve over time, or over whatever `x` is."""
    thin = envelope(x, y, bins)
    return curve(*thin, name, colour, unit, axis=axis, **more)


def curve(x: ArrayLike, y: ArrayLike, name: str, colour: str, unit: str = "", *, axis: str = "", **more: Any) -> Trace:
    """A curve through points that stay as they are."""
    style = {"color": colour, "width": 1.4} | more.pop("line", {})
    ends = f" {unit}" if unit else ""
    shown = {"hovertemplate": f"%{{x:.6~g}}: %{{y:.5~g}}{ends}<extra>%{{fullData.name}}</extra>"} | more
    return (
        {"type": "scatter", "mode": "lines", "name": name, "x": packed(x), "y": packed(y), "line": style}
        | shown
        | ({"yaxis": f"y{axis}", "xaxis": "x"} if axis else {})
    )


def band(
    x: Array, low: Array, high: Array, name: str, colour: str, *, axis: str = "", bins: int = BINS, turned: bool = False
) -> Trace:
    """The area between two curves, thinned each by itself; `turned`: `x` is drawn upwards."""
    xs: list[Array] = []
    ys: list[Array] = []
    pieces = _pieces(np.isfinite(low) & np.isfinite(high) & np.isfinite(x))
    share = max(bins // max(len(pieces), 1), 20)
    for piece in pieces:
        under, over = (envelope(x[piece], v[piece], share) for v in (low, high))
        xs += [under[0], over[0][::-1], under[0][:1], np.array([np.nan])]
        ys += [under[1], over[1][::-1], under[1][:1], np.array([np.nan])]
    flat = [np.concatenate(v)[:-1] if v else np.zeros(0) for v in (xs, ys)]
    if turned:
        flat.reverse()
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": packed(flat[0]), "y": packed(flat[1]),
        "line": {"width": 0, "color": colour}, "fill": "toself", "fillcolor": colour, "hoverinfo": "skip",
    } | ({"yaxis": f"y{axis}", "xaxis": "x"} if axis else {})  # fmt: skip


def _pieces(good: BoolArray) -> list[NDArray[np.intp]]:
    """Indices of the runs of samples that can be drawn; all of them as one where gaps are too many."""
    index = np.flatnonzero(good)
    if not len(index):
        return []
    runs = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
    runs = [run for run in runs if len(run) > 1]
    return [index] if len(runs) > _PIECES else runs


def axis(title: str, **more: Any) -> dict[str, Any]:
    """An axis in the report's style."""
    return {
        "title": {"text": title, "standoff": 6, "font": {"size": 12}}, "gridcolor": "@grid", "zerolinecolor": "@grid",
        "linecolor": "@muted", "automargin": True, "exponentformat": "power", "ticks": "outside", "ticklen": 4,
        "tickcolor": "@muted",
    } | more  # fmt: skip


def logarithmic(title: str, **more: Any) -> dict[str, Any]:
    """A logarithmic axis, a tick at every power of ten."""
    return axis(title, type="log", dtick=1, **more)


def layout(height: int, *, top: int = 12, legend: bool = True, **more: Any) -> dict[str, Any]:
    """Layout of a figure of one panel; the legend stands below the axes."""
    below = _BELOW + (34 if legend else 0)
    inner = max(height - top - below, 50)
    return {
        "height": height,
        "margin": {"l": 64, "r": 12, "t": top, "b": below},
        "showlegend": legend,
        "legend": {"orientation": "h", "x": 0.0, "xanchor": "left", "y": -_BELOW / inner, "yanchor": "top"},
        "hovermode": "closest",
        "font": {"size": 12, "color": "@ink"},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
    } | more


def stacked(
    panels: Sequence[tuple[Sequence[Trace], dict[str, Any]]],
    x: dict[str, Any],
    height: int,
    events: Mapping[str, float] | None = None,
    legend: bool = False,
) -> dict[str, Any]:
    """Panels one below the other over the same x, with the flight's events across all of them.

    Parameters
    ----------
    panels : sequence of (traces, y axis)
        The traces' ``axis`` must be "" in the first panel, then "2", "3", …
    x : dict
        The x axis; its ``range`` limits the events.
    height : int
        Pixels.
    events : mapping, optional
        Name → s.
    """
    count, gap = len(panels), 0.035
    tall = (1.0 - gap * (count - 1)) / count
    marks = dict(events or {})
    made = layout(height, top=ABOVE if marks else 12, legend=legend)
    for k, (_, y) in enumerate(panels):
        top = 1.0 - k * (tall + gap)
        made[f"yaxis{k + 1 if k else ''}"] = y | {"domain": [max(top - tall, 0.0), top], "automargin": False}
    made["xaxis"] = x | {"anchor": f"y{count if count > 1 else ''}"}
    made["shapes"], made["annotations"] = event_marks(marks, x.get("range"))
    return {"data": [trace for traces, _ in panels for trace in traces], "layout": made}


def event_marks(
    events: Mapping[str, float], span: Sequence[float] | None
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Lines at all events in the span, and names above those whose labels do not meet."""
    inside = {n: t for n, t in events.items() if span is None or span[0] <= t <= span[1]}
    shapes: list[dict[str, Any]] = [
        {"type": "line", "x0": t, "x1": t, "xref": "x", "y0": 0, "y1": 1, "yref": "paper", "layer": "below",
         "line": {"color": "@muted", "width": 1, "dash": "dot"}}
        for t in inside.values()
    ]  # fmt: skip
    if not inside:
        return shapes, []
    low, high = span if span is not None else (min(inside.values()), max(inside.values()))
    order = sorted(inside, key=lambda name: list(LABELS).index(name) if name in LABELS else len(LABELS))
    placed: list[float] = []
    notes = []
    for name in order:
        if all(abs(inside[name] - t) > _APART * (high - low) for t in placed):
            placed.append(inside[name])
            notes.append(
                {"x": inside[name], "xref": "x", "y": 1, "yref": "paper", "yanchor": "bottom", "showarrow": False,
                 "text": LABELS.get(name, name.replace("_", " ")), "textangle": -90,
                 "font": {"size": 11, "color": "@muted"}}
            )  # fmt: skip
    return shapes, notes


def extent(*values: Array, outside: float = 0.004, margin: float = 0.08) -> list[float] | None:
    """Range of nearly all finite values, with a margin; None where there are none."""
    ends = [np.quantile(v[np.isfinite(v)], (outside, 1.0 - outside)) for v in values if np.isfinite(v).any()]
    if not ends:
        return None
    low, high = float(min(e[0] for e in ends)), float(max(e[1] for e in ends))
    room = margin * (high - low) or 0.1 * abs(high) or 1.0
    return [low - room, high + room]
