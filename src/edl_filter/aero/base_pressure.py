"""Base pressure from Viking's flights (thesis eqs. 11.3 and 11.4).

``Cp_base = a0 + a1/M + a2/M² + a3/M³`` and ``CA = CA_forebody − Cp_base``, at Mach 10 and below. The thesis's
text keeps the form but lost the four numbers; these are from memory of the MER, Phoenix and MSL database
papers, and agree with the thesis's check at Mach 1.9, where base pressure is 10 % of the forebody's. They lie
between zero and the vacuum limit from Mach 1.5 to Mach 9 and are held below Mach 1.5, where the cubic turns.

MEVAD's own tables (and the surrogate) have the base pressure in them; this is for forebody solutions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.grid import Array, GridTable

#: a0 … a3 of eq. 11.3.
COEFFICIENTS = (8.325e-3, 1.1293e-1, -1.801, 1.2885)
#: Above it the thesis's databases have no base pressure.
MACH_MAX = 10.0
#: Below it the cubic is held.
MACH_MIN = 1.5


def base_pressure_coefficient(mach: ArrayLike) -> Array:
    """Eq. 11.3: base pressure less ambient pressure over dynamic pressure; zero above Mach 10."""
    mach = np.asarray(mach, float)
    inverse = 1.0 / np.maximum(mach, MACH_MIN)
    a0, a1, a2, a3 = COEFFICIENTS
    return np.where(mach > MACH_MAX, 0.0, a0 + inverse * (a1 + inverse * (a2 + inverse * a3)))


def add_base_pressure(ca_forebody: ArrayLike, mach: ArrayLike) -> Array:
    """Eq. 11.4: CA of the whole body from CA of its forebody (gauge pressure)."""
    return np.asarray(ca_forebody, float) - base_pressure_coefficient(mach)


def with_base_pressure(table: GridTable) -> GridTable:
    """A continuum table of a forebody with eq. 11.4 applied: nodes are put in, so that the cubic is followed to 2e-4.

    The step of 0.003 at Mach 10, where the thesis's databases end the base pressure, stays a step (of Mach 0.001).
    """
    first, last = table.nodes[0], table.nodes[-1]
    more = np.concatenate((np.arange(0.4, 4.0, 0.05), np.arange(4.0, 10.0, 0.25), [MACH_MAX, MACH_MAX + 1e-3]))
    nodes = np.unique(np.concatenate((table.nodes, more[(more > first) & (more < last)])))

    def at_nodes(values: Array) -> Array:
        return np.stack([np.interp(nodes, table.nodes, column) for column in values.T], axis=1)

    ca = add_base_pressure(at_nodes(table.CA), nodes[:, None])
    source = f"{table.source}, base pressure by eq. 11.4"
    return replace(table, nodes=nodes, CA=ca, CN=at_nodes(table.CN), Cm=at_nodes(table.Cm), source=source)


def base_to_forebody_pressure(mach: ArrayLike, ca: ArrayLike, heat_capacity_ratio: float = 1.33) -> Array:
    """Mean base pressure over mean forebody pressure at zero angle, from CA of the whole body."""
    mach = np.asarray(mach, float)
    inverse = 1.0 / np.maximum(mach, MACH_MIN)
    a0, a1, a2, a3 = COEFFICIENTS
    cp_base = a0 + inverse * (a1 + inverse * (a2 + inverse * a3))  # also above Mach 10, to compare with the thesis
    dynamic = 0.5 * heat_capacity_ratio * mach**2
    return (1.0 + dynamic * cp_base) / (1.0 + dynamic * (np.asarray(ca, float) + cp_base))
