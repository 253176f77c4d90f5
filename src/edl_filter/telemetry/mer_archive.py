"""Reader of Spirit's and Opportunity's entry telemetry, with corrections of defects that the labels do not mention.

Input: PDS volume merimu_1001 (data set MER1/MER2-M-IMU-4-EDL-V1.0, Kass et al. 2004), or its tables in compact form
(`mer_compact`), in which every number is the same to the last bit. The volume has, for each spacecraft, a
table TRANSFORMED (on-board attitude, accumulated velocity, acceleration at the centre of mass) and a table HIGHRATE
(increments of angle and velocity of both IMUs at 8 Hz). MER1 is Opportunity (MER-B), MER2 is Spirit (MER-A). Method:
the functions of `mer_cleaning` detect and correct each defect. Output: both tables (`MerTables`) in the archive's axes
and in seconds of the spacecraft clock; a missing value is NaN, never zero. The clock count of a row is the time at
which the computer read; `MerTables.clocks` has the time at which the increments of each IMU end (`increment_clock`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry.increment_clock import INCREMENT, IncrementClock, extra_increments
from edl_filter.telemetry.mer_cleaning import (
    backshell_copies,
    blank_quaternions,
    blank_vectors,
    clipped_register,
    find_gaps,
    find_resets,
    j2000_from_sc,
    remove_resets,
    rounding_sigma,
    select_fullest_rows,
    trailing_run,
    with_nan,
)
from edl_filter.telemetry.mer_compact import PRODUCTS, read_compact_table
from edl_filter.telemetry.pds3 import Pds3Table, find_in_volume, read_table
from edl_filter.types import Array

#: Sampling interval of HIGHRATE, s; TRANSFORMED has one or two of them between rows.
SAMPLE_INTERVAL = 0.125

_NAMES = {1: "MER-B Opportunity", 2: "MER-A Spirit"}
_CLOCK = "SPACECRAFT_CLOCK_START_COUNT"
_AXES = ("X", "Y", "Z")
#: Largest rounding error of a quaternion with which increments are counted, rad: a hundredth of an increment of angle.
_COUNTED_SIGMA = 3e-6


@dataclass(frozen=True)
class Transformed:
    """The TRANSFORMED table, one row per clock count.

    Attributes
    ----------
    sclk : (N,) array
        Spacecraft clock, s, strictly increasing.
    rover_j2000_from_sc, backshell_j2000_from_sc : (N, 4) arrays
        On-board attitude, scalar last: ``rotate(q, v_sc)`` is in J2000. NaN where missing.
    rover_sigma, backshell_sigma : (N,) arrays
        One sigma per axis of the attitude, due to the rounding to six decimals only, rad (`rounding_sigma`).
    register : (N, 3) array
        Accumulated velocity change of the rover as telemetered, m/s. Up to the first reset its axes are inertial
        (north, east, down of the landing site), not the spacecraft's.
    velocity : (N, 3) array
        `register` without the jumps at its resets, m/s. The velocity that was accumulated between the row before a
        reset and the reset is not contained in it.
    backshell_acceleration : (N, 3) array
        Specific force at the centre of mass from the backshell's IMU, m/s². It is the mean of two 8 Hz samples and
        applies 0.125 s before the time of its row.
    """

    sclk: Array
    rover_j2000_from_sc: Array
    backshell_j2000_from_sc: Array
    rover_sigma: Array
    backshell_sigma: Array
    register: Array
    velocity: Array
    backshell_acceleration: Array


@dataclass(frozen=True)
class HighRate:
    """The HIGHRATE table: increments over the 0.125 s that end at `sclk`, in the axes of each IMU.

    Attributes
    ----------
    sclk : (M,) array
        Spacecraft clock, s, strictly increasing.
    rover_angle_increment, backshell_angle_increment : (M, 3) arrays
        rad. The label describes them as rates in rad/s, but a comparison with the on-board quaternions shows that
        they are increments.
    rover_velocity_increment, backshell_velocity_increment : (M, 3) arrays
        m/s.
    """

    sclk: Array
    rover_angle_increment: Array
    backshell_angle_increment: Array
    rover_velocity_increment: Array
    backshell_velocity_increment: Array


@dataclass(frozen=True)
class MerTables:
    """Both tables of one spacecraft, cleaned.

    Attributes
    ----------
    spacecraft : int
        1 (MER-B Opportunity) or 2 (MER-A Spirit).
    name : str
    transformed : Transformed
    highrate : HighRate
    clocks : dict
        `IncrementClock` of the ``backshell`` and the ``rover`` IMU, on the spacecraft clock.
    files : dict
        Name in the volume → sha256 of the four files.
    notes : tuple of str
        Corrections that were made, one sentence each.
    """

    spacecraft: int
    name: str
    transformed: Transformed
    highrate: HighRate
    clocks: dict[str, IncrementClock]
    files: dict[str, str]
    notes: tuple[str, ...]


def _read(source: Path, product: str, spacecraft: int) -> Pds3Table:
    """Table `product` of a spacecraft, from the volume's folder, its DATA folder or a compact file."""
    name = f"{spacecraft}{product}.LBL"
    label = source if source.is_file() else find_in_volume(source, name)
    if label is None:
        raise InputError(
            f"{source}: neither DATA/{name} nor {name} is there; the folder of volume merimu_1001 is needed."
        )
    table = read_compact_table(source, f"{spacecraft}{product}") if source.is_file() else read_table(label)
    host = f"MARS EXPLORATION ROVER {spacecraft}"
    if table.label.get("INSTRUMENT_HOST_NAME") != host:
        label_host = table.label.get("INSTRUMENT_HOST_NAME")
        raise InputError(f"{label}: INSTRUMENT_HOST_NAME is {label_host!r}; {host!r} is needed.")
    step = np.diff(table.stack(_CLOCK)[:, 0])
    if np.any(step < 0.0):
        row = int((step < 0.0).argmax()) + 2
        raise InputError(f"{table.path}, row {row}: time goes backwards by {-step[row - 2]:g} s.")
    return table


def _clean_transformed(table: Pds3Table, notes: list[str]) -> Transformed:
    """Cleaned TRANSFORMED table; appends to `notes`."""
    file_name = table.path.name
    rover_names = [f"ROVER_IMU_QUATERNION_{k}" for k in (1, 2, 3, 4)]
    backshell_names = [name.replace("ROVER", "BACKSHELL") for name in rover_names]
    register_names = [f"ROVER_IMU_DELTA_VEL_{axis}" for axis in _AXES]
    force_names = [f"BACKSHELL_IMU_ACCEL_{axis}" for axis in _AXES]
    columns = table.stack(_CLOCK, *rover_names, *backshell_names, *register_names, *force_names)
    selected = select_fullest_rows(columns[:, 0], columns[:, 1:])
    if duplicates := np.count_nonzero(~selected):
        notes.append(f"{file_name}: {duplicates} rows with the time of another removed, the fuller row kept.")
    sclk, rover, backshell, register, force = np.split(columns[selected], (1, 5, 9, 12), axis=1)
    sclk = sclk[:, 0]
    missing = {
        "rover quaternion": blank_quaternions(rover),
        "backshell quaternion": blank_quaternions(backshell),
        "rover velocity register": blank_vectors(register) | clipped_register(register),
        "backshell acceleration": blank_vectors(force),
    }
    off = trailing_run(missing["backshell quaternion"] & missing["backshell acceleration"])
    for quantity, rows in missing.items():
        count = np.count_nonzero(rows[:off] if "backshell" in quantity else rows)
        if count:
            notes.append(f"{file_name}: {count} rows with a blank or clipped {quantity} marked missing.")
    if off < len(sclk):
        notes.append(f"{file_name}: {len(sclk) - off} rows after the backshell's IMU went off marked missing.")
    register = with_nan(register, missing["rover velocity register"])
    resets = find_resets(sclk, register)
    notes.append(
        f"{file_name}: the velocity register was reset {len(resets)} times"
        + (f" (SCLK {', '.join(f'{t:.3f}' for t in sclk[resets])}); the jumps are removed." if len(resets) else ".")
    )
    rover = with_nan(rover, missing["rover quaternion"])
    backshell = with_nan(backshell, missing["backshell quaternion"])
    return Transformed(
        sclk=sclk,
        rover_j2000_from_sc=j2000_from_sc(rover),
        backshell_j2000_from_sc=j2000_from_sc(backshell),
        rover_sigma=rounding_sigma(rover),
        backshell_sigma=rounding_sigma(backshell),
        register=register,
        velocity=remove_resets(register, resets),
        backshell_acceleration=with_nan(force, missing["backshell acceleration"]),
    )


def _clean_highrate(table: Pds3Table, notes: list[str]) -> HighRate:
    """Cleaned HIGHRATE table; appends to `notes`."""
    names = [f"{unit}_IMU_{quantity}_{axis}" for unit in ("ROVER", "BACKSHELL") for quantity in ("RATES", "DELTA_VEL")
             for axis in _AXES]  # fmt: skip
    columns = table.stack(_CLOCK, *names)
    selected = select_fullest_rows(columns[:, 0], columns[:, 1:])
    sclk, rover, backshell = np.split(columns[selected], (1, 7), axis=1)
    sclk = sclk[:, 0]
    off = backshell_copies(rover, backshell)
    backshell = with_nan(backshell, off)
    for count, note in (
        (np.count_nonzero(~selected), "with the time of another removed"),
        (np.count_nonzero(off), "whose backshell columns repeat the rover's marked missing"),
    ):
        if count:
            notes.append(f"{table.path.name}: {count} rows {note}.")
    return HighRate(sclk, rover[:, :3], backshell[:, :3], rover[:, 3:], backshell[:, 3:])


def _increment_clock(transformed: Transformed, highrate: HighRate, unit: str, notes: list[str]) -> IncrementClock:
    """Clock of one IMU from its samples with another number of increments; appends to `notes`.

    HIGHRATE has the increments themselves, and velocity and angle must agree. Before it, the angle between two on-board
    quaternions shows the number, since the vehicle spins evenly.
    """
    angle, velocity, quaternion, sigma = (
        (
            highrate.backshell_angle_increment,
            highrate.backshell_velocity_increment,
            transformed.backshell_j2000_from_sc,
            transformed.backshell_sigma,
        )
        if unit == "backshell"
        else (
            highrate.rover_angle_increment,
            highrate.rover_velocity_increment,
            transformed.rover_j2000_from_sc,
            transformed.rover_sigma,
        )
    )
    index, extra = extra_increments(np.diff(highrate.sclk, prepend=highrate.sclk[0] - SAMPLE_INTERVAL), angle, velocity)
    rows = np.flatnonzero(np.isfinite(sigma) & (transformed.sclk < highrate.sclk[0]))
    rotation = rotations.to_rotation_vector(
        rotations.multiply(rotations.conjugate(quaternion[rows][:-1]), quaternion[rows][1:])
    )
    coarse = sigma[rows] > _COUNTED_SIGMA
    rotation[coarse[1:] | coarse[:-1]] = np.nan
    earlier, earlier_extra = extra_increments(np.diff(transformed.sclk[rows]), rotation)
    slips = np.concatenate((transformed.sclk[rows][1:][earlier], highrate.sclk[index]))
    clock = IncrementClock.from_slips(slips, np.concatenate((earlier_extra, extra)), unit)
    if len(slips):
        count = round(SAMPLE_INTERVAL / INCREMENT) + clock.extra
        rate = f", so that its oscillator is {1e6 * clock.rate_error:+.1f} ppm off" if len(slips) > 1 else ""
        notes.append(
            f"{unit} IMU: {len(slips)} sample{'s' * (len(slips) != 1)} of {count} increments (SCLK "
            f"{', '.join(f'{t:.3f}' for t in clock.slips)}){rate}; its sample times are corrected for that."
        )
    return clock


def read_mer_tables(source: str | Path, spacecraft: int) -> MerTables:
    """Read and clean the tables TRANSFORMED and HIGHRATE of one spacecraft.

    Parameters
    ----------
    source : path
        The volume's folder, its DATA folder, or a compact file (`mer_compact`).
    spacecraft : {1, 2}
        1 is MER-B Opportunity, 2 is MER-A Spirit.

    Returns
    -------
    MerTables

    Raises
    ------
    InputError
        No such spacecraft, a missing or damaged file, a file of the other spacecraft, or times that decrease.
    """
    if spacecraft not in _NAMES:
        raise InputError(f"spacecraft is {spacecraft!r}; 1 (MER-B Opportunity) and 2 (MER-A Spirit) are accepted.")
    source = Path(source)
    tables = {name: _read(source, name, spacecraft) for name in PRODUCTS}
    notes: list[str] = []
    if source.is_file():
        names = " and ".join(table.path.name for table in tables.values())
        notes.append(f"{source.name}: the numbers of {names}, unchanged, in compact form.")
    transformed = _clean_transformed(tables["TRANSFORMED"], notes)
    highrate = _clean_highrate(tables["HIGHRATE"], notes)
    gaps = {
        "TRANSFORMED": find_gaps(transformed.sclk, 2.1 * SAMPLE_INTERVAL),
        "HIGHRATE": find_gaps(highrate.sclk, 1.1 * SAMPLE_INTERVAL),
    }
    for name, of_table in gaps.items():
        details = ", ".join(f"{length:g} s after SCLK {start:.3f}" for start, length in of_table)
        count = f"{len(of_table)} gap{'s' * (len(of_table) != 1)}"
        notes.append(f"{tables[name].path.name}: {count}" + (f" ({details})." if of_table else "."))
    clocks = {unit: _increment_clock(transformed, highrate, unit, notes) for unit in ("backshell", "rover")}
    return MerTables(
        spacecraft=spacecraft,
        name=_NAMES[spacecraft],
        transformed=transformed,
        highrate=highrate,
        clocks=clocks,
        files={f"DATA/{name}": sha for table in tables.values() for name, sha in table.files.items()},
        notes=tuple(notes),
    )
