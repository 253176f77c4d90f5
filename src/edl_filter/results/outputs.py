"""All that one run leaves: result, summary and figures in one folder."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from edl_filter.results.netcdf import replace_with, tree_of, write
from edl_filter.results.summary import summary

if TYPE_CHECKING:
    from edl_filter.reconstruction import Reconstruction


def write_outputs(reconstruction: Reconstruction, directory: str | Path, figures: bool) -> dict[str, Any]:
    """Write ``result.nc``, ``summary.json`` and, if wanted, ``figures/``.

    Parameters
    ----------
    reconstruction : Reconstruction
    directory : path
        Made if it is not there.
    figures : bool

    Returns
    -------
    dict
        ``result`` and ``summary``: `Path`; ``figures``: list of `Path`; ``content``: the summary itself.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    from edl_filter.results.content import content, derive

    directory = Path(directory)
    begin = time.perf_counter()
    derived = derive(reconstruction)
    groups = content(reconstruction, derived)
    timing = {"postflight": time.perf_counter() - begin}
    begin = time.perf_counter()
    result = write(groups, directory / "result.nc")
    timing["write"] = time.perf_counter() - begin
    drawn: list[Path] = []
    if figures:
        from edl_filter.report.figures import draw_all

        begin = time.perf_counter()
        drawn = draw_all(tree_of(groups), directory / "figures")
        timing["figures"] = time.perf_counter() - begin
    told = summary(reconstruction, derived)
    told["timing_s"] |= timing
    path = write_json(told, directory / "summary.json")
    return {"result": result, "summary": path, "figures": drawn, "content": told}


def write_json(data: Any, path: Path) -> Path:
    """Write JSON whole or not at all; what is not finite becomes null."""
    text = json.dumps(finite(data), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    return replace_with(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def finite(data: Any) -> Any:
    """Return `data` with None for every number that is not finite, and arrays as lists."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [finite(value) for value in data]
    if isinstance(data, np.floating):
        return finite(float(data))
    if isinstance(data, np.ndarray | np.generic):
        return finite(data.tolist())
    return None if isinstance(data, float) and not math.isfinite(data) else data
