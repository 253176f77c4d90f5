"""Output to a terminal or a pipe, through rich."""

from __future__ import annotations

import typer
from rich.console import Console, RenderableType
from rich.markup import escape

from edl_filter.report.terminal.table import Column, Table

#: Columns if the output is no terminal and has no width of its own.
WIDTH = 118


def echo(*parts: RenderableType, wrap: bool = True) -> None:
    """Print texts and tables; empty texts are omitted.

    Parameters
    ----------
    *parts : str or Table
        Text that begins with two blanks is a command, which is not wrapped.
    wrap : bool
        Whether other text is wrapped.
    """
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=WIDTH)
    with console.capture() as captured:  # rich would end the program when a reader such as head closes the pipe
        for part in parts:
            if part != "":
                console.print(part, soft_wrap=isinstance(part, str) and (not wrap or part.startswith("  ")))
    typer.echo(captured.get(), nl=False)


def print_paragraph(text: str) -> None:
    """Print a text without markup, wrapped between words."""
    echo(escape(text))


def empty_table(
    title: str,
    texts: tuple[str, ...],
    numbers: tuple[str, ...] = (),
    last: tuple[str, ...] = (),
    last_texts: tuple[str, ...] = (),
    optional: tuple[str, ...] = (),
) -> Table:
    """Table without rows.

    Parameters
    ----------
    title : str
        Title; none if empty.
    texts, numbers, last, last_texts : tuple of str
        Heads of columns of text, of numbers at the right, of numbers with names at the left, and of text after them.
    optional : tuple of str
        Heads of columns that a narrow terminal omits, the first one first.
    """
    columns = [Column(head, wraps=True, right=False) for head in texts]
    columns += [Column(head, wraps=False, right=True) for head in numbers]
    columns += [Column(head, wraps=False, right=False) for head in last]
    columns += [Column(head, wraps=True, right=False) for head in last_texts]
    return Table(title, tuple(columns), optional)
