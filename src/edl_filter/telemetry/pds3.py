"""Reader of fixed-width ASCII tables of the Planetary Data System, version 3.

Input: a detached label, which names its table. Method: the label defines the columns (PDS Standards Reference 3.8,
chapter 12: Object Description Language); everything else in it is checked against the table, because a label of another
table would give plausible but wrong numbers. Output: numeric columns, units and the label (`Pds3Table`).
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError, quoted
from edl_filter.types import Array

Label = dict[str, Any]

_COMMENT_OR_STRING = re.compile(r'"[^"]*"|/\*.*?\*/', re.DOTALL)
_STATEMENT = re.compile(
    r"""(?P<key>\^?[A-Za-z][\w:]*)\s*=\s*
        (?P<value>"[^"]*"|'[^'\n]*'|\([^)]*\)|\{[^}]*\}|[^\s"'({<]\S*)
        (?:[ \t]*<[^>\n]*>)?                # a unit after the value
      | (?P<end>END(?:_OBJECT|_GROUP)?)(?![\w:])""",
    re.VERBOSE,
)
#: Longest name of a table: file systems have no longer ones.
_LONGEST_NAME = 200
_NUMERIC_TYPES = {"ASCII_REAL", "ASCII_INTEGER"}


@dataclass(frozen=True)
class Pds3Table:
    """A table and its label.

    Attributes
    ----------
    columns : dict of (N,) arrays
        Numeric columns by NAME, in the order of the label and in its units.
    units : dict of str
        UNIT of each column, ``""`` where the label gives none.
    label : dict
        Result of `read_label`.
    path : Path
        File of the table.
    files : dict
        Path → sha256 of the label and the table.
    """

    columns: dict[str, Array]
    units: dict[str, str]
    label: Label
    path: Path
    files: dict[str, str]

    def stack(self, *names: str) -> Array:
        """Columns by name, side by side.

        Parameters
        ----------
        *names : str
            NAME of each column.

        Returns
        -------
        (N, C) array
            One column for each name, in its unit.

        Raises
        ------
        InputError
            There is no such column.
        """
        for name in names:
            if name not in self.columns:
                raise InputError(f"{self.path}: no column {name}; the label has {', '.join(self.columns)}.")
        return np.stack([self.columns[name] for name in names], axis=-1)


def _are_objects(value: Any) -> bool:
    """Whether a label's entry is what `read_label` makes of objects, and not a keyword's value."""
    return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)


def _parsed(text: str) -> Any:
    """Convert a value of a label into a number, a string or a list of strings."""
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
    """Label text with comments replaced by blanks; line breaks and quoted strings are unchanged."""

    def blank(match: re.Match[str]) -> str:
        text = match.group()
        return text if text.startswith('"') else re.sub(r"[^\n]", " ", text)

    return _COMMENT_OR_STRING.sub(blank, text)


def _read_bytes(path: Path, description: str) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such {description}.") from None
    except OSError as error:
        raise InputError(f"{path}: the {description} cannot be read ({error.strerror}).") from None


def read_label(path: str | Path) -> Label:
    """Keywords and objects of a detached PDS3 label.

    Parameters
    ----------
    path : path
        The ``.LBL`` file.

    Returns
    -------
    dict
        Keyword → int, float, str or list of str. Objects and groups are nested: the name of an object is the key of a
        *list* of such dicts, since a table has many ``COLUMN`` objects.

    Raises
    ------
    InputError
        The file is missing, is no PDS3 label, or has a line that cannot be parsed (the message names the line).
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
        key, value, end = match.group("key"), match.group("value"), match.group("end")
        if end == "END":
            break
        key = key.upper() if key else end
        if key in ("OBJECT", "GROUP"):
            inner: Label = {}
            siblings = stack[-1][1].setdefault(value.upper(), [])
            if siblings != [] and not _are_objects(siblings):
                line = text.count("\n", 0, match.start()) + 1
                raise InputError(f"{path}, line {line}: {key} = {str(value)[:80]}: this is a keyword, too.")
            siblings.append(inner)
            stack.append((value.upper(), inner))
        elif key in ("END_OBJECT", "END_GROUP"):
            name, _ = stack.pop()
            if not stack or (value is not None and value.upper() != name):
                line = text.count("\n", 0, match.start()) + 1
                raise InputError(f"{path}, line {line}: {key} = {str(value)[:80]} closes no open object of that name.")
        else:
            stack[-1][1][key] = _parsed(value)
    else:
        match = None
    if match is None or match.group("end") != "END":
        start = position + len(text[position:]) - len(text[position:].lstrip())
        statement = text[start : start + 40].split("\n")[0].strip() or "the end of the file"
        line = text.count("\n", 0, start) + 1
        raise InputError(f"{path}, line {line}: found {statement!r}; a PDS3 label has KEY = VALUE lines up to END.")
    if len(stack) > 1:
        raise InputError(f"{path}: OBJECT = {stack[-1][0][:80]} is never closed by END_OBJECT.")
    if label.get("PDS_VERSION_ID") != "PDS3":
        raise InputError(f"{path}: PDS_VERSION_ID is {quoted(label.get('PDS_VERSION_ID'))}, not PDS3.")
    return label


def find_file(folder: Path, name: str) -> Path | None:
    """File `name` in `folder`, in any case of letters (copies of old volumes differ), or None."""
    if (folder / name).is_file():
        return folder / name
    if not folder.is_dir():
        return None
    return next((p for p in sorted(folder.iterdir()) if p.name.lower() == name.lower()), None)


def find_in_volume(folder: Path, name: str) -> Path | None:
    """File `name` of a volume, from the volume's folder or its DATA folder, or None."""
    return find_file(folder / "DATA", name) or find_file(folder, name)


def _positive_integer(path: Path, label: Label, key: str) -> int:
    value = label.get(key)
    if not isinstance(value, int) or value < 1:
        raise InputError(f"{path}: {key} is {quoted(value)}; a positive integer is needed.")
    return value


def _check_size(path: Path, label_path: Path, raw: bytes, rows: int, row_bytes: int) -> None:
    """Raise if the table's length or line ends differ from those in its label."""
    if len(raw) != rows * row_bytes:
        lines = raw.count(b"\n")
        reason = "the table is truncated" if lines < rows else "the label disagrees with its table"
        if lines == rows and raw.count(b"\r\n") == 0:
            reason = "its CR-LF line ends were changed to LF in copying"
        raise InputError(
            f"{path}: {len(raw)} bytes in {lines} lines, but {label_path.name} says {rows} rows of "
            f"{row_bytes} bytes = {rows * row_bytes}; {reason}."
        )
    without_line_end = np.frombuffer(raw, np.uint8).reshape(rows, row_bytes)[:, -1] != ord("\n")
    if without_line_end.any():
        raise InputError(
            f"{path}, row {int(without_line_end.argmax()) + 1}: no line end after ROW_BYTES = {row_bytes} bytes; "
            f"{label_path.name} disagrees with its table."
        )


def _column(path: Path, column_label: Label, name: str, table: NDArray[np.uint8], label_path: Path) -> Array:
    """One numeric column (N,) as float64; an error names the row of a field that is no finite number."""
    start = _positive_integer(label_path, column_label, "START_BYTE")
    width = _positive_integer(label_path, column_label, "BYTES")
    if start + width - 1 > table.shape[1]:
        raise InputError(
            f"{label_path}: column {name[:80]} ends at byte {start + width - 1}, beyond ROW_BYTES = {table.shape[1]}."
        )
    if "ITEMS" in column_label:
        raise InputError(f"{label_path}: column {name[:80]} has ITEMS; only columns of one item are read.")
    fields = np.ascontiguousarray(table[:, start - 1 : start - 1 + width]).view(f"S{width}")[:, 0]
    try:
        values = fields.astype(np.float64)
    except ValueError:
        values = np.array([_number_or_nan(field) for field in fields])
    not_finite = ~np.isfinite(values)
    if not_finite.any():
        row = int(not_finite.argmax())
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
    label_path : path
        The table is the file that ``^TABLE`` names, in the folder of the label, in any case of letters.

    Returns
    -------
    Pds3Table

    Raises
    ------
    InputError
        A missing label or table; a table that is truncated or differs from ROW_BYTES, ROWS, FILE_RECORDS or COLUMNS of
        its label; a field that is not a finite number (the message names file, row counted from 1, and column).
    """
    label_path = Path(label_path)
    label = read_label(label_path)
    if not isinstance(label.get("^TABLE"), str) or not _are_objects(label.get("TABLE")):
        raise InputError(f"{label_path}: no ^TABLE pointer to a file, or no TABLE object.")
    table_label = label["TABLE"][0]
    if table_label.get("INTERCHANGE_FORMAT") != "ASCII":
        interchange_format = table_label.get("INTERCHANGE_FORMAT")
        raise InputError(
            f"{label_path}: INTERCHANGE_FORMAT is {quoted(interchange_format)}; only ASCII tables are read."
        )
    rows = _positive_integer(label_path, table_label, "ROWS")
    row_bytes = _positive_integer(label_path, table_label, "ROW_BYTES")
    columns = table_label.get("COLUMN", [])
    if not _are_objects(columns) and columns != []:
        raise InputError(f"{label_path}: COLUMN is {quoted(columns)}; objects are needed.")
    for key, expected, table_key in (
        ("FILE_RECORDS", rows, "ROWS"),
        ("RECORD_BYTES", row_bytes, "ROW_BYTES"),
    ):
        if label.get(key, expected) != expected:
            raise InputError(f"{label_path}: {key} is {str(label[key])[:80]}, but {table_key} is {expected}.")
    if table_label.get("COLUMNS", len(columns)) != len(columns):
        raise InputError(
            f"{label_path}: COLUMNS is {str(table_label['COLUMNS'])[:80]}, but it describes {len(columns)} columns."
        )
    if Path(label["^TABLE"]).name != label["^TABLE"] or len(label["^TABLE"]) > _LONGEST_NAME:
        raise InputError(
            f"{label_path}: ^TABLE is {quoted(label['^TABLE'])}; the name of a file in its folder is needed."
        )
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
            raise InputError(f"{label_path}: two columns are called {name[:80]}.")
        if column.get("DATA_TYPE") in _NUMERIC_TYPES:
            values[name] = _column(path, column, name, table, label_path)
            units[name] = str(column.get("UNIT", ""))
    files = {
        label_path.name: hashlib.sha256(label_path.read_bytes()).hexdigest(),
        path.name: hashlib.sha256(raw).hexdigest(),
    }
    return Pds3Table(values, units, label, path, files)
