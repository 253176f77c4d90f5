"""The page: blocks, of which a section consists, and their rendering by one template into one file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.report.colours import page_roles
from edl_filter.report.description import Figure, Panel
from edl_filter.report.html.bundle import write_bundle
from edl_filter.report.next_step import NextStep
from edl_filter.report.plotly_renderer import BINS, plotly_figure
from edl_filter.report.text import readable
from edl_filter.results.files import REPORT, finite
from edl_filter.results.reader import ResultReader

if TYPE_CHECKING:
    from jinja2 import Environment


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
class Verdict:
    """Head of the page.

    Attributes
    ----------
    sign, tone : str
        Sign before the sentence, and its style.
    sentence : str
        How much fails, and the verdict.
    more : list of str
        What the leader reduces, effects in the model, the remainder, and why an improvement ended.
    warnings : list of str
        Reasons not to trust the result, above all else.
    next : NextStep
        What to do next.
    """

    sign: str
    tone: str
    sentence: str
    more: list[str]
    warnings: list[str]
    next: NextStep


@dataclass(frozen=True)
class Section:
    """One section of the page."""

    key: str
    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)


def write_page(
    folder: Path,
    verdict: Callable[[ResultReader], Verdict],
    sections: Sequence[Callable[[ResultReader], Section]],
) -> Path:
    """Write ``report.html`` from the contents of a result folder.

    Parameters
    ----------
    folder : Path
        Folder of a run.
    verdict : callable
        Forms the head of the page.
    sections : sequence of callable
        Form the sections, in the order of the page.

    Returns
    -------
    Path
        ``report.html`` in the folder.

    Raises
    ------
    InputError
        The folder has neither a result nor a summary, or it cannot be written.
    """
    with ResultReader.open(folder, required=False) as reader:
        if not reader.has_result and reader.summary is None:
            raise InputError(f"{folder}: found no result; expected the folder that 'edl-filter run' writes.")
        page = _render(reader.title, verdict(reader), [section(reader) for section in sections])
    write_bundle(folder)
    return replace_with(folder / REPORT, lambda path: path.write_text(page, encoding="utf-8"))


def _render(title: str, verdict: Verdict, sections: Sequence[Section]) -> str:
    """The page as text."""
    from markupsafe import Markup

    template = _environment().get_template("page.html.j2")
    return template.render(
        title=title,
        verdict=verdict,
        sections=sections,
        created=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        version=__version__,
        payload=Markup(embedded(_payload(sections))),
    )


def embedded(data: Any) -> str:
    """JSON that is valid inside a script element, whatever texts it contains."""
    text = json.dumps(finite(data), allow_nan=False, separators=(",", ":"), ensure_ascii=False)
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _payload(sections: Iterable[Section]) -> dict[str, Any]:
    blocks = [block for section in sections for block in _flat(section.blocks)]
    residuals = [b.payload for b in blocks if isinstance(b, ResidualPlot)]
    return {
        "roles": page_roles(),
        "figures": {b.name: b.figure for b in blocks if isinstance(b, Plot)},
        "residuals": residuals[0] if residuals else None,
    }


def _flat(blocks: Iterable[Block]) -> Iterator[Block]:
    for block in blocks:
        yield block
        if isinstance(block, Details):
            yield from _flat(block.blocks)
        elif isinstance(block, Grid):
            yield from block.plots


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("edl_filter.report.html"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["readable"] = readable
    return environment
