"""Volume merimu_1001 as text again, written from the numbers that the package ships.

The tables are those of the archive to the byte, which their sha256 shows. The labels are shorter than the archive's:
all keywords, and the position and format of each column, without descriptions.
"""

from importlib.resources import files
from pathlib import Path

import h5py
import numpy as np

from edl_filter.telemetry.mer_compact import FILE_NAMES

#: Bytes of the clock's column, and from the end of one further column to the end of the next.
CLOCK_WIDTH, STRIDE = 13, 14


def shipped_file(spacecraft):
    """Path of the rover's file in the package."""
    return Path(str(files("edl_filter") / "data" / FILE_NAMES[spacecraft]))


def write_volume(folder):
    """Write labels and tables of both rovers into DATA; give the volume's folder."""
    (folder / "DATA").mkdir(parents=True)
    for spacecraft in FILE_NAMES:
        with h5py.File(shipped_file(spacecraft)) as file:
            for product, group in file.items():
                (folder / "DATA" / f"{product}.TAB").write_bytes(table_text(group))
                (folder / "DATA" / f"{product}.LBL").write_text(label_text(product, group), newline="\r\n")
    return folder


def contents(path):
    """Attributes and values of every member of an HDF5 file, by name."""
    members = {}

    def add(name, node):
        values = (node.dtype.str, node.shape, node[()].tobytes()) if isinstance(node, h5py.Dataset) else None
        members[name] = {key: np.asarray(value).tolist() for key, value in node.attrs.items()}, values

    with h5py.File(path) as file:
        add("", file)
        file.visititems(add)
    return members


def width_of(dataset):
    return int(dataset.attrs["format"][1:].split(".")[0])


def table_text(group):
    """Rows in the archive's fixed-width format."""
    datasets = [group[name] for name in group.attrs["columns"]]
    clock, *channels = (d.attrs["decimals"] for d in datasets)
    row = f"%{CLOCK_WIDTH}.{clock}f" + "".join(f"%{STRIDE}.{decimals}f" for decimals in channels) + "\r\n"
    columns = [d[()] / 10.0 ** d.attrs["decimals"] for d in datasets]
    return "".join(row % tuple(values) for values in np.stack(columns, axis=1)).encode()


def label_text(product, group):
    """A label that describes the table."""
    keywords = {key: value for key, value in group.attrs.items() if key.isupper()}
    bare = ("PDS_VERSION_ID", "RECORD_TYPE", "RECORD_BYTES", "FILE_RECORDS")
    lines = [f"{key} = {keywords.pop(key)}" for key in bare] + [f'^TABLE = "{product}.TAB"']
    lines += [f"{key} = {value}" if "TIME" in key else f'{key} = "{value}"' for key, value in keywords.items()]
    names = group.attrs["columns"]
    counts = {"ROW_BYTES": group.attrs["RECORD_BYTES"], "ROWS": group.attrs["FILE_RECORDS"], "COLUMNS": len(names)}
    lines += ["OBJECT = TABLE", "INTERCHANGE_FORMAT = ASCII", *(f"{key} = {value}" for key, value in counts.items())]
    for k, name in enumerate(names):
        width = width_of(group[name])
        start = CLOCK_WIDTH + STRIDE * k - width + 1
        lines += ["OBJECT = COLUMN", f'NAME = "{name}"', "DATA_TYPE = ASCII_REAL", f"START_BYTE = {start}"]
        lines += [f"BYTES = {width}", f'FORMAT = "{group[name].attrs["format"]}"']
        lines += [f'UNIT = "{group[name].attrs["unit"]}"', "END_OBJECT = COLUMN"]
    return "\n".join([*lines, "END_OBJECT = TABLE", "END", ""])
