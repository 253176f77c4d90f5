"""`edl-filter run`: a mission with its effects, refitted and compared with the model, and the files of its result."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from edl_filter.errors import InputError
from edl_filter.io.atomic import cannot_write
from edl_filter.io.output_folder import STAGING, interrupted, output_folder, staged_output
from edl_filter.mission import Mission
from edl_filter.results.files import (
    DIAGNOSIS,
    DIAGNOSIS_FIGURES,
    FIGURES,
    REPORT,
    RESIDUALS,
    RESULT,
    SUMMARY,
    TABLES,
    UPDATE_FILES,
    figure_files,
    write_json,
)
from edl_filter.results.netcdf import write

if TYPE_CHECKING:  # the compiler and the reconstruction are imported while another process imports matplotlib
    from edl_filter.report.figure_process import FigureProcess
    from edl_filter.results.result import Result


class RunDisplay(Protocol):
    """What the caller of `run_into_folder` displays while it works."""

    def task(self, name: str) -> AbstractContextManager[Callable[[str], None]]:
        """Display a task while it lasts; the callable is called with each of its steps."""

    def replaces(self, sentence: str) -> None:
        """Display, before the work, what of an earlier run is replaced or removed."""

    def written(self, outputs: dict[str, Any]) -> None:
        """Display the result, as `write_outputs` returns it, while its figures are still being drawn."""


def run_into_folder(
    mission: str,
    output: Path | None,
    changes: Sequence[str],
    figures: bool,
    refit: bool,
    formats: Sequence[str],
    display: RunDisplay,
) -> dict[str, Any]:
    """Reconstruct a mission and write the files of its result, from the mission's name to the last figure.

    Parameters
    ----------
    mission : str
        Mission file, or ``builtin:NAME``.
    output : Path, optional
        Folder of the result; by default the one that the mission names. It is locked while the run lasts.
    changes : sequence of str
        ``KEY=VALUE``, for this run.
    figures : bool
        Whether figures are drawn, if the mission does not turn them off.
    refit : bool
        As in `run_mission`.
    formats : sequence of str
        As in `write_outputs`.
    display : RunDisplay
        Called with tasks and results in the order of the work.

    Returns
    -------
    dict
        As `write_outputs`, with the figures.

    Raises
    ------
    InputError
        The mission or a file that it names is wrong, or the folder cannot be written.
    InterruptedCommandError
        Ctrl-C ended the run; the message says what it has kept.
    """
    loaded = Mission.load(mission, changes)
    folder = output or loaded.output_directory()
    drawn = figures and loaded.outputs.figures
    written_before = _written_at(folder)

    def kept() -> str:
        """What an interrupted run leaves."""
        if _written_at(folder) == written_before:
            return f"Nothing was written; what {folder} held before is unchanged."
        return f"The result is complete; its report or figures may be missing: edl-filter figures {folder}"

    from edl_filter.report.figure_process import FigureProcess

    # matplotlib is imported in a process of its own while the mission is reconstructed
    with output_folder(folder), interrupted(kept), FigureProcess() if drawn else nullcontext() as process:
        check_output_names(folder)
        for sentence in earlier_outputs(folder):
            display.replaces(sentence)
        with display.task(f"Reconstructing {loaded.title or loaded.name}") as report_step:
            result = run_mission(loaded, refit, report_step)
        with display.task("Writing results"):
            outputs = write_outputs(result, folder, drawn, formats, process)
        display.written(outputs)
        if process is not None:
            with display.task("Drawing figures"):
                outputs["figures"] = process.wait()
    return outputs


def run_mission(mission: Mission, refit: bool = True, progress: Callable[[str], None] = lambda _: None) -> Result:
    """Reconstruct an entry with its effects at their most probable values.

    A mission without effects is reconstructed and no more: to compare it with its model takes longer than that,
    and `edl-filter diagnose` does it.

    Parameters
    ----------
    mission : Mission
        The mission, checked.
    refit : bool
        Without it effects stay at their values, and nothing is compared.
    progress : callable
        Called with what is being done.

    Returns
    -------
    Result
        Its `refit` is empty where there are no effects, or no aerodynamic database with which to predict.

    Raises
    ------
    InputError
        As `reconstruct`; or the record violates the physics of an entry (`pipeline.plausibility`).
    """
    from edl_filter.pipeline.reconstruct import FlightInputs, reconstruct
    from edl_filter.pipeline.trust import checked_telemetry
    from edl_filter.results.result import Result
    from edl_filter.results.summary import RefitSummary

    telemetry = checked_telemetry(mission)
    if not refit or not mission.effects or mission.aerodynamics is None or mission.vehicle.inertia is None:
        return Result(reconstruct(mission, inputs=None if telemetry is None else FlightInputs(telemetry)))
    from edl_filter.diagnosis.linear_model.credible_model import credible_model
    from edl_filter.diagnosis.linear_model.flight_case import flight_case, load_case
    from edl_filter.diagnosis.residual_analysis.residual_map import rms_by_regime
    from edl_filter.diagnosis.selection.outer_loop import can_fit_effects, fit_effects

    if can_fit_effects(mission):
        fitted = fit_effects(mission, progress)
        reconstruction, sigma = fitted.reconstruction, fitted.sigma
    else:
        reconstruction, sigma = reconstruct(mission), {}
    progress("comparing model and measurements")
    begin = time.perf_counter()
    if reconstruction.recovery is None:
        case = flight_case(reconstruction)
    else:  # as in a diagnosis, which does not add the noise of a recovery to the model
        case = load_case(mission, reconstruction.effects)
    normalised = rms_by_regime(credible_model(case)[0])
    timing = reconstruction.timing | {"residuals": time.perf_counter() - begin}
    return Result(replace(reconstruction, timing=timing), RefitSummary(sigma, normalised))


def write_outputs(
    result: Result,
    directory: str | Path,
    figures: bool,
    formats: Sequence[str] = ("png",),
    process: FigureProcess | None = None,
) -> dict[str, Any]:
    """Write ``result.nc``, ``summary.json``, tables in ``tables/``, ``report.html`` and, on request, ``figures/``.

    Result, summary and tables are written into a hidden folder and appear together (`output_folder.staged_output`), so
    that a failure, or the end of the program at any moment, does not mix earlier and new files; figures, report and
    diagnosis of an earlier run are removed in the same step. Then the figures are drawn from ``result.nc``, in other
    processes, while the report is written; each file appears when it is complete.

    Parameters
    ----------
    result : Result
        The result.
    directory : path
        Created if it does not exist.
    figures : bool
        Whether figures are written.
    formats : sequence of str
        Formats of the figures, of `results.files.FIGURE_FORMATS`.
    process : FigureProcess, optional
        Begins to draw the figures, and the caller waits for it (``process.wait()``); the returned mapping has none.

    Returns
    -------
    dict
        ``result``, ``summary`` and ``report``: `Path`; ``figures``: list of `Path`; ``content``: the summary itself.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    for active in result.mission.session_effects:
        raise InputError(
            f"{directory}: found the effect {active.name}, which exists in this Python session only; a result that "
            f"is to be read later needs it in a file: edl_filter.effect({active.name!r}, file='my_effect.py')."
        )
    directory = Path(directory)
    check_output_names(directory)
    file, summary = directory / RESULT, directory / SUMMARY
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with staged_output(directory, _removals) as staged:
            content = _write_all(result, staged)
        if (directory / FIGURES).is_dir() and not any((directory / FIGURES).iterdir()):
            (directory / FIGURES).rmdir()
    except OSError as error:
        place = Path(error.filename2 or error.filename or directory)
        if any(part.startswith(STAGING) for part in place.parts):  # its place at the end, not that before
            place = directory / place.name
        raise cannot_write(place, error) from None
    from edl_filter.report.html import write_report

    written: dict[str, Any] = {"result": file, "summary": summary, "content": content}
    if not figures:
        return written | {"report": write_report(directory), "figures": []}
    from edl_filter.report.figure_process import FigureProcess

    if process is not None:
        process.start(directory, directory / FIGURES, formats)
        return written | {"report": write_report(directory), "figures": []}
    with FigureProcess() as drawing:
        drawing.start(directory, directory / FIGURES, formats)
        return written | {"report": write_report(directory), "figures": drawing.wait()}


def check_output_names(directory: Path) -> None:
    """Raise InputError if a folder stands where a file of a result is to be written."""
    for name in (RESULT, SUMMARY, REPORT):
        if (directory / name).is_dir():
            raise cannot_write(directory / name, "it is a folder")


def earlier_outputs(directory: Path) -> list[str]:
    """Sentences on what a run replaces and removes in a folder."""
    sentences = []
    if (directory / RESULT).is_file():
        sentences.append(f"{directory} holds an earlier result; it is replaced.")
    if (directory / DIAGNOSIS).is_file():
        sentences.append(f"{directory} holds the diagnosis of the earlier result; it is removed ({DIAGNOSIS}).")
    return sentences


def _written_at(folder: Path) -> int | None:
    """Time (ns) at which the result in a folder was written; None without one."""
    path = folder / RESULT
    return path.stat().st_mtime_ns if path.is_file() else None


def _write_all(result: Result, folder: Path) -> dict[str, Any]:
    """Write result, tables and summary into `folder`; the content of the summary."""
    from edl_filter.results.postflight import tables

    begin = time.perf_counter()
    groups = result.groups
    timing = {"postflight": time.perf_counter() - begin}
    begin = time.perf_counter()
    write(groups, folder / RESULT)
    timing["write"] = time.perf_counter() - begin
    postflight = result.derived.postflight
    if postflight is not None:
        (folder / TABLES).mkdir()
        for name, text in tables(postflight).items():
            (folder / TABLES / name).write_text(text, encoding="utf-8")
    content = result.summary()
    content["timing_s"] |= timing
    write_json(content, folder / SUMMARY)
    return content


def _removals(staged: Path) -> list[str]:
    """Files of an earlier result that a new one in `staged` makes invalid: those that are not replaced."""
    from edl_filter.report.figures import FIGURES as DRAWN

    names = (DIAGNOSIS, RESIDUALS, *UPDATE_FILES, REPORT, *figure_files((*DRAWN, *DIAGNOSIS_FIGURES)))
    return [name for name in names if not (staged / name).is_file()]
