"""Panels of what each constraint said against what was predicted for it, in sigmas."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import blended_transform_factory
from scipy.special import chdtri
from xarray import Dataset, DataTree

from edl_filter.report import style, view
from edl_filter.types import Array, BoolArray

PROBABILITY = 0.999
LIMIT = 5.0  # sigmas shown; beyond it an arrow at the edge with its number
ROW_INCHES = 0.2
LEFT = 3.2  # inches for the names of constraints and components


@dataclass(frozen=True)
class Row:
    """All values of one component of a constraint, in sigmas; NaN where nothing was predicted."""

    name: str
    values: Array
    accepted: BoolArray


@dataclass(frozen=True)
class Block:
    """One constraint: its components and what its NIS says."""

    name: str
    rows: list[Row]
    nis: float
    dof: int

    @property
    def interval(self) -> tuple[float, float]:
        """Interval that holds the NIS with `PROBABILITY`."""
        tail = 0.5 * (1.0 - PROBABILITY)
        low, high = chdtri(self.dof, [1.0 - tail, tail])
        return float(low), float(high)


@style.styled
def innovations(tree: DataTree, ax: Axes | None = None) -> Axes:
    """Innovations of all constraints on the way forwards, one dot for each use and component.

    The entry state is where that way begins; how it stands to the rest is in `left_out`.
    """
    found = view.constraints(tree).items()
    blocks = [_innovation(name, data) for name, data in found if name != "entry_state"]
    return _draw(tree, ax, blocks, "constraint innovations", "innovation (sigma)")


@style.styled
def left_out(tree: DataTree, ax: Axes | None = None) -> Axes:
    """Each constraint against the prediction from all others."""
    blocks = [_left_out(name, data) for name, data in view.constraints(tree).items() if "left_out" in data]
    return _draw(tree, ax, blocks, "each constraint against all others", "measured − predicted (sigma)")


def _innovation(name: str, data: Dataset) -> Block:
    residual = np.atleast_2d(np.asarray(data["innovation"].values, float))
    sigma = np.atleast_2d(np.asarray(data["innovation_sigma"].values, float))
    uses = len(residual)
    accepted = np.ones(uses, bool)
    if "accepted" in data:
        accepted = np.atleast_1d(data["accepted"].values).astype(bool)
    names = _components(data, residual.shape[1])
    rows = [Row(n, _ratio(residual[:, i], sigma[:, i]), accepted) for i, n in enumerate(names)]
    dof = int(data.attrs.get("dof", residual.size))
    return Block(name, rows, float(np.sum(data["nis"].values)) if "nis" in data else np.nan, dof)


def _left_out(name: str, data: Dataset) -> Block:
    residual = np.atleast_1d(np.asarray(data["left_out"].values, float))
    sigma = np.atleast_1d(np.asarray(data["left_out_sigma"].values, float))
    ratio = _ratio(residual, sigma)
    names = _components(data, len(residual))
    rows = [Row(n, ratio[i : i + 1], np.ones(1, bool)) for i, n in enumerate(names)]
    return Block(
        name,
        rows,
        float(data.attrs.get("left_out_nis", np.nan)),
        int(data.attrs.get("left_out_dof", len(residual))),
    )


def _ratio(residual: Array, sigma: Array) -> Array:
    good = np.isfinite(sigma) & (sigma > 0.0)
    return np.divide(residual, sigma, out=np.full(residual.shape, np.nan), where=good)


def _components(data: Dataset, count: int) -> list[str]:
    """Names of the components without their units: in sigmas there are none."""
    found = data["component"].values if "component" in data.coords else data.attrs.get("components", ())
    names = [re.sub(r"\s*\([^)]*\)$", "", str(n)) for n in np.atleast_1d(found)]
    return names if len(names) == count else [str(i) for i in range(count)]


def _draw(tree: DataTree, ax: Axes | None, blocks: list[Block], subject: str, label: str) -> Axes:
    if ax is None:
        count = sum(len(b.rows) for b in blocks) + 0.6 * len(blocks)
        height = 1.75 + ROW_INCHES * max(count, 6.0)
        made = style.figure(height)
        style.margins(made, top=0.85, left=LEFT, right=2.35, bottom=0.9)
        made.text(
            0.15 / style.WIDTH,
            1.0 - 0.2 / height,
            f"{view.title(tree)}: {subject}",
            va="top",
            fontsize=style.TITLE_SIZE,
            fontweight="bold",
        )
        ax = made.add_subplot()
    for bound, shade in ((3.0, "#EEF6FB"), (1.0, "#CFE6F5")):
        ax.axvspan(-bound, bound, color=shade, linewidth=0.0, zorder=0)
    for bound in (-3.0, 3.0):
        ax.axvline(bound, color=style.GREY, linewidth=0.8, linestyle="--")
    ax.axvline(0.0, color=style.GREY, linewidth=0.8)
    beside = blended_transform_factory(ax.transAxes, ax.transData)
    y = 0.0
    for block in blocks:
        first = y
        for row in block.rows:
            _dots(ax, row, y)
            ax.text(-0.02, y, row.name, transform=beside, ha="right", va="center", fontsize=10.0)
            y += 1.0
        _beside(ax, block, 0.5 * (first + y - 1.0))
        y += 0.6
        ax.axhline(y - 0.8, color="#BBBBBB", linewidth=0.6)
    ax.set_yticks([])
    ax.set_ylim(max(y - 0.8, 1.0), -0.8)
    ax.set_xlim(-LIMIT, LIMIT)
    if any(len(row.values) > 1 for block in blocks for row in block.rows):
        label += "\nused many times: one small dot per use, the first at the top"
    if any(not row.accepted.all() for block in blocks for row in block.rows):
        label += "; cross: not accepted"
    ax.set_xlabel(label)
    ax.text(
        1.03,
        1.0,
        f"NIS in its {100 * PROBABILITY:g} % interval",
        transform=ax.transAxes,
        va="bottom",
        fontsize=10.5,
    )
    return ax


def _dots(ax: Axes, row: Row, y: float) -> None:
    values = row.values
    if not np.isfinite(values).any():
        ax.text(0.0, y, "not predicted by the others", ha="center", va="center", fontsize=9.0, color=style.GREY)
        return
    many = len(values) > 1
    rows = np.full(len(values), y)
    if many:  # an even spread over the row, in order of use
        rows = y + np.linspace(-0.35, 0.35, len(values))
    inside = np.abs(values) <= LIMIT
    size, alpha = (2.5, 0.5) if many else (6.0, 1.0)
    for keep, colour, marker in ((row.accepted, style.BLUE, "o"), (~row.accepted, style.VERMILLION, "x")):
        some = keep & inside
        if not some.any():
            continue
        ax.plot(
            values[some],
            rows[some],
            marker,
            color=colour,
            markersize=size if marker == "o" else 6.0,
            alpha=alpha,
        )
    for value in values[~inside & np.isfinite(values)]:
        edge = float(np.copysign(LIMIT, value))
        ax.plot(edge, y, ">" if edge > 0 else "<", color=style.VERMILLION, markersize=7.0, clip_on=False)
        ax.annotate(
            f"{value:.1f}",
            (edge, y),
            (-7.0 if edge > 0 else 7.0, 0.0),
            textcoords="offset points",
            ha="right" if edge > 0 else "left",
            va="center",
            fontsize=10.0,
            color=style.VERMILLION,
        )


def _beside(ax: Axes, block: Block, y: float) -> None:
    """Write the constraint's name to the left of its rows, its NIS with the interval to the right."""
    width = style.width(ax) / 72.0
    beside = blended_transform_factory(ax.transAxes, ax.transData)
    name = block.name.replace("_", " ")
    ax.text(-(LEFT - 0.15) / width, y, name, transform=beside, ha="left", va="center", fontsize=11.0)
    if not np.isfinite(block.nis) or block.dof < 1:
        return
    low, high = block.interval
    good = low <= block.nis <= high
    text = f"{_short(block.nis)} {'in' if good else 'not in'} {_short(low)} … {_short(high)}"
    colour = "#222222" if good else style.VERMILLION
    ax.text(1.03, y, text, transform=beside, ha="left", va="center", fontsize=10.5, color=colour)


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.1f}" if value >= 10.0 else f"{value:.2f}"
