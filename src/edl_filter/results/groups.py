"""Plain groups of variables: what a netCDF file holds, before any library.

A result is a dict from the group's path (``"/trajectory"``) to a `Group`. From it come both the file and the
DataTree; a run that draws no figures needs no xarray, whose import takes longer than the reconstruction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Attributes = dict[str, Any]


@dataclass(frozen=True)
class Variable:
    """One variable: names of its dimensions, values, attributes (``units`` and ``long_name`` always)."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attrs: Attributes


@dataclass
class Group:
    """Variables by name, and attributes. A variable named like its one dimension is a coordinate."""

    variables: dict[str, Variable] = field(default_factory=dict)
    attrs: Attributes = field(default_factory=dict)

    def add(
        self,
        name: str,
        dims: Sequence[str],
        values: ArrayLike,
        units: str,
        long_name: str,
        **attrs: Any,
    ) -> None:
        """Add a variable; floats become float64, truth 0 and 1."""
        array = np.asarray(values)
        if array.dtype == bool:
            array = array.astype(np.int8)
        elif array.dtype.kind == "f":
            array = array.astype(np.float64, copy=False)
        self.variables[name] = Variable(tuple(dims), array, {"units": units, "long_name": long_name} | attrs)

    def text(self, name: str, dim: str, values: Sequence[str], long_name: str) -> None:
        """Add text along a dimension; under the dimension's own name it labels its places."""
        self.variables[name] = Variable((dim,), np.array(values, dtype=object), {"long_name": long_name})

    def label(self, dim: str, names: Sequence[str], long_name: str) -> None:
        """Name the places along a dimension."""
        self.text(dim, dim, names, long_name)


Groups = dict[str, Group]
