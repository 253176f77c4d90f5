"""Plain groups to and from netCDF-4, with h5py alone.

netCDF-4 is HDF5 with dimension scales: a dimension is a dataset, a variable is attached to its dimensions. Libraries
for netCDF take longer for some 250 small variables than the reconstruction takes; this module implements the part of
the format that results need. xarray, h5netcdf and netCDF-C read the files (netCDF-4 file format, Unidata).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from edl_filter.results.groups import Group, Groups, Variable

_NOT_A_VARIABLE = "This is a netCDF dimension but not a netCDF variable."
#: Attributes that belong to the format, not to the contents.
_INTERNAL = {
    "CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates", "_NCProperties",
}  # fmt: skip


def write_groups(groups: Groups, path: Path) -> None:
    """Write groups to the new file `path`."""
    with h5py.File(path, "w") as file:
        file.attrs["_NCProperties"] = f"version=2,h5py={h5py.__version__},hdf5={h5py.version.hdf5_version}"
        count = 0
        for name, group in groups.items():
            count = _write_group(file.require_group(name), group, count)


def _write_group(node: Any, group: Group, count: int) -> int:
    """Write one group; `count` dimensions are in the file before; returns the number after."""
    for key, value in group.attrs.items():
        node.attrs[key] = value
    sizes = {d: n for v in group.variables.values() for d, n in zip(v.dims, v.values.shape, strict=True)}
    scales = {}
    for dim, size in sizes.items():
        if dim in group.variables:
            scale = _dataset(node, dim, group.variables[dim])
            scale.make_scale(dim)
        else:
            scale = node.create_dataset(dim, (size,), dtype=">f4")
            scale.make_scale(f"{_NOT_A_VARIABLE}{size:10d}")
        scale.attrs["_Netcdf4Dimid"] = np.int32(count)
        scales[dim] = scale
        count += 1
    for name, variable in group.variables.items():
        if name in sizes:
            continue
        dataset = _dataset(node, name, variable)
        for axis, dim in enumerate(variable.dims):
            dataset.dims[axis].attach_scale(scales[dim])
    return count


def _dataset(node: Any, name: str, variable: Variable) -> Any:
    values = variable.values
    dtype = h5py.string_dtype() if values.dtype == np.dtype(object) else values.dtype
    dataset = node.create_dataset(name, data=values, dtype=dtype)
    for key, value in variable.attrs.items():
        dataset.attrs[key] = value
    return dataset


def read_groups(path: Path) -> Groups:
    """Read all groups of a netCDF-4 file, except those (other than the root) that contain only groups."""
    groups: Groups = {}

    def visit(name: str, node: Any) -> None:
        group = Group(_variables(node), _attributes(node))
        if name == "/" or group.variables or group.attrs:
            groups[name] = group
        for key, child in node.items():
            if isinstance(child, h5py.Group):
                visit(f"{name.rstrip('/')}/{key}", child)

    with h5py.File(path, "r") as file:
        visit("/", file)
    return groups


def _variables(node: Any) -> dict[str, Variable]:
    variables = {}
    names = {}  # address of a dimension's dataset → its name
    datasets = {name: d for name, d in node.items() if isinstance(d, h5py.Dataset)}
    for name, dataset in datasets.items():
        if dataset.is_scale:
            names[h5py.h5o.get_info(dataset.id).addr] = name
    for name, dataset in datasets.items():
        if dataset.is_scale:
            label = dataset.attrs.get("NAME", b"")
            label = label.decode() if isinstance(label, bytes) else str(label)
            if label.startswith(_NOT_A_VARIABLE):
                continue
            dims: tuple[str, ...] = (name,)
        else:
            lists = dataset.attrs.get("DIMENSION_LIST", ())
            dims = tuple(names[h5py.h5o.get_info(node[refs[0]].id).addr] for refs in lists)
        variables[name] = Variable(dims, _values(dataset), _attributes(dataset))
    return variables


def _values(dataset: Any) -> NDArray[Any]:
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()], dtype=object)
    return np.asarray(dataset[()])


def _attributes(node: Any) -> dict[str, Any]:
    return {key: _plain(node.attrs[key]) for key in node.attrs if key not in _INTERNAL}


def _plain(value: Any) -> Any:
    """A scalar as a Python number."""
    return value.item() if isinstance(value, np.generic) else value
