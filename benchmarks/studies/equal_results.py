"""Two results of one input: the largest difference of their numbers, relative to each variable's largest value.

Compares `result.nc`, `residuals.nc`, `summary.json` and `diagnosis.json` of two folders, for example of two versions of
Python. Every component of a variable has its own largest value, over all times. Computing times are not compared. The
exit code is 1 above the tolerance, or where anything but a number differs. ``python equal_results.py FOLDER FOLDER``
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from edl_filter.results.files import DIAGNOSIS, RESIDUALS, RESULT, SUMMARY

TOLERANCE = 1e-9
#: Keys whose values belong to the run, not to the result.
OF_THE_RUN = ("timing_s", "versions", "created", "history")


def relative_difference(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two arrays of numbers, relative to the larger value of each component over the first axis.

    Infinite where shapes, or the places of values that are not finite, differ.
    """
    if a.shape != b.shape:
        return np.inf
    special = [np.where(np.isfinite(x), 0.0, x) for x in (a, b)]
    if not np.array_equal(*special, equal_nan=True):
        return np.inf
    a, b = (np.where(np.isfinite(x), x, 0.0) for x in (a, b))
    scale = np.maximum(np.abs(a), np.abs(b))
    if a.ndim:
        scale = np.broadcast_to(scale.max(axis=0, initial=0.0), a.shape)
    difference = np.abs(a - b)
    return float(np.max(np.divide(difference, scale, out=np.zeros_like(difference), where=scale > 0.0), initial=0.0))


def leaves(content: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Values of a JSON file by path, without those of the run."""
    if isinstance(content, dict):
        for key, value in content.items():
            if key not in OF_THE_RUN:
                yield from leaves(value, f"{path}/{key}")
    elif isinstance(content, list):
        for k, value in enumerate(content):
            yield from leaves(value, f"{path}/{k}")
    else:
        yield path, content


def variables(file: Path) -> dict[str, Any]:
    """Variables of an HDF5 file by path."""
    values: dict[str, Any] = {}

    def read(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset):
            values[name] = node[()]

    with h5py.File(file) as content:
        content.visititems(read)
    return values


def differences(a: dict[str, Any], b: dict[str, Any]) -> dict[str, float]:
    """Relative difference of each value by name; infinite where one is missing or is no number and differs."""
    out = dict.fromkeys(a.keys() ^ b.keys(), np.inf)
    for name in a.keys() & b.keys():
        x, y = np.asarray(a[name]), np.asarray(b[name])
        if x.dtype.kind in "fiu" and y.dtype.kind in "fiu":
            out[name] = relative_difference(x.astype(float), y.astype(float))
        else:
            out[name] = 0.0 if np.array_equal(x, y) else np.inf
    return out


def compare(first: Path, second: Path) -> dict[str, dict[str, float]]:
    """Differences by file, for the files of either folder."""
    out = {}
    for name in (RESULT, RESIDUALS, SUMMARY, DIAGNOSIS):
        paths = [folder / name for folder in (first, second)]
        if not any(path.is_file() for path in paths):
            continue
        if name.endswith(".json"):
            contents = [dict(leaves(json.loads(p.read_text()))) if p.is_file() else {} for p in paths]
        else:
            contents = [variables(p) if p.is_file() else {} for p in paths]
        out[name] = differences(*contents)
    return out


def main() -> None:
    """Print the largest differences of each file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs=2, type=Path)
    parser.add_argument("--tolerance", type=float, default=TOLERANCE)
    arguments = parser.parse_args()
    largest = 0.0
    for name, values in compare(*arguments.folders).items():
        worst = sorted(values.items(), key=lambda item: -item[1])[:3]
        print(f"{name}: {len(values)} variables, {sum(v > 0.0 for v in values.values())} differ")
        print("".join(f"  {value:.2g}  {variable}\n" for variable, value in worst if value > 0.0), end="")
        largest = max(largest, *values.values())
    print(f"largest relative difference {largest:.2g}")
    sys.exit(largest > arguments.tolerance)


if __name__ == "__main__":
    main()
