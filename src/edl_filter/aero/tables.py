"""Reader of aerodynamic tables in CSV, with an error message for each kind of mistake.

Input: a file in one of two formats. `read_table`: rows in order, moment about the nose. `read_printed_table`: the
format of the thesis's printed tables, rows in any order, moment about the reference point of the table. Output: a
`GridTable`.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from edl_filter.aero.grid import GridTable, Interpolation, Kind
from edl_filter.errors import InputError
from edl_filter.io.csv_table import Row, read_rows
from edl_filter.types import Array

#: Total angle, degrees, up to which CA of a blunt vehicle that flies nose first is positive at least.
FORWARD_DEG = 45.0

__all__ = ["GridTable", "move_moment_to_nose", "read_printed_table", "read_table"]


def read_table(path: Path, kind: Kind, interpolation: Interpolation = "linear") -> GridTable:
    """Read a table with the header ``mach,alpha_deg,CA,CN,Cm`` or ``knudsen,alpha_deg,CA,CN,Cm``.

    Rows are grouped by Mach (or Knudsen) number, which increases, and the angle increases within each group.

    Parameters
    ----------
    path : Path
        CSV of Mach (or Knudsen) numbers, total angles (degrees) and coefficients, Cm about the nose.
    kind : "mach" or "knudsen"
        Quantity of the first column.
    interpolation : "linear" or "pchip"
        Interpolation in the angle.

    Returns
    -------
    GridTable

    Raises
    ------
    InputError
        Wrong header, a value that is no finite number, nodes or angles unsorted or repeated, a grid with a hole, CA not
        positive at small angles.
    """
    rows = read_rows(path, (kind, "alpha_deg", "CA", "CN", "Cm"), "aerodynamic table")
    _check_range(path, kind, rows)
    for previous, row in pairwise(rows):
        x, angle = row.values[:2]
        x_before, angle_before = previous.values[:2]
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
    """Read a table in the thesis's printed format and transfer its moment to the nose (eq. 11.1).

    Parameters
    ----------
    path : Path
        CSV with the header ``mach,alpha_total_deg,CA,CN,Cm`` (or ``knudsen,…``), rows in any order.
    kind : "mach" or "knudsen"
        Quantity of the first column.
    x_mrp_over_d : float
        Distance of the table's moment reference point behind the nose, in diameters.
    interpolation : "linear" or "pchip"
        Interpolation in the angle.

    Returns
    -------
    GridTable

    Raises
    ------
    InputError
        As for `read_table`, except that rows may be in any order.
    """
    rows = read_rows(path, (kind, "alpha_total_deg", "CA", "CN", "Cm"), "aerodynamic table")
    _check_range(path, kind, rows)
    rows.sort(key=lambda row: row.values[:2])
    for previous, row in pairwise(rows):
        if row.values[:2] == previous.values[:2]:
            x, angle = row.values[:2]
            line = max(row.line, previous.line)
            raise InputError(f"{path}, line {line}: {kind} {x:g}, alpha_total_deg {angle:g} is there twice.")
    table = _grid(path, kind, rows, interpolation)
    cm = move_moment_to_nose(table.Cm, table.CN, x_mrp_over_d)
    return GridTable(kind, table.nodes, table.alpha, table.CA, table.CN, cm, interpolation, table.source)


def move_moment_to_nose(cm_mrp: Array, cn: Array, x_mrp_over_d: float) -> Array:
    """Transfer of a pitching moment to the nose (thesis eq. 11.1): ``Cm_nose = Cm_mrp − (x_mrp/D) CN``.

    The thesis's arm is positive for a point in front of the nose; x_mrp is positive behind it.

    Parameters
    ----------
    cm_mrp, cn : (...) arrays
        Cm about the moment reference point, and CN.
    x_mrp_over_d : float
        Distance of the moment reference point behind the nose, in diameters.

    Returns
    -------
    (...) array
        Cm about the nose.
    """
    return cm_mrp - x_mrp_over_d * cn


def _check_range(path: Path, kind: Kind, rows: list[Row]) -> None:
    """Raise if a value is impossible for a vehicle that flies nose first."""
    for line, (x, angle, ca, *_) in rows:
        if x <= 0.0:
            raise InputError(f"{path}, line {line}: {kind} must be positive, found {x:g}.")
        if not 0.0 <= angle <= 180.0:
            raise InputError(f"{path}, line {line}: the total angle must lie in 0 to 180 degrees, found {angle:g}.")
        if angle < FORWARD_DEG and ca <= 0.0:
            raise InputError(
                f"{path}, line {line}: CA must be positive for a vehicle that flies nose first (below {FORWARD_DEG:g} "
                f"degrees), found {ca:g}; drag gives the density. Forces backward along the axis count positive."
            )


def _grid(path: Path, kind: Kind, rows: list[Row], interpolation: Interpolation) -> GridTable:
    """Table from rows of a full grid; raises if a row is missing."""
    nodes = sorted({row.values[0] for row in rows})
    angles = sorted({row.values[1] for row in rows})
    if len(nodes) < 2 or len(angles) < 2:
        raise InputError(
            f"{path}: at least 2 values of {kind} and 2 angles are needed; found {len(nodes)} and {len(angles)}."
        )
    row_at = {(row.values[0], row.values[1]): row for row in rows}
    for x in nodes:
        for angle in angles:
            if (x, angle) not in row_at:
                last = max(row.line for row in rows if row.values[0] == x)
                raise InputError(
                    f"{path}, line {last}: the grid has a hole: {kind} {x:g} has no row for {angle:g} degrees, "
                    "which other rows have; every angle is needed at every node."
                )
    values = np.array([[row_at[x, angle].values[2:] for angle in angles] for x in nodes])
    ca, cn, cm = np.ascontiguousarray(np.moveaxis(values, 2, 0))
    return GridTable(kind, np.array(nodes), np.radians(angles), ca, cn, cm, interpolation, str(path))
