"""Results as files and as DataTrees: written whole or not at all, read with a check of what they are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from edl_filter.errors import InputError
from edl_filter.results.groups import Attributes, Groups
from edl_filter.whole_file import replace_with

if TYPE_CHECKING:
    import xarray

    from edl_filter.reconstruction import Reconstruction

FORMAT, FORMAT_VERSION = "edl-result", 1


def to_datatree(reconstruction: Reconstruction) -> xarray.DataTree:
    """Reconstruction as a labelled tree, the same as `read` gives of its file.

    Parameters
    ----------
    reconstruction : Reconstruction

    Returns
    -------
    xarray.DataTree
        Groups ``/trajectory``, ``/imu/…``, ``/attitude`` (if on board there was one), ``/sensor_errors/…``,
        ``/constraints/…``, ``/entry``, ``/events``, ``/nodes``; units and ``long_name`` on every variable.
    """
    from edl_filter.results.content import content

    return tree_of(content(reconstruction))


def tree_of(groups: Groups) -> xarray.DataTree:
    """DataTree of plain groups."""
    import xarray as xr

    datasets = {}
    for path, group in groups.items():
        variables = {n: xr.Variable(v.dims, v.values, v.attrs) for n, v in group.variables.items()}
        datasets[path] = xr.decode_cf(xr.Dataset(variables, attrs=group.attrs), decode_timedelta=False)
    return xr.DataTree.from_dict(datasets)


def write(result: xarray.DataTree | Groups, path: str | Path) -> Path:
    """Write a result; the file appears under its name only when it is whole.

    Parameters
    ----------
    result : xarray.DataTree or dict of Group
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
        A ``result.nc``, or the folder that holds one.

    Returns
    -------
    xarray.DataTree

    Raises
    ------
    InputError
        There is no such file, it is no result, or one of another version.
    """
    return tree_of(load(path))


def load(path: str | Path) -> Groups:
    """Read a result as plain groups, without xarray; otherwise as `read`."""
    path = Path(path)
    path = path / "result.nc" if path.is_dir() else path
    _check(path)
    from edl_filter.results.hdf5 import read_groups

    return read_groups(path)


def attributes(path: str | Path) -> Attributes:
    """Attributes of a result's root, which say where it comes from; otherwise as `load`."""
    import h5py

    path = Path(path)
    path = path / "result.nc" if path.is_dir() else path
    _check(path)
    with h5py.File(path, "r") as file:
        return dict(file.attrs)


def _check(path: Path) -> None:
    """See that `path` is a result of this version, or raise InputError."""
    import h5py

    if not path.is_file():
        raise InputError(f"{path}: no such result; expected the result.nc that 'edl-filter run' writes.")
    try:
        with h5py.File(path, "r") as file:
            found, version = file.attrs.get("format"), file.attrs.get("format_version")
            whole = isinstance(file.get("trajectory"), h5py.Group)
    except OSError:
        raise InputError(
            f"{path}: this is no HDF5 file, or a damaged one; expected the result.nc that 'edl-filter run' writes."
        ) from None
    if found != FORMAT:
        raise InputError(
            f"{path}: attribute format is {found!r}; expected {FORMAT!r}, the result.nc that 'edl-filter run' writes."
        )
    if version != FORMAT_VERSION:
        raise InputError(
            f"{path}: it is a result of version {version}; this edl-filter reads version {FORMAT_VERSION}. "
            "Run the mission again."
        )
    if not whole:
        raise InputError(f"{path}: the group /trajectory is missing; this is only a part of a result.")
