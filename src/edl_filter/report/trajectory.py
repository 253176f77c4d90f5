"""Panels of height and speed (thesis figure 3.12) and of how well they are known."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from xarray import DataTree

from edl_filter.report import style, view
from edl_filter.report.decimate import envelope


@style.styled
def altitude(tree: DataTree, ax: Axes | None = None) -> Axes:
    """Areodetic altitude, with the height above the landing place on the right."""
    ax, finish = style.alone(tree, ax, "altitude")
    low, high = view.span(tree)
    values = view.trajectory(tree, "altitude")
    if values is not None:
        ax.plot(*envelope(view.time(tree), values / 1e3), color=style.BLUE)
        landing = view.event(tree, "landing")
        if landing is not None:
            site = float(np.interp(landing, view.time(tree), values)) / 1e3
            ax.axhline(site, color=style.GREY, linewidth=0.8, linestyle=":")
            above = ax.secondary_yaxis("right", functions=_shift(site))
            above.set_ylabel("above landing\nplace (km)")
            above.spines["right"].set_visible(True)
    ax.set_xlim(low, high)
    ax.set_ylabel("areodetic\naltitude (km)")
    style.mark_events(tree, ax)
    finish()
    return ax


def _shift(height: float) -> Any:
    """Two functions: altitudes to heights above `height`, and back."""
    return lambda h: np.asarray(h) - height, lambda h: np.asarray(h) + height


@style.styled
def speed(tree: DataTree, ax: Axes | None = None) -> Axes:
    """Air-relative speed."""
    ax, finish = style.alone(tree, ax, "air-relative velocity")
    values = view.trajectory(tree, "speed")
    if values is not None:
        ax.plot(*envelope(view.time(tree), values / 1e3), color=style.VERMILLION)
    ax.set_xlim(*view.span(tree))
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("air-relative\nvelocity (km/s)")
    style.mark_events(tree, ax)
    finish()
    return ax


@style.styled
def uncertainty(tree: DataTree, ax: Axes | None = None) -> Axes:
    """Three sigma of altitude and air-relative speed on one logarithmic axis."""
    ax, finish = style.alone(tree, ax, "3 sigma of altitude and velocity")
    low, high = view.span(tree)
    time = view.time(tree)
    inside = (time >= low) & (time <= high)
    for name, label, colour, dash in (
        ("altitude_sigma", "altitude (m)", style.BLUE, "-"),
        ("speed_sigma", "velocity (m/s)", style.VERMILLION, "--"),
    ):
        values = view.trajectory(tree, name)
        if values is not None:
            ax.semilogy(*envelope(time[inside], 3.0 * values[inside]), dash, color=colour, label=label)
    ax.set_xlim(low, high)
    ax.set_ylabel("3 sigma\n(m; m/s)")
    if ax.lines:
        bottom, top = ax.get_ylim()
        ax.set_ylim(10.0 ** np.floor(np.log10(bottom)), 10.0 ** (np.ceil(np.log10(top)) + 0.7))
        ax.yaxis.set_major_formatter(style.plain_powers)
        ax.minorticks_off()
        ax.legend(loc="upper left", ncols=2)
    style.mark_events(tree, ax)
    finish()
    return ax
