"""Who may ask, and for what: only the page that this server sent, and only paths inside the served folder.

A server on loopback is open to every page in the user's browser. The Host header stops names that another site points
at 127.0.0.1 (DNS rebinding); Origin and Sec-Fetch-Site stop requests which other sites send from the browser.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: The page may load and ask this server only, and nobody may frame it; plotly writes style elements.
_POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
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
_READS = ("GET", "HEAD")


class ForbiddenError(Exception):
    """A request for what lies outside of the served folder; the message is one sentence for the page."""


class SameOrigin:
    """Answers 403 to every request that the served page did not make, before anything else sees it.

    Parameters
    ----------
    app : ASGI application
    port : int
        That the server listens at.
    """

    def __init__(self, app: ASGIApp, port: int) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        from starlette.responses import JSONResponse

        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refused = "only plain HTTP is served" if scope["type"] != "http" else self._refusal(scope)
        if refused is not None:
            if scope["type"] == "http":
                await JSONResponse({"error": f"Refused: {refused}."}, 403, _HEADERS)(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"], *((k.lower().encode(), v.encode()) for k, v in _HEADERS.items())
                ]  # fmt: skip
            await send(message)

        await self._app(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> str | None:
        """Why a request is refused; None for one that is not."""
        found: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            found.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
        hosts, origins = found.get("host", []), found.get("origin", [])
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return f"found Host {', '.join(hosts) or 'nothing'}; expected {' or '.join(sorted(self._hosts))}"
        own = f"http://{hosts[0]}"
        if any(origin != own for origin in origins):
            return f"found Origin {', '.join(origins)}; expected {own}"
        site = found.get("sec-fetch-site", ["none"])
        if any(s not in ("same-origin", "none") for s in site):
            return f"found Sec-Fetch-Site {', '.join(site)}; expected same-origin"
        if scope["method"] in _READS:
            return None
        if not origins:
            return f"found no Origin; a request that changes something needs {own}"
        kind = ", ".join(found.get("content-type", ())).split(";")[0].strip().lower()
        return None if kind == "application/json" else f"found Content-Type {kind or 'nothing'}; expected JSON"


def inside(root: Path, text: str) -> Path:
    """Path of `text` below `root`, symlinks followed.

    Parameters
    ----------
    root : Path
        Resolved.
    text : str
        Relative, without ``..``.

    Raises
    ------
    ForbiddenError
        It leads out, through ``..``, as an absolute path or through a symlink.
    """
    path = Path(text)
    if not text or "\0" in text or "\\" in text or path.is_absolute() or ".." in path.parts:
        raise ForbiddenError(f"Refused: found the path {text!r}; expected one inside the served folder.")
    if not leads_inside(root, root / path):
        raise ForbiddenError(f"Refused: {text!r} leads out of the served folder.")
    return root / path


def leads_inside(root: Path, path: Path) -> bool:
    """Whether `path`, symlinks followed, lies below the resolved folder `root`, or is it."""
    try:
        return path.resolve().is_relative_to(root)
    except (OSError, RuntimeError):  # a loop of symlinks
        return False
