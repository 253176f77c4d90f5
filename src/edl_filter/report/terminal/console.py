"""What goes to a terminal or into a pipe, through rich."""

from __future__ import annotations

import typer
from rich import box
from rich.console import Console, RenderableType
from rich.table import Table

#: Columns where the output is no terminal and has no width of its own.
WIDTH = 118


def echo(*parts: RenderableType) -> None:
    """Print texts and tables; empty texts are left out."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=WIDTH)
    with console.capture() as captured:  # rich would end the program where a reader such as head goes away
        for part in parts:
            if part != "":
                console.print(part, soft_wrap=isinstance(part, str) and part.startswith("  "))
    typer.echo(captured.get(), nl=False)


def table(title: str, text: tuple[str, ...], numbers: tuple[str, ...] = (), after: tuple[str, ...] = ()) -> Table:
    """Empty table in the house's style: columns of text, of numbers, and of text after them."""
    made = Table(title=title or None, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1))
    for head in text:
        made.add_column(head, no_wrap=head == text[0])
    for head in numbers:
        made.add_column(head, justify="right", no_wrap=True)
    for head in after:
        made.add_column(head)
    return made
