"""One result per run: ``result.nc`` (netCDF-4, an xarray DataTree), ``summary.json`` and tables.

In: a reconstruction, the refit of its effects, and the quantities derived from both. Out: a `Result` in memory, its
files, and these files read again.

Read in this order: `result` (what a result consists of), `summary` with `landing` (``summary.json``), `content` with
`estimates` and `postflight` (groups and variables of ``result.nc``), `database_update` (increments of the database as
files), `groups`, `hdf5` and `netcdf` (the file), `verdicts` (names of the verdicts of a diagnosis), `schema`
(``summary.json``, ``diagnosis.json`` and the ledger, with every key), `files` (names of all files, writing and reading
of JSON), `residual_series` (``residuals.nc``), `reader` (one access to all that a result holds), `reopen` (a result
opened for further work). A campaign has `campaign_variables`, `campaign_store` (one Zarr group of all cases) and
`campaign_statistics`. xarray is imported only where a DataTree is made, and each public name when it is first used:
names of files, schemas and the reader need neither filter nor telemetry.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edl_filter.results.netcdf import FORMAT, FORMAT_VERSION, read, write
    from edl_filter.results.result import Result, reconstruct
    from edl_filter.results.summary import RefitSummary

__all__ = ["FORMAT", "FORMAT_VERSION", "RefitSummary", "Result", "read", "reconstruct", "write"]

#: Public name → module of this package.
_MODULES = {
    "FORMAT": "netcdf", "FORMAT_VERSION": "netcdf", "read": "netcdf", "write": "netcdf",
    "RefitSummary": "summary", "Result": "result", "reconstruct": "result",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value
