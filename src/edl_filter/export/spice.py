"""SPICE kernels of the trajectory: SPK type 13, CK type 3, and the text kernels that relate their times.

Input: a result. Method: ephemeris time is computed from UTC with the leap seconds and the periodic term of NAIF's
leapseconds kernel (NAIF, Time Required Reading). The clock kernel is specific to the flight: one relation, 256 ticks
per second, as in NAIF's kernels for MER's clock. Output: the binary kernel and both text kernels in the same folder, so
that it can be read without other kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.results.reader import ResultReader
from edl_filter.types import Array

#: Spacecraft number if neither the mission nor the user states one.
NO_SPACECRAFT = -999
#: Ticks of the spacecraft's clock per second.
TICKS = 256.0
#: Clock count at the epoch of a flight without a spacecraft clock, s.
_COUNT_WITHOUT_CLOCK = 1.0e8
#: Days from which a number of leap seconds applies, since 1972, and the number (IERS Bulletin C).
_LEAP_SECONDS = (
    ("1972-01-01", 10), ("1972-07-01", 11), ("1973-01-01", 12), ("1974-01-01", 13), ("1975-01-01", 14),
    ("1976-01-01", 15), ("1977-01-01", 16), ("1978-01-01", 17), ("1979-01-01", 18), ("1980-01-01", 19),
    ("1981-07-01", 20), ("1982-07-01", 21), ("1983-07-01", 22), ("1985-07-01", 23), ("1988-01-01", 24),
    ("1990-01-01", 25), ("1991-01-01", 26), ("1992-07-01", 27), ("1993-07-01", 28), ("1994-07-01", 29),
    ("1996-01-01", 30), ("1997-07-01", 31), ("1999-01-01", 32), ("2006-01-01", 33), ("2009-01-01", 34),
    ("2012-07-01", 35), ("2015-07-01", 36), ("2017-01-01", 37),
)  # fmt: skip
_MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")
#: Periodic term of TDB - TT: amplitude (s), eccentricity, mean anomaly (rad) and its rate (rad/s).
_K, _EB, _M0, _M1 = 1.657e-3, 1.671e-2, 6.239996, 1.99096871e-7
#: Shortest step between two rows, s: between closer rows the interpolation would be dominated by rounding.
_SHORTEST_STEP = 1e-3


@dataclass(frozen=True)
class KernelContents:
    """Contents of the kernels, in J2000 and ephemeris time.

    Attributes
    ----------
    et, ticks : (N,) arrays
        Ephemeris time, s past J2000, and encoded spacecraft clock, ticks.
    states : (N, 6) array
        Position and velocity relative to the planet's centre, km and km/s.
    body_from_j2000 : (N, 4) array
        Unit quaternions, scalar last.
    rate : (N, 3) array
        Angular velocity in J2000, rad/s.
    spacecraft : int
    planet, title : str
    clock : float
        Clock count of the first row, s.
    has_clock : bool
        True if it is the spacecraft's clock, false if it is the kernel's own count.
    utc : str
        UTC of the first row.
    """

    et: Array
    ticks: Array
    states: Array
    body_from_j2000: Array
    rate: Array
    spacecraft: int
    planet: str
    title: str
    clock: float
    has_clock: bool
    utc: str


def write_kernels(reader: ResultReader, fmt: str, path: Path, naif_id: int | None = None) -> list[Path]:
    """Write an SPK or CK, and the clock (``.tsc``) and leapseconds (``.tls``) kernels in the same folder.

    Parameters
    ----------
    reader : ResultReader
        Of a result.
    fmt : {"spk", "ck"}
        Kernel of the trajectory or of the attitude.
    path : Path
        Binary kernel to write or replace.
    naif_id : int, optional
        Number of the spacecraft; by default the mission's, or `NO_SPACECRAFT`.

    Returns
    -------
    list of Path
        The three kernels.

    Raises
    ------
    InputError
        spiceypy is missing, or the result does not state the orientation of its inertial frame in J2000.
    """
    try:
        import spiceypy
    except ImportError:
        raise InputError(
            f"--to {fmt} needs spiceypy, which is not installed; install it with pip install 'edl-filter[spice]'."
        ) from None
    contents = _contents(reader, naif_id)
    write = _write_spk if fmt == "spk" else _write_ck
    replace_with(path, lambda temporary: write(spiceypy, contents, temporary))
    clock, leap = path.with_suffix(".tsc"), path.with_suffix(".tls")
    replace_with(clock, lambda temporary: temporary.write_text(clock_kernel(contents), encoding="ascii"))
    replace_with(leap, lambda temporary: temporary.write_text(leapseconds_kernel(), encoding="ascii"))
    return [path, clock, leap]


def ephemeris_time(utc: NDArray[np.datetime64]) -> Array:
    """Ephemeris time (TDB past J2000) of UTC, as SPICE computes it.

    Parameters
    ----------
    utc : (N,) array of datetime64
        UTC since 1972.

    Returns
    -------
    (N,) array
        s.
    """
    leap_seconds = np.zeros(utc.shape)
    for day, number in _LEAP_SECONDS:
        leap_seconds[utc >= np.datetime64(day)] = number
    utc_past_j2000 = (utc - np.datetime64("2000-01-01T12:00:00", "us")) / np.timedelta64(1, "us") * 1e-6
    et = utc_past_j2000 + leap_seconds + 32.184
    for _ in range(3):
        anomaly = _M0 + _M1 * et
        et = utc_past_j2000 + leap_seconds + 32.184 + _K * np.sin(anomaly + _EB * np.sin(anomaly))
    return et


def _contents(reader: ResultReader, naif_id: int | None) -> KernelContents:
    """Contents of the kernels from a result."""
    root = reader.groups["/"].attrs
    if "j2000_from_inertial" not in root:
        raise InputError(
            f"mission {root.get('mission')}: planet.j2000_from_inertial: found nothing; SPICE needs to know how the "
            "result's inertial frame lies in J2000. State it in the mission and run it again."
        )
    j2000_from_inertial = rotations.from_matrix(np.reshape(root["j2000_from_inertial"], (3, 3)))
    time = reader.time
    selected = np.concatenate(([True], np.diff(time) > _SHORTEST_STEP))
    first = reader.groups["/trajectory"].variables["utc"].values[0].astype("datetime64[us]")
    has_clock = "epoch_sclk" in root
    count = float(root.get("epoch_sclk", _COUNT_WITHOUT_CLOCK)) + time
    j2000_from_body = rotations.multiply(
        j2000_from_inertial, reader.required("trajectory", "inertial_from_body")[selected]
    )
    states = [
        rotations.rotate(j2000_from_inertial, reader.required("trajectory", name)[selected])
        for name in ("position", "velocity")
    ]
    return KernelContents(
        # Within one flight the rates of ephemeris time and UTC agree to 1e-12
        et=float(ephemeris_time(np.array([first]))[0]) + (time - time[0])[selected],
        ticks=TICKS * count[selected],
        states=1e-3 * np.hstack(states),
        body_from_j2000=rotations.normalise(rotations.conjugate(j2000_from_body)),
        rate=rotations.rotate(j2000_from_body, reader.required("trajectory", "angular_rate")[selected]),
        spacecraft=int(naif_id if naif_id is not None else root.get("naif_spacecraft_id", NO_SPACECRAFT)),
        planet=str(root["planet"]),
        title=str(root["title"]),
        clock=float(count[0]),
        has_clock=has_clock,
        utc=str(first),
    )


def _comments(contents: KernelContents) -> list[str]:
    """Comment lines of all kernels."""
    clock = "spacecraft clock" if contents.has_clock else "kernel's own clock (the flight has none)"
    return [
        f"{contents.title}: reconstructed by edl-filter.",
        f"UTC {contents.utc} is {clock} {contents.clock:.6f} s and ephemeris time {contents.et[0]:.6f} s past J2000.",
        "All three run alike to a millionth over the flight; SCLK in ticks of 1/256 s.",
        f"Spacecraft {contents.spacecraft}, body axes {1000 * contents.spacecraft}: x along the symmetry axis towards "
        "the nose, y right, z down.",
    ]


def _write_spk(spiceypy: Any, contents: KernelContents, path: Path) -> None:
    """Write an SPK with Hermite interpolation of degree 3, which depends only on the two rows around a time."""
    centre = spiceypy.bodn2c(contents.planet)
    path.unlink()  # SPICE writes to new files only
    handle = spiceypy.spkopn(str(path), "edl-filter", 4000)
    try:
        spiceypy.dafac(handle, _comments(contents))
        spiceypy.spkw13(
            handle, contents.spacecraft, centre, "J2000", contents.et[0], contents.et[-1], "edl-filter", 3,
            len(contents.et), contents.states, contents.et,
        )  # fmt: skip
    finally:
        spiceypy.spkcls(handle)


def _write_ck(spiceypy: Any, contents: KernelContents, path: Path) -> None:
    """Write a CK with attitudes and rates, interpolated over the whole flight as one interval."""
    path.unlink()
    handle = spiceypy.ckopn(str(path), "edl-filter", 4000)
    try:
        spiceypy.dafac(handle, _comments(contents))
        spiceypy.ckw03(
            handle, contents.ticks[0], contents.ticks[-1], 1000 * contents.spacecraft, "J2000", True, "edl-filter",
            len(contents.ticks), contents.ticks, np.roll(contents.body_from_j2000, 1, axis=1), contents.rate,
            1, contents.ticks[:1],
        )  # fmt: skip
    finally:
        spiceypy.ckcls(handle)


def clock_kernel(contents: KernelContents) -> str:
    """Text of the spacecraft clock kernel (type 1): one relation, with TDB as the parallel time."""
    number = -contents.spacecraft
    comments = "\n".join(_comments(contents))
    return f"""KPL/SCLK

{comments}

\\begindata

SCLK_KERNEL_ID            = ( @2000-01-01/00:00:00 )
SCLK_DATA_TYPE_{number}        = ( 1 )
SCLK01_TIME_SYSTEM_{number}    = ( 1 )
SCLK01_N_FIELDS_{number}       = ( 2 )
SCLK01_MODULI_{number}         = ( 4294967296 256 )
SCLK01_OFFSETS_{number}        = ( 0 0 )
SCLK01_OUTPUT_DELIM_{number}   = ( 1 )
SCLK_PARTITION_START_{number}  = ( 0.0 )
SCLK_PARTITION_END_{number}    = ( 1.0995116E+12 )
SCLK01_COEFFICIENTS_{number}   = ( {TICKS * contents.clock:.6f} {contents.et[0]:.9f} 1.0 )

\\begintext
"""


def leapseconds_kernel() -> str:
    """Text of the leapseconds kernel with all leap seconds, of which the last was in 2017."""
    rows = []
    for day, number in _LEAP_SECONDS:
        year, month, date = day.split("-")
        rows.append(f"        {number}, @{year}-{_MONTHS[int(month) - 1]}-{int(date)}")
    table = ",\n".join(rows)
    return f"""KPL/LSK

Leap seconds (IERS Bulletin C), the relation of TDB to TT as in NAIF's leapseconds kernels.

\\begindata

DELTET/DELTA_T_A = 32.184
DELTET/K         = {_K}
DELTET/EB        = {_EB}
DELTET/M         = ( {_M0} {_M1} )
DELTET/DELTA_AT  = (
{table}
)

\\begintext
"""
