"""Figures of the post-flight atmosphere (thesis figures 4.1 and 4.2, chapter 4)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from xarray import DataTree

from edl_filter.report import style
from edl_filter.report.decimate import envelope
from edl_filter.report.postflight import LEGEND, Layer, Panel, bounds, layer, strips
from edl_filter.report.profile import EDGE, known
from edl_filter.types import Array, BoolArray

FLIGHT, PREFLIGHT = "atmosphere/flight", "atmosphere/preflight"
_KILO = 1e-3


@style.styled
def mach_and_knudsen(tree: DataTree) -> Figure:
    """Mach and Knudsen numbers with the flight's atmosphere and the one expected."""
    shared = layer(tree)
    return strips(
        shared, "Mach and Knudsen numbers", (_mach, _knudsen, _differences), (2.4, 2.4, 2.0), low=shared.start
    )


def _mach(panel: Panel) -> None:
    _both(panel, "mach")
    flown, expected = _pair(panel, "mach")
    panel.ax.set_ylim(0.0, 1.25 * max(np.nanmax(expected[panel.inside]), np.nanmax(flown[panel.layer.counts])))
    panel.ax.set_ylabel("Mach number (–)")
    _continuum(panel)
    panel.ax.legend(loc="upper right")


def _knudsen(panel: Panel) -> None:
    _both(panel, "knudsen")
    panel.ax.set_yscale("log")
    panel.ax.yaxis.set_major_locator(LogLocator(numticks=6))
    panel.ax.yaxis.set_minor_locator(NullLocator())
    panel.ax.set_ylabel("Knudsen number (–)")
    _continuum(panel)
    if panel.layer.continuum:
        panel.ax.axhline(panel.layer.continuum[1], color=style.GREEN, linewidth=1.2, linestyle=":")


def _differences(panel: Panel) -> None:
    shown = []
    for name, label, colour in (("mach", "Mach", style.BLUE), ("knudsen", "Knudsen", style.ORANGE)):
        shown.append(panel.layer.get("atmosphere_differences", name))
        panel.line(shown[-1], colour, label, 1.2)
    # the Mach number's first seconds, when the pressure is still that of the start, would make all else small
    mach, knudsen = shown
    panel.limits(np.where(panel.layer.counts, mach, np.nan), knudsen, everything=True, room=LEGEND)
    panel.ax.set_ylabel("flight less\npreflight (%)")
    panel.legend()


def _continuum(panel: Panel) -> None:
    """From where on the database is entered with the Mach number."""
    if panel.layer.continuum:
        time, limit = panel.layer.continuum
        panel.ax.axvline(time, color=style.GREEN, linewidth=1.4, linestyle=":", label=f"continuum (Kn < {limit:g})")


def _pair(panel: Panel, name: str) -> tuple[Array, Array]:
    return panel.layer.get(FLIGHT, name), panel.layer.get(PREFLIGHT, name)


def _both(panel: Panel, name: str) -> None:
    flown, expected = _pair(panel, name)
    panel.line(flown, style.BLUE, "flight", 1.4)
    panel.line(expected, style.VERMILLION, "preflight", 1.4, linestyle=(0, (5, 2)))


@style.styled
def atmosphere_profile(tree: DataTree) -> Figure:
    """Density, pressure and temperature against altitude with one-sigma bands, and their ratios to those expected."""
    shared = layer(tree)
    made = style.figure(8.4)
    style.margins(made, top=0.6)
    made.subplots_adjust(hspace=0.3, wspace=0.12)
    axes = made.subplots(2, 2, sharey=True)
    inside = (shared.time >= shared.start) & (shared.time <= shared.end - EDGE)
    height = _KILO * shared.get(FLIGHT, "altitude")[inside]
    for ax, name, unit in zip(axes.flat, ("density", "pressure", "temperature"), ("kg/m³", "Pa", "K"), strict=False):
        _profile(shared, ax, name, inside, height)
        ax.set_xlabel(f"{name} ({unit})")
    _ratios(shared, axes[1, 1], inside, height)
    for row in axes:
        row[0].set_ylabel("altitude (km)")
    low, high = float(np.nanmin(height)), float(np.nanmax(height))
    axes[0, 0].set_ylim(max(0.0, low - 3.0), high + 1.0)
    for ax in axes.flat:
        _mark_mach(shared, ax, named=ax in axes[:, 0])
    style.title(tree, axes[0, 0], "atmosphere along the flight")
    return made


def _profile(shared: Layer, ax: Axes, name: str, inside: BoolArray, height: Array) -> None:
    flown, expected = (shared.get(group, name)[inside] for group in (FLIGHT, PREFLIGHT))
    sigma = shared.get(FLIGHT, f"{name}_sigma")[inside]
    linear = name == "temperature"
    flown = known(flown, sigma) if linear else flown
    _band(ax, height, flown, sigma, 0.0 if linear else 1e-3 * float(np.nanmin(expected)), style.SKY, "±1 sigma")
    ax.plot(*envelope(height, flown)[::-1], color=style.BLUE, linewidth=1.3, label="flight")
    ax.plot(
        *envelope(height, expected)[::-1],
        color=style.VERMILLION,
        linewidth=1.3,
        linestyle=(0, (5, 2)),
        label="preflight",
    )
    if linear:
        low, high = bounds([flown[shared.counts[inside]], expected])
        ax.set_xlim(max(low, 0.0), high)
        ax.legend(loc="upper right")
    else:
        ax.set_xscale("log")
        both = np.concatenate((flown, expected))
        both = both[both > 0.0]
        # the hydrostatic pressure begins with nothing: its first metres are not worth decades
        least = max(float(both.min()), 0.02 * float(np.nanmin(expected)))
        ax.set_xlim(0.5 * least, 2.0 * float(both.max()))
        ax.xaxis.set_major_locator(LogLocator(numticks=6))
        ax.xaxis.set_minor_locator(NullLocator())
        ax.legend(loc="upper right")


def _ratios(shared: Layer, ax: Axes, inside: BoolArray, height: Array) -> None:
    shown = []
    for name, colour in (("density", style.BLUE), ("pressure", style.GREEN), ("temperature", style.ORANGE)):
        flown, expected = (shared.get(group, name)[inside] for group in (FLIGHT, PREFLIGHT))
        sigma = shared.get(FLIGHT, f"{name}_sigma")[inside]
        ratio = known(flown, sigma) / expected
        _band(ax, height, ratio, sigma / expected, 0.0, colour, "", alpha=0.25)
        ax.plot(*envelope(height, ratio)[::-1], color=colour, linewidth=1.2, label=name)
        shown.append(ratio if name == "density" else ratio[shared.counts[inside]])
    ax.axvline(1.0, color=style.GREY, linewidth=0.8)
    low, high = bounds([*shown, np.array([0.9, 1.1])], 0.01)
    ax.set_xlim(max(low, 0.0), high)
    ax.set_xlabel("flight / preflight (–)")
    ax.legend(loc="best")


def _band(
    ax: Axes, height: Array, values: Array, sigma: Array, least: float, colour: str, label: str, alpha: float = 0.5
) -> None:
    low, high = envelope(height, np.maximum(values - sigma, least)), envelope(height, values + sigma)
    order = np.argsort(low[0], kind="stable"), np.argsort(high[0], kind="stable")
    ends = np.union1d(low[0], high[0])
    left = np.interp(ends, low[0][order[0]], low[1][order[0]])
    right = np.interp(ends, high[0][order[1]], high[1][order[1]])
    ax.fill_betweenx(ends, left, right, color=colour, alpha=alpha, linewidth=0.0, label=label or None)


def _mark_mach(shared: Layer, ax: Axes, named: bool) -> None:
    altitude = _KILO * shared.get(FLIGHT, "altitude")
    for number, time in shared.mach_times.items():
        height = float(np.interp(time, shared.time, altitude))
        ax.axhline(height, color=style.GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1.5)
        if named:
            ax.annotate(
                f"Mach {number}",
                (0.0, height),
                (3.0, 1.0),
                xycoords=("axes fraction", "data"),
                textcoords="offset points",
                fontsize=9.0,
                color="#333333",
            )
