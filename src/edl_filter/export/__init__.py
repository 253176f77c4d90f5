"""Export of a result's trajectory and attitude for other tools.

In: a result (``result.nc``). Out: a CSV table for spreadsheets, or SPK and CK kernels for SPICE; each has UTC and the
spacecraft's clock.

Read in this order: this file (`export`, which selects the format), `table` (CSV), `spice` (SPK and CK; needs the extra
``edl-filter[spice]``).
"""

from __future__ import annotations

from pathlib import Path

from edl_filter.errors import InputError
from edl_filter.results.files import result_file

FORMATS = ("csv", "spk", "ck")
_SUFFIX = {"csv": ".csv", "spk": ".bsp", "ck": ".bc"}

__all__ = ["FORMATS", "default_path", "export"]


def default_path(result: str | Path, fmt: str) -> Path:
    """The file that an export in a format writes, in the folder of the result.

    Raises
    ------
    InputError
        An unknown format.
    """
    if fmt not in FORMATS:
        raise InputError(f"--to: found {fmt!r}; accepted are {', '.join(FORMATS)}.")
    return result_file(result).parent / f"trajectory{_SUFFIX[fmt]}"


def export(result: str | Path, fmt: str, out: str | Path | None = None, naif_id: int | None = None) -> list[Path]:
    """Write a result in another format.

    Parameters
    ----------
    result : path
        ``result.nc``, or the folder that holds it.
    fmt : {"csv", "spk", "ck"}
        Format: a table, a trajectory kernel, an attitude kernel.
    out : path, optional
        File to write or replace; by default ``trajectory.csv``, ``.bsp`` or ``.bc`` in the folder of the result.
    naif_id : int, optional
        Number of the spacecraft in SPICE, negative; by default the mission's (MER: -253, -254), or -999.

    Returns
    -------
    list of Path
        `out`, and for SPICE the text kernels in its folder that relate its times to UTC and the spacecraft's clock.

    Raises
    ------
    InputError
        No result, an unknown format, spiceypy is missing, or the result does not state the orientation of its frame.
    """
    default_path(result, fmt)  # refuses another format
    from edl_filter.export.spice import write_kernels
    from edl_filter.export.table import write_csv
    from edl_filter.results.reader import ResultReader

    path = Path(out) if out is not None else default_path(result, fmt)
    with ResultReader.open(result) as reader:
        return [write_csv(reader, path)] if fmt == "csv" else write_kernels(reader, fmt, path, naif_id)
