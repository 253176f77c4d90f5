"""Output to a terminal or a pipe, through rich."""

from __future__ import annotations

import typer
from rich import box
from rich.console import Console, RenderableType
from rich.table import Table

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


def empty_table(
    title: str, texts: tuple[str, ...], numbers: tuple[str, ...] = (), last_texts: tuple[str, ...] = ()
) -> Table:
    """Table without rows.

    Parameters
    ----------
    title : str
        Title; none if empty.
    texts, numbers, last_texts : tuple of str
        Heads of columns of text, of numbers, and of text after them.
    """
    table = Table(title=title or None, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1))
    for head in texts:
        table.add_column(head, overflow="fold", min_width=12 if head == texts[0] else None)
    for head in numbers:  # on a narrow terminal a number and its sigma are on two lines, never cut
        table.add_column(head, justify="right", overflow="fold")
    for head in last_texts:
        table.add_column(head)
    return table
