"""Every table of the thesis's appendices B to G by name, and what stands for it here.

The printed numbers are not public in machine form. A table is therefore *shipped* (as a surrogate, or another
vehicle's as proxy), *computed here*, or *to be brought* by a user who has it.
"""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal

from edl_filter.errors import InputError

Status = Literal["shipped", "computed here", "to be brought"]

_TOTAL = ("mach", "alpha_total_deg", "CA", "CN", "Cm")
_RAREFIED = ("knudsen", "alpha_total_deg", "CA", "CN", "Cm")
_FREE = ("alpha_total_deg", "CA", "CN", "Cm")
_RANGE = ("mach", "alpha_rms_deg", "CD")
_REYNOLDS = ("reynolds", "alpha_total_deg", "CD", "speed_km_s")


@dataclass(frozen=True)
class Entry:
    """One table of the thesis.

    Attributes
    ----------
    name : str
        The name under which it is known here.
    table : str
        Its number in the thesis.
    title : str
        What it holds.
    columns : tuple of str
        What is printed; Cm about the table's own reference point.
    status : "shipped", "computed here" or "to be brought"
    remark : str
        One sentence: what stands for it, or how it is brought and used.
    """

    name: str
    table: str
    title: str
    columns: tuple[str, ...]
    status: Status
    remark: str


_GRID = "Bring it as CSV in the printed form (read_printed_table moves its moment to the nose)."
_DRAG = "Bring the columns as arrays; fit_drag and effective_drag compare them with a table at the RMS angle."
_AT_REYNOLDS = (
    "Bring the columns as arrays; they show how CD depends on gas, angle and Reynolds number, at no set Mach."
)
_DSMC = "Free-molecular panels bridged by sin² to the continuum curve stand for the DSMC, within about 25 % in CN."
_PANELS = "Free-molecular panels (full accommodation, speed ratio 24) stand for it; CN is known to 25 %."

CATALOGUE: tuple[Entry, ...] = (
    Entry(
        "viking_wind_tunnel",
        "12.1",
        "Viking wind tunnels, Mach 0.4 to 10",
        _TOTAL,
        "to be brought",
        "Below Mach 1.5 the shipped Phoenix surrogate rests on it; " + _GRID[0].lower() + _GRID[1:],
    ),
    Entry("viking_range_pbr_mach2_air", "12.2", "Viking in PBR at Mach 2 in air", _RANGE, "to be brought", _DRAG),
    Entry("viking_range_hffaf_mach2_air", "12.3", "Viking in HFFAF at Mach 2 in air", _RANGE, "to be brought", _DRAG),
    Entry("viking_range_hffaf_mach11_co2", "12.4", "Viking in HFFAF at Mach 11 in CO2", _RANGE, "to be brought", _DRAG),
    Entry(
        "viking_range_hffaf_air_constant_reynolds",
        "12.5",
        "Viking in HFFAF in air, Reynolds number held",
        _REYNOLDS,
        "to be brought",
        _AT_REYNOLDS,
    ),
    Entry(
        "viking_range_hffaf_co2_constant_reynolds",
        "12.6",
        "Viking in HFFAF in CO2, Reynolds number held",
        _REYNOLDS,
        "to be brought",
        _AT_REYNOLDS,
    ),
    Entry(
        "viking_range_hffaf_constant_angle",
        "12.7",
        "Viking in HFFAF, total angle held at 11.2 degrees",
        _REYNOLDS,
        "to be brought",
        _AT_REYNOLDS,
    ),
    Entry(
        "viking_flight",
        "12.8",
        "Viking 1 in flight",
        ("mach", "alpha_total_deg", "CA", "CN"),
        "to be brought",
        "Points along one flight and no grid: bring them as arrays to lay over a look-up.",
    ),
    Entry("pathfinder_halis", "13.1", "Pathfinder, HALIS perfect gas, forebody", _TOTAL, "to be brought", _GRID),
    Entry("pathfinder_laura", "13.2", "Pathfinder, LAURA real gas, forebody", _TOTAL, "to be brought", _GRID),
    Entry("pathfinder_program", "13.3", "Pathfinder database program, continuum", _TOTAL, "to be brought", _GRID),
    Entry(
        "mer_ballistic_range",
        "14.1",
        "MER at Eglin's range, Mach 1.5 to 3.5",
        ("mach", "alpha_total_deg", "CA"),
        "to be brought",
        "CA only, so no table for a look-up: bring it as arrays to lay over one.",
    ),
    Entry(
        "mer_program_9.1",
        "14.2",
        "MER database program 9.1, continuum",
        _TOTAL,
        "shipped",
        "Proxy: Phoenix's surrogate, entered by speed (205.8 m/s per Mach) in the hypersonic part.",
    ),
    Entry(
        "phoenix_program_2.3",
        "15.1",
        "Phoenix database program 2.3, continuum",
        _TOTAL,
        "shipped",
        "Surrogate: 33 × 9 numbers fitted to the published curves (rms CA 0.0024, CN 0.0007, Cm 0.0004).",
    ),
    Entry(
        "msl_program",
        "16.1",
        "MSL database program, continuum",
        _TOTAL,
        "shipped",
        "Proxy: Phoenix's surrogate, extrapolated beyond 16 degrees of total angle.",
    ),
    Entry("pathfinder_dac", "17.1", "Pathfinder, DSMC (DAC), transitional", _RAREFIED, "computed here", _DSMC),
    Entry("pathfinder_dacfree", "17.2", "Pathfinder, DACFree, free molecular", _FREE, "computed here", _PANELS),
    Entry(
        "pathfinder_program_knudsen",
        "17.3",
        "Pathfinder database program, transitional",
        _RAREFIED,
        "computed here",
        _DSMC,
    ),
    Entry(
        "pathfinder_program_free_molecular",
        "17.4",
        "Pathfinder database program, free molecular",
        _FREE,
        "computed here",
        _PANELS,
    ),
    Entry("mer_dac", "17.5", "MER database program, DAC, transitional", _RAREFIED, "computed here", _DSMC),
    Entry("mer_dacfree", "17.6", "MER database program, DACFree, free molecular", _FREE, "computed here", _PANELS),
)


def find(name: str) -> Entry:
    """The entry of a name, or of the thesis's table number.

    Raises
    ------
    InputError
        No such table; the nearest name is suggested.
    """
    for entry in CATALOGUE:
        if name in (entry.name, entry.table):
            return entry
    names = [entry.name for entry in CATALOGUE]
    near = get_close_matches(name.lower(), names, n=1, cutoff=0.4)
    hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(names)}."
    raise InputError(f"MEVAD has no table '{name}'; {hint}")
