"""Compress the practice flights for the tests, without loss.

Run: ``python tests/data/compress_flights.py FOLDER``, the folder with practice_01.h5 and so on. Every array and every
attribute of a flight is written bit for bit into tests/data/practice, with the sha256 of the original and this command
as attributes of the file. practice_06 is part of the package and not written again. The true effects (answers.json) and
the damping table are copied.
"""

import hashlib
import shutil
import sys
from pathlib import Path

import h5py

NUMBERS = (1, 2, 3, 4, 5, 7, 8)
TABLES = ("answers.json", "damping.csv")
TARGET = Path(__file__).parent / "practice"
COMMAND = "python tests/data/compress_flights.py FOLDER"


def compressed(values):
    """Options of the smaller of two lossless compressions: shuffled bytes make quantised numbers larger."""
    sizes = {}
    for shuffle in (True, False):
        options = {"chunks": values.shape, "compression": "gzip", "compression_opts": 9, "shuffle": shuffle}
        with h5py.File("size", "w", driver="core", backing_store=False) as file:
            sizes[file.create_dataset("a", data=values, **options).id.get_storage_size()] = options
    return sizes[min(sizes)]


def copy_compressed(source, target, without=(), **attributes):
    """Copy the flight file `source` to `target` without some groups, compressed, with further attributes."""
    with h5py.File(source) as original, h5py.File(target, "w") as copy:

        def write(name, node):
            if name.split("/")[0] in without:
                return
            if isinstance(node, h5py.Dataset):
                values = node[()]
                copy.create_dataset(name, data=values, **(compressed(values) if values.size > 100 else {}))
            else:
                copy.require_group(name)
            copy[name].attrs.update(node.attrs)

        original.visititems(write)
        copy.attrs.update(original.attrs)
        copy.attrs.update(attributes)


def compress(source, target):
    """Write the flight file `source` to `target`."""
    checksum = hashlib.sha256(Path(source).read_bytes()).hexdigest()
    copy_compressed(source, target, original_sha256=checksum, command=COMMAND)


def main(folder):
    TARGET.mkdir(exist_ok=True)
    for number in NUMBERS:
        name = f"practice_{number:02d}.h5"
        compress(folder / name, TARGET / name)
        print(f"{name}: {(folder / name).stat().st_size} → {(TARGET / name).stat().st_size} bytes")
    for name in TABLES:
        shutil.copyfile(folder / name, TARGET / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
