"""A vehicle's aerodynamic database: continuum and rarefied tables, joined, with their uncertainties."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.base_pressure import with_base_pressure
from edl_filter.aero.body import SphereCone, sphere_cone
from edl_filter.aero.grid import Array, Bools, GridTable, Interpolation, Kind
from edl_filter.aero.newtonian import newtonian_table
from edl_filter.aero.planes import moments_at_cm, split, total_from_planes
from edl_filter.aero.surrogate import Surrogate, phoenix_surrogate
from edl_filter.aero.tables import read_printed_table, read_table
from edl_filter.aero.transition import FreeMolecularBridge, Join, Sum, join_regimes
from edl_filter.aero.uncertainty import CONTINUUM_LIMIT, ThreeSigma, three_sigma
from edl_filter.errors import InputError

__all__ = [
    "Coefficients",
    "Database",
    "load_database",
    "moments_at_cm",
    "shipped_database",
    "split",
    "total_from_planes",
]

#: Speed per Mach number that joins Phoenix's CA(Mach) with its CA(speed), m/s (900 to 4200 m/s, rms 0.003).
SPEED_PER_MACH = 205.8
#: Between these Mach numbers a database indexed by speed goes over from Mach to speed.
INDEX_MACH = (8.0, 9.0)

NEWTONIAN = "builtin:newtonian"
BUILTIN_CONTINUUM = ("builtin:surrogate", "builtin:continuum_grid", NEWTONIAN)
BUILTIN_RAREFIED = ("builtin:free_molecular", "builtin:rarefied_grid")


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Total coefficients along a flight, all of one shape.

    Attributes
    ----------
    ca, cn, cm_nose : arrays
        In the plane of the total angle; the moment about the nose.
    outside : array of bool
        Held at the edge of a table.
    three_sigma : ThreeSigma
        The database's uncertainty.
    rarefied : array of bool
        The Knudsen number is above the continuum limit.
    """

    ca: Array
    cn: Array
    cm_nose: Array
    outside: Bools
    three_sigma: ThreeSigma
    rarefied: Bools

    def cm_at(self, x_over_d: ArrayLike, z_over_d: ArrayLike = 0.0) -> Array:
        """Pitching moment about a point behind the nose and below the axis (+z), both in diameters.

        ``Cm_nose + x CN + z CA``: a centre of mass below the axis turns the nose up, for drag then pulls the
        body back above it.
        """
        return self.cm_nose + np.asarray(x_over_d, float) * self.cn + np.asarray(z_over_d, float) * self.ca


@dataclass(frozen=True, eq=False)
class Database:
    """Look-up in Mach and Knudsen number and total angle.

    Attributes
    ----------
    continuum : GridTable or Surrogate
    rarefied : GridTable or FreeMolecularBridge
    continuum_limit : float
        Knudsen number, on the diameter, up to which the flow is a continuum.
    join : "switch", "blend" or "continuous"
        `edl_filter.aero.transition`.
    family : "MER" or "Phoenix"
        Whose uncertainties hold.
    speed_per_mach : float or None
        m/s; if given, the continuum table is entered with speed/speed_per_mach instead of Mach above Mach 9 and
        with Mach below Mach 8, linearly joined between. So a table of one vehicle stands for another whose
        flight is as fast but in other air.
    """

    continuum: GridTable | Surrogate
    rarefied: GridTable | FreeMolecularBridge
    continuum_limit: float = CONTINUUM_LIMIT
    join: Join = "continuous"
    family: str = "Phoenix"
    speed_per_mach: float | None = None

    def at(self, mach: ArrayLike, knudsen: ArrayLike, speed: ArrayLike | None = None) -> Sum:
        """The curves over the angle of N samples; arguments (N,).

        Raises
        ------
        ValueError
            The database is indexed by speed and none is given.
        """
        mach, knudsen = np.broadcast_arrays(np.asarray(mach, float), np.asarray(knudsen, float))
        cut = self.continuum.at(self._index(mach, speed))
        return join_regimes(cut, self.rarefied, knudsen, self.continuum_limit, self.join)

    def lookup(
        self, mach: ArrayLike, knudsen: ArrayLike, alpha_total: ArrayLike, speed: ArrayLike | None = None
    ) -> Coefficients:
        """Coefficients at Mach and Knudsen numbers and total angles (rad) that broadcast against each other.

        Raises
        ------
        ValueError
            The database is indexed by speed and none is given.
        """
        inputs = (mach, knudsen, alpha_total, np.nan if speed is None else speed)
        mach, knudsen, alpha, speeds = np.broadcast_arrays(*(np.asarray(x, float) for x in inputs))
        shape = mach.shape
        cut = self.at(mach.ravel(), knudsen.ravel(), None if speed is None else speeds.ravel())
        ca, cn, cm = cut.evaluate(alpha.ravel()).reshape(3, *shape)
        sigma = three_sigma(self.family, mach, knudsen, ca, self.continuum_limit)
        outside = cut.outside_at(alpha.ravel()).reshape(shape)
        return Coefficients(ca, cn, cm, outside, sigma, knudsen > self.continuum_limit)

    def _index(self, mach: Array, speed: ArrayLike | None) -> Array:
        if self.speed_per_mach is None:
            return mach
        if speed is None:
            raise ValueError("this database is indexed by speed: give the speed with the Mach number")
        low, high = INDEX_MACH
        part = np.clip((mach - low) / (high - low), 0.0, 1.0)
        return mach + part * (np.asarray(speed, float) / self.speed_per_mach - mach)


def shipped_database(join: Join = "continuous", family: str = "Phoenix") -> Database:
    """The database that the package ships: Phoenix's surrogate and free-molecular panels.

    For MER it is a *proxy*: the same table, entered by speed in its hypersonic part.
    """
    speed = SPEED_PER_MACH if family == "MER" else None
    return load_database(join=join, family=family, speed_per_mach=speed)


def load_database(
    continuum: str | Path = "builtin:surrogate",
    rarefied: str | Path = "builtin:free_molecular",
    *,
    continuum_limit: float = CONTINUUM_LIMIT,
    join: Join | None = None,
    family: str = "Phoenix",
    speed_per_mach: float | None = None,
    interpolation: Interpolation = "linear",
    body: str | SphereCone | None = None,
    base_pressure: bool = False,
    continuum_moment_point: float | None = None,
    rarefied_moment_point: float | None = None,
) -> Database:
    """A database from built-in or brought tables.

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
        None is "continuous" for free-molecular panels and "switch" for tables.
    interpolation : "linear" or "pchip"
        In the angle, for tables.
    body : str, SphereCone or None
        Vehicle by name, or its forebody, whose panels are summed; None is the family's.
    base_pressure : bool
        Take base pressure off CA (eq. 11.4): for continuum tables of a forebody, which the first two built-in ones are
        not.
    continuum_moment_point, rarefied_moment_point : float or None
        Moment reference point behind the nose, diameters, of a file in the thesis's printed form
        (`edl_filter.aero.tables.read_printed_table`); None is a file with moments about the nose.

    Raises
    ------
    InputError
        No such built-in table, a file that cannot be used, no such family; base pressure for a table that has it.
    """
    three_sigma(family, 20.0, 1e-5, 1.7)  # refuses an unknown family here rather than at the first look-up
    forebody = body if isinstance(body, SphereCone) else sphere_cone(body or family)
    thick: GridTable | None
    if continuum == NEWTONIAN and continuum_moment_point is None:
        thick = newtonian_table(forebody)
    else:
        thick = _resolve(continuum, "mach", BUILTIN_CONTINUUM, interpolation, continuum_moment_point)
    if base_pressure:
        if thick is None or continuum in BUILTIN_CONTINUUM[:2]:
            raise InputError(
                f"aerodynamics.base_pressure: {continuum} has the base pressure in it already; leave the key out, or "
                f"use {NEWTONIAN} or a table of a forebody."
            )
        thick = with_base_pressure(thick)
    thin: GridTable | FreeMolecularBridge | None = _resolve(
        rarefied, "knudsen", BUILTIN_RAREFIED, interpolation, rarefied_moment_point
    )
    if thin is None:
        thin = FreeMolecularBridge.of(body or family)
    if join is None:
        join = "continuous" if isinstance(thin, FreeMolecularBridge) else "switch"
    return Database(thick or phoenix_surrogate(), thin, continuum_limit, join, family, speed_per_mach)


def _resolve(
    where: str | Path, kind: Kind, builtin: tuple[str, ...], interpolation: Interpolation, moment_point: float | None
) -> GridTable | None:
    """The table of a path or built-in name; None for the built-in that is no grid, the first."""
    if not str(where).startswith("builtin:"):
        if moment_point is not None:
            return read_printed_table(Path(where), kind, moment_point, interpolation)
        return read_table(Path(where), kind, interpolation)
    side = "continuum" if kind == "mach" else "rarefied"
    if moment_point is not None:
        raise InputError(
            f"aerodynamics.{side}_moment_point is for a CSV in the printed form; {where} has its moments about the "
            f"nose. Leave the key out, or name a file under aerodynamics.{side}."
        )
    if where not in builtin:
        raise InputError(f"{side} table: there is no '{where}'; accepted are {', '.join(builtin)} or a CSV file.")
    if where == builtin[0]:
        return None
    name = "mevad_continuum.csv" if kind == "mach" else "mevad_rarefied.csv"
    return read_table(Path(str(files("edl_filter") / "data" / name)), kind, interpolation)
