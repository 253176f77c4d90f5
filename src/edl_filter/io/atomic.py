"""Atomic writes: a file appears under its name only when it is complete."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from edl_filter.errors import InputError


def replace_with(path: Path, write: Callable[[Path], Any]) -> Path:
    """Let `write` fill a temporary file in the folder of `path`, then rename it to `path`.

    Missing folders of `path` are created. On failure the temporary file is removed and an existing file at `path`
    stays as it was.

    Parameters
    ----------
    path : Path
        File to write or replace.
    write : callable
        Called with the temporary file's path.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    InputError
        `path` is a folder, its folder cannot be written, or the disk fails.
    """
    if path.is_dir():
        raise cannot_write(path, "it is a folder; a file's name is needed")
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        write(temporary)
        temporary.chmod(default_file_mode())  # mkstemp creates files that only their owner can read
        temporary.replace(path)
    except OSError as error:
        raise cannot_write(path, error) from None
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return path


def write_through_memory(path: Path, fill: Callable[[Any], Any]) -> None:
    """Write an HDF5 file: `fill` an open file in memory, then write its bytes to `path`.

    On a full disk HDF5 itself fails while it closes the file, with errors of its own and a crash when the program ends.

    Parameters
    ----------
    path : Path
        File to write.
    fill : callable
        Called with the open, empty `h5py.File`.

    Raises
    ------
    OSError
        The disk is full, or fails.
    """
    import h5py

    with io.BytesIO() as memory:
        with h5py.File(memory, "w") as file:
            fill(file)
        path.write_bytes(memory.getvalue())


def cannot_write(path: Path, reason: OSError | str) -> InputError:
    """Error that says why `path` cannot be written."""
    return InputError(f"{path}: cannot be written ({getattr(reason, 'strerror', None) or reason}).")


def default_file_mode() -> int:
    """Permission bits of a new file under the user's umask."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
