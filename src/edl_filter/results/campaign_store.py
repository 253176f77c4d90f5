"""The store of a campaign: records of all cases in one Zarr group, by case and labelled dimensions.

`write_store` reads one thousand records at a time, so that its memory does not depend on their number. `open_store`
opens the group as an xarray Dataset that reads nothing before it is used.
"""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from edl_filter.errors import InputError
from edl_filter.io.atomic import cannot_write
from edl_filter.io.output_folder import STAGING
from edl_filter.results.campaign_variables import OUTCOMES, PARTS, PHASES, STATE, VARIABLES
from edl_filter.types import AXES, BoolArray

if TYPE_CHECKING:
    from xarray import Dataset

#: Cases in one chunk of the store.
CHUNK = 1000
#: Labels that are the same in all campaigns.
_LABELS = {"axis": AXES, "phase": PHASES, "component": STATE, "part": tuple(PARTS)}


class _Labels:
    """Labels of each dimension, in the order in which records have them."""

    def __init__(self) -> None:
        self.names: dict[str, dict[str, int]] = {
            key: {label: k for k, label in enumerate(labels)} for key, labels in _LABELS.items()
        }

    def index(self, dimension: str, label: str) -> int:
        names = self.names.setdefault(dimension, {})
        return names.setdefault(label, len(names))


def write_store(
    path: Path,
    shards: Callable[[], Iterable[list[dict[str, Any]]]],
    groups: list[tuple[str, str]],
    done: BoolArray,
    failed: BoolArray,
    attributes: dict[str, Any],
) -> Path:
    """Write the store; it replaces an earlier one when it is complete.

    Parameters
    ----------
    path : Path
        Folder ``results.zarr``.
    shards : callable
        Returns an iterable of the records of each thousand cases, in order; called twice.
    groups : list of (str, str)
        Flight and dispersion of case n at index n modulo their number.
    done, failed : (N,) boolean arrays
        Outcome by case.
    attributes : dict
        Of the group.

    Raises
    ------
    InputError
        It cannot be written.
    """
    import zarr

    staged = path.with_name(f"{STAGING}{path.name}")
    shutil.rmtree(staged, ignore_errors=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of zarr, on text in format 2
            root = zarr.open_group(str(staged), mode="w", zarr_format=2)
            _fill(root, shards, groups, done, failed)
            root.attrs.update(attributes)
            zarr.consolidate_metadata(root.store, zarr_format=2)
        old = path.with_name(f"{STAGING}old.{path.name}")
        if path.exists():
            path.rename(old)
        staged.rename(path)
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        shutil.rmtree(staged, ignore_errors=True)
        raise cannot_write(path, error) from None
    return path


def _fill(
    root: Any,
    shards: Callable[[], Iterable[list[dict[str, Any]]]],
    groups: list[tuple[str, str]],
    done: BoolArray,
    failed: BoolArray,
) -> None:
    total, labels, used = len(done), _Labels(), set[str]()
    for records in shards():
        for record in records:
            for name, value in record["values"].items():
                if name in VARIABLES:
                    used.add(name)
                    for _ in _entries(VARIABLES[name].dimensions, value, labels):
                        pass
    _coordinate(root, "case", np.arange(total), ("case",), "number of the case")
    names = np.arange(total) % len(groups)
    for key, column in (("flight", 0), ("dispersion", 1)):
        texts = np.array([group[column] for group in groups])
        _coordinate(root, key, texts[names], ("case",), f"name of the {key}")
    outcome = np.where(done, 0, np.where(failed, 1, 2)).astype("i1")
    _coordinate(root, "outcome", outcome, ("case",), "index in " + ", ".join(OUTCOMES))
    for dimension, entries in labels.names.items():
        if entries and any(dimension in VARIABLES[n].dimensions for n in used):
            _coordinate(root, dimension, np.array(list(entries)), (dimension,), f"labels of {dimension}")
    arrays = {}
    for name in [n for n in VARIABLES if n in used]:
        variable = VARIABLES[name]
        shape = (total, *(len(labels.names[d]) for d in variable.dimensions))
        arrays[name] = root.create_array(
            name, shape=shape, chunks=(min(CHUNK, total), *shape[1:]), dtype="f8", fill_value=np.nan
        )
        arrays[name].attrs.update(
            {
                "_ARRAY_DIMENSIONS": ["case", *variable.dimensions],
                "units": variable.unit,
                "long_name": variable.description,
            }
        )
    seconds = root.create_array("seconds", shape=(total,), chunks=(min(CHUNK, total),), dtype="f8", fill_value=np.nan)
    seconds.attrs.update({"_ARRAY_DIMENSIONS": ["case"], "units": "s", "long_name": "time of the case"})
    arrays["seconds"] = seconds
    for records in shards():
        if records:
            _write_shard(arrays, records, labels, total)


def _write_shard(arrays: dict[str, Any], records: list[dict[str, Any]], labels: _Labels, total: int) -> None:
    """Write the records of one chunk."""
    first = CHUNK * (records[0]["case"] // CHUNK)
    length = min(CHUNK, total - first)
    for name, array in arrays.items():
        values = np.full((length, *array.shape[1:]), np.nan)
        for record in records:
            row = record["case"] - first
            if row >= length:
                continue
            if name == "seconds":
                values[row] = record["seconds"]
            elif name in record["values"]:
                for index, number in _entries(VARIABLES[name].dimensions, record["values"][name], labels):
                    values[(row, *index)] = np.nan if number is None else number
        array[first : first + length] = values


def _entries(dimensions: tuple[str, ...], value: Any, labels: _Labels) -> Iterator[tuple[tuple[int, ...], Any]]:
    """Index and number of each entry of nested labels."""
    if not dimensions:
        yield (), value
        return
    for label, part in value.items():
        index = labels.index(dimensions[0], label)
        for rest, number in _entries(dimensions[1:], part, labels):
            yield (index, *rest), number


def _coordinate(root: Any, name: str, values: Any, dimensions: tuple[str, ...], description: str) -> None:
    array = root.create_array(
        name,
        shape=values.shape,
        chunks=(max(1, min(len(values), 100 * CHUNK)),),
        dtype=values.dtype,
        fill_value=None,  # with one, xarray reads it as a missing number
    )
    array[:] = values
    array.attrs.update({"_ARRAY_DIMENSIONS": list(dimensions), "long_name": description})


def open_store(path: Path) -> Dataset:
    """Open the store lazily.

    Parameters
    ----------
    path : Path
        ``results.zarr``, or the campaign's folder.

    Returns
    -------
    Dataset
        Variables by ``case``; dask arrays if dask is installed.

    Raises
    ------
    InputError
        There is no store.
    """
    import xarray

    path = path if path.suffix == ".zarr" else path / "results.zarr"
    if not path.is_dir():
        raise InputError(f"{path}: found no store; 'edl-filter campaign CAMPAIGN -o DIR' writes it.")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = xarray.open_zarr(str(path), consolidated=True)
    return data.set_coords([name for name in ("flight", "dispersion", "outcome") if name in data])
