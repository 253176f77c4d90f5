"""How all figures look: colours, sizes, titles and the marks of events."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from xarray import DataTree

from edl_filter.report import view
from edl_filter.report.label_layout import place

# re-exported: figures say style.ORANGE, and the HTML report needs no matplotlib for its colours
from edl_filter.report.palette import BLACK as BLACK
from edl_filter.report.palette import BLUE as BLUE
from edl_filter.report.palette import GREEN as GREEN
from edl_filter.report.palette import GREY as GREY
from edl_filter.report.palette import ORANGE as ORANGE
from edl_filter.report.palette import PURPLE as PURPLE
from edl_filter.report.palette import SKY as SKY
from edl_filter.report.palette import VERMILLION as VERMILLION
from edl_filter.report.palette import YELLOW as YELLOW

P = ParamSpec("P")
R = TypeVar("R")

#: Colours of body axes x, y, z.
AXIS_COLOURS = (BLUE, VERMILLION, GREEN)

WIDTH = 9.0  # inches; printed at half that the text is still 6 points
LEFT, RIGHT, BOTTOM = 0.95, 0.3, 0.65  # margins, inches
EVENT_SIZE = 11.0  # points
EVENT_PITCH = 14.0  # points from one row of labels to the next
TITLE_SIZE = 14.0

_RC: Any = {
    "font.size": 12.0,
    "font.family": "DejaVu Sans",
    "axes.labelsize": 12.0,
    "axes.titlesize": TITLE_SIZE,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.grid": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.fontsize": 11.0,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "lines.linewidth": 1.3,
    "xtick.labelsize": 11.0,
    "ytick.labelsize": 11.0,
    "text.usetex": False,
    "axes.unicode_minus": True,
}

_ACTIVE: ContextVar[bool] = ContextVar("_ACTIVE", default=False)
_SHOWN: ContextVar[bool] = ContextVar("_SHOWN", default=False)

EVENT_LABELS = {
    "entry_interface": "entry",
    "peak_deceleration": "peak",
    "parachute_deploy": "parachute",
    "heat_shield_separation": "heat shield",
    "backshell_separation": "backshell",
    "retro_rocket_fire": "rockets",
    "bridle_cut": "bridle cut",
}


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Make a drawing function use this style, whatever the user's matplotlib settings are."""

    @functools.wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        if _ACTIVE.get():  # setting it once is enough, and not cheap
            return draw(*args, **kwargs)
        token = _ACTIVE.set(True)
        try:
            with mpl.rc_context(_RC):
                return draw(*args, **kwargs)
        finally:
            _ACTIVE.reset(token)

    return wrapper


@contextmanager
def shown() -> Iterator[None]:
    """Make figures with pyplot meanwhile: a notebook shows them at the end of the cell, a script in a window."""
    from matplotlib import pyplot

    # Loads the backend before any style is set: a notebook's switches interaction on, which must outlast the style
    pyplot.draw_if_interactive()
    token = _SHOWN.set(True)
    try:
        yield
    finally:
        _SHOWN.reset(token)


def figure(height: float, width: float = WIDTH) -> Figure:
    """Empty figure, inches, on its own Agg canvas: no window, no global state, unless it is to be `shown`."""
    if _SHOWN.get():
        from matplotlib import pyplot

        return pyplot.figure(figsize=(width, height))
    made = Figure(figsize=(width, height))
    FigureCanvasAgg(made)
    return made


def margins(made: Figure, top: float, left: float = LEFT, right: float = RIGHT, bottom: float = BOTTOM) -> None:
    """Set the margins of a figure, inches."""
    width, height = made.get_size_inches()
    made.subplots_adjust(left=left / width, right=1.0 - right / width, bottom=bottom / height, top=1.0 - top / height)


def alone(tree: DataTree, ax: Axes | None, subject: str) -> tuple[Axes, Callable[[], None]]:
    """Axes to draw on, and what finishes them: nothing for the caller's own axes.

    Axes that are made here get the flight's title, labelled events and the label of the time axis.
    """
    if ax is not None:
        return ax, lambda: None
    made = figure(5.0)
    margins(made, top=0.5)
    own = made.add_subplot()
    return own, lambda: dress(tree, [own], [own], subject)


def dress(tree: DataTree, top: Sequence[Axes], bottom: Sequence[Axes], subject: str) -> None:
    """Give a figure its title, labels of events above the `top` axes and of time below the `bottom` ones."""
    rows = max(label_events(tree, ax) for ax in top)
    title(tree, top[0], subject, rows)
    for k, ax in enumerate(bottom):
        ax.set_xlabel("time (s)" if k else view.time_label(tree))
    made = top[0].get_figure()
    assert isinstance(made, Figure)
    height = made.get_size_inches()[1]
    room = (rows * EVENT_PITCH + TITLE_SIZE + 18.0) / 72.0
    made.subplots_adjust(top=1.0 - room / height)


def title(tree: DataTree, ax: Axes, subject: str, rows: int = 0) -> None:
    """Name of the flight and of what is shown, above `rows` rows of labels."""
    ax.set_title(f"{view.title(tree)}: {subject}", loc="left", pad=rows * EVENT_PITCH + 8.0, fontweight="bold")


def plain_powers(value: float, _position: float = 0.0) -> str:
    """Label of a tick on a logarithmic axis: 0.001, 10, 100 000."""
    return f"{value:,.0f}".replace(",", " ") if value >= 1.0 else f"{value:g}"


def mark_events(tree: DataTree, ax: Axes) -> None:
    """Draw a thin line at every event inside the axes' range."""
    for _, time in _visible(tree, ax):
        line = ax.axvline(time, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1.5)
        line.set_gid("event")


def width(ax: Axes) -> float:
    """Width of the axes, points."""
    return float(ax.get_window_extent().width) * 72.0 / ax.figure.dpi


def label_events(tree: DataTree, ax: Axes) -> int:
    """Name the events above the axes; gives the number of rows that takes."""
    shown = _visible(tree, ax)
    if not shown:
        return 0
    low, high = ax.get_xlim()
    span = width(ax)
    names = [EVENT_LABELS.get(n, n.replace("_", " ")) for n, _ in shown]
    marks = [(t - low) / (high - low) * span for _, t in shown]
    widths = [0.58 * EVENT_SIZE * len(n) for n in names]
    places = place(marks, widths, span)
    above: dict[str, Any] = {
        "xycoords": ("data", "axes fraction"),
        "textcoords": "offset points",
        "annotation_clip": False,
    }
    for name, (_, time), mark, at in zip(names, shown, marks, places, strict=True):
        base = at.row * EVENT_PITCH + 3.0
        beside = not at.left < mark < at.left + 0.58 * EVENT_SIZE * len(name)
        leader = base + (0.8 * EVENT_SIZE if beside else 0.0)
        ax.annotate(
            "",
            (time, 1.0),
            (0.0, leader),
            arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.8},
            **above,
        )
        left_of = at.left < mark - 3.0 and beside
        anchor = "right" if left_of else "left"
        offset = at.left - mark if not left_of else at.left - mark + 0.58 * EVENT_SIZE * len(name)
        ax.annotate(
            name,
            (time, 1.0),
            (offset, base),
            ha=anchor,
            va="bottom",
            fontsize=EVENT_SIZE,
            color="#333333",
            **above,
        )
    return 1 + max(p.row for p in places)


def _visible(tree: DataTree, ax: Axes) -> list[tuple[str, float]]:
    low, high = ax.get_xlim()
    edge = 1e-6 * (high - low)
    return [(n, t) for n, t in view.events(tree) if low - edge <= t <= high + edge]
