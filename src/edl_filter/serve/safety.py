"""Which requests are accepted: only those of the served page, and only for paths inside the served folder.

Every page in the user's browser can send requests to a server on loopback. The check of Host refuses names of other
sites that resolve to 127.0.0.1 (DNS rebinding); the checks of Origin and Sec-Fetch-Site refuse requests of other sites'
pages.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: The page may send requests to this server only and may not be framed; plotly writes style elements.
_POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
#: A report has its scripts and styles within itself; in the sandbox it has an origin of its own.
REPORT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
    "sandbox allow-scripts allow-downloads allow-popups; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
#: Methods that change nothing.
_READ_METHODS = ("GET", "HEAD")


class ForbiddenError(Exception):
    """A request for a path outside of the served folder; the message is one sentence for the page."""


class SameOrigin:
    """Middleware that answers every request of another page with 403 before the application receives it.

    Parameters
    ----------
    app : ASGI application
        The application.
    port : int
        Port of the server.
    """

    def __init__(self, app: ASGIApp, port: int) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the application, or refuse it."""
        from starlette.responses import JSONResponse

        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        reason = "only plain HTTP is served" if scope["type"] != "http" else self._refusal(scope)
        if reason is not None:
            if scope["type"] == "http":
                await JSONResponse({"error": f"Refused: {reason}."}, 403, _HEADERS)(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in message["headers"]}
                added = [(k.lower().encode(), v.encode()) for k, v in _HEADERS.items()]
                message["headers"] = [*message["headers"], *(pair for pair in added if pair[0] not in own)]
            await send(message)

        await self._app(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> str | None:
        """Reason for which a request is refused; None if it is accepted."""
        headers: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
        hosts, origins = headers.get("host", []), headers.get("origin", [])
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return f"found Host {', '.join(hosts) or 'nothing'}; expected {' or '.join(sorted(self._hosts))}"
        page_origin = f"http://{hosts[0]}"
        if any(origin != page_origin for origin in origins):
            return f"found Origin {', '.join(origins)}; expected {page_origin}"
        site = headers.get("sec-fetch-site", ["none"])
        if any(s not in ("same-origin", "none") for s in site):
            return f"found Sec-Fetch-Site {', '.join(site)}; expected same-origin"
        if scope["method"] in _READ_METHODS:
            return None
        if not origins:
            return f"found no Origin; a request that changes something needs {page_origin}"
        media_type = ", ".join(headers.get("content-type", ())).split(";")[0].strip().lower()
        if media_type == "application/json":
            return None
        return f"found Content-Type {media_type or 'nothing'}; expected JSON"


def inside(root: Path, text: str) -> Path:
    """Check that a path lies in the served folder, and return it.

    Parameters
    ----------
    root : Path
        The served folder, resolved.
    text : str
        Path relative to `root`, without ``..``.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder through ``..``, as an absolute path or through a symlink.
    """
    path = Path(text)
    if not text or "\0" in text or "\\" in text or path.is_absolute() or ".." in path.parts:
        raise ForbiddenError(f"Refused: found the path {text!r}; expected one inside the served folder.")
    if not leads_inside(root, root / path):
        raise ForbiddenError(f"Refused: {text!r} leads out of the served folder.")
    return root / path


def leads_inside(root: Path, path: Path) -> bool:
    """Whether `path`, with symlinks resolved, is the resolved folder `root` or lies below it."""
    try:
        return path.resolve().is_relative_to(root)
    except (OSError, RuntimeError):  # a loop of symlinks
        return False
