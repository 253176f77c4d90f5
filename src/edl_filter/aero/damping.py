"""Table of pitch and yaw damping: read from CSV.

Input: a file of Mach numbers and damping coefficients. Output: both as arrays.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from edl_filter.errors import InputError
from edl_filter.io.csv_table import check_monotonic, read_rows
from edl_filter.types import Array


def read_damping(path: Path) -> tuple[Array, Array]:
    """Read a CSV with the header ``mach,Cmq``.

    Cmq is the derivative of the moment coefficient with respect to the rate times D / 2V, for pitch and yaw alike.

    Parameters
    ----------
    path : Path
        CSV file; ``#`` starts a comment.

    Returns
    -------
    mach, cmq : (N,) arrays
        Cmq per rad.

    Raises
    ------
    InputError
        Wrong header, a value that is no finite number, a negative Mach number, or Mach numbers that do not increase.
    """
    rows = read_rows(path, ("mach", "Cmq"), "aerodynamic table")
    if rows[0].values[0] < 0.0:
        raise InputError(f"{path}, line {rows[0].line}: mach must not be negative, found {rows[0].values[0]:g}.")
    check_monotonic(path, rows, 0, "mach")
    mach, cmq = np.array([row.values for row in rows]).T
    return mach, cmq
