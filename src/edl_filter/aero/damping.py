"""Reading of pitch and yaw damping from CSV."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from edl_filter.aero.grid import Array
from edl_filter.aero.tables import read_rows
from edl_filter.errors import InputError


def read_damping(path: Path) -> tuple[Array, Array]:
    """Read ``mach,Cmq``: the moment coefficient over rate D / 2V, about body y and z alike.

    Returns
    -------
    mach, cmq : (N,) arrays

    Raises
    ------
    InputError
        Wrong header, a value that is no finite number, a negative Mach number, or Mach numbers that do not increase.
    """
    rows = read_rows(path, ("mach", "Cmq"))
    if rows[0].values[0] < 0.0:
        raise InputError(f"{path}, line {rows[0].line}: mach must not be negative, found {rows[0].values[0]:g}.")
    for before, row in pairwise(rows):
        if row.values[0] <= before.values[0]:
            raise InputError(
                f"{path}, line {row.line}: mach must increase, but {row.values[0]:g} follows {before.values[0]:g}."
            )
    mach, cmq = np.array([row.values for row in rows]).T
    return mach, cmq
