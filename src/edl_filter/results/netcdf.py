"""Results as netCDF files and as DataTrees; a file is checked when it is read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.io.hdf5_guard import DAMAGE, open_hdf5
from edl_filter.io.output_folder import complete_output
from edl_filter.results.files import result_file
from edl_filter.results.groups import Groups

if TYPE_CHECKING:
    import xarray

_NEEDED = "the result.nc that 'edl-filter run' writes"
FORMAT, FORMAT_VERSION = "edl-result", 2


def tree_of(groups: Groups) -> xarray.DataTree:
    """Plain groups as a DataTree."""
    import xarray as xr

    datasets = {}
    for path, group in groups.items():
        variables = {n: xr.Variable(v.dims, v.values, v.attrs) for n, v in group.variables.items()}
        datasets[path] = xr.decode_cf(xr.Dataset(variables, attrs=group.attrs), decode_timedelta=False)
    return xr.DataTree.from_dict(datasets)


def write(result: xarray.DataTree | Groups, path: str | Path) -> Path:
    """Write a result; the file appears under its name only when it is complete.

    Parameters
    ----------
    result : xarray.DataTree or dict of Group
        Contents.
    path : path
        Replaced if it exists.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    path = Path(path)
    if isinstance(result, dict):
        from edl_filter.results.hdf5 import write_groups

        groups = result
        return replace_with(path, lambda temporary: write_groups(groups, temporary))
    tree = result
    return replace_with(path, lambda temporary: tree.to_netcdf(temporary, engine="h5netcdf"))


def read(path: str | Path) -> xarray.DataTree:
    """Read a result into memory.

    Parameters
    ----------
    path : path
        A ``result.nc``, or its folder.

    Returns
    -------
    xarray.DataTree

    Raises
    ------
    InputError
        There is no such file, it is no result, or a result of another version.
    """
    return tree_of(load(path))


def load(path: str | Path) -> Groups:
    """Read a result as plain groups, without xarray; in all else as `read`."""
    path = result_file(path)
    check_result(path)
    from edl_filter.results.hdf5 import read_groups

    try:
        return read_groups(path)
    except DAMAGE:
        raise InputError(f"{path}: this is no HDF5 file, or a damaged one; {_NEEDED} is needed.") from None


def check_result(path: Path) -> None:
    """Raise InputError unless the file `path` is a result of this version."""
    import h5py

    if path.parent.is_dir():
        complete_output(path.parent)
    if not path.is_file():
        raise InputError(f"{path}: no such result; expected the result.nc that 'edl-filter run' writes.")
    with open_hdf5(path, _NEEDED) as file:
        name, version = file.attrs.get("format"), file.attrs.get("format_version")
        complete = isinstance(file.get("trajectory"), h5py.Group)
    if name != FORMAT:
        raise InputError(
            f"{path}: attribute format is {name!r}; expected {FORMAT!r}, the result.nc that 'edl-filter run' writes."
        )
    if version != FORMAT_VERSION:
        raise InputError(
            f"{path}: it is a result of version {version}; this edl-filter reads version {FORMAT_VERSION}. "
            "Run the mission again."
        )
    if not complete:
        raise InputError(f"{path}: the group /trajectory is missing; this is only a part of a result.")
