"""`edl-filter diagnose`: a result taken up again, diagnosed, and what is written beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any

from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.diagnose import diagnose
from edl_filter.diagnosis.ranking import Progress
from edl_filter.diagnosis.series import residual_series
from edl_filter.effects.again import among, offered
from edl_filter.effects.catalogue import unknown
from edl_filter.effects.effect import Effect
from edl_filter.effects.loading import effects_in, known_effects
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.naming import name_of, unchanged, write_mission
from edl_filter.results.netcdf import write
from edl_filter.results.outputs import AS_RUN, DIAGNOSIS, RESIDUALS, write_json
from edl_filter.results.plain import finite
from edl_filter.results.reopen import Reopened, reopen


@dataclass(frozen=True)
class Diagnosed:
    """What a diagnosis of a result leaves.

    Attributes
    ----------
    content : dict
        Of ``diagnosis.json``.
    path : Path
        ``diagnosis.json``.
    figures : list of Path
    following : list of str
        Commands to type next.
    report : Path
        ``report.html``, with the diagnosis in it.
    """

    content: dict[str, Any]
    path: Path
    figures: list[Path]
    following: list[str]
    report: Path


def candidates(names: Sequence[str] = (), file: Path | None = None) -> list[Effect]:
    """Effects that may be missing.

    Parameters
    ----------
    names : sequence of str
        Only these; without them all of the catalogue, of installed packages and of `file`.
    file : Path, optional
        Python file with effects of the user's.

    Raises
    ------
    InputError
        There is none of a name (the nearest are named), or the file cannot be used.
    """
    known = known_effects() | (effects_in(file.expanduser()) if file is not None else {})
    found = {name: among(known, name) for name in names}
    for name, effect in found.items():
        if effect is None:
            raise InputError(f"--effect: {unknown(name, known)}.")
    return [e for e in found.values() if e is not None] if names else list(known.values())


def needs_prediction(mission: Mission, where: str) -> None:
    """Raise InputError where a mission has nothing to predict the flight with."""
    for key, found in (("aerodynamics", mission.aerodynamics), ("vehicle.inertia", mission.vehicle.inertia)):
        if found is None:
            raise InputError(
                f"{where}: {key}: found nothing; a diagnosis compares the flight with a prediction, which needs it."
            )


def diagnose_result(
    result: Path, names: Sequence[str] = (), file: Path | None = None, progress: Progress = lambda _: None
) -> Diagnosed:
    """Diagnose a result; write ``diagnosis.json``, ``residuals.nc`` and figures beside it.

    Parameters
    ----------
    result : Path
        ``result.nc``, or the folder that holds one.
    names, file
        As `candidates`.
    progress : callable
        Told what is being done.

    Raises
    ------
    InputError
        No such result or effect, a result of another version, or a mission without a database to compare with.
    """
    reopened = reopen(result)
    mission = reopened.mission
    needs_prediction(mission, str(reopened.path))
    chosen = candidates(names, file)
    present = {a.name for a in reopened.effects}
    if names and not offered(chosen, present):
        raise InputError(f"--effect: {', '.join(names)} is in the model already; name an effect that is not.")
    progress("reconstructing")
    case = load_case(mission, reopened.effects)
    reopened.check_same_flight(case.reconstruction)
    found = diagnose(case, chosen, progress)
    content = finite(found.content())
    progress("drawing")
    from edl_filter.report.diagnosis import draw_diagnosis

    figures = draw_diagnosis(content, mission.title or mission.name, reopened.folder / "figures")
    path = write_json(content, reopened.folder / DIAGNOSIS)
    write(residual_series(found.ranking.linear), reopened.folder / RESIDUALS)
    _update_summary(reopened.folder / "summary.json", content)
    commands = following(reopened, content, file)
    progress("writing the report")
    from edl_filter.report.html import write_report

    return Diagnosed(content, path, figures, commands, write_report(reopened.folder))


def following(reopened: Reopened, content: dict[str, Any], file: Path | None) -> list[str]:
    """Commands that add the effect which a diagnosis names, and run the mission with it.

    A mission that ``--set`` changed is written beside its result as soon as there is a hypothesis to add to it.
    """
    if not content["ranking"]:
        return []
    mission, effect = reopened.mission, content["ranking"][0]["effect"]
    if unchanged(mission):
        name = name_of(mission)
    else:
        name = str(write_mission(mission, mission.text, reopened.folder / AS_RUN))
    if content["verdict"] != "missing":
        return []
    built_in = name.startswith("builtin:")
    stem = f"{name.removeprefix('builtin:') if built_in else Path(name).stem}+{effect}"
    added = f"{stem}.yaml" if built_in else str(Path(name).with_name(f"{stem}.yaml"))
    mine = file is not None and among(effects_in(file.expanduser()), effect) is not None
    add = f"edl-filter add {quote(name)} {effect} --from {quote(str(reopened.folder))}"
    output = reopened.folder.parent / f"{reopened.folder.name}+{effect}"
    return [
        add + (f" --file {quote(str(file))}" if mine else ""),
        f"edl-filter run {quote(added)} -o {quote(str(output))}",
    ]


def _update_summary(path: Path, content: dict[str, Any]) -> None:
    """Put the residuals that a plain run does not have into its summary."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        kept = told["residuals"]
    except (OSError, ValueError, KeyError):
        return  # moved, or not a summary: nothing hangs on it
    told["residuals"] = by_channel(content) | {name: rms for name, rms in kept.items() if ": " in name}
    write_json(told, path)


def by_channel(content: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Residuals of a diagnosis as a summary has them: channel → ``overall`` and every regime → normalised RMS."""
    found = {name: {"overall": rms} for name, rms in content["errors"].items()}
    for cell in content["map"]:
        if cell["regime"] != "constraints":
            found[cell["channel"]][cell["regime"]] = cell["normalised_rms"]
    return found
