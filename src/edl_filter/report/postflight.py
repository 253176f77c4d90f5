"""What the figures of the post-flight layer share: its groups in the tree, and panels over the validation domain."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from xarray import Dataset, DataTree

from edl_filter.report import style, view
from edl_filter.report.decimate import envelope
from edl_filter.types import Array, BoolArray

SHADE, BAND = "#EEEEEE", "#CFE6F5"
#: Shares of a panel's samples that may lie below and above its range, and the range's margin.
_OUTSIDE, _MARGIN = 0.004, 0.10
#: Room for a legend in one row, share of the range.
LEGEND = 0.28
#: Events before the parachute beside the Mach numbers; others would crowd the row of labels.
_EVENTS = ("parachute_deploy",)


@dataclass(frozen=True)
class Layer:
    """The post-flight groups of one run.

    Attributes
    ----------
    tree : DataTree
    time : (N,) array
        s, the same in all groups of samples.
    start, useful, end : float
        Validation domain, s: deceleration is felt; force coefficients count; parachute.
    unstable : list of (float, float)
        Instabilities, s.
    mach_times : dict
        Mach number → s.
    continuum : (float, float) or None
        From when on the flow is a continuum, s, and the Knudsen number that says so.
    """

    tree: DataTree
    time: Array
    start: float
    useful: float
    end: float
    unstable: list[tuple[float, float]]
    mach_times: dict[str, float]
    continuum: tuple[float, float] | None

    def get(self, group: str, name: str) -> Array:
        """Variable `name` of group ``/postflight/<group>``."""
        return np.asarray(self.tree[f"postflight/{group}"].dataset[name].values, float)

    def has(self, group: str, name: str) -> bool:
        """Whether `get` would find it."""
        return has(self.tree, f"{group}:{name}")

    @cached_property
    def counts(self) -> BoolArray:
        """Samples from `useful` to the parachute, or from `start` if nothing is useful."""
        return (self.time >= self.useful) & (self.time <= self.end)

    @cached_property
    def right(self) -> float:
        """Right end of all axes, s: the parachute, and room to see its line."""
        parachute = view.event(self.tree, "parachute_deploy")
        near = parachute is not None and abs(parachute - self.end) < 1.0
        return max(self.end, parachute) if near and parachute is not None else self.end

    @cached_property
    def marks(self) -> DataTree:
        """Title, epoch and marks of the flight, in the form of a run's tree: Mach numbers and the parachute."""
        shown = {n: t for n, t in view.events(self.tree) if n in _EVENTS}
        shown |= {f"Mach {m}": t for m, t in self.mach_times.items()}
        events = Dataset({"time_s": ("event", list(shown.values()))}, coords={"event": list(shown)})
        return DataTree.from_dict({"/": Dataset(attrs=self.tree.attrs), "/events": events})


def has(tree: DataTree, *needs: str) -> bool:
    """Whether ``/postflight`` has all of `needs`, ``group:variable`` each."""
    for need in needs:
        group, name = need.split(":")
        node = tree
        for part in ("postflight", *group.split("/")):  # `in` does not look below children
            if part not in node.children:
                return False
            node = node.children[part]
        if name not in node.dataset or not node.dataset.sizes.get("time"):
            return False
    return True


def layer(tree: DataTree) -> Layer:
    """Read what all figures need; where the domain is not stated it is all there is."""
    node = tree["postflight"]
    about = node.attrs
    series = (np.asarray(n.dataset["time"].values, float) for n in node.subtree if "time" in n.dataset)
    time = max(series, key=len)  # the samples', not the windows' of the oscillation
    start = _finite(about.get("domain_start"), float(time[0]))
    windows = json.loads(about.get("instabilities") or "{}")
    machs = json.loads(about.get("mach_times") or "{}")
    return Layer(
        tree=tree,
        time=time,
        start=start,
        useful=_finite(about.get("domain_useful"), start),
        end=_finite(about.get("domain_end"), float(time[-1])),
        unstable=[(float(w[0]), float(w[1])) for w in windows.values() if w],
        mach_times={m: float(t) for m, t in machs.items() if t is not None and np.isfinite(t)},
        continuum=(float(about["continuum_from"]), float(about["continuum_limit"]))
        if "continuum_from" in about
        else None,
    )


def _finite(value: float | None, otherwise: float) -> float:
    return otherwise if value is None or not np.isfinite(value) else float(value)


class Panel:
    """Axes over time that draw `Layer`'s variables, thinned, and range over what counts.

    Parameters
    ----------
    layer : Layer
    ax : Axes
    low : float
        Left end of the axis, s.
    """

    def __init__(self, layer: Layer, ax: Axes, low: float) -> None:
        self.layer, self.ax, self.low = layer, ax, low
        self.inside = (layer.time >= low) & (layer.time <= layer.end)
        self.time = layer.time[self.inside]

    def line(self, values: Array, colour: str, label: str = "", width: float = 1.0, **how: Any) -> None:
        """One variable over time."""
        shown = envelope(self.time, values[self.inside])
        self.ax.plot(*shown, color=colour, label=label or None, linewidth=width, **how)

    def band(self, low: Array, high: Array, colour: str, label: str = "", alpha: float = 1.0) -> None:
        """What lies between two variables."""
        least, most = envelope(self.time, low[self.inside]), envelope(self.time, high[self.inside])
        ends = np.union1d(least[0], most[0])
        between = (np.interp(ends, *least), np.interp(ends, *most))
        self.ax.fill_between(ends, *between, color=colour, linewidth=0.0, label=label or None, alpha=alpha)

    def limits(self, *values: Array, room: float = 0.0, everything: bool = False, outside: float = _OUTSIDE) -> None:
        """Range that holds nearly all of `values` where they count, or everywhere on the axis, and room on top."""
        where = self.inside if everything else self.layer.counts
        low, high = bounds([v[where] for v in values], outside)
        self.ax.set_ylim(low, high + room * (high - low))

    def legend(self, columns: int = 4) -> None:
        """In one row along the top."""
        legend_row(self.ax, columns)


def legend_row(ax: Axes, columns: int = 4) -> None:
    """Legend in rows along the top of the axes."""
    ax.legend(loc="upper left", ncols=columns, borderaxespad=0.2, columnspacing=1.2, handlelength=1.5, framealpha=0.8)


def bounds(values: Sequence[Array], outside: float = _OUTSIDE) -> tuple[float, float]:
    """Range of nearly all finite values of several variables, with a margin."""
    ends = [np.quantile(v[np.isfinite(v)], (outside, 1.0 - outside)) for v in values if np.isfinite(v).any()]
    if not ends:
        return -1.0, 1.0
    low, high = float(min(e[0] for e in ends)), float(max(e[1] for e in ends))
    margin = _MARGIN * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin


def strips(
    shared: Layer,
    subject: str,
    panels: Sequence[Callable[[Panel], None]],
    heights: Sequence[float],
    low: float | None = None,
) -> Figure:
    """Panels one below the other over the same time, with the flight's marks.

    Parameters
    ----------
    heights : sequence of float
        Inches.
    low : float, optional
        Left end, s; from where the force coefficients count if not given.
    """
    made = style.figure(sum(heights) + 1.5)
    style.margins(made, top=0.6, left=1.2)
    made.subplots_adjust(hspace=0.1)
    axes = made.subplots(len(panels), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    begin = shared.useful if low is None else low
    for k, (draw, ax) in enumerate(zip(panels, axes, strict=True)):
        shade_instabilities(shared, ax)
        draw(Panel(shared, ax, begin))
        ax.yaxis.set_label_coords(-0.088, 0.5)  # all in line, without measuring the ticks' labels
        ax.set_title("", y=1.0)  # only the top axes get a title: no search for its place
        ax.set_xlim(begin, shared.right)
        style.mark_events(shared.marks, ax)
        if k == 0:
            name_shades(shared, ax, begin)
    style.dress(shared.marks, [axes[0]], [axes[-1]], subject)
    return made


def shade_instabilities(shared: Layer, ax: Axes) -> None:
    """Shade the times at which the vehicle is statically unstable."""
    for left, right in shared.unstable:
        ax.axvspan(left, right, color=SHADE, linewidth=0.0, zorder=0.5)


def name_shades(shared: Layer, ax: Axes, low: float, height: float = 0.02) -> None:
    """Say what the shades are, at a `height` that is a fraction of the axes': their foot, if nothing dips there."""
    for left, right in shared.unstable:
        middle = max(0.5 * (left + right), low + 0.04 * (shared.right - low))
        if right > low:
            ax.annotate(
                "unstable",
                (middle, height),
                xycoords=("data", "axes fraction"),
                ha="center",
                fontsize=9.0,
                color="#555555",
                bbox={"facecolor": SHADE, "edgecolor": "none", "pad": 0.5},
            )
