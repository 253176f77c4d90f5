"""Figures of one channel's residual against time, and of the evidence for an effect against a place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from xarray import DataArray, Dataset

from edl_filter.errors import InputError
from edl_filter.report import style

#: Units as people read them.
_UNITS = {"m/s^2": "m/s²", "rad/s^2": "rad/s²"}
#: Part of the samples that may leave the panel on either side.
_OUTSIDE = 0.002


@style.styled
def residual(
    series: Dataset, channel: str, cells: Sequence[Mapping[str, Any]], title: str, ax: Axes | None = None
) -> Axes:
    """Residual of a channel with the band of two stated sigmas; regimes in which it fails are shaded.

    Parameters
    ----------
    series : Dataset
        Content of ``residuals.nc``.
    channel : str
    cells : sequence of dict
        ``map`` of ``diagnosis.json``.
    title : str
        Name of the flight.
    ax : Axes, optional

    Raises
    ------
    InputError
        There is no such channel.
    """
    known = [str(c) for c in series["channel"].values]
    name = channel.replace(" ", "_")
    if name not in known:
        raise InputError(f"residual: found {channel!r}; accepted: {', '.join(known)}.")
    ax = _own(ax, f"{title}: residual of {name.replace('_', ' ')}")
    one = series.sel(channel=name)
    time, values, sigma = (np.asarray(one[v].values, float) for v in ("time", "residual", "sigma"))
    there = np.isfinite(values)
    time, values, sigma = time[there], values[there], sigma[there]
    failing = [c for c in cells if c["channel"] == name and c["fails"] and c["regime"] != "constraints"]
    for k, cell in enumerate(failing):
        ax.axvspan(
            cell["t0_s"], cell["t1_s"], color="#F3E3DA", linewidth=0.0, zorder=0.5, label=None if k else "regime fails"
        )
    ax.fill_between(
        time, -2.0 * sigma, 2.0 * sigma, color=style.SKY, alpha=0.45, linewidth=0.0, label="±2 sigma stated"
    )
    ax.plot(time, values, color=style.BLUE, linewidth=0.9, label="measured less predicted")
    ax.axhline(0.0, color=style.GREY, linewidth=0.8)
    if len(values):
        low, high = np.quantile(values, (_OUTSIDE, 1.0 - _OUTSIDE))
        band = 2.0 * float(np.median(sigma))
        low, high = min(low, -band), max(high, band)
        ax.set_ylim(low - 0.1 * (high - low), high + 0.35 * (high - low))
        ax.set_xlim(time[0], time[-1])
    unit = str(one["unit"].values)
    ax.set_xlabel("time since the epoch (s)")
    ax.set_ylabel(f"{_quantity(name)} ({_UNITS.get(unit, unit)})")
    ax.legend(loc="upper left", ncols=3)
    return ax


@style.styled
def scan(gains: DataArray, title: str, ax: Axes | None = None) -> Axes:
    """Evidence for an effect against a place, the best one marked."""
    name = str(gains.dims[0])
    place, values = np.asarray(gains[name].values, float), np.asarray(gains.values, float)
    ax = _own(ax, f"{title}: evidence for {gains.name}")
    ax.plot(place, values, color=style.BLUE, marker="o", markersize=3.5)
    best = int(np.argmax(values))
    unit = str(gains[name].attrs.get("units", ""))
    ax.axvline(place[best], color=style.VERMILLION, linestyle=(0, (4, 3)), label=f"most at {place[best]:.4g} {unit}")
    ax.axhline(0.0, color=style.GREY, linewidth=0.8)
    ax.set_xlabel(f"{name}: {gains[name].attrs.get('long_name', '')} ({unit})")
    ax.set_ylabel("gain over the model as it is (nats)")
    ax.legend(loc="best")
    return ax


def _quantity(channel: str) -> str:
    """What a channel compares, for an axis."""
    *instrument, what, axis = channel.split("_")
    if what == "moment":
        return f"angular acceleration\nby moment {axis}"
    quantity = f"{'specific force' if what == 'force' else 'angular rate'} {axis}"
    return "\n".join((*instrument, quantity))


def _own(ax: Axes | None, title: str) -> Axes:
    """The axes given, or new ones with a title."""
    if ax is not None:
        return ax
    made = style.figure(4.2)
    style.margins(made, top=0.5, left=1.2)
    own = made.add_subplot()
    own.set_title(title, loc="left", fontweight="bold")
    return own
