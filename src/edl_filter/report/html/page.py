"""The page: its sections in order, and one template."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.report.colours import page_roles
from edl_filter.report.html import diagnosis_sections as diagnosis
from edl_filter.report.html import flight_sections as flight
from edl_filter.report.html.blocks import Block, Details, Grid, Plot, ResidualPlot, Section
from edl_filter.report.html.bundle import write_bundle
from edl_filter.report.html.residual_map import residual_map
from edl_filter.results.files import REPORT
from edl_filter.results.plain import finite
from edl_filter.results.reader import ResultReader

if TYPE_CHECKING:
    from jinja2 import Environment

#: Sections after the verdict, in the order of the page.
SECTIONS = (
    flight.events, residual_map, diagnosis.hypotheses, diagnosis.missing, diagnosis.database, diagnosis.ledger,
    flight.trajectory, flight.atmosphere, flight.coefficients, flight.constraints, flight.instruments,
    flight.provenance,
)  # fmt: skip


def write_report(folder: str | Path) -> Path:
    """Write ``report.html`` from the contents of a result folder, and the plotting library where it is missing.

    Parameters
    ----------
    folder : path
        Folder of a run, with or without a diagnosis and a ledger. The report states which parts are missing.

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
    with ResultReader.open(folder, required=False) as reader:
        if not reader.has_result and reader.summary is None:
            raise InputError(f"{folder}: found no result; expected the folder that 'edl-filter run' writes.")
        page = render(reader)
    write_bundle(folder)
    return replace_with(folder / REPORT, lambda path: path.write_text(page, encoding="utf-8"))


def render(reader: ResultReader) -> str:
    """The page as text."""
    from markupsafe import Markup

    sections = [section(reader) for section in SECTIONS]
    template = _environment().get_template("page.html.j2")
    return template.render(
        title=reader.title,
        verdict=diagnosis.verdict(reader),
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

    return Environment(
        loader=PackageLoader("edl_filter.report.html"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
