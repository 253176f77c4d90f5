"""One result per run: ``result.nc`` (netCDF-4, an xarray DataTree), ``summary.json`` and tables.

In: a reconstruction, the refit of its effects, and the quantities derived from both. Out: a `Result` in memory, its
files, and these files read again.

Read in this order: `result` (what a result consists of), `summary` with `landing` (``summary.json``), `content` with
`estimates` and `postflight` (groups and variables of ``result.nc``), `groups`, `hdf5` and `netcdf` (the file), `schema`
(``summary.json``, ``diagnosis.json`` and the ledger, with every key), `files` (names of all files, writing and reading
of JSON), `reader` (one access to all that a result holds), `reopen` (a result opened for further work). xarray is
imported only where a DataTree is made.
"""

from edl_filter.results.netcdf import FORMAT, FORMAT_VERSION, read, write
from edl_filter.results.result import Result, reconstruct
from edl_filter.results.summary import RefitSummary

__all__ = ["FORMAT", "FORMAT_VERSION", "RefitSummary", "Result", "read", "reconstruct", "write"]
