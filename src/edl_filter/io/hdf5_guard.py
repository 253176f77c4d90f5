"""Check of an HDF5 file from an unknown source before anything in it is read.

An HDF5 file can name other files (external links, external storage, virtual datasets), contain itself (hard links) and
state shapes for which it has no data. All of this is refused with one sentence. Input: an open file. Output: none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from edl_filter.errors import InputError

#: Size of all numbers relative to that of the file, above an allowance (bytes) for files of a few constants.
LARGEST_EXPANSION, ALLOWANCE = 10, 1 << 20
#: Most members of a file, and deepest group.
MOST_MEMBERS, DEEPEST = 20_000, 16
#: What h5py raises for damaged data, missing members and types that it cannot convert.
DAMAGE = (
    OSError,
    KeyError,
    ValueError,
    TypeError,
    RuntimeError,
    IndexError,
    AttributeError,
    OverflowError,
    MemoryError,
)


@contextmanager
def open_hdf5(path: Path, needed: str) -> Iterator[Any]:
    """Open an HDF5 file for reading, checked.

    Parameters
    ----------
    path : Path
        The file.
    needed : str
        What is needed, for the message of a file that is none.

    Yields
    ------
    h5py.File

    Raises
    ------
    InputError
        It is no HDF5 file or a damaged one, or refers to other files or is larger in memory than `LARGEST_EXPANSION`
        times the file.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            check_members(file, path)
            yield file
    except DAMAGE as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: this is no HDF5 file, or a damaged one; {needed} is needed.") from None


def check_members(file: Any, path: Path) -> None:
    """Raise InputError if a member refers to another file, or the members are larger or more than a file of its size.

    Parameters
    ----------
    file : h5py.File
        Open for reading.
    path : Path
        Its path, for the size and the messages.
    """
    from h5py import h5d, h5g, h5i, h5l, h5o

    limit = LARGEST_EXPANSION * path.stat().st_size + ALLOWANCE
    total = members = 0
    seen: set[int] = set()

    def refuse(name: str, reason: str) -> InputError:
        return InputError(f"{path}: {name} {reason}")

    def visit(group: Any, parent: str, depth: int) -> None:
        nonlocal total, members
        if depth > DEEPEST:
            raise refuse(parent, f"is deeper than {DEEPEST} groups; no file of this program is.")
        for key in group:
            name = f"{parent}/{key.decode(errors='replace')}"
            members += 1
            if members > MOST_MEMBERS:
                raise refuse(name, f"is member {members}; at most {MOST_MEMBERS} are read.")
            if group.links.get_info(key).type != h5l.TYPE_HARD:
                raise refuse(name, "is a link to another member or file; a file must contain its data itself.")
            node = h5o.open(group, key)
            if isinstance(node, h5d.DatasetID):
                creation = node.get_create_plist()
                if creation.get_layout() == h5d.VIRTUAL or creation.get_external_count():
                    raise refuse(name, "has its numbers in another file; a file must contain its data itself.")
                total += math.prod(node.shape or (0,)) * node.get_type().get_size()
                if total > limit:
                    raise refuse(
                        name, f"has shape {node.shape}; with it the file's members are more than {LARGEST_EXPANSION} "
                        "times as large as the file."
                    )  # fmt: skip
            elif isinstance(node, h5g.GroupID):
                address = hash(node)
                if address in seen:
                    raise refuse(name, "is a group that has another name already; groups have one name.")
                seen.add(address)
                visit(node, name, depth + 1)

    root = h5i.get_file_id(file.id)
    top = h5o.open(root, b"/")
    seen.add(hash(top))
    visit(top, "", 0)
