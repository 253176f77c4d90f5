"""The trajectory as SPICE kernels: SPK type 13, CK type 3, with the text kernels that relate their times.

Ephemeris time follows UTC by the leap seconds and the periodic term of NAIF's own leapseconds kernel (NAIF, Time
Required Reading). The clock kernel is this flight's: one relation, 256 ticks a second, as MER's clock is kept by
NAIF. Both text kernels are written beside the binary one, so that it can be read back without others.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.results.groups import Groups
from edl_filter.whole_file import replace_with

Array = NDArray[np.float64]

#: Spacecraft number where neither mission nor user has one.
NO_SPACECRAFT = -999
TICKS = 256.0
#: Clock at the epoch of a flight that has none, s: the kernel's own count.
_COUNT_WITHOUT_CLOCK = 1.0e8
#: First day of every number of leap seconds since 1972, and that number (IERS Bulletin C).
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
#: Rows closer than this are one, s: interpolation between them would only see rounding.
_LEAST_STEP = 1e-3


@dataclass(frozen=True)
class Flight:
    """What the kernels hold, in J2000 and ephemeris time.

    Attributes
    ----------
    et, ticks : (N,) arrays
        Ephemeris time, s past J2000, and encoded spacecraft clock.
    states : (N, 6) array
        km and km/s from the planet's centre.
    body_from_j2000 : (N, 4) array
        Scalar last.
    rate : (N, 3) array
        Angular velocity in J2000, rad/s.
    spacecraft : int
    planet, title : str
    clock : float
        Count of the spacecraft's clock at the first row, s.
    has_clock : bool
        Whether that is the spacecraft's own.
    utc : str
        Of the first row.
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


def write_kernels(groups: Groups, fmt: str, path: Path, naif_id: int | None = None) -> list[Path]:
    """Write SPK or CK, and beside it the leapseconds (``.tls``) and clock (``.tsc``) kernels.

    Raises
    ------
    InputError
        spiceypy is missing, or the result does not say how its inertial frame lies in J2000.
    """
    try:
        import spiceypy
    except ImportError:
        raise InputError(
            f"--to {fmt} needs spiceypy, which is not installed; install it with pip install 'edl-filter[spice]'."
        ) from None
    flight = _flight(groups, naif_id)
    make = _write_spk if fmt == "spk" else _write_ck
    replace_with(path, lambda temporary: make(spiceypy, flight, temporary))
    clock, leap = path.with_suffix(".tsc"), path.with_suffix(".tls")
    replace_with(clock, lambda temporary: temporary.write_text(clock_kernel(flight), encoding="ascii"))
    replace_with(leap, lambda temporary: temporary.write_text(leapseconds_kernel(), encoding="ascii"))
    return [path, clock, leap]


def ephemeris_time(utc: NDArray[np.datetime64]) -> Array:
    """Seconds of TDB past J2000 of UTC, as SPICE computes them."""
    count = np.zeros(utc.shape)
    for day, leap in _LEAP_SECONDS:
        count[utc >= np.datetime64(day)] = leap
    since = (utc - np.datetime64("2000-01-01T12:00:00", "us")) / np.timedelta64(1, "us") * 1e-6
    et = since + count + 32.184
    for _ in range(3):
        anomaly = _M0 + _M1 * et
        et = since + count + 32.184 + _K * np.sin(anomaly + _EB * np.sin(anomaly))
    return et


def _flight(groups: Groups, naif_id: int | None) -> Flight:
    root, trajectory = groups["/"].attrs, groups["/trajectory"]
    if "j2000_from_inertial" not in root:
        raise InputError(
            f"mission {root.get('mission')}: planet.j2000_from_inertial: found nothing; SPICE needs to know how the "
            "result's inertial frame lies in J2000. State it in the mission and run it again."
        )
    j2000_from_inertial = rotations.from_matrix(np.reshape(root["j2000_from_inertial"], (3, 3)))

    def get(name: str) -> Array:
        return np.asarray(trajectory.variables[name].values, float)

    time = get("time")
    keep = np.concatenate(([True], np.diff(time) > _LEAST_STEP))
    first = trajectory.variables["utc"].values[0].astype("datetime64[us]")
    has_clock = "epoch_sclk" in root
    count = float(root.get("epoch_sclk", _COUNT_WITHOUT_CLOCK)) + time
    j2000_from_body = rotations.multiply(j2000_from_inertial, get("inertial_from_body")[keep])
    km = 1e-3 * np.hstack([rotations.rotate(j2000_from_inertial, get(name)[keep]) for name in ("position", "velocity")])
    return Flight(
        # within one flight ephemeris time runs with UTC to 1e-12
        et=float(ephemeris_time(np.array([first]))[0]) + (time - time[0])[keep],
        ticks=TICKS * count[keep],
        states=km,
        body_from_j2000=rotations.normalise(rotations.conjugate(j2000_from_body)),
        rate=rotations.rotate(j2000_from_body, get("angular_rate")[keep]),
        spacecraft=int(naif_id if naif_id is not None else root.get("naif_spacecraft_id", NO_SPACECRAFT)),
        planet=str(root["planet"]),
        title=str(root["title"]),
        clock=float(count[0]),
        has_clock=has_clock,
        utc=str(first),
    )


def _comments(flight: Flight) -> list[str]:
    clock = "spacecraft clock" if flight.has_clock else "kernel's own clock (the flight has none)"
    return [
        f"{flight.title}: reconstructed by edl-filter.",
        f"UTC {flight.utc} is {clock} {flight.clock:.6f} s and ephemeris time {flight.et[0]:.6f} s past J2000.",
        "All three run alike to a millionth over the flight; SCLK in ticks of 1/256 s.",
        f"Spacecraft {flight.spacecraft}, body axes {1000 * flight.spacecraft}: x along the symmetry axis towards "
        "the nose, y right, z down.",
    ]


def _write_spk(spiceypy: Any, flight: Flight, path: Path) -> None:
    """Hermite interpolation of degree 3: between two rows nothing but these two is needed."""
    centre = spiceypy.bodn2c(flight.planet)
    path.unlink()  # SPICE wants a new file
    handle = spiceypy.spkopn(str(path), "edl-filter", 4000)
    try:
        spiceypy.dafac(handle, _comments(flight))
        spiceypy.spkw13(
            handle, flight.spacecraft, centre, "J2000", flight.et[0], flight.et[-1], "edl-filter", 3,
            len(flight.et), flight.states, flight.et,
        )  # fmt: skip
    finally:
        spiceypy.spkcls(handle)


def _write_ck(spiceypy: Any, flight: Flight, path: Path) -> None:
    """Attitude and rates, interpolated over the whole flight as one interval."""
    path.unlink()
    handle = spiceypy.ckopn(str(path), "edl-filter", 4000)
    try:
        spiceypy.dafac(handle, _comments(flight))
        spiceypy.ckw03(
            handle, flight.ticks[0], flight.ticks[-1], 1000 * flight.spacecraft, "J2000", True, "edl-filter",
            len(flight.ticks), flight.ticks, np.roll(flight.body_from_j2000, 1, axis=1), flight.rate,
            1, flight.ticks[:1],
        )  # fmt: skip
    finally:
        spiceypy.ckcls(handle)


def clock_kernel(flight: Flight) -> str:
    """Spacecraft clock kernel (type 1): one relation, parallel time TDB."""
    number = -flight.spacecraft
    comments = "\n".join(_comments(flight))
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
SCLK01_COEFFICIENTS_{number}   = ( {TICKS * flight.clock:.6f} {flight.et[0]:.9f} 1.0 )

\\begintext
"""


def leapseconds_kernel() -> str:
    """Leapseconds kernel with all leap seconds up to 2017, the last so far."""
    rows = []
    for day, leap in _LEAP_SECONDS:
        year, month, date = day.split("-")
        rows.append(f"        {leap}, @{year}-{_MONTHS[int(month) - 1]}-{int(date)}")
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
