"""The catalogue of effects on the terminal: all as a table, or one in detail."""

from __future__ import annotations

from collections.abc import Iterable

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import bounds_text
from edl_filter.effects.tables import parameters_text, size_text

#: Columns where the output is no terminal and has no width of its own.
_WIDTH = 118


def print_catalogue(effects: Iterable[Effect]) -> None:
    """Print one row for each effect."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1))
    table.add_column("effect", no_wrap=True)
    table.add_column("what it is")
    table.add_column("parameters, plausible size or range")
    family = ""
    for e in effects:
        if family and e.family != family:
            table.add_section()
        family = e.family
        table.add_row(e.name, e.summary, parameters_text(e))
    _print(table, "'edl-filter effects NAME' shows one with its source and how it shows in the residuals.")


def print_effect(effect: Effect) -> None:
    """Print all that one effect declares."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1))
    for head in ("parameter", "meaning", "plausible size or range", "accepted"):
        table.add_column(head, no_wrap=head == "parameter")
    for q in effect.parameters:
        table.add_row(q.name, q.description, size_text(q), bounds_text(q))
    first = effect.sizes[0] if effect.sizes else None
    example = f" --set {first.name}={first.sigma:g}" if first is not None else ""
    _print(
        f"[bold]{effect.name}[/bold] ({effect.family}): {effect.summary}",
        f"Shows: {effect.shows}" if effect.shows else "",
        f"Region: {effect.region}",
        f"Source: {effect.source}" if effect.source else "",
        table,
        f"Add it: edl-filter add MISSION {effect.name}{example}",
    )


def _print(*parts: Table | str) -> None:
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=_WIDTH)
    with console.capture() as captured:  # rich would end the program where a reader such as head goes away
        for part in parts:
            if part:
                console.print(part)
    typer.echo(captured.get(), nl=False)
