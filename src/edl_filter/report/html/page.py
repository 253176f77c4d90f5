"""Putting the page together: sections in their order, one template, one file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.report.html import verdict as first
from edl_filter.report.html.atmosphere import atmosphere
from edl_filter.report.html.blocks import Block, Details, Grid, Plot, Residuals, Section
from edl_filter.report.html.coefficients import coefficients
from edl_filter.report.html.colours import ROLES
from edl_filter.report.html.constraints import constraints
from edl_filter.report.html.heatmap import heatmap
from edl_filter.report.html.hypotheses import hypotheses
from edl_filter.report.html.missing import missing
from edl_filter.report.html.provenance import provenance
from edl_filter.report.html.source import Source
from edl_filter.report.html.trajectory import trajectory
from edl_filter.report.html.waterfall import waterfall
from edl_filter.results.plain import finite

if TYPE_CHECKING:
    from jinja2 import Environment

#: Name of the file, beside the result.
REPORT = "report.html"
#: Sections after the verdict, in the order of the page.
SECTIONS: tuple[Callable[[Source], Section], ...] = (
    first.events, heatmap, hypotheses, missing, waterfall, trajectory, atmosphere, coefficients, constraints,
    provenance,
)  # fmt: skip


def write_report(folder: str | Path) -> Path:
    """Write ``report.html`` from what a results folder holds.

    Parameters
    ----------
    folder : path
        Of a run; a diagnosis and a ledger in it are part of the report. Parts that are missing are said to be.

    Returns
    -------
    Path
        ``report.html`` in the folder.

    Raises
    ------
    InputError
        The folder has neither a result nor a summary, or it cannot be written.
    """
    folder = Path(folder)
    source = Source(folder)
    try:
        if not source.has_result and not source.summary:
            raise InputError(f"{folder}: found no result; expected the folder that 'edl-filter run' writes.")
        page = render(source)
    finally:
        source.close()
    return replace_with(folder / REPORT, lambda path: path.write_text(page, encoding="utf-8"))


def render(source: Source) -> str:
    """The page as text."""
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    sections = [make(source) for make in SECTIONS]
    template = _environment().get_template("page.html.j2")
    return template.render(
        title=source.title,
        verdict=first.verdict(source),
        sections=sections,
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        version=__version__,
        payload=Markup(embedded(_payload(sections))),
        plotly=Markup(get_plotlyjs()),
    )


def embedded(data: Any) -> str:
    """JSON that may stand inside a script element, whatever texts are in it."""
    text = json.dumps(finite(data), allow_nan=False, separators=(",", ":"), ensure_ascii=False)
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _payload(sections: Iterable[Section]) -> dict[str, Any]:
    blocks = [block for section in sections for block in _flat(section.blocks)]
    residuals = [b.payload for b in blocks if isinstance(b, Residuals)]
    return {
        "roles": ROLES,
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

    return Environment(
        loader=PackageLoader("edl_filter.report.html"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
