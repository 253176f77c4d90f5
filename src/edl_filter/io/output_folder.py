"""The folder that a command writes: checked before the work, locked while it lasts; what Ctrl-C leaves in it."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from edl_filter.errors import InputError, InterruptedCommandError
from edl_filter.io.atomic import cannot_write

try:
    import fcntl
except ImportError:  # a system without POSIX locks: two commands in one folder are not recognised
    _HAS_LOCKS = False
else:
    _HAS_LOCKS = True

#: Beginning of the names of hidden folders that hold unfinished output.
STAGING = ".edl-filter."
#: Name of the folder with output that is complete and is being moved to its place, and of the list of what to remove.
_COMMIT, _REMOVALS = f"{STAGING}commit", ".removals.json"


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
            descriptor = os.open(folder, os.O_RDONLY) if _HAS_LOCKS else None
        except OSError as error:
            raise cannot_write(folder, error) from None
        if descriptor is not None:
            _lock(folder, descriptor)
        finish_commit(folder)
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


@contextmanager
def interrupted(outcome: str | Callable[[], str]) -> Iterator[None]:
    """Say what a command has kept if Ctrl-C ends it.

    Parameters
    ----------
    outcome : str or callable
        Sentence, or what returns it at that time.

    Raises
    ------
    InterruptedCommandError
        In place of a KeyboardInterrupt, with the sentence.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise InterruptedCommandError(outcome if isinstance(outcome, str) else outcome()) from None


@contextmanager
def staged_output(folder: Path, removals: Callable[[Path], Iterable[str]] = lambda _: ()) -> Iterator[Path]:
    """Write several files of a folder so that either all of them appear, or none.

    They are written into a hidden folder. At the end this is renamed, in one step: from then on the output is complete,
    and its files are moved to their places. If the program is killed in between, the next one moves the rest
    (`finish_commit`).

    Parameters
    ----------
    folder : Path
        Existing folder.
    removals : callable
        Returns, for the hidden folder when it is complete, the names of files in `folder` that are removed.

    Yields
    ------
    Path
        The hidden folder; paths within it are those within `folder`.
    """
    finish_commit(folder)
    staged = Path(tempfile.mkdtemp(prefix=STAGING, dir=folder))
    try:
        yield staged
        (staged / _REMOVALS).write_text(json.dumps(list(removals(staged))), encoding="utf-8")
        staged.rename(folder / _COMMIT)
    except BaseException:
        shutil.rmtree(staged, ignore_errors=True)
        raise
    finish_commit(folder)


def finish_commit(folder: Path) -> None:
    """Move the files of a complete output to their places in `folder` that an interrupted command has not moved."""
    complete = folder / _COMMIT
    listed = complete / _REMOVALS
    if not complete.is_dir():
        return
    if listed.is_file():
        for name in json.loads(listed.read_text(encoding="utf-8")):
            (folder / name).unlink(missing_ok=True)
        for path in sorted(p for p in complete.rglob("*") if p.is_file() and p != listed):
            place = folder / path.relative_to(complete)
            place.parent.mkdir(parents=True, exist_ok=True)
            path.replace(place)
    shutil.rmtree(complete, ignore_errors=True)


def complete_output(folder: Path) -> None:
    """Finish the commit of a program that was killed, before its files are read; nothing while a program still runs."""
    if not (folder / _COMMIT).is_dir():
        return
    try:
        with output_folder(folder):
            pass
    except InputError:  # it is being written, or cannot be
        return


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
