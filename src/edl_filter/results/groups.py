"""Plain groups of variables, the contents of a netCDF file independent of any library.

A result is a dict from the group's path (``"/trajectory"``) to a `Group`. Both the file and the DataTree are made from
it; a run without figures needs no xarray, whose import takes longer than the reconstruction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Attributes = dict[str, Any]


#: Names of the CF standard name table, by the name of the variable, where the table has the quantity.
STANDARD_NAMES = {
    "altitude": "height_above_reference_ellipsoid",
    "azimuth": "platform_course",
    "density": "air_density",
    "latitude": "latitude",
    "longitude": "longitude",
    "pressure": "air_pressure",
    "speed": "platform_speed_wrt_air",
    "temperature": "air_temperature",
}


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
        """Add a variable; floats become float64, booleans 0 and 1."""
        array = np.asarray(values)
        if array.dtype == bool:
            array = array.astype(np.int8)
        elif array.dtype.kind == "f":
            array = array.astype(np.float64, copy=False)
        standard = {"standard_name": STANDARD_NAMES[name]} if name in STANDARD_NAMES else {}
        attributes = {"units": units, "long_name": long_name} | standard | attrs
        self.variables[name] = Variable(tuple(dims), array, attributes)

    def text(self, name: str, dim: str, values: Sequence[str], long_name: str) -> None:
        """Add text along a dimension; with the name of the dimension it is its coordinate."""
        self.variables[name] = Variable((dim,), np.array(values, dtype=object), {"long_name": long_name})

    def label(self, dim: str, names: Sequence[str], long_name: str) -> None:
        """Add the names along a dimension as its coordinate."""
        self.text(dim, dim, names, long_name)


Groups = dict[str, Group]
