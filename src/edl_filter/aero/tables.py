"""Reading of aerodynamic tables from CSV, with one clear message for each mistake.

Two forms: that of ``flight-file.md``, in order and with the moment about the nose; and the thesis's printed
form, in any order and with the moment about the table's own reference point.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from edl_filter.aero.grid import Array, GridTable, Interpolation, Kind
from edl_filter.errors import InputError

FORWARD = 45.0  # degrees; a blunt vehicle that flies nose first decelerates along its axis up to here at least

__all__ = ["GridTable", "move_moment_to_nose", "read_printed_table", "read_rows", "read_table"]


class Row(NamedTuple):
    """One line of numbers and its place in the file."""

    line: int
    values: list[float]


def read_table(path: Path, kind: Kind, interpolation: Interpolation = "linear") -> GridTable:
    """Read ``mach,alpha_deg,CA,CN,Cm`` or ``knudsen,alpha_deg,CA,CN,Cm``.

    Rows are grouped by Mach (or Knudsen) number, which increases, and the angle increases within each group.

    Raises
    ------
    InputError
        Wrong header, a value that is no finite number, nodes or angles unsorted or repeated, a grid with a hole, CA not
        positive at small angles.
    """
    rows = read_rows(path, (kind, "alpha_deg", "CA", "CN", "Cm"))
    _check_range(path, kind, rows)
    for before, row in pairwise(rows):
        x, angle = row.values[:2]
        x_before, angle_before = before.values[:2]
        if x < x_before:
            raise InputError(f"{path}, line {row.line}: {kind} must increase, but {x:g} follows {x_before:g}.")
        if x == x_before and angle == angle_before:
            raise InputError(f"{path}, line {row.line}: {kind} {x:g}, alpha_deg {angle:g} is there twice.")
        if x == x_before and angle < angle_before:
            raise InputError(
                f"{path}, line {row.line}: alpha_deg must increase within {kind} {x:g}, but {angle:g} follows "
                f"{angle_before:g}."
            )
    return _grid(path, kind, rows, interpolation)


def read_printed_table(
    path: Path, kind: Kind, x_mrp_over_d: float, interpolation: Interpolation = "linear"
) -> GridTable:
    """Read a table in the thesis's printed form and move its moment to the nose (eq. 11.1).

    Parameters
    ----------
    path : Path
        CSV with the header ``mach,alpha_total_deg,CA,CN,Cm`` (or ``knudsen,…``), rows in any order.
    kind : "mach" or "knudsen"
    x_mrp_over_d : float
        Distance of the table's moment reference point behind the nose, in diameters.
    interpolation : "linear" or "pchip"

    Raises
    ------
    InputError
        As `read_table`, but rows need no order.
    """
    rows = read_rows(path, (kind, "alpha_total_deg", "CA", "CN", "Cm"))
    _check_range(path, kind, rows)
    rows.sort(key=lambda row: row.values[:2])
    for before, row in pairwise(rows):
        if row.values[:2] == before.values[:2]:
            x, angle = row.values[:2]
            line = max(row.line, before.line)
            raise InputError(f"{path}, line {line}: {kind} {x:g}, alpha_total_deg {angle:g} is there twice.")
    table = _grid(path, kind, rows, interpolation)
    cm = move_moment_to_nose(table.Cm, table.CN, x_mrp_over_d)
    return GridTable(kind, table.nodes, table.alpha, table.CA, table.CN, cm, interpolation, table.source)


def move_moment_to_nose(cm_mrp: Array, cn: Array, x_mrp_over_d: float) -> Array:
    """Thesis eq. 11.1: ``Cm_nose = Cm_mrp − (x_mrp/D) CN``.

    The thesis's arm is positive for a point in front of the nose; here x_mrp is positive behind it, as vehicles
    have their centre of mass.
    """
    return cm_mrp - x_mrp_over_d * cn


def read_rows(path: Path, columns: tuple[str, ...]) -> list[Row]:
    """Rows of finite numbers of a CSV file with this header; ``#`` starts a comment.

    Raises
    ------
    InputError
        The file cannot be read, wrong header, no rows, a value that is no finite number.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path}: the aerodynamic table cannot be read ({error.strerror}).") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: the aerodynamic table is no text file.") from None
    content = [(n, line.split("#")[0].strip()) for n, line in enumerate(lines, 1)]
    content = [(n, line) for n, line in content if line]
    if not content or tuple(c.strip() for c in content[0][1].split(",")) != columns:
        found = f"'{content[0][1]}' in line {content[0][0]}" if content else "an empty file"
        raise InputError(f"{path}: the header must be {','.join(columns)}; found {found}.")
    if len(content) == 1:
        raise InputError(f"{path}: the table has a header but no rows.")
    return [Row(n, _numbers(path, n, line, len(columns))) for n, line in content[1:]]


def _numbers(path: Path, line: int, text: str, count: int) -> list[float]:
    try:
        values = [float(c) for c in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise InputError(f"{path}, line {line}: expected {count} finite numbers, found '{text}'.")
    return values


def _check_range(path: Path, kind: Kind, rows: list[Row]) -> None:
    for line, (x, angle, ca, *_) in rows:
        if x <= 0.0:
            raise InputError(f"{path}, line {line}: {kind} must be positive, found {x:g}.")
        if not 0.0 <= angle <= 180.0:
            raise InputError(f"{path}, line {line}: the total angle must lie in 0 to 180 degrees, found {angle:g}.")
        if angle < FORWARD and ca <= 0.0:
            raise InputError(
                f"{path}, line {line}: CA must be positive for a vehicle that flies nose first (below {FORWARD:g} "
                f"degrees), found {ca:g}; drag gives the density. Forces backward along the axis count positive."
            )


def _grid(path: Path, kind: Kind, rows: list[Row], interpolation: Interpolation) -> GridTable:
    nodes = sorted({row.values[0] for row in rows})
    angles = sorted({row.values[1] for row in rows})
    if len(nodes) < 2 or len(angles) < 2:
        raise InputError(
            f"{path}: at least 2 values of {kind} and 2 angles are needed; found {len(nodes)} and {len(angles)}."
        )
    lines = {(row.values[0], row.values[1]): row for row in rows}
    for x in nodes:
        for angle in angles:
            if (x, angle) not in lines:
                last = max(row.line for row in rows if row.values[0] == x)
                raise InputError(
                    f"{path}, line {last}: the grid has a hole: {kind} {x:g} has no row for {angle:g} degrees, "
                    "which other rows have; every angle is needed at every node."
                )
    values = np.array([[lines[x, angle].values[2:] for angle in angles] for x in nodes])
    ca, cn, cm = np.ascontiguousarray(np.moveaxis(values, 2, 0))
    return GridTable(kind, np.array(nodes), np.radians(angles), ca, cn, cm, interpolation, str(path))
