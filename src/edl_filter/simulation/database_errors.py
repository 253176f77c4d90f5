"""Random errors of an aerodynamic database: one smooth Gaussian field over the flow for each coefficient.

The fields are squared exponential in ln Mach (in rarefied flow, log10 Kn) and in the total angle, with a third of the
database's three sigma as standard deviation. Those of CN and Cm vanish at zero angle, where both are zero by symmetry.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.aero.database import Database
from edl_filter.aero.grid import GridTable
from edl_filter.aero.uncertainty import three_sigma
from edl_filter.errors import InputError
from edl_filter.estimation.random_fields import smooth_field

#: Correlation lengths of the errors, and angle at which those of CN and Cm have grown to 0.76 of their sigma.
LN_MACH_LENGTH, DECADES_LENGTH, ANGLE_LENGTH_DEG, ODD_ANGLE_DEG = 0.5, 1.0, 6.0, 4.0


def table_with_errors(random: np.random.Generator, table: GridTable, family: str, scale: float = 1.0) -> GridTable:
    """A table with errors drawn at its nodes; between them it is interpolated as the nominal one.

    Parameters
    ----------
    random : Generator
        Source of the errors.
    table : GridTable
        Nominal coefficients.
    family : str
        Vehicle family, which determines the three sigma.
    scale : float
        Factor on the standard deviation.

    Returns
    -------
    GridTable
    """
    angle = np.degrees(table.alpha)
    if table.kind == "mach":
        points, length, knudsen = np.log(table.nodes), LN_MACH_LENGTH, 0.0
    else:  # the whole table is rarefied flow, its first node too
        points, length, knudsen = np.log10(table.nodes), DECADES_LENGTH, np.inf
    sigma = three_sigma(family, table.nodes[:, None], knudsen, table.CA)
    ca, cn, cm = (scale * smooth_field(random, points, length, angle, ANGLE_LENGTH_DEG) for _ in range(3))
    odd = np.tanh(angle / ODD_ANGLE_DEG)
    return replace(
        table,
        CA=table.CA + sigma.ca / 3.0 * ca,
        CN=table.CN + sigma.cn / 3.0 * cn * odd,
        Cm=table.Cm + sigma.cm / 3.0 * cm * odd,
    )


def database_with_errors(
    random: np.random.Generator, database: Database, family: str, label: str, scale: float = 1.0
) -> Database:
    """A database both of whose tables have random errors.

    Parameters
    ----------
    random : Generator
        Source of the errors.
    database : Database
        Nominal.
    family : str
        Vehicle family, which determines the three sigma.
    label : str
        Name of the mission, for the message.
    scale : float
        Factor on the standard deviation.

    Returns
    -------
    Database

    Raises
    ------
    InputError
        A table is no grid.
    """
    tables: list[GridTable] = []
    for regime in ("continuum", "rarefied"):
        table = getattr(database, regime)
        if not isinstance(table, GridTable):
            raise InputError(
                f"{label}: aerodynamics.{regime}: found a table that is no grid; random errors of the database need "
                f"a grid of nodes, such as builtin:{regime}_grid."
            )
        tables.append(table_with_errors(random, table, family, scale))
    return replace(database, continuum=tables[0], rarefied=tables[1])
