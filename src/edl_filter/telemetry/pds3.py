"""Read fixed-width ASCII tables of the Planetary Data System, version 3, as their labels describe them.

The label is trusted for what the columns are, and checked against the table for everything that can be
checked: a label that belongs to another table otherwise gives numbers that look right and are not.
(PDS Standards Reference 3.8, chapter 12: Object Description Language.)
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError

Array = NDArray[np.float64]
Label = dict[str, Any]

_COMMENT_OR_STRING = re.compile(r'"[^"]*"|/\*.*?\*/', re.DOTALL)
_STATEMENT = re.compile(
    r"""(?P<key>\^?[A-Za-z][\w:]*)\s*=\s*
        (?P<value>"[^"]*"|'[^'\n]*'|\([^)]*\)|\{[^}]*\}|[^\s"'({<]\S*)
        (?:[ \t]*<[^>\n]*>)?                # a unit after the value
      | (?P<end>END(?:_OBJECT|_GROUP)?)(?![\w:])""",
    re.VERBOSE,
)
_NUMERIC_TYPES = {"ASCII_REAL", "ASCII_INTEGER"}


@dataclass(frozen=True)
class Pds3Table:
    """A table and its label.

    Attributes
    ----------
    columns : dict of (N,) arrays
        Numeric columns by NAME, in the order of the label.
    units : dict of str
        UNIT of each column, ``""`` where the label gives none.
    label : dict
        What `read_label` gives.
    path : Path
        The table's file.
    files : dict
        Path → sha256 of the label and the table.
    """

    columns: dict[str, Array]
    units: dict[str, str]
    label: Label
    path: Path
    files: dict[str, str]

    def stack(self, *names: str) -> Array:
        """Columns side by side, ``(N, len(names))``; an `InputError` names one that is not there."""
        for name in names:
            if name not in self.columns:
                raise InputError(f"{self.path}: no column {name}; the label has {', '.join(self.columns)}.")
        return np.stack([self.columns[name] for name in names], axis=-1)


def _value(text: str) -> Any:
    """Turn a label's value into a number, string or list of strings."""
    if text[0] in "\"'":
        return " ".join(text[1:-1].split())
    if text[0] in "({":
        return [item.strip(" \t\r\n\"'") for item in text[1:-1].split(",")]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def _without_comments(text: str) -> str:
    """Label text with comments blanked, line breaks kept, and quoted strings left alone."""

    def blank(match: re.Match[str]) -> str:
        found = match.group()
        return found if found.startswith('"') else re.sub(r"[^\n]", " ", found)

    return _COMMENT_OR_STRING.sub(blank, text)


def _read_bytes(path: Path, what: str) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such {what}.") from None
    except OSError as error:
        raise InputError(f"{path}: the {what} cannot be read ({error.strerror}).") from None


def read_label(path: str | Path) -> Label:
    """Keywords and objects of a detached PDS3 label.

    Parameters
    ----------
    path : path of the ``.LBL`` file

    Returns
    -------
    dict
        Keyword → int, float, str or list of str. Objects and groups are nested: their name gives a *list*
        of such dicts, since a table has many ``COLUMN`` objects.

    Raises
    ------
    InputError
        The file is missing, is no PDS3 label, or a line of it cannot be understood (the line is named).
    """
    path = Path(path)
    text = _without_comments(_read_bytes(path, "label").decode("latin-1"))
    label: Label = {}
    stack: list[tuple[str, Label]] = [("", label)]
    position = 0
    while match := _STATEMENT.search(text, position):
        if text[position : match.start()].strip():
            break
        position = match.end()
        key, raw, end = match.group("key"), match.group("value"), match.group("end")
        if end == "END":
            break
        key = key.upper() if key else end
        if key in ("OBJECT", "GROUP"):
            inner: Label = {}
            stack[-1][1].setdefault(raw.upper(), []).append(inner)
            stack.append((raw.upper(), inner))
        elif key in ("END_OBJECT", "END_GROUP"):
            name, _ = stack.pop()
            if not stack or (raw is not None and raw.upper() != name):
                line = text.count("\n", 0, match.start()) + 1
                raise InputError(f"{path}, line {line}: {key} = {raw} closes no open object of that name.")
        else:
            stack[-1][1][key] = _value(raw)
    else:
        match = None
    if match is None or match.group("end") != "END":
        start = position + len(text[position:]) - len(text[position:].lstrip())
        found = text[start : start + 40].split("\n")[0].strip() or "the end of the file"
        line = text.count("\n", 0, start) + 1
        raise InputError(f"{path}, line {line}: found {found!r}; a PDS3 label has KEY = VALUE lines up to END.")
    if len(stack) > 1:
        raise InputError(f"{path}: OBJECT = {stack[-1][0]} is never closed by END_OBJECT.")
    if label.get("PDS_VERSION_ID") != "PDS3":
        raise InputError(f"{path}: PDS_VERSION_ID is {label.get('PDS_VERSION_ID')!r}, not PDS3.")
    return label


def find_file(folder: Path, name: str) -> Path | None:
    """File called `name` in `folder` whatever its case (copies of old volumes differ), or None."""
    if (folder / name).is_file():
        return folder / name
    if not folder.is_dir():
        return None
    return next((p for p in sorted(folder.iterdir()) if p.name.lower() == name.lower()), None)


def _integer(path: Path, block: Label, key: str) -> int:
    value = block.get(key)
    if not isinstance(value, int) or value < 1:
        raise InputError(f"{path}: {key} is {value!r}; a positive integer is needed.")
    return value


def _check_size(path: Path, label_path: Path, raw: bytes, rows: int, row_bytes: int) -> None:
    """Refuse a table whose length or line ends differ from what its label says."""
    if len(raw) != rows * row_bytes:
        lines = raw.count(b"\n")
        reason = "the table is truncated" if lines < rows else "the label disagrees with its table"
        if lines == rows and raw.count(b"\r\n") == 0:
            reason = "its CR-LF line ends were changed to LF in copying"
        raise InputError(
            f"{path}: {len(raw)} bytes in {lines} lines, but {label_path.name} says {rows} rows of "
            f"{row_bytes} bytes = {rows * row_bytes}; {reason}."
        )
    ends = np.frombuffer(raw, np.uint8).reshape(rows, row_bytes)[:, -1] != ord("\n")
    if ends.any():
        raise InputError(
            f"{path}, row {int(ends.argmax()) + 1}: no line end after ROW_BYTES = {row_bytes} bytes; "
            f"{label_path.name} disagrees with its table."
        )


def _column(path: Path, block: Label, name: str, table: NDArray[np.uint8], label_path: Path) -> Array:
    """One numeric column as float64, with the row named when a field is not a finite number."""
    start, width = _integer(label_path, block, "START_BYTE"), _integer(label_path, block, "BYTES")
    if start + width - 1 > table.shape[1]:
        raise InputError(
            f"{label_path}: column {name} ends at byte {start + width - 1}, beyond ROW_BYTES = {table.shape[1]}."
        )
    if "ITEMS" in block:
        raise InputError(f"{label_path}: column {name} has ITEMS; only columns of one item are read.")
    fields = np.ascontiguousarray(table[:, start - 1 : start - 1 + width]).view(f"S{width}")[:, 0]
    try:
        values = fields.astype(np.float64)
    except ValueError:
        values = np.array([_number_or_nan(field) for field in fields])
    bad = ~np.isfinite(values)
    if bad.any():
        row = int(bad.argmax())
        raise InputError(
            f"{path}, row {row + 1}, column {name}: found {fields[row].decode('latin-1').strip()!r}; "
            "a finite number is needed."
        )
    return values


def _number_or_nan(field: bytes) -> float:
    try:
        return float(field)
    except ValueError:
        return float("nan")


def read_table(label_path: str | Path) -> Pds3Table:
    """Read the ASCII table that a detached PDS3 label points to.

    Parameters
    ----------
    label_path : path of the label
        The table is the file that ``^TABLE`` names, in the same folder, in any case of letters.

    Returns
    -------
    Pds3Table

    Raises
    ------
    InputError
        A missing label or table; a table truncated or otherwise unlike ROW_BYTES, ROWS, FILE_RECORDS or
        COLUMNS of its label; a field that is not a finite number (file, row counted from 1, column).
    """
    label_path = Path(label_path)
    label = read_label(label_path)
    if not isinstance(label.get("^TABLE"), str) or "TABLE" not in label:
        raise InputError(f"{label_path}: no ^TABLE pointer to a file, or no TABLE object.")
    block = label["TABLE"][0]
    if block.get("INTERCHANGE_FORMAT") != "ASCII":
        found = block.get("INTERCHANGE_FORMAT")
        raise InputError(f"{label_path}: INTERCHANGE_FORMAT is {found!r}; only ASCII tables are read.")
    rows, row_bytes = _integer(label_path, block, "ROWS"), _integer(label_path, block, "ROW_BYTES")
    columns = block.get("COLUMN", [])
    for key, expected, meaning in (
        ("FILE_RECORDS", rows, "ROWS"),
        ("RECORD_BYTES", row_bytes, "ROW_BYTES"),
    ):
        if label.get(key, expected) != expected:
            raise InputError(f"{label_path}: {key} is {label[key]}, but {meaning} is {expected}.")
    if block.get("COLUMNS", len(columns)) != len(columns):
        raise InputError(f"{label_path}: COLUMNS is {block['COLUMNS']}, but it describes {len(columns)} columns.")
    path = find_file(label_path.parent, label["^TABLE"])
    if path is None:
        raise InputError(f"{label_path}: its table {label['^TABLE']} is not in {label_path.parent}.")
    raw = _read_bytes(path, "table")
    _check_size(path, label_path, raw, rows, row_bytes)
    table = np.frombuffer(raw, np.uint8).reshape(rows, row_bytes)
    values: dict[str, Array] = {}
    units: dict[str, str] = {}
    for column in columns:
        name = str(column.get("NAME", "without NAME"))
        if name in values:
            raise InputError(f"{label_path}: two columns are called {name}.")
        if column.get("DATA_TYPE") in _NUMERIC_TYPES:
            values[name] = _column(path, column, name, table, label_path)
            units[name] = str(column.get("UNIT", ""))
    files = {
        label_path.name: hashlib.sha256(label_path.read_bytes()).hexdigest(),
        path.name: hashlib.sha256(raw).hexdigest(),
    }
    return Pds3Table(values, units, label, path, files)
