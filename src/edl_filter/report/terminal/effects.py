"""The catalogue of effects on the terminal: all as a table, or one in detail."""

from __future__ import annotations

from collections.abc import Iterable

from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import bounds_text
from edl_filter.effects.tables import parameters_text, size_text
from edl_filter.report.terminal.console import echo, empty_table


def print_catalogue(effects: Iterable[Effect]) -> None:
    """Print one row for each effect."""
    table = empty_table("", ("effect", "what it is", "parameters, plausible size or range"))
    family = ""
    for e in effects:
        if family and e.family != family:
            table.add_section()
        family = e.family
        table.add_row(e.name, e.summary, parameters_text(e))
    echo(table, "'edl-filter effects NAME' shows one with its source and how it shows in the residuals.")


def print_effect(effect: Effect) -> None:
    """Print all declarations of one effect."""
    table = empty_table("", ("parameter", "meaning", "plausible size or range", "accepted"))
    for q in effect.parameters:
        table.add_row(q.name, q.description, size_text(q), bounds_text(q))
    first = effect.sizes[0] if effect.sizes else None
    example = f" --set {first.name}={first.sigma:g}" if first is not None else ""
    echo(
        f"[bold]{effect.name}[/bold] ({effect.family}): {effect.summary}",
        f"Shows: {effect.shows}" if effect.shows else "",
        f"Region: {effect.region}",
        f"Source: {effect.source}" if effect.source else "",
        table,
        f"Add it: edl-filter add MISSION {effect.name}{example}",
    )
