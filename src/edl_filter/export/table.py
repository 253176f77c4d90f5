"""CSV table of the trajectory.

Input: the group ``/trajectory`` of a result. Output: one row per epoch, after one header row with units; angles are in
degrees.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.io.atomic import replace_with
from edl_filter.results.groups import Group
from edl_filter.results.reader import ResultReader
from edl_filter.types import AXES, QUATERNION

#: Variables of ``/trajectory`` in the order of their columns, after the times. Vectors have one column per component.
_COLUMNS = (
    "altitude", "latitude", "longitude", "areocentric_latitude", "radius", "speed", "flight_path_angle",
    "azimuth", "alpha", "beta", "alpha_total", "mach", "dynamic_pressure", "density", "altitude_sigma",
    "speed_sigma", "flight_path_angle_sigma", "alpha_sigma", "beta_sigma", "alpha_total_sigma", "position",
    "velocity", "inertial_from_body", "specific_force", "angular_rate", "velocity_body", "position_sigma",
    "velocity_sigma", "attitude_sigma",
)  # fmt: skip
_DEGREES = {"rad": "deg", "rad/s": "deg/s"}
_COMPONENTS = {3: AXES, 4: QUATERNION}


def write_csv(reader: ResultReader, path: Path) -> Path:
    """Write the trajectory as a CSV table.

    Parameters
    ----------
    reader : ResultReader
        Of a result.
    path : Path
        File to write; an existing one is replaced when the new one is complete.

    Returns
    -------
    Path
        `path`.
    """
    trajectory = reader.groups["/trajectory"]
    columns: dict[str, Any] = {"time [s]": _numbers(trajectory.variables["time"].values, 6)}
    if "sclk" in trajectory.variables:
        columns["sclk [s]"] = _numbers(trajectory.variables["sclk"].values, 6)
    columns["utc"] = utc_text(trajectory)
    for name in _COLUMNS:
        if name in trajectory.variables:
            columns |= _columns(name, trajectory)

    def write(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))

    return replace_with(path, write)


def utc_text(group: Group) -> list[str]:
    """UTC of the epochs, ISO 8601, to the microsecond."""
    stamps = group.variables["utc"].values.astype("datetime64[us]")
    return [str(stamp) for stamp in stamps]


def _columns(name: str, group: Group) -> dict[str, list[str]]:
    """Header → column, for one variable."""
    variable = group.variables[name]
    unit, values = str(variable.attrs["units"]), variable.values
    if unit in _DEGREES:
        unit, values = _DEGREES[unit], np.rad2deg(values)
    if values.ndim == 1:
        return {f"{name} [{unit}]": _numbers(values)}
    return {
        f"{name}_{component} [{unit}]": _numbers(values[:, k])
        for k, component in enumerate(_COMPONENTS[values.shape[1]])
    }


def _numbers(values: NDArray[Any], decimals: int | None = None) -> list[str]:
    """Format with twelve significant digits (a millimetre in a planet's radius needs ten) or a number of decimals."""
    number_format = "%.12g" if decimals is None else f"%.{decimals}f"
    return [number_format % value for value in values]
