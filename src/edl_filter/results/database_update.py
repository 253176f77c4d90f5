"""Increments of the aerodynamic database as files: ``database_update.nc`` and tables in the form of the database's own.

The netCDF file has the group ``/database_update`` with the covariance of all increments, and below it one group for
each regime that the flight passes through: ``mach`` (continuum) and ``knudsen`` (rarefied flow).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS
from edl_filter.aero.increments import REGIMES, SYMBOLS, DatabaseUpdate, RegimeUpdate
from edl_filter.aero.increments_file import FORMAT, FORMAT_VERSION, GROUP
from edl_filter.io.atomic import replace_with
from edl_filter.results.files import DATABASE_UPDATE, TABLES, UPDATE_FILES, UPDATE_TABLES
from edl_filter.results.groups import Group, Groups
from edl_filter.results.netcdf import write

#: Regime → name of its table in the folder of tables.
TABLE_NAMES = dict(zip(REGIMES, UPDATE_TABLES, strict=True))
_LONG_NAMES = {"mach": "Mach number", "knudsen": "Knudsen number based on the diameter"}


def update_groups(update: DatabaseUpdate) -> Groups:
    """Groups of ``database_update.nc``."""
    prior, covariance = update.prior, Group()
    covariance.attrs |= {
        "family": update.family,
        "coefficients": "CA, CN, Cm about the nose, reference area pi D^2/4, reference length D",
        "order": "regime, coefficient (CA, CN, Cm), node, alpha_deg; the last index changes fastest",
        "coefficient_sigma": prior.scale,
        "log_mach_length": prior.log_mach_length,
        "log_knudsen_length": prior.log_knudsen_length,
        "angle_length_deg": float(np.degrees(prior.angle_length)),
        "vanishing_angle_deg": float(np.degrees(prior.vanishing_angle)),
    }
    covariance.add("covariance", ("row", "column"), update.covariance, "1", "covariance of all increments")
    groups = {"/": Group(attrs={"format": FORMAT, "format_version": FORMAT_VERSION}), f"/{GROUP}": covariance}
    return groups | {f"/{GROUP}/{r.regime}": _regime_group(r) for r in update.regimes}


def _regime_group(regime: RegimeUpdate) -> Group:
    group, dims = Group(), (regime.regime, "alpha_deg")
    group.add(regime.regime, dims[:1], regime.nodes, "1", _LONG_NAMES[regime.regime])
    group.add("alpha_deg", dims[1:], np.degrees(regime.alpha), "deg", "total angle of attack")
    for c, name in enumerate(FIELD_COEFFICIENTS):
        symbol = SYMBOLS[name]
        group.add(symbol, dims, regime.increment[c], "1", f"increment of {symbol}")
        group.add(f"{symbol}_sigma", dims, regime.sigma[c], "1", f"1 sigma of the increment of {symbol}")
        group.add(f"{symbol}_prior_sigma", dims, regime.prior_sigma[c], "1", f"1 sigma of {symbol} in the database")
        share = f"share of the prior variance of {symbol} that the data removed"
        group.add(f"{symbol}_share", dims, regime.share[c], "1", share)
    group.add("bins", dims, regime.bins, "1", "number of time bins of the flight nearest to the node and angle")
    return group


def update_tables(update: DatabaseUpdate) -> dict[str, str]:
    """Name → text of the tables: the columns of the database's own, then one sigma and share of each coefficient."""
    symbols = list(SYMBOLS.values())
    names = ["alpha_deg", *symbols, *(f"{s}_sigma" for s in symbols), *(f"{s}_share" for s in symbols), "bins"]
    tables = {}
    for r in update.regimes:
        lines = [",".join([r.regime, *names])]
        for k, node in enumerate(r.nodes):
            for a, angle in enumerate(np.degrees(r.alpha)):
                values = (*r.increment[:, k, a], *r.sigma[:, k, a], *r.share[:, k, a])
                cells = [f"{node:.6g}", f"{angle:.6g}", *(f"{v:.6g}" for v in values), str(r.bins[k, a])]
                lines.append(",".join(cells))
        tables[TABLE_NAMES[r.regime]] = "\n".join(lines) + "\n"
    return tables


def write_update(update: DatabaseUpdate | None, folder: Path) -> list[Path]:
    """Write ``database_update.nc`` and its tables into the folder of a result; files of an earlier one are removed.

    Parameters
    ----------
    update : DatabaseUpdate or None
        None writes nothing.
    folder : Path
        Existing folder.

    Returns
    -------
    list of Path
        The files.
    """
    for path in (folder / name for name in UPDATE_FILES):
        path.unlink(missing_ok=True)
    if update is None:
        return []
    written = [write(update_groups(update), folder / DATABASE_UPDATE)]
    for name, text in update_tables(update).items():
        (folder / TABLES).mkdir(exist_ok=True)
        path = folder / TABLES / name
        written.append(replace_with(path, partial(_write_text, text)))
    return written


def _write_text(text: str, path: Path) -> None:
    path.write_text(text, encoding="utf-8")
