"""Trajectory and attitude of a result for other tools: a table for spreadsheets, kernels for SPICE.

`table` writes CSV; `spice` writes SPK and CK and needs the extra ``edl-filter[spice]``. UTC and the spacecraft's
clock are in every one of them.
"""

from __future__ import annotations

from pathlib import Path

from edl_filter.errors import InputError

FORMATS = ("csv", "spk", "ck")
_SUFFIX = {"csv": ".csv", "spk": ".bsp", "ck": ".bc"}

__all__ = ["FORMATS", "export"]


def export(result: str | Path, fmt: str, out: str | Path | None = None, naif_id: int | None = None) -> list[Path]:
    """Write a result in another form.

    Parameters
    ----------
    result : path
        ``result.nc``, or the folder that holds it.
    fmt : {"csv", "spk", "ck"}
    out : path, optional
        File to write, or to replace; beside the result if not given (``trajectory.csv``, ``.bsp``, ``.bc``).
    naif_id : int, optional
        Spacecraft's number in SPICE, negative; the mission's own (MER: -253, -254) or -999 if not given.

    Returns
    -------
    list of Path
        `out`, and for SPICE the text kernels beside it that relate its times to UTC and the spacecraft's clock.

    Raises
    ------
    InputError
        No result, an unknown format, spiceypy is missing, or the result does not say how its frame lies.
    """
    if fmt not in FORMATS:
        raise InputError(f"--to: found {fmt!r}; accepted are {', '.join(FORMATS)}.")
    from edl_filter.results.netcdf import load

    groups = load(result)
    folder = Path(result) if Path(result).is_dir() else Path(result).parent
    path = Path(out) if out is not None else folder / f"trajectory{_SUFFIX[fmt]}"
    if fmt == "csv":
        from edl_filter.export.table import write_csv

        return [write_csv(groups, path)]
    from edl_filter.export.spice import write_kernels

    return write_kernels(groups, fmt, path, naif_id)
