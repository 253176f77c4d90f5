"""Files that appear under their name only when they are whole."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from edl_filter.errors import InputError


def replace_with(path: Path, make: Callable[[Path], Any]) -> Path:
    """Let `make` write a temporary file beside `path`, then give it that name; nothing is left on failure.

    Folders above `path` are made.

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
        make(temporary)
        temporary.chmod(usual_mode())  # mkstemp makes it private
        temporary.replace(path)
    except OSError as error:
        raise cannot_write(path, error) from None
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return path


def cannot_write(path: Path, reason: OSError | str) -> InputError:
    """Error that says why `path` cannot be written."""
    return InputError(f"{path}: cannot be written ({getattr(reason, 'strerror', None) or reason}).")


def usual_mode() -> int:
    """Mode of a new file under the user's umask."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
