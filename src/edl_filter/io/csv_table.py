"""Tables of numbers in CSV: read with error messages that name the file and the line.

Input: a CSV file with one header line; ``#`` starts a comment. Output: rows of finite numbers with their line numbers
(`read_rows`), or rows of text by column name (`read_records`). `package_data` gives the path of a file that the package
ships.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from edl_filter.errors import InputError


class Row(NamedTuple):
    """Numbers of one line and the line's number in the file, counted from 1."""

    line: int
    values: list[float]


def package_data(name: str) -> Path:
    """Path of the file `name` in the package's ``data`` folder."""
    return Path(str(files("edl_filter") / "data" / name))


def numbered_lines(text: str) -> list[tuple[int, str]]:
    """Lines without comments and outer blanks, with their numbers counted from 1; empty ones are left out."""
    stripped = ((number, line.split("#")[0].strip()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, line) for number, line in stripped if line]


def read_rows(path: Path, columns: tuple[str, ...], description: str) -> list[Row]:
    """Read the rows of a table whose header must be `columns`.

    Parameters
    ----------
    path : Path
        CSV file.
    columns : tuple of str
        Names of all columns, in order.
    description : str
        Kind of table in error messages, such as ``"aerodynamic table"``.

    Returns
    -------
    list of Row
        One or more; each has as many finite numbers as there are columns.

    Raises
    ------
    InputError
        The file cannot be read, wrong header, no rows, a value that is no finite number.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: the {description} cannot be read ({error.strerror}).") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: the {description} is no text file.") from None
    lines = numbered_lines(text)
    if not lines or tuple(name.strip() for name in lines[0][1].split(",")) != columns:
        header = f"'{lines[0][1]}' in line {lines[0][0]}" if lines else "an empty file"
        raise InputError(f"{path}: the header must be {','.join(columns)}; found {header}.")
    if len(lines) == 1:
        raise InputError(f"{path}: the table has a header but no rows.")
    return [Row(number, _numbers(path, number, line, len(columns))) for number, line in lines[1:]]


def _numbers(path: Path, number: int, line: str, count: int) -> list[float]:
    try:
        values = [float(field) for field in line.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise InputError(f"{path}, line {number}: expected {count} finite numbers, found '{line}'.")
    return values


def check_monotonic(path: Path, rows: Sequence[Row], column: int, name: str, *, decreasing: bool = False) -> None:
    """Check that the values of one column strictly increase, or strictly decrease.

    Parameters
    ----------
    path : Path
        File of the rows, for the message.
    rows : sequence of Row
        In the order of the file.
    column : int
        Index of the column.
    name : str
        Name of the column in the message.
    decreasing : bool
        The values must decrease.

    Raises
    ------
    InputError
        They do not: the message names the first line at fault.
    """
    for previous, row in pairwise(rows):
        before, after = previous.values[column], row.values[column]
        if not (after < before if decreasing else after > before):
            direction = "decrease" if decreasing else "increase"
            raise InputError(f"{path}, line {row.line}: {name} must {direction}, but {after:g} follows {before:g}.")


def read_records(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """Read rows of text by column name; lines that begin with ``#`` are comments.

    Parameters
    ----------
    path : Path
        CSV file.
    columns : sequence of str
        Columns that the file must have; it may have more.

    Returns
    -------
    list of dict
        Column name → text; None where a row is too short.

    Raises
    ------
    InputError
        A column is missing.
    """
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    records = csv.DictReader(lines)
    missing = [name for name in columns if name not in (records.fieldnames or ())]
    if missing:
        raise InputError(f"{path.name}: the columns {', '.join(missing)} are missing")
    return list(records)
