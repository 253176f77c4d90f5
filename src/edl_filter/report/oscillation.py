"""Figure of the oscillation: how large it is, what its damping makes of it, and how stiff the vehicle is."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from xarray import DataTree

from edl_filter.report import style
from edl_filter.report.postflight import Panel, bounds, layer, strips

_GROUP = "oscillation"


@style.styled
def oscillation(tree: DataTree) -> Figure:
    """Lateral rates, growth by damping and static stability, window by window."""
    shared = layer(tree)
    return strips(shared, "oscillation", (_rate, _growth, _stiffness), (1.7, 2.5, 1.7))


def _rate(panel: Panel) -> None:
    panel.ax.plot(
        panel.layer.get(_GROUP, "time"),
        np.degrees(panel.layer.get(_GROUP, "rate")),
        "o-",
        color=style.BLUE,
        markersize=3.5,
    )
    panel.ax.set_ylim(-0.12 * panel.ax.get_ylim()[1], None)  # the shades are named at the foot
    panel.ax.set_ylabel("lateral rates,\nRMS (°/s)")


def _growth(panel: Panel) -> None:
    _windows(panel, "growth", style.VERMILLION)
    panel.ax.axhline(0.0, color=style.GREY, linewidth=0.8)
    panel.ax.set_ylabel("growth by moments in\nphase with rates (1/s)")
    says = "above zero the oscillation is fed; bars: 1 sigma of the fit"
    panel.ax.text(0.99, 0.03, says, transform=panel.ax.transAxes, ha="right", fontsize=9.0)


def _stiffness(panel: Panel) -> None:
    _windows(panel, "stiffness", style.GREEN)
    panel.ax.set_ylabel("slope Cm over\nangle (1/rad)")


def _windows(panel: Panel, name: str, colour: str) -> None:
    time, value, sigma = (panel.layer.get(_GROUP, n) for n in ("time", name, f"{name}_sigma"))
    known = np.isfinite(value)
    # windows that say little do not set the range
    telling = (sigma < 3.0 * np.nanmedian(sigma)) | (np.abs(value) > 3.0 * sigma)
    panel.ax.errorbar(
        time[known], value[known], sigma[known], fmt="o", color=colour, markersize=3.5, elinewidth=1.0, capsize=2.0
    )
    panel.ax.set_ylim(*bounds([(value - sigma)[telling], (value + sigma)[telling]], outside=0.0))
