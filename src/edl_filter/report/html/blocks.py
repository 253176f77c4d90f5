"""What sections are made of; the template has a form for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar


@dataclass(frozen=True)
class Note:
    """A paragraph; `tone` is empty, ``muted`` or ``warning``."""

    text: str
    tone: str = ""
    kind: ClassVar[str] = "note"


@dataclass(frozen=True)
class Command:
    """A line to type, with a button that copies it."""

    text: str
    kind: ClassVar[str] = "command"


@dataclass(frozen=True)
class Mark:
    """A word in a table that says good or bad: by a sign and a colour; `tone` is ``good``, ``bad`` or ``doubt``."""

    text: str
    tone: str
    kind: ClassVar[str] = "mark"


Cell = str | Mark


@dataclass(frozen=True)
class Table:
    """A table; the first `texts` columns are text, and those of `wide`; the others numbers."""

    caption: str
    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    texts: int = 1
    wide: Sequence[int] = ()
    kind: ClassVar[str] = "table"


@dataclass(frozen=True)
class Plot:
    """A figure that the page's script draws.

    Attributes
    ----------
    name : str
        Of the element, unique on the page.
    caption : str
        What is shown, in words.
    figure : dict
        ``data`` and ``layout`` as plotly takes them, colours by role.
    height : int
        Pixels.
    """

    name: str
    caption: str
    figure: dict[str, Any]
    height: int = 320
    kind: ClassVar[str] = "plot"


@dataclass(frozen=True)
class Grid:
    """Plots side by side where there is room."""

    plots: Sequence[Plot]
    kind: ClassVar[str] = "grid"


@dataclass(frozen=True)
class Details:
    """Blocks that open on demand."""

    title: str
    blocks: Sequence[Any]
    kind: ClassVar[str] = "details"


@dataclass(frozen=True)
class HeatCell:
    """One cell of the map; `index` is its place among the cells that the script knows, None for an empty one."""

    index: int | None = None
    text: str = ""
    ground: str = ""
    ink: str = ""
    fails: bool = False
    sentence: str = ""


@dataclass(frozen=True)
class HeatMap:
    """Channels by regimes; a click on a cell shows its residual in the plot below."""

    corner: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[tuple[str, Sequence[HeatCell]]]
    kind: ClassVar[str] = "heatmap"


@dataclass(frozen=True)
class Scale:
    """Legend of the map's colours: a gradient between two numbers."""

    gradient: str
    low: str
    high: str
    kind: ClassVar[str] = "scale"


@dataclass(frozen=True)
class Residuals:
    """Place of the plot that the map's cells fill; `payload` is what the script needs for it."""

    payload: dict[str, Any]
    kind: ClassVar[str] = "residuals"


Block = Note | Command | Table | Plot | Grid | Details | HeatMap | Scale | Residuals


@dataclass(frozen=True)
class Section:
    """One section of the page."""

    key: str
    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)
