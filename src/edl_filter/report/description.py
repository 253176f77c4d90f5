"""Description of a figure, independent of the library that draws it.

A `Figure` is a grid of `Panel`; a panel has two axes and elements in data coordinates: curves, bands, bars, regions,
reference lines, shaded spans, texts, heat maps. The functions of this package that describe figures compute every value
once; `matplotlib_renderer` and `plotly_renderer` draw a description and compute nothing but the layout. Colours are
roles of `colours.ROLES`. Curves and bands have all samples: a renderer reduces them to its resolution (`decimate`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from edl_filter.types import Array

Direction = Literal["x", "y"]
Dash = Literal["", "dash", "dot"]
Symbol = Literal["", "circle", "square", "diamond", "star", "triangle", "cross", "plus", "right", "left", "down"]
Anchor = Literal["left", "center", "right"]
Place = Literal["row", "best", "upper left", "upper right", "lower left", "lower center", "outside", "below"]
#: Points of the outline of an ellipse.
_OUTLINE_POINTS = 181


#: Decades of a logarithmic axis below which twice and five times a power of ten are labelled too.
FEW_DECADES = 1.6


@dataclass(frozen=True)
class Axis:
    """One axis of a panel.

    Attributes
    ----------
    label, unit : str
        Name and unit of the quantity; ``text`` is both.
    scale : {"linear", "log", "symlog"}
        ``"symlog"`` is linear between plus and minus `linear_limit`.
    range : (float, float), optional
        Ends of the axis, the first one at the left or bottom; determined from the data if it is not given.
    ticks : tuple of (float, str), optional
        Positions and labels of the ticks.
    tick_angle : float
        Slope of the tick labels, degrees.
    linear_limit : float
        Half length of the linear part of a ``"symlog"`` axis.
    grid : bool
        Whether there are grid lines.
    """

    label: str = ""
    unit: str = ""
    scale: Literal["linear", "log", "symlog"] = "linear"
    range: tuple[float, float] | None = None
    ticks: tuple[tuple[float, str], ...] | None = None
    tick_angle: float = 0.0
    linear_limit: float = 1.0
    grid: bool = True

    @property
    def text(self) -> str:
        """Label with unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


@dataclass(frozen=True, eq=False)
class Curve:
    """A line through points, or the points themselves.

    Attributes
    ----------
    x, y : (N,) arrays
        Data coordinates; NaN is a gap.
    label : str
        Entry of the legend; none if empty.
    colour, unit : str
        Role of the colour; unit of the dependent coordinate.
    width : float
        Width of the line, points; 0 draws symbols only.
    dash, symbol : str
        Style of the line; symbol at each point.
    size : float
        Size of the symbols, points.
    opacity : float
        Of symbols, 0 to 1.
    independent : {"x", "y", "none"}
        Independent coordinate, in whose bins the curve is reduced; none for a path.
    sigma : (N,) array, optional
        Half length of error bars along y.
    names, notes : tuple of str
        Name of each point; text at each point.
    """

    x: Array
    y: Array
    label: str = ""
    colour: str = "blue"
    unit: str = ""
    width: float = 1.3
    dash: Dash = ""
    symbol: Symbol = ""
    size: float = 4.0
    opacity: float = 1.0
    independent: Literal["x", "y", "none"] = "x"
    sigma: Array | None = None
    names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Band:
    """Area between two curves over the same coordinate.

    Attributes
    ----------
    position, low, high : (N,) arrays
        Independent coordinate, lower and upper limit; NaN is a gap.
    label, colour : str
        Entry of the legend; role of the colour.
    independent : {"x", "y"}
        Axis of `position`.
    curve : str
        Label of the curve to which the band belongs, if any: the legend switches both.
    """

    position: Array
    low: Array
    high: Array
    label: str = ""
    colour: str = "blue-band"
    independent: Direction = "x"
    curve: str = ""


@dataclass(frozen=True, eq=False)
class Region:
    """Area within a closed line ``x``, ``y`` ``(N,)``; `filled` or outline only."""

    x: Array
    y: Array
    label: str = ""
    colour: str = "blue"
    filled: bool = True


@dataclass(frozen=True)
class Line:
    """Straight line across a panel at one `position` of the `axis`."""

    position: float
    axis: Direction = "y"
    label: str = ""
    colour: str = "muted"
    dash: Dash = ""
    width: float = 0.8


@dataclass(frozen=True)
class Span:
    """Shaded interval of an axis; `note` is written at a `height` that is a fraction of the panel's."""

    low: float
    high: float
    axis: Direction = "x"
    label: str = ""
    colour: str = "shade"
    note: str = ""
    height: float = 0.02


@dataclass(frozen=True)
class Bars:
    """Bars from `starts` to `ends` at `positions` of one axis.

    Attributes
    ----------
    positions, starts, ends : tuple of float
        Middle of each bar across its length; its ends.
    colours : tuple of str
        Role of each bar's colour.
    label : str
        Entry of the legend.
    thickness : float
        In units of the positions.
    horizontal : bool
        Whether bars extend along x.
    notes : tuple of str
        Text at the end of each bar.
    """

    positions: tuple[float, ...]
    starts: tuple[float, ...]
    ends: tuple[float, ...]
    colours: tuple[str, ...]
    label: str = ""
    thickness: float = 0.6
    horizontal: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Text:
    """Text at a point.

    Attributes
    ----------
    text : str
    x, y : float
        Data coordinates, or fractions of the panel where `frame` says so.
    frame : (str, str)
        ``"data"`` or ``"panel"`` for x and y.
    offset : (float, float)
        Displacement, points.
    horizontal : {"left", "center", "right"}
        Part of the text that is at the point.
    vertical : {"top", "center", "bottom"}
        Part of the text that is at the point.
    size : float
        Points.
    colour : str
        Role.
    boxed : bool
        Whether the background is covered.
    """

    text: str
    x: float
    y: float
    frame: tuple[Literal["data", "panel"], Literal["data", "panel"]] = ("data", "data")
    offset: tuple[float, float] = (0.0, 0.0)
    horizontal: Anchor = "center"
    vertical: Literal["top", "center", "bottom"] = "center"
    size: float = 10.0
    colour: str = "ink"
    boxed: bool = False


@dataclass(frozen=True)
class HeatCell:
    """Cell of a heat map: value, background and text colour (not roles), text, whether it is outlined."""

    row: int
    column: int
    value: float
    background: str
    ink: str
    text: str
    outlined: bool


@dataclass(frozen=True)
class HeatMap:
    """Cells in rows and columns at integer coordinates, row 0 at the top."""

    cells: tuple[HeatCell, ...]


@dataclass(frozen=True)
class ColourScale:
    """Logarithmic colour scale from `low` to `high` next to a figure, with its label."""

    low: float
    high: float
    label: str


Element = Curve | Band | Region | Line | Span | Bars | Text | HeatMap


@dataclass(frozen=True)
class Legend:
    """Legend of a panel: its place (``"row"`` is a compact row along the top), number of columns and title."""

    place: Place = "row"
    columns: int = 4
    title: str = ""


@dataclass(frozen=True)
class Panel:
    """One pair of axes with its elements, later ones drawn over earlier ones.

    Attributes
    ----------
    x, y : Axis
    elements : tuple of Element
    events : dict
        Name → position on the x axis of events; those outside the range of the axis are not drawn.
    legend : Legend, optional
    shifted_axis : (str, float), optional
        Label of a second y axis at the right, whose zero is at this value of the first.
    aspect : {"auto", "equal", "square"}
        ``"equal"``: the same length of a unit on both axes; ``"square"``: the panel is a square as well.
    name, caption : str
        Identifier and caption on a page.
    """

    x: Axis
    y: Axis
    elements: tuple[Element, ...]
    events: Mapping[str, float] = field(default_factory=dict)
    legend: Legend | None = None
    shifted_axis: tuple[str, float] | None = None
    aspect: Literal["auto", "equal", "square"] = "auto"
    name: str = ""
    caption: str = ""


@dataclass(frozen=True)
class Figure:
    """Panels in rows and columns.

    Attributes
    ----------
    title : str
        Flight and subject.
    rows : tuple of tuple of Panel
        Panels of each row; a row of one panel spans all columns.
    heights : tuple of float
        Height of each row, inches.
    widths : tuple of float
        Relative width of each column.
    width : float
        Inches.
    margins : (float, float, float)
        Left, right and bottom, inches.
    gaps : (float, float)
        Between columns and between rows, as a fraction of a panel's mean size.
    shared_x : bool
        Whether the panels of a column have the same x axis, labelled at the bottom only.
    shared_y : bool
        Whether the panels of a row have the same y axis, labelled at the left only.
    event_labels : bool
        Whether the events are named above the first row.
    scale : ColourScale, optional
    legend : bool
        Whether the legend of the last row's first panel is below the figure.
    """

    title: str
    rows: tuple[tuple[Panel, ...], ...]
    heights: tuple[float, ...]
    widths: tuple[float, ...] = (1.0,)
    width: float = 9.0
    margins: tuple[float, float, float] = (0.95, 0.3, 0.65)
    gaps: tuple[float, float] = (0.18, 0.12)
    shared_x: bool = False
    shared_y: bool = False
    event_labels: bool = False
    scale: ColourScale | None = None
    legend: bool = False

    @property
    def panels(self) -> tuple[Panel, ...]:
        """All panels, row by row."""
        return tuple(panel for row in self.rows for panel in row)


def bounds(values: Sequence[Array], outside: float = 0.004, margin: float = 0.10) -> tuple[float, float]:
    """Range of nearly all finite values of several variables, with a margin.

    Parameters
    ----------
    values : sequence of (N,) arrays
        Variables of one unit; NaN is ignored.
    outside : float
        Share of the samples of each variable that may be below, and above, the range.
    margin : float
        Margin as a share of the range.
    """
    ends = [np.quantile(v[np.isfinite(v)], (outside, 1.0 - outside)) for v in values if np.isfinite(v).any()]
    if not ends:
        return -1.0, 1.0
    low, high = float(min(e[0] for e in ends)), float(max(e[1] for e in ends))
    room = margin * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def significant(values: Array, sigma: Array | None, share: float) -> Array:
    """Values with gaps where the sigma exceeds a share of the value; all of them if no sigma is stated.

    Parameters
    ----------
    values, sigma : (N,) arrays
        In the same unit.
    share : float
        Largest relative sigma.
    """
    return values if sigma is None else np.where(sigma < share * np.abs(values), values, np.nan)


def ellipse_outline(centre: Array, covariance: Array, sigmas: float) -> Array:
    """Outline of the ellipse of a two-dimensional normal distribution.

    Parameters
    ----------
    centre : (2,) array
        Mean.
    covariance : (2, 2) array
        In the square of the unit of `centre`.
    sigmas : float
        Semi-axes in standard deviations along them.

    Returns
    -------
    (2, K) array
        Closed, in the unit of `centre`.
    """
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, _OUTLINE_POINTS)
    circle = np.stack((np.cos(angle), np.sin(angle)))
    return np.asarray(centre[:, None] + sigmas * vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle))
