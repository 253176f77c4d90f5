"""Routes of the workbench: small JSON answers over the library, the plans and the worker."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

import edl_filter
from edl_filter.errors import InputError
from edl_filter.mission.adding import by_name
from edl_filter.serve import library
from edl_filter.serve.jobs import BusyError, Worker
from edl_filter.serve.plans import Plan, plan_add, plan_compare, plan_diagnose, plan_run, prepare_add
from edl_filter.serve.safety import ForbiddenError, SameOrigin

_STATIC = Path(__file__).parent / "static"
#: Bytes that a request may send: names, and no more.
_LONGEST = 16_384


def make_app(root: Path, port: int, worker: Worker | None = None) -> Starlette:
    """Application that serves one folder.

    Parameters
    ----------
    root : Path
    port : int
        That the server listens at, which is part of its origin.
    worker : Worker, optional
        Does the jobs.
    """
    bench = _Bench(root.resolve(), worker or Worker(root.resolve()))

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        yield
        await run_in_threadpool(bench.worker.cancel)

    routes = [
        Route("/", _file(_STATIC / "workbench.html")),
        Route("/workbench.css", _file(_STATIC / "workbench.css")),
        Route("/workbench.js", _file(_STATIC / "workbench.js")),
        Route("/plotly.js", _file(plotly_js())),
        Route("/api/library", bench.library),
        Route("/api/result", bench.result),
        Route("/api/residual", bench.residual),
        Route("/api/job", bench.job),
        Route("/api/run", _posted(bench.run), methods=["POST"]),
        Route("/api/diagnose", _posted(bench.diagnose), methods=["POST"]),
        Route("/api/add", _posted(bench.add), methods=["POST"]),
        Route("/api/cancel", _posted(bench.cancel), methods=["POST"]),
    ]
    handlers = {ForbiddenError: _told(403), BusyError: _told(409), InputError: _told(400), HTTPException: _plain}
    return Starlette(
        routes=routes, middleware=[Middleware(SameOrigin, port=port)], exception_handlers=handlers, lifespan=lifespan
    )


def plotly_js() -> Path:
    """The plotting library as the plotly package ships it."""
    import plotly

    return Path(str(plotly.__file__)).parent / "package_data" / "plotly.min.js"


class _Bench:
    """Answers of the routes."""

    def __init__(self, root: Path, worker: Worker) -> None:
        self.root, self.worker = root, worker

    def library(self, _: Request) -> Response:
        """Missions, with the commands that run them, and results."""
        missions = library.missions(self.root)
        for m in missions:
            try:
                plan = plan_run(self.root, m["name"])
                m.update(commands=plan.lines(), result=plan.result)
            except (InputError, ForbiddenError) as error:  # one that cannot be run does not hide the others
                m.update(commands=[], result=None, error=str(error))
        results = [
            {"path": r.path, "title": r.title, "effects": list(r.effects), "verdict": r.verdict}
            for r in library.results(self.root)
        ]
        told = {"root": str(self.root), "version": edl_filter.__version__, "missions": missions, "results": results}
        return JSONResponse(told)

    def result(self, request: Request) -> Response:
        """A result, its diagnosis, the way to it, and what can be done next."""
        result = library.find_result(self.root, _query(request, "path"))
        way = library.lineage(result, library.results(self.root))
        steps = [
            {"path": s.path, "effects": s.effects, "verdict": s.verdict, "errors": (s.diagnosis or {}).get("errors")}
            for s in way
        ]
        told = result.diagnosis
        adding = {e: self._add_lines(result.path, e) for e in by_name((told or {"ranking": ()})["ranking"])}
        return JSONResponse({
            "path": result.path, "title": result.title, "mission": result.mission, "effects": result.effects,
            "diagnosis": told, "steps": steps, "adding": adding,
            "diagnosing": plan_diagnose(self.root, result.path).lines(),
            "comparing": plan_compare([s.path for s in way]).lines() if len(way) > 1 else [],
        })  # fmt: skip

    def residual(self, request: Request) -> Response:
        """A channel's residual against time."""
        return JSONResponse(library.residual(self.root, _query(request, "path"), _query(request, "channel")))

    def job(self, _: Request) -> Response:
        """What is being done."""
        return JSONResponse({"job": None if self.worker.job is None else self.worker.job.told()})

    def run(self, asked: dict[str, Any]) -> Response:
        """Run a mission."""
        return self._start(plan_run(self.root, _text(asked, "mission"), asked.get("diagnose") is not False))

    def diagnose(self, asked: dict[str, Any]) -> Response:
        """Diagnose a result."""
        return self._start(plan_diagnose(self.root, _text(asked, "result")))

    def add(self, asked: dict[str, Any]) -> Response:
        """Add an effect to a result's mission, run and diagnose that."""
        result = _text(asked, "result")
        plan = plan_add(self.root, result, _text(asked, "effect"))
        if self.worker.job is None or self.worker.job.state != "running":
            prepare_add(self.root, result)
        return self._start(plan)

    def cancel(self, _: dict[str, Any]) -> Response:
        """Stop what is being done."""
        self.worker.cancel()
        return JSONResponse({"job": None if self.worker.job is None else self.worker.job.told()})

    def _start(self, plan: Plan) -> Response:
        return JSONResponse({"job": self.worker.start(plan).told()}, 202)

    def _add_lines(self, result: str, effect: str) -> list[str]:
        try:
            return plan_add(self.root, result, effect).lines()
        except (InputError, ForbiddenError):  # said when it is asked for; the result can be looked at all the same
            return []


def _file(path: Path) -> Callable[[Request], Response]:
    return lambda _: FileResponse(path)


def _posted(answer: Callable[[dict[str, Any]], Response]) -> Callable[[Request], Any]:
    """A route that gives the JSON object it was sent to `answer`."""

    async def route(request: Request) -> Response:
        sent = b""
        async for part in request.stream():
            sent += part
            if len(sent) > _LONGEST:
                raise HTTPException(413, f"The request is longer than {_LONGEST} bytes.")
        try:
            asked = json.loads(sent)
        except ValueError:
            asked = None
        if not isinstance(asked, dict):
            raise InputError("The request holds no JSON object.")
        return await run_in_threadpool(answer, asked)

    return route


def _query(request: Request, key: str) -> str:
    return _text(dict(request.query_params), key)


def _text(asked: dict[str, Any], key: str) -> str:
    value = asked.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"The request does not name its {key}.")
    return value


def _told(status: int) -> Callable[[Request, Exception], Response]:
    return lambda _, error: JSONResponse({"error": str(error)}, status)


def _plain(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code)
