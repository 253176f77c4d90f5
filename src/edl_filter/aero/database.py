"""Aerodynamic database of a vehicle: continuum and rarefied tables, joined, with their uncertainties.

Input: names of built-in tables, or CSV files (`load_database`). Output: a `Database`, which gives total coefficients
with three sigma at Mach numbers, Knudsen numbers and total angles of attack (`Database.lookup`), or the curves over
the angle for the inverse look-up (`Database.at`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.base_pressure import with_base_pressure
from edl_filter.aero.body import SphereCone, sphere_cone
from edl_filter.aero.grid import GridTable, Interpolation, Kind
from edl_filter.aero.increment_tables import IncrementTables, increment_terms
from edl_filter.aero.newtonian import newtonian_table
from edl_filter.aero.planes import moments_at_cm, split
from edl_filter.aero.regimes import CONTINUUM_KNUDSEN
from edl_filter.aero.surrogate import Surrogate, phoenix_surrogate
from edl_filter.aero.tables import read_printed_table, read_table
from edl_filter.aero.transition import FreeMolecularBridge, Join, WeightedSum, join_regimes
from edl_filter.aero.uncertainty import ThreeSigma, three_sigma
from edl_filter.errors import InputError
from edl_filter.io.csv_table import package_data
from edl_filter.types import Array, BoolArray

__all__ = [
    "Coefficients",
    "Database",
    "load_database",
    "moments_at_cm",
    "split",
]

#: Mach numbers between which the index of a database that is indexed by speed changes from Mach number to speed. The
#: kernel of the simulation contains them (`simulation.dynamics`); numba compiles it again when its own file changes.
INDEX_MACH = (8.0, 9.0)

NEWTONIAN = "builtin:newtonian"
BUILTIN_CONTINUUM = ("builtin:surrogate", "builtin:continuum_grid", NEWTONIAN)
BUILTIN_RAREFIED = ("builtin:free_molecular", "builtin:rarefied_grid")


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Total coefficients, all arrays of one shape.

    Attributes
    ----------
    ca, cn, cm_nose : (...) arrays
        In the plane of the total angle; the moment about the nose.
    outside : (...) boolean array
        True outside a table, where its value at the edge is used.
    three_sigma : ThreeSigma
        Uncertainties of the database.
    rarefied : (...) boolean array
        True where the Knudsen number is above the continuum limit.
    """

    ca: Array
    cn: Array
    cm_nose: Array
    outside: BoolArray
    three_sigma: ThreeSigma
    rarefied: BoolArray

    def cm_at(self, x_over_d: ArrayLike) -> Array:
        """Pitching moment about another point of the axis, ``Cm_nose + x CN``.

        Parameters
        ----------
        x_over_d : (...) array
            Distance of the point behind the nose, in diameters.

        Returns
        -------
        (...) array
        """
        return self.cm_nose + np.asarray(x_over_d, float) * self.cn


@dataclass(frozen=True, eq=False)
class Database:
    """Look-up in Mach number, Knudsen number and total angle of attack.

    Attributes
    ----------
    continuum : GridTable or Surrogate
    rarefied : GridTable or FreeMolecularBridge
    continuum_limit : float
        Knudsen number, based on the diameter, up to which the flow is a continuum.
    join : "switch", "blend" or "continuous"
        See `edl_filter.aero.transition`.
    family : "MER" or "Phoenix"
        Vehicle family of the uncertainties.
    speed_per_mach : float or None
        If given, m/s: above Mach 9 the continuum table is indexed by speed/speed_per_mach instead of the Mach number,
        below Mach 8 by the Mach number, with a linear transition in between. A table of one vehicle is thus a proxy
        for another one that flies at the same speed in another atmosphere. With 205.8 m/s Phoenix's CA(speed) agrees
        with its CA(Mach) from 900 to 4200 m/s (RMS difference 0.003).
    increments : IncrementTables, optional
        Added to the tables: what another flight says of them.
    """

    continuum: GridTable | Surrogate
    rarefied: GridTable | FreeMolecularBridge
    continuum_limit: float = CONTINUUM_KNUDSEN
    join: Join = "continuous"
    family: str = "Phoenix"
    speed_per_mach: float | None = None
    increments: IncrementTables | None = None

    def at(self, mach: ArrayLike, knudsen: ArrayLike, speed: ArrayLike | None = None) -> WeightedSum:
        """Slice: the curves over the angle of N samples.

        Parameters
        ----------
        mach, knudsen : (N,) arrays
            Mach number, and Knudsen number based on the diameter.
        speed : (N,) array, optional
            Air-relative speed, m/s; needed if the database is indexed by speed.

        Returns
        -------
        WeightedSum

        Raises
        ------
        ValueError
            The database is indexed by speed and no speed is given.
        """
        mach, knudsen = np.broadcast_arrays(np.asarray(mach, float), np.asarray(knudsen, float))
        continuum = self.continuum.at(self._index(mach, speed))
        joined = join_regimes(continuum, self.rarefied, knudsen, self.continuum_limit, self.join)
        if self.increments is None:
            return joined
        return WeightedSum([*joined.terms, *increment_terms(self.increments.mean, mach, knudsen, self.continuum_limit)])

    def lookup(
        self, mach: ArrayLike, knudsen: ArrayLike, alpha_total: ArrayLike, speed: ArrayLike | None = None
    ) -> Coefficients:
        """Coefficients at Mach numbers, Knudsen numbers and total angles.

        Parameters
        ----------
        mach, knudsen : (...) arrays
            Mach number, and Knudsen number based on the diameter.
        alpha_total : (...) array
            Total angle of attack, rad, ≥ 0.
        speed : (...) array, optional
            Air-relative speed, m/s; needed if the database is indexed by speed. All arguments broadcast.

        Returns
        -------
        Coefficients

        Raises
        ------
        ValueError
            The database is indexed by speed and no speed is given.
        """
        inputs = (mach, knudsen, alpha_total, np.nan if speed is None else speed)
        mach, knudsen, alpha, speeds = np.broadcast_arrays(*(np.asarray(x, float) for x in inputs))
        shape = mach.shape
        curves = self.at(mach.ravel(), knudsen.ravel(), None if speed is None else speeds.ravel())
        ca, cn, cm = curves.evaluate(alpha.ravel()).reshape(3, *shape)
        sigma = three_sigma(self.family, mach, knudsen, ca, self.continuum_limit)
        outside = curves.outside_at(alpha.ravel()).reshape(shape)
        return Coefficients(ca, cn, cm, outside, sigma, knudsen > self.continuum_limit)

    def _index(self, mach: Array, speed: ArrayLike | None) -> Array:
        """Mach numbers (N,) at which the continuum table is evaluated."""
        if self.speed_per_mach is None:
            return mach
        if speed is None:
            raise ValueError("this database is indexed by speed: give the speed with the Mach number")
        low, high = INDEX_MACH
        weight = np.clip((mach - low) / (high - low), 0.0, 1.0)
        return mach + weight * (np.asarray(speed, float) / self.speed_per_mach - mach)


def load_database(
    continuum: str | Path = "builtin:surrogate",
    rarefied: str | Path = "builtin:free_molecular",
    *,
    continuum_limit: float = CONTINUUM_KNUDSEN,
    join: Join | None = None,
    family: str = "Phoenix",
    speed_per_mach: float | None = None,
    interpolation: Interpolation = "linear",
    body: str | SphereCone | None = None,
    base_pressure: bool = False,
    continuum_moment_point: float | None = None,
    rarefied_moment_point: float | None = None,
) -> Database:
    """Load a database from built-in tables or from files.

    Parameters
    ----------
    continuum : str or Path
        ``builtin:surrogate``, ``builtin:continuum_grid``, ``builtin:newtonian`` or a CSV file
        (`edl_filter.aero.tables.read_table`).
    rarefied : str or Path
        ``builtin:free_molecular``, ``builtin:rarefied_grid`` or a CSV file.
    continuum_limit, family, speed_per_mach
        As in `Database`.
    join : "switch", "blend", "continuous" or None
        None means "continuous" for free-molecular panels and "switch" for tables.
    interpolation : "linear" or "pchip"
        In the angle, for tables.
    body : str, SphereCone or None
        Vehicle name or forebody for the free-molecular panels and the Newtonian table; None means that of the family.
    base_pressure : bool
        Subtract the base pressure coefficient from CA (eq. 11.4). For continuum tables of a forebody, which the first
        two built-in tables are not.
    continuum_moment_point, rarefied_moment_point : float or None
        Moment reference point behind the nose, in diameters, of a file in the thesis's printed format
        (`edl_filter.aero.tables.read_printed_table`); None means a file with moments about the nose.

    Returns
    -------
    Database

    Raises
    ------
    InputError
        No such built-in table, a file that cannot be used, no such family, or base pressure for a table that includes
        it.
    """
    three_sigma(family, 20.0, 1e-5, 1.7)  # raises for an unknown family now, not at the first look-up
    forebody = body if isinstance(body, SphereCone) else sphere_cone(body or family)
    continuum_table: GridTable | None
    if continuum == NEWTONIAN and continuum_moment_point is None:
        continuum_table = newtonian_table(forebody)
    else:
        continuum_table = _table(continuum, "mach", BUILTIN_CONTINUUM, interpolation, continuum_moment_point)
    if base_pressure:
        if continuum_table is None or continuum in BUILTIN_CONTINUUM[:2]:
            raise InputError(
                f"aerodynamics.base_pressure: {continuum} has the base pressure in it already; leave the key out, or "
                f"use {NEWTONIAN} or a table of a forebody."
            )
        continuum_table = with_base_pressure(continuum_table)
    rarefied_table: GridTable | FreeMolecularBridge | None = _table(
        rarefied, "knudsen", BUILTIN_RAREFIED, interpolation, rarefied_moment_point
    )
    if rarefied_table is None:
        rarefied_table = FreeMolecularBridge.of(body or family)
    if join is None:
        join = "continuous" if isinstance(rarefied_table, FreeMolecularBridge) else "switch"
    return Database(
        continuum_table or phoenix_surrogate(), rarefied_table, continuum_limit, join, family, speed_per_mach
    )


def _table(
    name: str | Path, kind: Kind, builtin: tuple[str, ...], interpolation: Interpolation, moment_point: float | None
) -> GridTable | None:
    """Table of a file or built-in name; None for the first built-in name, which is no grid."""
    if not str(name).startswith("builtin:"):
        if moment_point is not None:
            return read_printed_table(Path(name), kind, moment_point, interpolation)
        return read_table(Path(name), kind, interpolation)
    side = "continuum" if kind == "mach" else "rarefied"
    if moment_point is not None:
        raise InputError(
            f"aerodynamics.{side}_moment_point is for a CSV in the printed form; {name} has its moments about the "
            f"nose. Leave the key out, or name a file under aerodynamics.{side}."
        )
    if name not in builtin:
        raise InputError(f"{side} table: there is no '{name}'; accepted are {', '.join(builtin)} or a CSV file.")
    if name == builtin[0]:
        return None
    file_name = "mevad_continuum.csv" if kind == "mach" else "mevad_rarefied.csv"
    return read_table(package_data(file_name), kind, interpolation)
