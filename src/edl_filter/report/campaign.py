"""Figures of a campaign: dispersion ellipses of the landing, coverage, percentiles of events, reliability.

In: the Dataset of `edl_filter.results.campaign_store.open_store` and its statistics. Out: descriptions of figures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from edl_filter.estimation.series import finite_rows
from edl_filter.report.description import Axis, Curve, Element, Figure, Legend, Line, Panel, Region, ellipse_outline
from edl_filter.results.campaign_statistics import ELLIPSE_95, NORMAL_SHARES, PERCENTILES, SIGMAS, landing_offsets
from edl_filter.types import Array

if TYPE_CHECKING:
    from xarray import Dataset

COLOURS = ("blue", "orange", "green", "vermillion", "purple", "sky")
#: Most points of a scatter plot.
MOST_POINTS = 2000
_LANDING_COLOURS = {"estimate": "blue", "without landing constraint": "orange", "truth": "green"}


def campaign_figures(data: Dataset, content: dict[str, Any], title: str) -> dict[str, Figure]:
    """All figures for which the campaign has data: file name → description.

    Parameters
    ----------
    data : Dataset
        Of the campaign.
    content : dict
        Its statistics.
    title : str
        Title of the campaign.
    """
    groups = [group for group in content["groups"] if group.get("events")]
    figures: dict[str, Figure] = {}
    panels = [panel for group in groups if (panel := _landing_panel(data, group)) is not None]
    if panels:
        figures["landing_ellipses"] = _column(f"{title}: landing, ellipses of 95 %", panels, [20] * len(panels))
    covered = [group for group in groups if group.get("coverage")]
    if covered:
        counts = [len([row for row in group["coverage"] if row["part"] != "all"]) for group in covered]
        figures["coverage"] = _column(
            f"{title}: coverage of the stated sigmas", [_coverage(g) for g in covered], counts, 2.4
        )
    varying = [group for group in groups if varying_events(group)]
    if varying:
        counts = [len(varying_events(group)) for group in varying]
        figures["event_percentiles"] = _column(
            f"{title}: percentiles of events", [_percentiles(g) for g in varying], counts, 4.7
        )
    reliable = [group for group in groups if group.get("reliability")]
    if reliable:
        figures["reliability"] = _column(f"{title}: reliability of named effects", [_reliability(reliable)], [18])
    return figures


def group_name(group: dict[str, Any]) -> str:
    """Flight and dispersion of a group."""
    return f"{group['flight']}, {group['dispersion']}"


def _column(title: str, panels: list[Panel], rows: list[int], left: float = 1.0) -> Figure:
    """Panels below each other, their heights for numbers of rows of text, with a left margin in inches."""
    heights = tuple(0.2 * count + 0.4 for count in rows)
    return Figure(
        title,
        tuple((panel,) for panel in panels),
        heights,
        width=left + 7.4,
        margins=(left, 2.4, 0.7),
        gaps=(0.2, float(0.75 / np.mean(heights))),
    )


def _landing_panel(data: Dataset, group: dict[str, Any]) -> Panel | None:
    """Landing positions of a group with their ellipses, km."""
    inside = (data["flight"].values == group["flight"]) & (data["dispersion"].values == group["dispersion"])
    selected = np.flatnonzero(inside & (data["outcome"].values == 0))
    offsets = landing_offsets(data, selected)
    if not offsets:
        return None
    elements: list[Element] = []
    for name, points in offsets.items():
        colour = _LANDING_COLOURS[name]
        shown = 1e-3 * points[:: max(1, len(points) // MOST_POINTS)]
        elements.append(
            Curve(
                shown[:, 0], shown[:, 1], name, colour, "km", 0.0, symbol="circle", size=2.5, opacity=0.5,
                independent="none",
            )
        )  # fmt: skip
        outline = _outline(points)
        if outline is not None:
            elements.append(Region(outline[0], outline[1], "", colour, filled=False))
    return Panel(
        Axis("east of the mean landing", "km"), Axis("north", "km"), tuple(elements), aspect="equal",
        legend=Legend("outside", 1, group_name(group)), name="landing",
    )  # fmt: skip


def _outline(points: Array) -> Array | None:
    """Ellipse ``(2, K)`` of 95 %, km."""
    valid = points[finite_rows(points)]
    if len(valid) < 3:
        return None
    return ellipse_outline(1e-3 * valid.mean(axis=0), 1e-6 * np.cov(valid.T), ELLIPSE_95)


def _coverage(group: dict[str, Any]) -> Panel:
    """Shares of the errors within 1, 2 and 3 sigma by phase and part, with those of a normal distribution."""
    rows = [row for row in group["coverage"] if row["part"] != "all"]
    names = [f"{row['phase']}, {row['part']}" for row in rows]
    elements: list[Element] = [Line(share, "x", colour="muted", dash="dash") for share in NORMAL_SHARES]
    for k, sigma in enumerate(SIGMAS):
        shares = np.array([row["within_sigmas"][k] for row in rows])
        elements.append(_dots(shares, names, f"within {sigma:.0f} sigma", k))
    return _named_rows(names, Axis("share of the errors", range=(0.0, 1.03)), elements, group)


def _percentiles(group: dict[str, Any]) -> Panel:
    """Percentiles of each quantity at each event, in standard deviations from the median."""
    rows = varying_events(group)
    scaled = np.array(
        [
            [(row["percentiles"][str(p)] - row["percentiles"]["50.0"]) / row["standard_deviation"] for p in PERCENTILES]
            for row in rows
        ]
    )
    names = [
        f"{row['event'].replace('_', ' ')}, {row['quantity'].replace('_', ' ')}: "
        f"{row['percentiles']['50.0']:.6g} ± {row['standard_deviation']:.3g} {row['unit']}"
        for row in rows
    ]
    elements: list[Element] = [
        _dots(scaled[:, k], names, f"{percentile:.0f} %", k) for k, percentile in enumerate(PERCENTILES)
    ]
    return _named_rows(names, Axis("percentile minus median", "standard deviations"), elements, group)


def varying_events(group: dict[str, Any]) -> list[dict[str, Any]]:
    """Quantities of events that differ between the cases of a group."""
    return [
        row
        for row in group["events"]
        if row["quantity"] in _SHOWN and row["standard_deviation"] > 1e-9 * abs(row["mean"])
    ]


def _dots(values: Array, names: list[str], label: str, colour: int) -> Curve:
    """One value for each of the named rows."""
    return Curve(
        values, np.arange(len(names), dtype=float), label, COLOURS[colour], "1", 0.0, symbol="circle", size=4.5,
        independent="none", names=tuple(names),
    )  # fmt: skip


def _named_rows(names: list[str], x: Axis, elements: list[Element], group: dict[str, Any]) -> Panel:
    """A panel with one row for each name, the first at the top."""
    ticks = tuple((float(k), name) for k, name in enumerate(names))
    y = Axis("", range=(len(names) - 0.5, -0.5), ticks=ticks)
    return Panel(x, y, tuple(elements), legend=Legend("outside", 1, group_name(group)))


_SHOWN = ("time", "altitude", "velocity", "dynamic_pressure")


def _reliability(groups: list[dict[str, Any]]) -> Panel:
    """Share of right names against the stated probability."""
    elements: list[Element] = [
        Curve(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "as stated", "muted", "1", 0.8, dash="dash")
    ]
    for k, group in enumerate(groups):
        rows = group["reliability"]
        stated = np.array([row["mean_probability"] for row in rows])
        share = np.array([row["share_right"] for row in rows])
        count = np.array([row["count"] for row in rows])
        sigma = np.sqrt((share * count + 1.0) * ((1.0 - share) * count + 1.0) / ((count + 2.0) ** 2 * (count + 3.0)))
        elements.append(
            Curve(
                stated, share, group_name(group), COLOURS[k % len(COLOURS)], "1", 0.0, symbol="circle", size=5.0,
                sigma=sigma, notes=tuple(str(n) for n in count),
            )
        )  # fmt: skip
    return Panel(
        Axis("stated probability", range=(0.0, 1.02)), Axis("share of right names", range=(0.0, 1.05)),
        tuple(elements), legend=Legend("best", 1), name="reliability",
    )  # fmt: skip
