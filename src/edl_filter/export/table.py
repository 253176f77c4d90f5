"""The trajectory as CSV: one header row with units, angles in degrees."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.results.groups import Group, Groups
from edl_filter.whole_file import replace_with

#: Columns after the times: variables of ``/trajectory``, in this order. Vectors become one column per axis.
_COLUMNS = (
    "altitude", "latitude", "longitude", "areocentric_latitude", "radius", "speed", "flight_path_angle",
    "azimuth", "alpha", "beta", "alpha_total", "mach", "dynamic_pressure", "density", "altitude_sigma",
    "speed_sigma", "flight_path_angle_sigma", "alpha_sigma", "beta_sigma", "alpha_total_sigma", "position",
    "velocity", "inertial_from_body", "specific_force", "angular_rate", "velocity_body", "position_sigma",
    "velocity_sigma", "attitude_sigma",
)  # fmt: skip
_DEGREES = {"rad": "deg", "rad/s": "deg/s"}
_PARTS = {3: ("x", "y", "z"), 4: ("x", "y", "z", "w")}


def write_csv(groups: Groups, path: Path) -> Path:
    """Write the trajectory as a table.

    Parameters
    ----------
    groups : dict of Group
        A result.
    path : Path

    Returns
    -------
    Path
        `path`; it appears when it is whole.
    """
    trajectory = groups["/trajectory"]
    columns: dict[str, Any] = {"time [s]": _numbers(trajectory.variables["time"].values, 6)}
    if "sclk" in trajectory.variables:
        columns["sclk [s]"] = _numbers(trajectory.variables["sclk"].values, 6)
    columns["utc"] = utc_text(trajectory)
    for name in (n for n in _COLUMNS if n in trajectory.variables):
        columns |= _columns(name, trajectory)

    def make(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))

    return replace_with(path, make)


def utc_text(group: Group) -> list[str]:
    """UTC as ISO 8601 to the microsecond."""
    stamps = group.variables["utc"].values.astype("datetime64[us]")
    return [str(stamp) for stamp in stamps]


def _columns(name: str, group: Group) -> dict[str, list[str]]:
    """Columns of one variable, by header."""
    variable = group.variables[name]
    unit, values = str(variable.attrs["units"]), variable.values
    if unit in _DEGREES:
        unit, values = _DEGREES[unit], np.rad2deg(values)
    if values.ndim == 1:
        return {f"{name} [{unit}]": _numbers(values)}
    return {f"{name}_{part} [{unit}]": _numbers(values[:, k]) for k, part in enumerate(_PARTS[values.shape[1]])}


def _numbers(values: NDArray[Any], decimals: int | None = None) -> list[str]:
    """Twelve digits: a millimetre of a planet's radius is ten."""
    form = "%.12g" if decimals is None else f"%.{decimals}f"
    return [form % value for value in values]
