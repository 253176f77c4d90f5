"""The folder that a command writes: checked before the work, and locked while it lasts."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from edl_filter.errors import InputError
from edl_filter.io.atomic import cannot_write

try:
    import fcntl
except ImportError:  # a system without POSIX locks: two commands in one folder are not recognised
    fcntl = None  # type: ignore[assignment]

#: Beginning of the names of hidden folders that hold unfinished output.
STAGING = ".edl-filter."


@contextmanager
def output_folder(folder: Path) -> Iterator[Path]:
    """Hold a folder for output: it exists, can be written, and no other command writes it.

    The lock belongs to the process, so that it ends with it however it ends. Unfinished output of a command that was
    killed is removed. A folder that this function created is removed if nothing was written into it.

    Parameters
    ----------
    folder : Path
        Created if it does not exist.

    Yields
    ------
    Path
        `folder`.

    Raises
    ------
    InputError
        It cannot be created or written, or another command writes it.
    """
    created = [p for p in (folder, *folder.parents) if not p.exists()]
    descriptor = None
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(prefix=STAGING, dir=folder) as probe:
                probe.write(b"0")
            descriptor = os.open(folder, os.O_RDONLY) if fcntl is not None else None
        except OSError as error:
            raise cannot_write(folder, error) from None
        if descriptor is not None:
            _lock(folder, descriptor)
        for remnant in folder.glob(f"{STAGING}*"):
            shutil.rmtree(remnant, ignore_errors=True)
        yield folder
    finally:
        if descriptor is not None:
            os.close(descriptor)
        for path in created:
            try:
                path.rmdir()
            except OSError:  # something was written
                break


def is_empty(folder: Path) -> bool:
    """Whether a folder holds no file except unfinished output of a command that was killed."""
    return folder.is_dir() and all(STAGING in str(p.relative_to(folder)) or p.is_dir() for p in folder.rglob("*"))


def remove_if_empty(folder: Path, top: Path) -> None:
    """Remove a folder that holds no file, and its parents below `top` that are empty then."""
    if not is_empty(folder):
        return
    shutil.rmtree(folder, ignore_errors=True)
    for parent in folder.parents:
        if parent == top or not parent.is_relative_to(top) or any(parent.iterdir()):
            return
        parent.rmdir()


def check_writable(folder: Path) -> None:
    """Raise InputError if a folder for output cannot be created or written; nothing is created.

    Parameters
    ----------
    folder : Path
        It, or the nearest of its parents that exists, must be a folder with permission to write.
    """
    existing = next((p for p in (folder, *folder.absolute().parents) if p.exists()), Path())
    if not existing.is_dir():
        raise cannot_write(folder, "File exists" if existing == folder else "Not a directory")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise cannot_write(folder, "Permission denied")


def _lock(folder: Path, descriptor: int) -> None:
    """Lock a folder for this process, or say that another one has."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(
            f"{folder}: another edl-filter command writes this folder; wait until it has ended, or name another "
            "folder with -o."
        ) from None
    except OSError:  # a file system without locks
        return
