"""Coefficients that flew against the aerodynamic database, within its three sigmas."""

from __future__ import annotations

import numpy as np

from edl_filter.report.html.blocks import Block, Details, Grid, Mark, Note, Plot, Section, Table
from edl_filter.report.html.plotting import ABOVE, axis, band, event_marks, extent, layout, line
from edl_filter.report.html.source import Source
from edl_filter.types import Array, BoolArray

_KEY, _TITLE = "coefficients", "Coefficients against the database"
_ROOT = "postflight/coefficients"
#: Groups of the flight's and the database's coefficients with the flight's density. What the instruments would
#: see of the database, with their smoothing, is the fair partner.
_PAIR = ("flight", "database_measured", "database")
#: The flight's density comes from CA itself; only the preflight one tells of CA.
_PAIR_CA = ("preflight_density", "database_preflight", "database_preflight")
_MEANING = {
    "CN": "normal force", "CY": "side force", "Cm": "pitching moment", "Cn": "yawing moment", "Cl": "rolling moment",
    "CA": "axial force, preflight density",
}  # fmt: skip
_HEIGHT, _BINS = 390, 250


def coefficients(source: Source) -> Section:
    """A plot for each coefficient, and the verdicts by window."""
    plots = [p for name in _MEANING if (p := _plot(source, name)) is not None]
    if not plots:
        return Section(
            _KEY,
            _TITLE,
            [Note("The run has no coefficients; they need an aerodynamic database in the mission.", "muted")],
        )
    blocks: list[Block] = [
        Note(
            "Blue band: three sigmas of the database (MEVAD). Orange band: one sigma of the flight's value. Shaded "
            "times: the vehicle is statically unstable there. Moments are about the centre of mass.",
            "muted",
        ),
        Grid(plots),
    ]
    rows = _verdicts(source)
    if rows:
        heads = ("window", "coefficient", "density", "database less flight", "3 sigma", "share", "")
        inside = sum(isinstance(row[-1], Mark) and row[-1].tone == "good" for row in rows)
        title = f"Average differences by window: {inside} of {len(rows)} within the database's 3 sigma"
        blocks.append(Details(title, [Table("", heads, rows, texts=3, wide=(6,))]))
    return Section(_KEY, _TITLE, blocks)


def _plot(source: Source, name: str) -> Plot | None:
    of_flight, of_database, of_limit = _PAIR_CA if name == "CA" else _PAIR
    time = source.get(f"{_ROOT}/{of_flight}", "time")
    flown = source.get(f"{_ROOT}/{of_flight}", name)
    sigma = source.get(f"{_ROOT}/{of_flight}", f"{name}_sigma")
    expected = source.get(f"{_ROOT}/{of_database}", name)
    limit = source.get(f"{_ROOT}/{of_limit}", f"{name}_three_sigma")
    if time is None or flown is None or expected is None:
        return None
    inside = _domain(source, time)
    if not inside.any():
        return None
    time, flown, expected = time[inside], flown[inside], expected[inside]
    traces, shown = [], [flown, expected]
    if limit is not None:
        low, high = expected - limit[inside], expected + limit[inside]
        traces.append(band(time, low, high, "database, 3 sigma", "@blue-band", bins=_BINS))
        shown += [low, high]
    if sigma is not None:
        low, high = flown - sigma[inside], flown + sigma[inside]
        traces.append(band(time, low, high, "flight, 1 sigma", "@vermillion-band", bins=_BINS))
    traces.append(line(time, expected, "database", "@blue", bins=_BINS))
    traces.append(line(time, flown, "flight", "@vermillion", bins=_BINS, line={"width": 1.1}))
    span = [float(time[0]), float(time[-1])]
    made = layout(_HEIGHT, top=ABOVE)
    made |= {"xaxis": axis(source.time_label, range=span), "yaxis": axis(f"{name} (–)", range=extent(*shown))}
    marks, made["annotations"] = event_marks(source.events, span)
    made["shapes"] = marks + _unstable(source, span)
    return Plot(f"coefficient_{name}", f"{name}: {_MEANING[name]}.", {"data": traces, "layout": made}, _HEIGHT)


def _domain(source: Source, time: Array) -> BoolArray:
    """Times at which coefficients count: enough air, and no parachute yet."""
    ends = [source.attribute("postflight", f"domain_{name}") for name in ("useful", "end")]
    low, high = (
        otherwise if end is None or not np.isfinite(end) else float(end)
        for end, otherwise in zip(ends, (time[0], time[-1]), strict=True)
    )
    return (time >= low) & (time <= high)


def _unstable(source: Source, span: list[float]) -> list[dict[str, object]]:
    found = (source.summary.get("postflight") or {}).get("instabilities_s", {})
    return [
        {"type": "rect", "xref": "x", "yref": "paper", "x0": max(w[0], span[0]), "x1": min(w[1], span[1]), "y0": 0,
         "y1": 1, "line": {"width": 0}, "fillcolor": "@shade", "layer": "below"}
        for w in found.values() if w and w[1] > span[0] and w[0] < span[1]
    ]  # fmt: skip


def _verdicts(source: Source) -> list[list[str | Mark]]:
    group = "postflight/verdicts"
    window, name, density = (source.text(group, v) for v in ("window", "coefficient", "density"))
    numbers = [source.get(group, v) for v in ("mean", "mean_sigma", "three_sigma", "ratio", "within")]
    if not window or any(v is None for v in numbers):
        return []
    mean, sigma, limit, ratio, within = (v for v in numbers if v is not None)
    return [
        [window[k], name[k], density[k], f"{mean[k]:+.2g} ± {sigma[k]:.1g}", f"{limit[k]:.2g}",
         f"{100.0 * abs(ratio[k]):.0f} %", Mark("✓ within", "good") if within[k] else Mark("▲ outside", "doubt")]
        for k in range(len(window))
    ]  # fmt: skip
