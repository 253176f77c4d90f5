"""The server of the workbench, on loopback only, until Ctrl-C."""

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
#: Packages of the extra ``edl-filter[serve]``.
_EXTRA_PACKAGES = ("starlette", "uvicorn")


def serve(folder: Path, port: int, browser: bool, announce: Callable[[str], None]) -> None:
    """Serve a folder's workbench until Ctrl-C.

    Parameters
    ----------
    folder : Path
        Folder of missions and results; requests cannot name files outside of it.
    port : int
        Port; 0 selects a free port.
    browser : bool
        Whether to open the page in the browser.
    announce : callable
        Called with the address of the page once the server accepts connections.

    Raises
    ------
    InputError
        The folder does not exist, packages are missing, or the port is in use.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: found no such folder; expected one with missions or results, or an empty one.")
    check_extra()
    import uvicorn

    from edl_filter.serve.app import make_app

    with listen(port) as listener:
        actual_port = listener.getsockname()[1]
        config = uvicorn.Config(
            make_app(folder, actual_port), log_level="warning", access_log=False, server_header=False,
            proxy_headers=False, ws="none", timeout_graceful_shutdown=10,
        )  # fmt: skip
        address = f"http://{HOST}:{actual_port}/"
        announce(address)
        if browser:
            webbrowser.open(address)
        with contextlib.suppress(KeyboardInterrupt):  # the regular end, after all connections are closed
            uvicorn.Server(config).run(sockets=[listener])


def check_extra() -> None:
    """Raise InputError where packages of the extra are missing."""
    missing = [name for name in _EXTRA_PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(f"serve: found no {' and no '.join(missing)}; it comes with pip install 'edl-filter[serve]'.")


def listen(port: int) -> socket.socket:
    """Return a socket that listens on loopback.

    Raises
    ------
    InputError
        The port is in use or not allowed.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # reuses a recently closed port; on other systems two servers could share a port
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        reason = "it is taken" if error.errno == errno.EADDRINUSE else (error.strerror or str(error))
        raise InputError(
            f"--port {port}: cannot be listened at ({reason}); name another, or 0 for a free one."
        ) from None
    return listener
