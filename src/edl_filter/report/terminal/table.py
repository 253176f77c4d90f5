"""Tables that fit the terminal: columns are narrowed, broken, left out or stacked, but no number is cut.

In this order until the table fits: words of text columns are wrapped; the sigma of a number is set below it; columns
that may be left out are, the first one first, and named below the table; every row becomes a block with one line for
each column.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

#: Columns of the terminal that a table takes without its cells: two blanks around each cell, one between, two outside.
_PADDING, _EDGES = 3, 1
_SIGMA = " ± "


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes
    ----------
    head : str
    wraps : bool
        Whether cells are text that may be wrapped between words; others are numbers.
    right : bool
        Whether cells are at the right of the column.
    """

    head: str
    wraps: bool
    right: bool


@dataclass
class Table:
    """A table.

    Attributes
    ----------
    title : str
    columns : tuple of Column
    optional : tuple of str
        Heads of the columns that a narrow terminal omits, the first one first.
    rows : list
        Cells with markup, or None for a rule between sections.
    """

    title: str
    columns: tuple[Column, ...]
    optional: tuple[str, ...] = ()
    rows: list[tuple[str, ...] | None] = field(default_factory=list)

    def add_row(self, *cells: str) -> None:
        """Add a row with one cell for each column."""
        assert len(cells) == len(self.columns)
        self.rows.append(cells)

    def add_section(self) -> None:
        """Begin a new section."""
        self.rows.append(None)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """The widest form that fits."""
        for omitted, broken in product(range(len(self.optional) + 1), (False, True)):
            names = self.optional[:omitted]
            used = [k for k, column in enumerate(self.columns) if column.head not in names]
            widths = self._widths(used, broken, options.max_width)
            if widths is not None:
                if self.title:  # rich would wrap a title at the width of its table
                    yield Text(self.title, style="italic")
                yield self._table(used, broken, widths)
                if names:
                    yield Text(f"  Not shown on so narrow a terminal: {', '.join(names)}.", style="dim")
                    yield Text()
                return
        yield from self._stacked()

    def _cells(self, k: int, broken: bool) -> list[str]:
        cells = [row[k] for row in self.rows if row is not None]
        return [_broken(cell) for cell in cells] if broken and not self.columns[k].wraps else cells

    def _widths(self, used: Sequence[int], broken: bool, available: int) -> list[int] | None:
        """Width of each column; None where they do not fit."""
        natural, least = [], []
        for k in used:
            cells = [Text.from_markup(cell).plain for cell in self._cells(k, broken)]
            head = self.columns[k].head
            lines = [line for cell in cells for line in cell.split("\n")]
            longest, word = max(map(len, lines), default=0), max((len(w) for w in head.split()), default=0)
            natural.append(max(longest, len(head)))
            if self.columns[k].wraps:
                longest = max((len(w) for line in lines for w in line.split()), default=0)
            least.append(max(longest, word))
        available -= _PADDING * len(used) + _EDGES
        if sum(least) > available:
            return None
        while sum(natural) > available:
            widest = max(range(len(used)), key=lambda i: (natural[i] > least[i], natural[i]))
            natural[widest] -= 1
        return natural

    def _table(self, used: Sequence[int], broken: bool, widths: Sequence[int]) -> RichTable:
        table = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1))
        for k, width in zip(used, widths, strict=True):
            column = self.columns[k]
            table.add_column(column.head, justify="right" if column.right else "left", width=width)
        for row in self.rows:
            if row is None:
                table.add_section()
            else:
                table.add_row(*(_broken(row[k]) if broken and not self.columns[k].wraps else row[k] for k in used))
        return table

    def _stacked(self) -> Iterator[RenderableType]:
        """A block for each row: the first cell, and one line for each other column."""
        if self.title:
            yield Text(self.title, style="italic")
        for row in self.rows:
            if row is None:
                continue
            yield Text.from_markup(f"  {row[0]}", style="bold")
            block = RichTable.grid(padding=(0, 2), pad_edge=True)
            block.add_column(no_wrap=True)
            block.add_column(overflow="fold")
            for column, cell in zip(self.columns[1:], row[1:], strict=True):
                if cell:
                    block.add_row(f"  {column.head}", cell)
            yield block
        yield Text()


def _broken(cell: str) -> str:
    """A cell with sigmas below their numbers."""
    return cell.replace(_SIGMA, "\n± ")
