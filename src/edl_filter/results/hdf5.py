"""Plain groups to and from netCDF-4, with h5py alone.

netCDF-4 is HDF5 with dimension scales: a dimension is a dataset, a variable is attached to its dimensions. Libraries
for netCDF take longer for some 250 small variables than the reconstruction takes; this module implements the part of
the format that results need. xarray, h5netcdf and netCDF-C read the files (netCDF-4 file format, Unidata).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError
from edl_filter.io.atomic import write_through_memory
from edl_filter.io.hdf5_guard import DAMAGE
from edl_filter.results.groups import Group, Groups, Variable

_NOT_A_VARIABLE = "This is a netCDF dimension but not a netCDF variable."
#: Attributes that belong to the format, not to the contents.
_INTERNAL = {
    "CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates", "_NCProperties",
}  # fmt: skip


def write_groups(groups: Groups, path: Path) -> None:
    """Write groups to the new file `path`."""

    def fill(file: Any) -> None:
        file.attrs["_NCProperties"] = f"version=2,h5py={h5py.__version__},hdf5={h5py.version.hdf5_version}"
        count = 0
        for name, group in groups.items():
            count = _write_group(file.require_group(name), group, count)

    write_through_memory(path, fill)


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
        group = read_group(node)
        if name == "/" or group.variables or group.attrs:
            groups[name] = group
        for key, child in node.items():
            if isinstance(child, h5py.Group):
                visit(f"{name.rstrip('/')}/{key}", child)

    with h5py.File(path, "r") as file:
        visit("/", file)
    return groups


def read_group(node: Any, lazily: bool = False) -> Group:
    """Read one group of an open file; `lazily` reads each variable when it is first used."""
    datasets = {name: child for name, child in node.items() if isinstance(child, h5py.Dataset)}
    names = {h5py.h5o.get_info(d.id).addr: name for name, d in datasets.items() if d.is_scale}
    variables: dict[str, Variable] = {}
    for name, dataset in datasets.items():
        if _is_bare_dimension(dataset):
            continue
        variable = _FileVariable(node, name, dataset, names)
        variables[name] = variable if lazily else Variable(variable.dims, variable.values, variable.attrs)
    return Group(variables, _attributes(node))


class _FileVariable(Variable):
    """A variable of an open file whose parts are read when they are first used."""

    def __init__(self, node: Any, name: str, dataset: Any, names: dict[int, str]) -> None:
        self.__dict__.update(_node=node, _name=name, _dataset=dataset, _names=names)

    def __getattr__(self, part: str) -> Any:
        if part not in ("values", "attrs", "dims"):
            raise AttributeError(part)
        with _undamaged(self._dataset.file):
            if part == "values":
                self.__dict__[part] = _values(self._dataset)
            elif part == "attrs":
                self.__dict__[part] = _attributes(self._dataset)
            else:
                lists = self._dataset.attrs.get("DIMENSION_LIST", ())
                addresses = (h5py.h5o.get_info(self._node[references[0]].id).addr for references in lists)
                scale = self._dataset.is_scale
                self.__dict__[part] = (self._name,) if scale else tuple(self._names[address] for address in addresses)
        return self.__dict__[part]


@contextmanager
def _undamaged(file: Any) -> Iterator[None]:
    """Raise InputError where a part of an open file cannot be read."""
    try:
        yield
    except DAMAGE:
        raise InputError(f"{file.filename}: this HDF5 file is damaged; run or diagnose again to write it.") from None


def _is_bare_dimension(dataset: Any) -> bool:
    """Whether a dataset is a dimension without a variable."""
    if not dataset.is_scale:
        return False
    label = dataset.attrs.get("NAME", b"")
    return (label.decode() if isinstance(label, bytes) else str(label)).startswith(_NOT_A_VARIABLE)


def _values(dataset: Any) -> NDArray[Any]:
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()], dtype=object)
    return np.asarray(dataset[()])


def _attributes(node: Any) -> dict[str, Any]:
    return {key: _plain(node.attrs[key]) for key in node.attrs if key not in _INTERNAL}


def _plain(value: Any) -> Any:
    """A scalar as a Python number."""
    return value.item() if isinstance(value, np.generic) else value


class FileGroups(Mapping[str, Group]):
    """Groups of an open HDF5 file, each read when it is first used."""

    def __init__(self, path: Path) -> None:
        self.file = h5py.File(path, "r")
        self._groups: dict[str, Group] = {}

    def __getitem__(self, path: str) -> Group:
        if path not in self._groups:
            with _undamaged(self.file):
                node = self.file.get(path)
                group = read_group(node, lazily=True) if isinstance(node, h5py.Group) else None
            if group is None:
                raise KeyError(path)
            self._groups[path] = group
        return self._groups[path]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    @cached_property
    def _names(self) -> list[str]:
        """Paths of all groups, the root first."""
        names = ["/"]

        def note(name: bytes, info: Any) -> None:
            if info.type == h5py.h5o.TYPE_GROUP and name != b".":
                names.append(f"/{name.decode()}")

        h5py.h5o.visit(self.file.id, note, info=True)  # `File.visititems` opens every variable
        return names

    def __len__(self) -> int:
        return len(self._names)
