"""Figures drawn by matplotlib from their descriptions: the PNG files of a run, and plots in Python."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Polygon, Rectangle
from matplotlib.transforms import blended_transform_factory

from edl_filter.io.atomic import replace_with
from edl_filter.report.colours import ROLES, VERMILLION, scale_colours
from edl_filter.report.decimate import envelope, reduced
from edl_filter.report.description import (
    FEW_DECADES,
    Axis,
    Band,
    Bars,
    ColourScale,
    Curve,
    Figure,
    HeatMap,
    Line,
    Panel,
    Region,
    Span,
    Text,
)  # fmt: skip
from edl_filter.report.label_layout import place_labels
from edl_filter.report.text import event_label

P = ParamSpec("P")
R = TypeVar("R")

DPI = 120
#: Bins to which curves are reduced, more than a panel has pixels.
BINS = 1200
EVENT_SIZE, EVENT_PITCH, TITLE_SIZE = 11.0, 14.0, 14.0  # points
#: Width of a character as a fraction of the font size, about.
_CHARACTER = 0.58
#: Height above the panels of a figure without event labels, inches.
_TOP = 0.85
_DASHES: dict[str, Any] = {"": "-", "dash": (0, (5, 2)), "dot": ":"}
_SYMBOLS = {
    "": "", "circle": "o", "square": "s", "diamond": "D", "star": "*", "triangle": "^", "cross": "x", "plus": "P",
    "right": ">", "left": "<", "down": "v",
}  # fmt: skip
_STYLE: Any = {
    "font.size": 12.0, "font.family": "DejaVu Sans", "axes.labelsize": 12.0, "axes.titlesize": TITLE_SIZE,
    "axes.spines.right": False, "axes.spines.top": False, "axes.grid": True, "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6, "axes.axisbelow": True, "legend.fontsize": 11.0, "legend.framealpha": 0.9,
    "legend.edgecolor": "none", "xtick.labelsize": 11.0, "ytick.labelsize": 11.0, "text.usetex": False,
    "axes.unicode_minus": True,
}  # fmt: skip
_PYPLOT: ContextVar[bool] = ContextVar("_PYPLOT", default=False)


def styled(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function so that it draws in this style, whatever the user's matplotlib settings are."""

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        with mpl.rc_context(_STYLE):
            return function(*args, **kwargs)

    return wrapper


@contextmanager
def pyplot_figures() -> Iterator[None]:
    """Create figures with pyplot meanwhile: a notebook displays them after the cell, a script in a window."""
    from matplotlib import pyplot

    # Loads the backend before any style is set: a notebook's switches interaction on, which must outlast the style
    pyplot.draw_if_interactive()
    token = _PYPLOT.set(True)
    try:
        yield
    finally:
        _PYPLOT.reset(token)


@styled
def draw(figure: Figure) -> Canvas:
    """Draw a figure on its own canvas, with title, event labels and axis labels."""
    margin, margin_right, bottom = figure.margins
    height = sum(figure.heights) + bottom + _TOP
    canvas = _canvas(figure.width, height)
    canvas.subplots_adjust(left=margin / figure.width, right=1.0 - margin_right / figure.width, bottom=bottom / height)
    columns = len(figure.widths)
    grid = canvas.add_gridspec(
        len(figure.rows), columns, height_ratios=figure.heights, width_ratios=figure.widths, wspace=figure.gaps[0],
        hspace=figure.gaps[1],
    )  # fmt: skip
    axes_rows: list[list[Axes]] = []
    for r, row in enumerate(figure.rows):
        cells = [grid[r, :]] if len(row) == 1 else [grid[r, c] for c in range(len(row))]
        axes_rows.append([canvas.add_subplot(cell) for cell in cells])
        for c, (panel, axes) in enumerate(zip(row, axes_rows[-1], strict=True)):
            draw_panel(panel, axes)
            if figure.shared_x and r < len(figure.rows) - 1:
                axes.set_xlabel("")
                axes.tick_params(labelbottom=False)
            if figure.shared_y and c > 0:
                axes.set_ylabel("")
                axes.tick_params(labelleft=False)
            if figure.shared_x and columns == 1:  # in line, without measuring the tick labels
                axes.yaxis.set_label_coords(-0.55 * margin / (figure.width - margin - margin_right), 0.5)
    first = list(zip(figure.rows[0], axes_rows[0], strict=True))
    label_rows = max((_label_events(panel, axes) for panel, axes in first), default=0) if figure.event_labels else 0
    room = (label_rows * EVENT_PITCH + TITLE_SIZE + 18.0) / 72.0 if figure.event_labels else _TOP - 0.25
    canvas.subplots_adjust(top=1.0 - room / height)
    if margin > 1.5:  # a column of names precedes the panel: the title begins at the edge of the figure
        position = (0.15 / figure.width, 1.0 - 0.2 / height)
        canvas.text(*position, figure.title, va="top", fontsize=TITLE_SIZE, fontweight="bold")
    else:
        pad = label_rows * EVENT_PITCH + 8.0
        # with a stated height the title is placed without measuring all tick labels
        axes_rows[0][0].set_title(figure.title, loc="left", y=1.0, pad=pad, fontweight="bold")
    if figure.legend:
        handles, labels = axes_rows[-1][0].get_legend_handles_labels()
        canvas.legend(handles, labels, loc="lower center", ncols=3)
    if figure.scale is not None:
        _draw_scale(canvas, figure.scale, height, figure.width)
    return canvas


@styled
def draw_panel(panel: Panel, axes: Axes) -> Axes:
    """Draw a panel on existing axes, with its axis labels and event lines."""
    for axis, set_scale, set_label in (
        (panel.x, axes.set_xscale, axes.set_xlabel),
        (panel.y, axes.set_yscale, axes.set_ylabel),
    ):
        if axis.scale == "symlog":
            set_scale("symlog", linthresh=axis.linear_limit)
        else:
            set_scale(axis.scale)
        set_label(axis.text)
    for k, element in enumerate(panel.elements):
        _DRAWERS[type(element)](axes, element, 2.0 + 0.01 * k)
    equal = panel.aspect == "equal"  # the limits may then grow
    _set_axis(axes.xaxis, panel.x, axes.set_xlim, equal)
    _set_axis(axes.yaxis, panel.y, axes.set_ylim, equal)
    if panel.aspect != "auto":
        axes.set_aspect("equal", adjustable="datalim" if panel.aspect == "equal" else "box")
    for position in _visible_events(panel, axes).values():
        line = axes.axvline(position, color=ROLES["muted"][0], linewidth=0.8, linestyle=(0, (4, 3)), zorder=1.5)
        line.set_gid("event")
    if panel.shifted_axis is not None:
        label, zero = panel.shifted_axis
        functions = (lambda v: np.asarray(v) - zero, lambda v: np.asarray(v) + zero)
        second = axes.secondary_yaxis("right", functions=functions)
        second.set_ylabel(label)
        second.spines["right"].set_visible(True)
    if panel.legend is not None and axes.get_legend_handles_labels()[1]:
        axes.legend(title=panel.legend.title or None, ncols=panel.legend.columns, **_LEGENDS[panel.legend.place])
    return axes


_LEGENDS: dict[str, dict[str, Any]] = {
    "row": {
        "loc": "upper left", "borderaxespad": 0.2, "columnspacing": 1.2, "handlelength": 1.5, "framealpha": 0.8,
    },
    "outside": {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)},
    "below": {"loc": "upper center", "bbox_to_anchor": (0.4, -0.35)},
    **{
        place: {"loc": place, "markerscale": 3.0 if place == "lower center" else 1.0}
        for place in ("best", "upper left", "upper right", "lower left", "lower center")
    },
}  # fmt: skip


def write_figure(figure: Figure, path: Path) -> Path:
    """Draw a figure and write it as PNG, SVG or PDF by its suffix; the file appears only when it is complete."""
    return write_canvas(draw(figure), path)


def write_canvas(canvas: Canvas, path: Path) -> Path:
    """Write a drawn figure as PNG, SVG or PDF by its suffix; the file appears only when it is complete."""
    kind = path.suffix.removeprefix(".")
    options: dict[str, Any] = {"dpi": DPI, "pil_kwargs": {"compress_level": 1}} if kind == "png" else {}
    if kind in ("svg", "pdf"):  # the same figure is the same file
        options["metadata"] = {"Date": None} if kind == "svg" else {"CreationDate": None}
    return replace_with(path, lambda temporary: canvas.savefig(temporary, format=kind, **options))


def power_label(value: float, _position: float = 0.0) -> str:
    """Label of a tick of a logarithmic axis in positional notation: 0.001, 10, 100 000."""
    return f"{value:,.0f}".replace(",", " ") if value >= 1.0 else f"{value:g}"


def _canvas(width: float, height: float) -> Canvas:
    """Empty figure, inches, on an Agg canvas: no window and no global state, except within `pyplot_figures`."""
    if _PYPLOT.get():
        from matplotlib import pyplot

        return pyplot.figure(figsize=(width, height))
    canvas = Canvas(figsize=(width, height))
    FigureCanvasAgg(canvas)
    return canvas


def _set_axis(target: Any, axis: Axis, set_limits: Callable[..., Any], variable: bool) -> None:
    if axis.range is not None:
        set_limits(*axis.range, auto=variable)
    if axis.scale == "log":
        few = axis.range is not None and np.log10(axis.range[1] / axis.range[0]) < FEW_DECADES
        target.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=8))
        target.set_minor_locator(ticker.NullLocator())
        if axis.range is not None and axis.range[0] >= 5e-4 and axis.range[1] <= 1e6:
            target.set_major_formatter(ticker.FuncFormatter(power_label))
    if axis.ticks is not None:
        # steep labels end at their tick, the others are below it
        turned = {"rotation": axis.tick_angle, "ha": "right", "rotation_mode": "anchor"} if axis.tick_angle else {}
        target.set_ticks([p for p, _ in axis.ticks], [label for _, label in axis.ticks], **turned)
    if not axis.grid:
        target.grid(False)
        target.set_tick_params(length=0)


def _draw_curve(axes: Axes, curve: Curve, order: float) -> None:
    index = reduced(curve, BINS)
    x, y = curve.x[index], curve.y[index]
    style: dict[str, Any] = {
        "color": ROLES[curve.colour][0], "linewidth": curve.width, "label": curve.label or None, "zorder": order,
        "linestyle": _DASHES[curve.dash] if curve.width else "none", "marker": _SYMBOLS[curve.symbol],
        "markersize": curve.size, "alpha": curve.opacity if curve.opacity < 1.0 else None,
    }  # fmt: skip
    if curve.sigma is not None:
        axes.errorbar(x, y, curve.sigma[index], elinewidth=1.0, capsize=2.0, **style)
    else:
        axes.plot(x, y, clip_on=curve.symbol not in ("right", "left"), **style)
    for note, px, py in zip(curve.notes, x, y, strict=False):
        if note:
            axes.annotate(note, (px, py), (0, 6), textcoords="offset points", ha="center", fontsize=10.0)


def _draw_band(axes: Axes, band: Band, order: float) -> None:
    limits = []
    for values in (band.low, band.high):
        position, reduced_values = envelope(band.position, values, BINS)
        ascending = np.argsort(position, kind="stable")
        limits.append((position[ascending], reduced_values[ascending]))
    positions = np.union1d(limits[0][0], limits[1][0])
    low, high = (np.interp(positions, *limit) for limit in limits)
    fill = axes.fill_between if band.independent == "x" else axes.fill_betweenx
    colour, label = ROLES[band.colour][0], band.label or None
    fill(positions, low, high, color=colour, linewidth=0.0, label=label, zorder=order - 0.8)


def _draw_region(axes: Axes, region: Region, order: float) -> None:
    colour = ROLES[region.colour][0]
    patch = Polygon(np.column_stack((region.x, region.y)), linewidth=1.6, edgecolor=colour, zorder=order)
    patch.set_facecolor(colour + "22" if region.filled else "none")
    patch.set_label(region.label)
    axes.add_patch(patch)


def _draw_line(axes: Axes, line: Line, order: float) -> None:
    draw_line = axes.axvline if line.axis == "x" else axes.axhline
    draw_line(
        line.position, color=ROLES[line.colour][0], linewidth=line.width, linestyle=_DASHES[line.dash],
        label=line.label or None, zorder=order - 0.5,
    )  # fmt: skip


def _draw_span(axes: Axes, span: Span, order: float) -> None:
    shade = axes.axvspan if span.axis == "x" else axes.axhspan
    colour = ROLES[span.colour][0]
    shade(span.low, span.high, color=colour, linewidth=0.0, label=span.label or None, zorder=order - 1.5)
    if span.note:
        axes.annotate(
            span.note, (0.5 * (span.low + span.high), span.height), xycoords=("data", "axes fraction"), ha="center",
            fontsize=9.0, color="#555555", bbox={"facecolor": colour, "edgecolor": "none", "pad": 0.5},
        )  # fmt: skip


def _draw_bars(axes: Axes, bars: Bars, order: float) -> None:
    lengths = np.subtract(bars.ends, bars.starts)
    colours = [ROLES[colour][0] for colour in bars.colours]
    label = bars.label or None
    if bars.horizontal:
        axes.barh(bars.positions, lengths, bars.thickness, bars.starts, color=colours, label=label, zorder=order)
    else:
        axes.bar(bars.positions, lengths, bars.thickness, bars.starts, color=colours, label=label, zorder=order)
    for note, position, end in zip(bars.notes, bars.positions, bars.ends, strict=False):
        point, offset = ((end, position), (4, 0)) if bars.horizontal else ((position, end), (0, 4))
        anchor: dict[str, Any] = {"ha": "left", "va": "center"} if bars.horizontal else {"ha": "center", "va": "bottom"}
        axes.annotate(note, point, offset, textcoords="offset points", fontsize=10.0, **anchor)


def _draw_text(axes: Axes, text: Text, order: float) -> None:
    frames = [axes.transAxes if frame == "panel" else axes.transData for frame in text.frame]
    axes.annotate(
        text.text, (text.x, text.y), text.offset, xycoords=blended_transform_factory(*frames),
        textcoords="offset points", ha=text.horizontal, va=text.vertical, fontsize=text.size, zorder=order,
        color=ROLES[text.colour][0], annotation_clip=False if "panel" in text.frame else None,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0} if text.boxed else None,
    )  # fmt: skip


def _draw_heat_map(axes: Axes, heat_map: HeatMap, order: float) -> None:
    for cell in heat_map.cells:
        corner = (cell.column - 0.5, cell.row - 0.5)
        axes.add_patch(Rectangle(corner, 1.0, 1.0, facecolor=cell.background, linewidth=0.0, zorder=order))
        axes.text(
            cell.column, cell.row, cell.text, ha="center", va="center", fontsize=9.5, color=cell.ink, zorder=order + 2
        )
        if cell.outlined:
            corner = (cell.column - 0.47, cell.row - 0.45)
            outline = Rectangle(corner, 0.94, 0.9, fill=False, edgecolor=VERMILLION, linewidth=2.5, zorder=order + 1)
            outline.set_gid("outline")
            axes.add_patch(outline)
    for spine in axes.spines.values():
        spine.set_visible(False)


_DRAWERS: dict[type, Callable[..., None]] = {
    Curve: _draw_curve, Band: _draw_band, Region: _draw_region, Line: _draw_line, Span: _draw_span, Bars: _draw_bars,
    Text: _draw_text, HeatMap: _draw_heat_map,
}  # fmt: skip


def _draw_scale(canvas: Canvas, scale: ColourScale, height: float, width: float) -> None:
    norm = LogNorm(scale.low, scale.high)
    colours = LinearSegmentedColormap.from_list("scale", scale_colours())
    box = canvas.add_axes((1.0 - 1.25 / width, 0.18, 0.2 / width, 0.7))
    bar = canvas.colorbar(mpl.cm.ScalarMappable(norm, colours), cax=box)
    bar.set_label(scale.label, fontsize=10.0)
    box.yaxis.set_major_formatter(ticker.FuncFormatter(power_label))
    box.grid(False)


def _visible_events(panel: Panel, axes: Axes) -> dict[str, float]:
    low, high = axes.get_xlim()
    edge = 1e-6 * (high - low)
    return {name: position for name, position in panel.events.items() if low - edge <= position <= high + edge}


def _label_events(panel: Panel, axes: Axes) -> int:
    """Write the names of the events above the axes; returns the number of rows of labels."""
    events = dict(sorted(_visible_events(panel, axes).items(), key=lambda event: event[1]))
    if not events:
        return 0
    low, high = axes.get_xlim()
    span = float(axes.get_window_extent().width) * 72.0 / axes.figure.dpi
    labels = [event_label(name) for name in events]
    marks = [(position - low) / (high - low) * span for position in events.values()]
    widths = [_CHARACTER * EVENT_SIZE * len(label) for label in labels]
    positions = place_labels(marks, widths, span)
    above: dict[str, Any] = {
        "xycoords": ("data", "axes fraction"), "textcoords": "offset points", "annotation_clip": True,
    }  # fmt: skip
    for label, time, mark, width, position in zip(labels, events.values(), marks, widths, positions, strict=True):
        base = position.row * EVENT_PITCH + 3.0
        across = position.start < mark < position.start + width
        leader = base + (0.0 if across else 0.8 * EVENT_SIZE)
        arrow = {"arrowstyle": "-", "color": ROLES["muted"][0], "linewidth": 0.8}
        axes.annotate("", (time, 1.0), (0.0, leader), arrowprops=arrow, **above)
        ends_at_leader = position.start < mark - 3.0 and not across
        offset = position.start - mark + (width if ends_at_leader else 0.0)
        axes.annotate(
            label, (time, 1.0), (offset, base), ha="right" if ends_at_leader else "left", va="bottom",
            fontsize=EVENT_SIZE, color="#333333", **above,
        )  # fmt: skip
    return 1 + max(position.row for position in positions)
