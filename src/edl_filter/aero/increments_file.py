"""Reader of increments of a database, ``database_update.nc``, with an error message for each kind of mistake.

The file is netCDF-4 (HDF5). Its group ``/database_update`` has the correlation lengths of the discrepancy as
attributes and the variable ``covariance``; its groups ``mach`` and ``knudsen``, one or both, have increments, sigmas
and shares over nodes and angles. `edl_filter.results.database_update` writes it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, DiscrepancyPrior
from edl_filter.aero.increments import REGIMES, SYMBOLS, DatabaseUpdate, RegimeUpdate
from edl_filter.errors import InputError
from edl_filter.types import Array

FORMAT, FORMAT_VERSION, GROUP = "edl-database-update", 1, "database_update"
#: Attributes of the group that are correlation lengths, and must be positive.
_LENGTHS = ("log_mach_length", "log_knudsen_length", "angle_length_deg", "vanishing_angle_deg")
#: Largest asymmetry and smallest eigenvalue of the covariance in squares of one sigma of the database, from rounding.
_ROUNDING = 1e-6


def read_increments(path: Path, family: str | None = None, key: str = "") -> DatabaseUpdate:
    """Read the increments that a diagnosis wrote.

    Parameters
    ----------
    path : Path
        ``database_update.nc``.
    family : str, optional
        Vehicle family of the database to which the increments are added; any if absent.
    key : str
        Mission and key that name the file, for messages.

    Raises
    ------
    InputError
        No such file or another format, increments of another database, other axes or units, a covariance that is no
        covariance, or a correlation length that is not positive.
    """
    where = f"{key}: {path}" if key else str(path)
    if not path.is_file():
        raise InputError(
            f"{where}: found no such file; expected the database_update.nc that 'edl-filter diagnose' writes."
        )
    try:
        with h5py.File(path, "r") as file:
            name, version = file.attrs.get("format"), file.attrs.get("format_version")
            if name != FORMAT or version != FORMAT_VERSION or not isinstance(file.get(GROUP), h5py.Group):
                raise InputError(
                    f"{where}: format: found {name!r}, version {version}; expected {FORMAT!r}, version "
                    f"{FORMAT_VERSION}, the database_update.nc that 'edl-filter diagnose' writes."
                )
            return _read_group(file[GROUP], where, family)
    except OSError:
        raise InputError(
            f"{where}: this is no HDF5 file, or a damaged one; expected the database_update.nc that 'edl-filter "
            "diagnose' writes."
        ) from None


def _read_group(group: Any, where: str, family: str | None) -> DatabaseUpdate:
    of_family = group.attrs.get("family")
    if family is not None and of_family != family:
        raise InputError(
            f"{where}: family: found {of_family!r}; expected increments of {family}, the database's family."
        )
    lengths = {name: _number(group, name, where) for name in _LENGTHS}
    for name, length in lengths.items():
        if not length > 0.0:
            raise InputError(f"{where}: {name}: found {length:g}; expected a correlation length above 0.")
    regimes = tuple(
        _read_regime(group[name], name, where) for name in REGIMES if isinstance(group.get(name), h5py.Group)
    )
    if not regimes:
        raise InputError(f"{where}: found neither a group {' nor '.join(REGIMES)}; expected increments in one of them.")
    prior = DiscrepancyPrior(
        scale=_number(group, "coefficient_sigma", where),
        log_mach_length=lengths["log_mach_length"],
        log_knudsen_length=lengths["log_knudsen_length"],
        angle_length=np.radians(lengths["angle_length_deg"]),
        vanishing_angle=np.radians(lengths["vanishing_angle_deg"]),
    )
    return DatabaseUpdate(str(of_family), prior, regimes, _read_covariance(group, regimes, where))


def _read_regime(group: Any, name: str, where: str) -> RegimeUpdate:
    nodes = _values(group, name, "1", f"{where}: {name}")
    degrees = _values(group, "alpha_deg", "deg", f"{where}: {name}")
    for axis, values in ((name, nodes), ("alpha_deg", degrees)):
        if values.ndim != 1 or len(values) < 2 or not np.all(np.diff(values) > 0.0):
            raise InputError(
                f"{where}: {name}/{axis}: found {_listed(values)}; expected two or more increasing numbers."
            )
    if nodes[0] <= 0.0 or degrees[0] != 0.0 or degrees[-1] > 180.0:
        raise InputError(
            f"{where}: {name}: found numbers from {nodes[0]:g} and angles from {degrees[0]:g} to {degrees[-1]:g} deg; "
            "expected positive numbers, and total angles from 0 to at most 180 deg."
        )
    shape = (len(nodes), len(degrees))

    def by_coefficient(suffix: str) -> Array:
        names = [SYMBOLS[c] + suffix for c in FIELD_COEFFICIENTS]
        arrays = [_values(group, n, "1", f"{where}: {name}") for n in names]
        for n, array in zip(names, arrays, strict=True):
            if array.shape != shape:
                raise InputError(
                    f"{where}: {name}/{n}: found an array of {array.shape}; expected {shape}, {name} by alpha_deg."
                )
        return np.stack(arrays)

    return RegimeUpdate(
        regime=name,
        nodes=nodes,
        alpha=np.radians(degrees),
        increment=by_coefficient(""),
        sigma=by_coefficient("_sigma"),
        prior_sigma=by_coefficient("_prior_sigma"),
        bins=_values(group, "bins", "1", f"{where}: {name}").astype(np.int64),
    )


def _read_covariance(group: Any, regimes: tuple[RegimeUpdate, ...], where: str) -> Array:
    covariance = _values(group, "covariance", "1", where)
    prior_sigma = np.concatenate([r.prior_sigma.ravel() for r in regimes])
    count = len(prior_sigma)
    if covariance.shape != (count, count):
        raise InputError(
            f"{where}: covariance: found an array of {covariance.shape}; expected {(count, count)}, a row for each "
            "increment."
        )
    scale = np.where(prior_sigma > 0.0, prior_sigma, 1.0)
    relative = covariance / np.outer(scale, scale)
    asymmetry = float(np.max(np.abs(relative - relative.T)))
    if asymmetry > _ROUNDING:
        raise InputError(f"{where}: covariance: found an asymmetry of {asymmetry:.2g}; expected a symmetric matrix.")
    smallest = float(np.linalg.eigvalsh(relative)[0])
    if smallest < -_ROUNDING:
        raise InputError(
            f"{where}: covariance: found the eigenvalue {smallest:.2g} (in squares of one sigma of the database); "
            "expected a positive definite matrix."
        )
    return 0.5 * (covariance + covariance.T)


def _values(group: Any, name: str, unit: str, where: str) -> Array:
    """Finite numbers of a dataset with a unit."""
    dataset = group.get(name)
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiu":
        raise InputError(f"{where}: {name}: found nothing; expected numbers in {unit}.")
    units = dataset.attrs.get("units")
    if units != unit:
        raise InputError(f"{where}: {name}: found the unit {units!r}; expected {unit!r}.")
    values = np.asarray(dataset[()], float)
    if not np.all(np.isfinite(values)):
        raise InputError(f"{where}: {name}: found numbers that are not finite; expected finite numbers.")
    return values


def _number(group: Any, name: str, where: str) -> float:
    value = group.attrs.get(name)
    if not isinstance(value, float | int | np.number) or not np.isfinite(value):
        raise InputError(f"{where}: {name}: found {value!r}; expected a number.")
    return float(value)


def _listed(values: Array) -> str:
    return f"an array of {values.shape}" if values.ndim != 1 or len(values) > 6 else str(values.tolist())
