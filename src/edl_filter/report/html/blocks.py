"""Blocks of a section; the template has a form for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from edl_filter.report.description import Figure, Panel
from edl_filter.report.plotly_renderer import BINS, plotly_figure


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
    """A judgement in a table, by a sign and a colour; `tone` is ``good``, ``bad``, ``doubt`` or ``muted``."""

    text: str
    tone: str
    kind: ClassVar[str] = "mark"


Cell = str | Mark


@dataclass(frozen=True)
class Table:
    """A table; the first `texts` columns and those of `wide` are text, the others numbers."""

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
        Identifier of the element, unique on the page.
    caption : str
        Contents in words.
    figure : dict
        ``data`` and ``layout`` as plotly takes them, colours by role.
    height : int
        Pixels.
    """

    name: str
    caption: str
    figure: dict[str, Any]
    height: int
    kind: ClassVar[str] = "plot"

    @classmethod
    def of_figure(cls, name: str, caption: str, figure: Figure, height: int, bins: int = BINS) -> Plot:
        """Plot of a described figure."""
        return cls(name, caption, plotly_figure(figure, height, bins), height)

    @classmethod
    def of_panel(cls, panel: Panel, height: int, bins: int) -> Plot:
        """Plot of one panel, which has the name and the caption."""
        return cls.of_figure(panel.name, panel.caption, Figure("", ((panel,),), (1.0,)), height, bins)


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
class MapButton:
    """One cell of the residual map; `index` is that of the script's cells, None for an empty cell."""

    index: int | None = None
    text: str = ""
    ground: str = ""
    ink: str = ""
    fails: bool = False
    sentence: str = ""


@dataclass(frozen=True)
class MapTable:
    """Channels by regimes; a click on a cell plots its residual below."""

    corner: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[tuple[str, Sequence[MapButton]]]
    kind: ClassVar[str] = "heatmap"


@dataclass(frozen=True)
class Scale:
    """Legend of the map's colours: a gradient between two numbers."""

    gradient: str
    low: str
    high: str
    kind: ClassVar[str] = "scale"


@dataclass(frozen=True)
class ResidualPlot:
    """Plot of the selected cell's residual; `payload` is the script's data."""

    payload: dict[str, Any]
    kind: ClassVar[str] = "residuals"


Block = Note | Command | Table | Plot | Grid | Details | MapTable | Scale | ResidualPlot


@dataclass(frozen=True)
class Section:
    """One section of the page."""

    key: str
    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)
