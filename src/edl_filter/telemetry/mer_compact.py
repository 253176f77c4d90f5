"""The tables of volume merimu_1001 in a compact form: one HDF5 file for each rover, without loss.

Input of the writer: the volume. Its tables are text with a fixed number of decimals, so that each column is stored as
compressed integers, value times 10^decimals. Output of the reader: the same `Pds3Table` as from the text, bit for bit,
because the quotient of an integer and a power of ten is rounded as the decimal number is. The package ships both files;
their attributes name products, volume, checksums of the originals and the command that made them.

Layout: a group for each product, with the keywords of its label as attributes, and a dataset for each column.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.io.hdf5_guard import open_hdf5
from edl_filter.telemetry.fetch import BASE_URL
from edl_filter.telemetry.pds3 import Label, Pds3Table, find_in_volume, read_table
from edl_filter.types import Array

FORMAT, VERSION = "edl-mer-tables", 1
PRODUCTS = ("TRANSFORMED", "HIGHRATE")
#: Spacecraft → name of its file.
FILE_NAMES = {1: "mer_b.h5", 2: "mer_a.h5"}
#: Command that writes both files from the volume.
COMMAND = "edl-filter fetch mer-imu --compact FOLDER"

_TITLES = {1: "MER-B Opportunity, entry of 2004-01-25", 2: "MER-A Spirit, entry of 2004-01-04"}
_VOLUME = "MERIMU_1001"
_CITATION = (
    "Kass, Schofield, Crisp, Bailey, Konefat, Lee, Litty, Manning, San Martin, Willis, Beebe, Murphy, Huber: "
    "MER1/MER2-M-IMU-4-EDL-V1.0, NASA Planetary Data System, 2004"
)
_FIXED_POINT = re.compile(r"F\d+\.(\d+)")


def write_compact(volume: str | Path, folder: str | Path) -> list[Path]:
    """Write the tables of both rovers in compact form.

    Parameters
    ----------
    volume : path
        Folder of volume merimu_1001, or its DATA folder.
    folder : path
        Folder for ``mer_a.h5`` (Spirit) and ``mer_b.h5`` (Opportunity).

    Returns
    -------
    list of Path
        Both files.

    Raises
    ------
    InputError
        A missing or damaged table, a number that its column's format cannot represent, or a folder that cannot be
        written.
    """
    written = []
    for spacecraft in sorted(FILE_NAMES, reverse=True):
        tables = {f"{spacecraft}{product}": _original(Path(volume), f"{spacecraft}{product}") for product in PRODUCTS}
        path = Path(folder, FILE_NAMES[spacecraft])
        written.append(replace_with(path, partial(_write, spacecraft, tables)))
    return written


def _original(volume: Path, product: str) -> Pds3Table:
    label = find_in_volume(volume, f"{product}.LBL")
    if label is None:
        raise InputError(f"{volume}: {product}.LBL is not there; the folder of volume merimu_1001 is needed.")
    return read_table(label)


def _write(spacecraft: int, tables: dict[str, Pds3Table], path: Path) -> None:
    """Write one rover's file from its tables by product."""
    with h5py.File(path, "w") as file:
        file.attrs.update(
            {
                "format": FORMAT,
                "version": VERSION,
                "title": _TITLES[spacecraft],
                "spacecraft": spacecraft,
                "volume_id": _VOLUME,
                "volume_url": BASE_URL,
                "citation": _CITATION,
                "command": COMMAND,
                "values": "column = dataset / 10**decimals, equal to the numbers of the archive's table bit for bit",
            }
        )
        for product, table in tables.items():
            _write_table(file.create_group(product), table)


def _write_table(group: Any, table: Pds3Table) -> None:
    """Write the columns of a table, the keywords of its label, and the checksums of both files."""
    keywords = {key: value for key, value in table.label.items() if isinstance(value, str | int | float)}
    group.attrs.update({key: value for key, value in keywords.items() if key[0].isalpha()})
    for kind, (name, sha256) in zip(("label", "table"), table.files.items(), strict=True):
        group.attrs[f"{kind}_file"], group.attrs[f"{kind}_sha256"] = f"DATA/{name}", sha256
    group.attrs["columns"] = list(table.columns)
    group.attrs["values_sha256"] = _digest(table.columns.values())
    formats = {column["NAME"]: str(column.get("FORMAT", "")) for column in table.label["TABLE"][0]["COLUMN"]}
    for name, values in table.columns.items():
        match = _FIXED_POINT.fullmatch(formats[name])
        if match is None:
            raise InputError(f"{table.path}: column {name} has FORMAT {formats[name]!r}; Fw.d is needed.")
        decimals = int(match[1])
        integers = np.round(values * 10.0**decimals).astype(np.int64)
        if _values(integers, decimals).tobytes() != values.tobytes():
            row = int((_values(integers, decimals).view(np.int64) != values.view(np.int64)).argmax())
            raise InputError(f"{table.path}, row {row + 1}, column {name}: {values[row]!r} is not {formats[name]}.")
        if np.abs(integers).max() < 2**31:
            integers = integers.astype(np.int32)
        dataset = group.create_dataset(
            name, data=integers, chunks=integers.shape, compression="gzip", compression_opts=9, shuffle=True,
            fletcher32=True,
        )  # fmt: skip
        dataset.attrs.update({"decimals": decimals, "unit": table.units[name], "format": formats[name]})


def _values(integers: Any, decimals: int) -> Array:
    """Numbers (N,) of a column in its unit, from its integers."""
    return np.asarray(integers) / 10.0**decimals


def _digest(columns: Iterable[Array]) -> str:
    """Compute the sha256 of columns (N,), as little-endian float64 one after another."""
    digest = hashlib.sha256()
    for values in columns:
        digest.update(np.ascontiguousarray(values, "<f8").tobytes())
    return digest.hexdigest()


def read_compact_table(path: str | Path, product: str) -> Pds3Table:
    """Read one table from a compact file.

    Parameters
    ----------
    path : path
        File of `write_compact`.
    product : str
        PRODUCT_ID of the table, such as ``2HIGHRATE``.

    Returns
    -------
    Pds3Table
        Columns, units and `files` equal those of the original table; `label` has the keywords of its label, without
        the objects; `path` is the table's name below `path`.

    Raises
    ------
    InputError
        Another or a damaged file, another rover's file, or numbers that differ from their checksum.
    """
    path = Path(path)
    with open_hdf5(path, f"a file with the tables of a rover ({FORMAT})") as file:
        return _read(file, path, product)


def _read(file: Any, path: Path, product: str) -> Pds3Table:
    """Read one table from an open file."""
    if (file_format := file.attrs.get("format")) != FORMAT:
        raise InputError(f"{path}: attribute format is {file_format!r}; {FORMAT!r} is needed.")
    if (version := file.attrs.get("version")) != VERSION:
        raise InputError(f"{path}: attribute version is {version}; version {VERSION} is read.")
    if product not in file:
        raise InputError(
            f"{path}: has the tables {', '.join(sorted(file))} ({file.attrs.get('title')}), not {product}; "
            "telemetry.path and telemetry.spacecraft are of different rovers."
        )
    group = file[product]
    names = [str(name) for name in group.attrs["columns"]]
    columns = {name: _values(group[name][()], int(group[name].attrs["decimals"])) for name in names}
    if _digest(columns.values()) != group.attrs["values_sha256"]:
        raise InputError(f"{path}: the numbers of {product} differ from their checksum; the file was changed.")
    label: Label = {}
    for key, value in group.attrs.items():
        if key.isupper():
            label[key] = value.item() if isinstance(value, np.generic) else value
    files = {Path(group.attrs[f"{kind}_file"]).name: group.attrs[f"{kind}_sha256"] for kind in ("label", "table")}
    units = {name: group[name].attrs["unit"] for name in names}
    return Pds3Table(columns, units, label, path / Path(group.attrs["table_file"]).name, files)
