"""Base pressure from Viking's flights (thesis eqs. 11.3 and 11.4), to be added to tables of a forebody.

Input: Mach numbers, or a continuum table of a forebody. Method: ``Cp_base = a0 + a1/M + a2/M² + a3/M³`` and
``CA = CA_forebody − Cp_base``, at Mach 10 and below. Output: coefficients, or a table, of the whole body.

The equations are in the thesis's text, but the four numbers are missing there. The numbers in `COEFFICIENTS` were
recalled from the MER, Phoenix and MSL database papers. They agree with the thesis's check at Mach 1.9, where the base
pressure is 10 % of the forebody's. From Mach 1.5 to Mach 9 Cp_base is between the vacuum limit and zero; below Mach
1.5, where the slope of the cubic changes sign, its value at Mach 1.5 is used.

MEVAD's tables (and the surrogate) include the base pressure.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.grid import GridTable
from edl_filter.estimation.series import interpolate_columns
from edl_filter.types import Array

#: a0 to a3 of eq. 11.3.
COEFFICIENTS = (8.325e-3, 1.1293e-1, -1.801, 1.2885)
#: Mach number above which the thesis's databases have no base pressure.
MACH_MAX = 10.0
#: Mach number below which the value of the cubic is constant.
MACH_MIN = 1.5


def base_pressure_coefficient(mach: ArrayLike) -> Array:
    """Base pressure coefficient (eq. 11.3): base pressure minus ambient pressure, over dynamic pressure.

    Parameters
    ----------
    mach : (...) array
        Mach number.

    Returns
    -------
    (...) array
        Zero above Mach 10.
    """
    mach = np.asarray(mach, float)
    inverse = 1.0 / np.maximum(mach, MACH_MIN)
    a0, a1, a2, a3 = COEFFICIENTS
    return np.where(mach > MACH_MAX, 0.0, a0 + inverse * (a1 + inverse * (a2 + inverse * a3)))


def add_base_pressure(ca_forebody: ArrayLike, mach: ArrayLike) -> Array:
    """Axial force coefficient of the whole body (eq. 11.4).

    Parameters
    ----------
    ca_forebody : (...) array
        CA of the forebody, from pressures relative to ambient pressure.
    mach : (...) array
        Mach number.

    Returns
    -------
    (...) array
    """
    return np.asarray(ca_forebody, float) - base_pressure_coefficient(mach)


def with_base_pressure(table: GridTable) -> GridTable:
    """Continuum table of the whole body from that of a forebody (eq. 11.4).

    Nodes are added, so that linear interpolation approximates the cubic to 2e-4. The discontinuity of 0.003 at Mach 10,
    where the base pressure of the thesis's databases ends, becomes a step over Mach 0.001.
    """
    first, last = table.nodes[0], table.nodes[-1]
    added = np.concatenate((np.arange(0.4, 4.0, 0.05), np.arange(4.0, 10.0, 0.25), [MACH_MAX, MACH_MAX + 1e-3]))
    nodes = np.unique(np.concatenate((table.nodes, added[(added > first) & (added < last)])))

    def at_nodes(values: Array) -> Array:
        return interpolate_columns(nodes, table.nodes, values)

    ca = add_base_pressure(at_nodes(table.CA), nodes[:, None])
    source = f"{table.source}, base pressure by eq. 11.4"
    return replace(table, nodes=nodes, CA=ca, CN=at_nodes(table.CN), Cm=at_nodes(table.Cm), source=source)
