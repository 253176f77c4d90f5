"""Routes of the workbench: JSON responses from the library, the plans and the worker."""

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
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.report.colours import page_roles
from edl_filter.report.html.bundle import bundle_path, script_path, with_bundle
from edl_filter.report.next_step import next_step
from edl_filter.report.text import limited_probability_sentence, none_gain_sentence
from edl_filter.results.files import REPORT
from edl_filter.results.schema import DiagnosisContent
from edl_filter.serve import library
from edl_filter.serve.jobs import BusyError, Worker
from edl_filter.serve.overview import map_view, overview, residual_view
from edl_filter.serve.plans import (
    Plan,
    plan_add,
    plan_compare,
    plan_diagnose,
    plan_identifiability,
    plan_improve,
    plan_run,
    prepare_add,
)
from edl_filter.serve.safety import REPORT_POLICY, ForbiddenError, SameOrigin, inside

_STATIC = Path(__file__).parent / "static"
#: Greatest number of bytes in the body of a request, which contains names only.
_MAX_BODY = 16_384


def make_app(root: Path, port: int, worker: Worker | None = None) -> Starlette:
    """Create the application that serves one folder.

    Parameters
    ----------
    root : Path
        Folder to serve.
    port : int
        Port of the server, which is part of its origin.
    worker : Worker, optional
        Worker that runs the jobs.
    """
    handlers = _Handlers(root.resolve(), worker or Worker(root.resolve()))

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        yield
        await run_in_threadpool(handlers.worker.cancel)

    routes = [
        Route("/", _file_route(_STATIC / "workbench.html")),
        Route("/workbench.css", _file_route(_STATIC / "workbench.css")),
        Route("/workbench.js", _file_route(_STATIC / "workbench.js")),
        Route("/figures.js", _file_route(script_path())),
        Route("/reconstruction.js", _file_route(_STATIC / "reconstruction.js")),
        Route("/plotly.js", _file_route(bundle_path())),
        Route("/api/library", handlers.library),
        Route("/api/result", handlers.result),
        Route("/api/residual", handlers.residual),
        Route("/api/overview", handlers.overview),
        Route("/report", handlers.report),
        Route("/api/job", handlers.job),
        Route("/api/run", _json_route(handlers.run), methods=["POST"]),
        Route("/api/diagnose", _json_route(handlers.diagnose), methods=["POST"]),
        Route("/api/improve", _json_route(handlers.improve), methods=["POST"]),
        Route("/api/identifiability", _json_route(handlers.identifiability), methods=["POST"]),
        Route("/api/add", _json_route(handlers.add), methods=["POST"]),
        Route("/api/cancel", _json_route(handlers.cancel), methods=["POST"]),
    ]
    exception_handlers = {
        ForbiddenError: _error_handler(403),
        BusyError: _error_handler(409),
        InputError: _error_handler(400),
        HTTPException: _http_error,
    }
    return Starlette(
        routes=routes,
        middleware=[Middleware(SameOrigin, port=port)],
        exception_handlers=exception_handlers,
        lifespan=lifespan,
    )


class _Handlers:
    """Responses of the routes."""

    def __init__(self, root: Path, worker: Worker) -> None:
        self.root, self.worker = root, worker

    def library(self, _: Request) -> Response:
        """Missions, with the commands that run them, and results."""
        missions = library.missions(self.root)
        for m in missions:
            try:
                plan = plan_run(self.root, m["name"])
                further = {
                    "improve": plan_improve(self.root, m["name"]).lines(),
                    "identifiability": plan_identifiability(self.root, m["name"]).lines(),
                }
                m.update(commands=plan.lines(), result=plan.result, further=further)
            except (InputError, ForbiddenError) as error:  # a mission that cannot be run is listed with its error
                m.update(commands=[], result=None, further={}, problems=[*m["problems"], str(error)])
        results = [
            {"path": r.path, "title": r.title, "effects": list(r.effects), "verdict": r.verdict, "headline": r.headline}
            for r in library.results(self.root)
        ]
        return JSONResponse({
            "root": str(self.root), "version": __version__, "missions": missions, "results": results,
            "roles": page_roles(),
        })  # fmt: skip

    def result(self, request: Request) -> Response:
        """A result, its diagnosis, the results of the preceding models, and the commands of the next steps."""
        result = library.find_result(self.root, _query_text(request, "path"))
        lineage = library.lineage(result, library.results(self.root))
        steps = [
            {"path": s.path, "effects": s.effects, "verdict": s.verdict, "errors": s.diagnosis and s.diagnosis.errors}
            for s in lineage
        ]
        diagnosis = result.diagnosis
        hypotheses = () if diagnosis is None else diagnosis.hypotheses()
        adding = {label: self._add_lines(result.path, label) for label in hypotheses}
        return JSONResponse({
            "headline": result.headline,
            "path": result.path, "title": result.title, "mission": result.mission, "effects": result.effects,
            "diagnosis": diagnosis and diagnosis.model_dump(mode="json", exclude_unset=True),
            "map": diagnosis and map_view(diagnosis), "steps": steps, "adding": adding,
            **_report_sentences(diagnosis, result.path),
            "diagnosing": plan_diagnose(self.root, result.path).lines(),
            "comparing": plan_compare([s.path for s in lineage]).lines() if len(lineage) > 1 else [],
        })  # fmt: skip

    def overview(self, request: Request) -> Response:
        """The reconstruction: warnings, events, trajectory, constraints."""
        return JSONResponse(overview(self.root, _query_text(request, "path")))

    def report(self, request: Request) -> Response:
        """The report of a result as one page, in a sandbox of its own: its scripts cannot reach this server."""
        path = inside(self.root, f"{_query_text(request, 'path')}/{REPORT}")
        if not path.is_file():
            raise InputError(f"{path.parent.name}: found no report.")
        page = with_bundle(path.read_text(encoding="utf-8"))
        return HTMLResponse(page, headers={"Content-Security-Policy": REPORT_POLICY})

    def residual(self, request: Request) -> Response:
        """A channel's residual, or a constraint's innovations, against time."""
        return JSONResponse(residual_view(self.root, _query_text(request, "path"), _query_text(request, "channel")))

    def job(self, _: Request) -> Response:
        """The current job, or the last one."""
        return self._job_response()

    def run(self, body: dict[str, Any]) -> Response:
        """Run a mission."""
        return self._start(plan_run(self.root, _required_text(body, "mission"), body.get("diagnose") is not False))

    def improve(self, body: dict[str, Any]) -> Response:
        """Improve a mission."""
        return self._start(plan_improve(self.root, _required_text(body, "mission")))

    def identifiability(self, body: dict[str, Any]) -> Response:
        """Compute the detectable sizes of the effects on a mission's flight."""
        return self._start(plan_identifiability(self.root, _required_text(body, "mission")))

    def diagnose(self, body: dict[str, Any]) -> Response:
        """Diagnose a result."""
        return self._start(plan_diagnose(self.root, _required_text(body, "result")))

    def add(self, body: dict[str, Any]) -> Response:
        """Add an effect to a result's mission, run that mission and diagnose its result."""
        result = _required_text(body, "result")
        plan = plan_add(self.root, result, _required_text(body, "effect"))
        if self.worker.job is None or self.worker.job.state != "running":
            prepare_add(self.root, result)
        return self._start(plan)

    def cancel(self, _: dict[str, Any]) -> Response:
        """Cancel the current job."""
        self.worker.cancel()
        return self._job_response()

    def _start(self, plan: Plan) -> Response:
        return JSONResponse({"job": self.worker.start(plan).as_json()}, 202)

    def _job_response(self) -> Response:
        return JSONResponse({"job": None if self.worker.job is None else self.worker.job.as_json()})

    def _add_lines(self, result: str, effect: str) -> list[str]:
        try:
            return plan_add(self.root, result, effect).lines()
        except (InputError, ForbiddenError):  # reported when the effect is added; the result can be displayed
            return []


def _report_sentences(diagnosis: DiagnosisContent | None, folder: str) -> dict[str, Any]:
    """Next step and remarks on the hypotheses, in the words of the report.

    ``next`` is a sentence, ``next_commands`` those that no button of the page runs, ``remarks`` a list of sentences.
    """
    if diagnosis is None:
        return {"next": "", "next_commands": [], "remarks": []}
    step = next_step(diagnosis, "mission.yaml", Path(folder))  # its commands that name a mission are not used
    remarks = [none_gain_sentence(diagnosis), limited_probability_sentence(diagnosis)]
    by_button = diagnosis.verdict != "unknown" and bool(diagnosis.ranking)
    return {
        "next": step.sentence.rstrip(":"),
        "next_commands": [] if by_button else list(step.commands),
        "remarks": [sentence for sentence in remarks if sentence],
    }


def _file_route(path: Path) -> Callable[[Request], Response]:
    return lambda _: FileResponse(path)


def _json_route(handler: Callable[[dict[str, Any]], Response]) -> Callable[[Request], Any]:
    """A route that calls `handler` with the JSON object in the body of the request."""

    async def route(request: Request) -> Response:
        content = b""
        async for chunk in request.stream():
            content += chunk
            if len(content) > _MAX_BODY:
                raise HTTPException(413, f"The request is longer than {_MAX_BODY} bytes.")
        try:
            body = json.loads(content)
        except ValueError:
            body = None
        if not isinstance(body, dict):
            raise InputError("The request holds no JSON object.")
        return await run_in_threadpool(handler, body)

    return route


def _query_text(request: Request, key: str) -> str:
    return _required_text(dict(request.query_params), key)


def _required_text(body: dict[str, Any], key: str) -> str:
    value = body.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"The request does not name its {key}.")
    return value


def _error_handler(status: int) -> Callable[[Request, Exception], Response]:
    return lambda _, error: JSONResponse({"error": str(error)}, status)


def _http_error(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code)
