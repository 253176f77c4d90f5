"""Pitch and yaw damping against Mach number.

Input: a CSV file of Mach numbers and damping coefficients. Output: `Damping`, which interpolates them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from edl_filter.errors import InputError
from edl_filter.io.csv_table import check_monotonic, read_rows
from edl_filter.types import Array


@dataclass(frozen=True)
class Damping:
    """Pitch and yaw damping against Mach number, linear between nodes and held at the edges.

    Attributes
    ----------
    mach, cmq : (M,) arrays
        Nodes, and the moment coefficient over rate D / 2V there.
    """

    mach: Array = field(default_factory=lambda: np.array([0.0, 1.0]))
    cmq: Array = field(default_factory=lambda: np.zeros(2))

    def at(self, mach: Array) -> Array:
        """Coefficient ``(N,)`` at Mach numbers ``(N,)``."""
        return np.interp(mach, self.mach, self.cmq)


def read_damping(path: Path) -> Damping:
    """Read a CSV with the header ``mach,Cmq``.

    Cmq is the derivative of the moment coefficient with respect to the rate times D / 2V, for pitch and yaw alike.

    Parameters
    ----------
    path : Path
        CSV file; ``#`` starts a comment.

    Returns
    -------
    Damping
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
    return Damping(mach, cmq)
