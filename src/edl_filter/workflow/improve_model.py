"""`edl-filter improve`: the loop with every step kept as plain files, and a ledger beside them.

``step_K`` holds the model that was diagnosed in step K, as a mission file that runs, and its diagnosis; the folder
itself the final model, its result and ``ledger.jsonl``: a line for each effect that was added, and a last one that
says why there are no more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from edl_filter.diagnosis import ledger
from edl_filter.diagnosis.improve import Step, improve
from edl_filter.diagnosis.of_result import by_channel, candidates, needs_prediction
from edl_filter.diagnosis.ranking import Progress
from edl_filter.diagnosis.series import residual_series
from edl_filter.diagnosis.settle import settle
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.having import text_with
from edl_filter.mission.naming import write_mission
from edl_filter.reconstruction import reconstruct
from edl_filter.results.effects import Judged
from edl_filter.results.netcdf import write
from edl_filter.results.outputs import DIAGNOSIS, RESIDUALS, write_json, write_outputs
from edl_filter.results.plain import finite

MISSION = "mission.yaml"


@dataclass(frozen=True)
class Kept:
    """A step of the loop and what it left.

    Attributes
    ----------
    step : Step
    content : dict
        Of its ``diagnosis.json``.
    text : str
        The mission with the model's effects at their estimates.
    paragraph : str
        The step in words.
    """

    step: Step
    content: dict[str, Any]
    text: str
    paragraph: str


def steps(
    mission: Mission,
    folder: Path,
    most: int | None = None,
    names: Sequence[str] = (),
    file: Path | None = None,
    progress: Progress = lambda _: None,
) -> Iterator[Kept]:
    """Improve a mission, writing each step into `folder` as it is done.

    Parameters
    ----------
    mission : Mission
    folder : Path
    most : int, optional
        Effects to add at most.
    names, file
        As `of_result.candidates`.
    progress : callable
        Told what is being done.

    Raises
    ------
    InputError
        The folder has another mission's ledger, there is no such effect, or the mission cannot be predicted.
    """
    needs_prediction(mission, str(mission.source or mission.name))
    chosen = candidates(names, file)
    _clear(mission, folder)
    for k, step in enumerate(improve(mission, chosen, progress=progress)):
        full = most is not None and k >= most and step.added is not None
        content = finite(step.diagnosis.content())
        text, _ = text_with(mission, step.model)
        here = folder / f"step_{k}"
        write_mission(mission, text, here / MISSION)
        write_json(content, here / DIAGNOSIS)
        stop = _why(step, content, full)
        line = _last_line(k, content, stop) if stop else ledger.entry(k, content)
        ledger.append(folder, line)
        yield Kept(step, content, text, _paragraph(k, content, line, stop))
        if full:
            return


def finish(mission: Mission, folder: Path, kept: Sequence[Kept], progress: Progress = lambda _: None) -> list[Path]:
    """Write the final model's mission, result, diagnosis and figures; gives their paths."""
    from edl_filter.report.diagnosis import draw_diagnosis, ledger_figure, write_figure

    last = kept[-1]
    path = write_mission(mission, last.text, folder / MISSION)
    final = Mission.load(path)
    progress("refitting the final model")
    if any(not a.fixed for a in last.step.model):
        settled = settle(final)
        reconstruction, sigma = settled.reconstruction, settled.sigma
    else:
        reconstruction, sigma = reconstruct(final), {}
    written = write_outputs(reconstruction, folder, False, Judged(sigma, by_channel(last.content)))
    title = mission.title or mission.name
    figures = draw_diagnosis(last.content, title, folder / "figures")
    made = ledger_figure(ledger.read(folder), last.content["noise_floor"], title)
    figures.append(write_figure(made, folder / "figures" / "ledger.png"))
    found = write_json(last.content, folder / DIAGNOSIS)
    write(residual_series(last.step.diagnosis.ranking.linear), folder / RESIDUALS)
    from edl_filter.report.html import write_report

    report = write_report(folder)
    return [path, written["result"], written["summary"], found, folder / ledger.NAME, report, *figures]


def _clear(mission: Mission, folder: Path) -> None:
    """Make room for a new ledger where an earlier one of the same mission is; refuse another mission's."""
    for line in ledger.read(folder):
        if line.get("mission") != mission.name:
            raise InputError(
                f"{folder / ledger.NAME}: found the ledger of {line.get('mission')!r}; expected none, or that of "
                f"{mission.name!r}. Name another folder with -o."
            )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ledger.NAME).unlink(missing_ok=True)
    for k in count():
        old = folder / f"step_{k}"
        if not old.is_dir():
            break
        for name in (MISSION, DIAGNOSIS):
            (old / name).unlink(missing_ok=True)
        if not any(old.iterdir()):
            old.rmdir()


def _why(step: Step, content: dict[str, Any], full: bool) -> str:
    """Why nothing is added, and what is left; empty where something is added."""
    if full and step.added is not None:
        return f"Stopped: as many effects as were asked for; the next would be {step.added.name}."
    left = content["remainder"]
    return step.why_stopped + (f" What is left: {left['description']}" if step.why_stopped and left else "")


def _last_line(step: int, content: dict[str, Any], why: str) -> dict[str, Any]:
    """The ledger's last line: nothing added, and why."""
    return {
        "step": step,
        "mission": content["mission"],
        "model": content["effects"],
        "added": None,
        "why": why,
        "errors": {name: {"before": before, "after": None} for name, before in content["errors"].items()},
    }


def _paragraph(k: int, content: dict[str, Any], line: dict[str, Any], stop: str) -> str:
    from edl_filter.report.findings import number, parameters_text

    cells = content["where"]
    text = f"Step {k}: "
    if cells:
        worst = cells[0]
        text += (
            f"{len(cells)} of {len(content['map'])} cells fail, worst {worst['channel']} in {worst['regime']} at "
            f"{number(worst['normalised_rms'])} sigmas. "
        )
    else:
        text += "no channel fails in any regime. "
    if stop:
        return text + stop
    first = content["ranking"][0]
    names = " or ".join((first["effect"], *first["same_as"]))
    values = parameters_text(line["parameters"]).replace("\n", ", ")
    return (
        f"{text}Added {names} ({values}): gain {number(first['gain'])} nats, {number(first['score_gain'])} held out; "
        f"{first['channel']} falls from {number(first['error_before'])} to {number(first['error_after'])}."
    )
