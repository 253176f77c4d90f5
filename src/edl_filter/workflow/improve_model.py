"""`edl-filter improve`: stepwise improvement with every step kept as plain files, and a ledger of them.

``step_K`` holds the model that was diagnosed in step K, as a mission file that runs, and its diagnosis; the folder
itself the final model, its result and ``ledger.jsonl``: a line for each effect that was added, and a last one that
says why no more were. An improvement that was interrupted goes on at its first incomplete step (`improvement_state`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from edl_filter.diagnosis.selection.outer_loop import fit_effects
from edl_filter.diagnosis.selection.ranking import Progress
from edl_filter.diagnosis.stepwise import Step, improve
from edl_filter.effects.registry import selected_effects
from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.mission import Mission
from edl_filter.mission.edit_effects import text_with_effects
from edl_filter.mission.files import write_mission
from edl_filter.mission.mission import require_prediction_inputs
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.results.files import DIAGNOSIS, FIGURES, LEDGER, finite, read_ledger, write_json
from edl_filter.results.result import Result
from edl_filter.results.schema import DiagnosisContent, LedgerEnd, LedgerLine, LedgerStep
from edl_filter.results.schema.ledger import ErrorChange
from edl_filter.results.summary import RefitSummary
from edl_filter.workflow import improvement_state
from edl_filter.workflow.diagnose_result import rms_by_channel, write_diagnosis
from edl_filter.workflow.improvement_state import NextStep
from edl_filter.workflow.run import write_outputs

MISSION = "mission.yaml"


@dataclass(frozen=True)
class StepFiles:
    """A step of the selection and what was written of it.

    Attributes
    ----------
    step : Step
    content : DiagnosisContent
        Of its ``diagnosis.json``.
    text : str
        The mission with the model's effects at their estimates.
    paragraph : str
        The step in words.
    """

    step: Step
    content: DiagnosisContent
    text: str
    paragraph: str


def improve_steps(
    mission: Mission,
    folder: Path,
    most: int | None = None,
    names: Sequence[str] = (),
    file: Path | None = None,
    progress: Progress = lambda _: None,
) -> Iterator[StepFiles]:
    """Improve a mission, writing each step into `folder` as it is done.

    Where the same improvement was interrupted in this folder, it goes on at the step that was not complete; the steps
    before are those on the disk and are not returned again.

    Parameters
    ----------
    mission : Mission
        The mission, checked.
    folder : Path
        Folder of the results.
    most : int, optional
        Largest number of effects to add.
    names, file
        As in `effects.registry.selected_effects`.
    progress : callable
        Called with what is being done.

    Raises
    ------
    InputError
        The folder has another mission's ledger, there is no such effect, or the mission cannot be predicted.
    """
    require_prediction_inputs(mission)
    effects = selected_effects(names, file)
    _refuse_another_mission(mission, folder)
    mark = improvement_state.fingerprint(mission, effects, file)
    start = improvement_state.read(folder, mark, [*effects, *(a.effect for a in mission.active_effects())])
    if start is None or not _steps_are_complete(folder, start.number):
        start = NextStep(0, mission.active_effects())
    else:
        progress(f"going on at step {start.number}")
    _remove_steps(folder, start.number)
    for k, step in enumerate(improve(mission, effects, start.model, progress), start.number):
        full = most is not None and k >= most and step.added is not None
        content = DiagnosisContent.of(step.diagnosis.content())
        text, _ = text_with_effects(mission, step.model)
        step_folder = folder / f"step_{k}"
        write_mission(mission, text, step_folder / MISSION)
        write_json(content.model_dump(exclude_unset=True), step_folder / DIAGNOSIS)
        stop = _why_stopped(step, content, full)
        line = _last_line(k, content, stop) if stop else _added_line(k, content, step)
        _append(folder, line)
        if not stop:
            improvement_state.write(folder, mark, NextStep(k + 1, step.improved))
        yield StepFiles(step, content, text, _paragraph(k, content, line, stop))
        if full:
            return


def write_final_model(
    mission: Mission, folder: Path, steps: Sequence[StepFiles], progress: Progress = lambda _: None
) -> tuple[list[Path], str | None]:
    """Write the final model's mission, result, diagnosis and figures; returns their paths, and the headline if any."""
    from edl_filter.report.diagnosis import ledger_figure, model_change
    from edl_filter.report.html import write_report
    from edl_filter.report.matplotlib_renderer import write_figure

    last = steps[-1]
    path = write_mission(mission, last.text, folder / MISSION)
    final = Mission.load(path)
    progress("refitting the final model")
    if any(not a.fixed for a in last.step.model):
        fitted = fit_effects(final)
        reconstruction, sigma = fitted.reconstruction, fitted.sigma
    else:
        reconstruction, sigma = reconstruct(final), {}
    result = Result(reconstruction, RefitSummary(sigma, rms_by_channel(last.content)))
    written = write_outputs(result, folder, False)
    title = mission.title or mission.name
    figures = write_diagnosis(folder, last.content.model_dump(exclude_unset=True), last.step.diagnosis, title)
    lines = read_ledger(folder)
    errors = [{name: error.before for name, error in line.errors.items()} for line in lines]
    changes = [model_change(line.label, line.removed) for line in lines if isinstance(line, LedgerStep)]
    ledger_drawing = ledger_figure(
        errors, changes, last.content.noise_floor, last.content.settings.cell_minimum_rms, title
    )
    figures.append(write_figure(ledger_drawing, folder / FIGURES / "ledger.png"))
    report = write_report(folder)
    improvement_state.remove(folder)
    paths = [path, written["result"], written["summary"], folder / DIAGNOSIS, folder / LEDGER, report, *figures]
    return paths, result.trust.headline


def complete_steps(folder: Path) -> int:
    """Number of steps in a folder whose mission and diagnosis are both there."""
    return next(k for k in count() if not all((folder / f"step_{k}" / n).is_file() for n in (MISSION, DIAGNOSIS)))


def _steps_are_complete(folder: Path, number: int) -> bool:
    """Whether the files and the lines of the ledger of the steps before `number` are there."""
    lines = [line.step for line in read_ledger(folder)]
    return complete_steps(folder) >= number and lines[:number] == list(range(number))


def _refuse_another_mission(mission: Mission, folder: Path) -> None:
    """Raise if the folder has another mission's ledger; make the folder if there is none."""
    for line in read_ledger(folder):
        if line.mission != mission.name:
            raise InputError(
                f"{folder / LEDGER}: found the ledger of {line.mission!r}; expected none, or that of "
                f"{mission.name!r}. Name another folder with -o."
            )
    folder.mkdir(parents=True, exist_ok=True)


def _remove_steps(folder: Path, first: int) -> None:
    """Remove the files and the lines of the ledger of the steps from `first` on."""
    if first == 0:
        improvement_state.remove(folder)
    _keep_lines(folder, first)
    for k in count(first):
        old = folder / f"step_{k}"
        if not old.is_dir():
            break
        for name in (MISSION, DIAGNOSIS):
            (old / name).unlink(missing_ok=True)
        if not any(old.iterdir()):
            old.rmdir()


def _added_line(number: int, content: DiagnosisContent, step: Step) -> LedgerStep:
    """The line of the effect that a diagnosis names first."""
    first = content.ranking[0]
    return LedgerStep(
        step=number,
        mission=content.mission,
        model=content.effects,
        added=first.effect,
        imu=first.imu,
        same_as=first.same_as,
        parameters=first.parameters,
        removed=tuple(a.label for a in step.removed),
        gain=first.gain,
        held_out_score=first.score_gain,
        errors={n: ErrorChange(before=e, after=first.errors_after.get(n)) for n, e in content.errors.items()},
    )


def _last_line(step: int, content: DiagnosisContent, why: str) -> LedgerEnd:
    """The last line: nothing added, and why."""
    errors = {name: ErrorChange(before=before, after=None) for name, before in content.errors.items()}
    return LedgerEnd(step=step, mission=content.mission, model=content.effects, added=None, why=why, errors=errors)


def _append(folder: Path, line: LedgerLine) -> Path:
    """Append a line to the ledger in `folder`; the file is replaced as a whole, so that no part of a line remains."""
    path = folder / LEDGER
    before = path.read_text(encoding="utf-8") if path.is_file() else ""
    text = before + json.dumps(finite(line.model_dump()), ensure_ascii=False, allow_nan=False) + "\n"
    return replace_with(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def _keep_lines(folder: Path, count: int) -> None:
    """Keep the first `count` lines of the ledger in `folder`; with none the file is removed."""
    path = folder / LEDGER
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.is_file() else []
    if count == 0:
        path.unlink(missing_ok=True)
    elif len(lines) > count:
        replace_with(path, lambda temporary: temporary.write_text("".join(lines[:count]), encoding="utf-8"))


def _why_stopped(step: Step, content: DiagnosisContent, full: bool) -> str:
    """Why nothing is added, and the remainder; empty where an effect is added."""
    if full and step.added is not None:
        return f"Stopped: as many effects as were asked for; the next would be {step.added.label}."
    remainder = content.remainder
    return step.why_stopped + (f" What is left: {remainder.description}" if step.why_stopped and remainder else "")


def _paragraph(k: int, content: DiagnosisContent, line: LedgerLine, stop: str) -> str:
    from edl_filter.report.text import number, parameters_text, words

    text = f"Step {k}: "
    if content.where:
        worst = content.where[0]
        text += (
            f"{len(content.where)} of {len(content.map)} cells fail, worst {words(worst.channel)} in {worst.regime} "
            f"at {number(worst.normalised_rms)} sigmas. "
        )
    else:
        text += "no channel fails in any regime. "
    if isinstance(line, LedgerEnd):
        return text + stop
    first = content.ranking[0]
    names = " or ".join((first.label, *first.same_as))
    values = parameters_text(line.parameters).replace("\n", ", ")
    removed = f" Removed {' and '.join(line.removed)}: no longer needed." if line.removed else ""
    return (
        f"{text}Added {names} ({values}): gain {number(first.gain)} nats, {number(first.score_gain)} held out; "
        f"{words(first.channel)} falls from {number(first.error_before)} to {number(first.error_after)}."
        f"{removed}"
    )
