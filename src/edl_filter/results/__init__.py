"""One result per run: ``result.nc`` (netCDF-4, an xarray DataTree), ``summary.json`` and the figures.

`content` says what is in a result, `netcdf` writes and reads the file, `summary` is what a person or a script
asks first, `outputs` puts it all in one folder. xarray is imported only where a DataTree is made.
"""

from edl_filter.results.netcdf import FORMAT, FORMAT_VERSION, read, to_datatree, write
from edl_filter.results.outputs import write_outputs
from edl_filter.results.summary import summary

__all__ = ["FORMAT", "FORMAT_VERSION", "read", "summary", "to_datatree", "write", "write_outputs"]
