"""The server: loopback only, until Ctrl-C."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import os
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path

from edl_filter.errors import InputError

HOST = "127.0.0.1"
#: Packages of the extra.
_NEEDED = ("starlette", "uvicorn")


def serve(folder: Path, port: int, browser: bool, say: Callable[[str], None]) -> None:
    """Serve a folder's workbench until Ctrl-C.

    Parameters
    ----------
    folder : Path
        Missions and results in it, and nothing outside, can be seen and written.
    port : int
        0 takes a free one.
    browser : bool
        Open the page.
    say : callable
        Told the page's address once it can be reached.

    Raises
    ------
    InputError
        No such folder, packages are missing, or the port is taken.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: found no such folder; expected one with missions or results, or an empty one.")
    check_extra()
    import uvicorn

    from edl_filter.serve.app import make_app

    with listen(port) as opened:
        taken = opened.getsockname()[1]
        config = uvicorn.Config(
            make_app(folder, taken), log_level="warning", access_log=False, server_header=False, proxy_headers=False,
            ws="none", timeout_graceful_shutdown=10,
        )  # fmt: skip
        address = f"http://{HOST}:{taken}/"
        say(address)
        if browser:
            webbrowser.open(address)
        with contextlib.suppress(KeyboardInterrupt):  # the usual end, after all was closed
            uvicorn.Server(config).run(sockets=[opened])


def check_extra() -> None:
    """Raise InputError where packages of the extra are missing."""
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(f"serve: found no {' and no '.join(missing)}; it comes with pip install 'edl-filter[serve]'.")


def listen(port: int) -> socket.socket:
    """Socket that listens on loopback.

    Raises
    ------
    InputError
        The port is taken or not allowed.
    """
    opened = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # a port that a server has just left; elsewhere it would let two share one
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        opened.bind((HOST, port))
        opened.listen(128)
    except OSError as error:
        opened.close()
        why = "it is taken" if error.errno == errno.EADDRINUSE else (error.strerror or str(error))
        raise InputError(f"--port {port}: cannot be listened at ({why}); name another, or 0 for a free one.") from None
    return opened
