"""`edl-filter diagnose`: open a result, diagnose it, and write the diagnosis into its folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from edl_filter.diagnosis.diagnosis import Diagnosis, diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.residual_analysis.residual_map import CONSTRAINTS, OVERALL, residual_series
from edl_filter.diagnosis.selection.ranking import Progress, candidate_instances
from edl_filter.effects.instances import lookup
from edl_filter.effects.registry import effects_in, selected_effects
from edl_filter.errors import InputError
from edl_filter.io.output_folder import staged_output
from edl_filter.mission.files import matches_file, mission_argument, write_mission
from edl_filter.mission.mission import require_prediction_inputs
from edl_filter.results.database_update import write_update
from edl_filter.results.files import (
    AS_RUN,
    DIAGNOSIS,
    DIAGNOSIS_FIGURES,
    FIGURES,
    REPORT,
    RESIDUALS,
    UPDATE_FILES,
    figure_files,
    read_summary,
    write_json,
)
from edl_filter.results.netcdf import write
from edl_filter.results.reopen import Reopened, reopen
from edl_filter.results.schema import DiagnosisContent

if TYPE_CHECKING:
    from edl_filter.report.next_step import NextStep


@dataclass(frozen=True)
class DiagnosisFiles:
    """What a diagnosis writes.

    Attributes
    ----------
    content : dict
        Of ``diagnosis.json``.
    path : Path
        ``diagnosis.json``.
    figures : list of Path
    following : NextStep
        What to do next, with the commands.
    report : Path
        ``report.html``, with the diagnosis in it.
    warnings : list of str
        Reasons not to trust the result that is diagnosed.
    headline : str or None
        Why that result is not to be trusted; None where it is.
    """

    content: dict[str, Any]
    path: Path
    figures: list[Path]
    following: NextStep
    report: Path
    warnings: list[str]
    headline: str | None


def diagnose_result(
    result: Path, names: Sequence[str] = (), file: Path | None = None, progress: Progress = lambda _: None
) -> DiagnosisFiles:
    """Diagnose a result; write ``diagnosis.json``, ``residuals.nc``, ``database_update.nc``, figures into its folder.

    Parameters
    ----------
    result : Path
        ``result.nc``, or the folder that holds one.
    names, file
        As in `effects.registry.selected_effects`.
    progress : callable
        Called with what is being done.

    Raises
    ------
    InputError
        No such result or effect, a result of another version, or a mission without a database to compare with.
    """
    reopened = reopen(result)
    mission, folder = reopened.mission, reopened.folder
    require_prediction_inputs(mission, str(reopened.path))
    effects = selected_effects(names, file)
    progress("reconstructing")
    case = load_case(mission, reopened.effects)
    if names and not candidate_instances(case, effects):
        raise InputError(f"--effect: {', '.join(names)} is in the model already; name an effect that is not.")
    reopened.check_same_flight(case.reconstruction)
    diagnosis = diagnose(case, effects, progress)
    content = diagnosis.content()
    content |= _own_effects(content, file)
    progress("drawing")
    figures = write_diagnosis(folder, content, diagnosis, mission.title or mission.name)
    path = folder / DIAGNOSIS
    step = following_step(reopened, content)
    progress("writing the report")
    from edl_filter.report.html import write_report

    return DiagnosisFiles(content, path, figures, step, write_report(folder), _warnings(reopened), reopened.headline)


def write_diagnosis(folder: Path, content: dict[str, Any], diagnosis: Diagnosis, title: str) -> list[Path]:
    """Write ``diagnosis.json``, ``residuals.nc``, increments and figures so that all appear together, or none.

    Parameters
    ----------
    folder : Path
        Of the result.
    content : dict
        Of ``diagnosis.json``.
    diagnosis : Diagnosis
        Whose residuals and increments are written.
    title : str
        Of the figures.

    Returns
    -------
    list of Path
        The figures.
    """
    from edl_filter.report.diagnosis import draw_diagnosis

    with staged_output(folder, _removals) as staged:
        drawn = draw_diagnosis(content, title, staged / FIGURES, diagnosis.update)
        write_json(content, staged / DIAGNOSIS)
        write(residual_series(diagnosis.ranking.model), staged / RESIDUALS)
        write_update(diagnosis.update, staged)
    return [folder / FIGURES / figure.name for figure in drawn]


def _warnings(reopened: Reopened) -> list[str]:
    """Reasons not to trust the result that is diagnosed."""
    from edl_filter.report.sentences import warnings

    try:
        return warnings(read_summary(reopened.folder))
    except InputError:  # moved, or changed by hand
        return [] if reopened.headline is None else [reopened.headline]


def _own_effects(content: dict[str, Any], file: Path | None) -> dict[str, dict[str, str]]:
    """Key of ``diagnosis.json`` with the ranked effects that a file of the user defines; none without a file."""
    if file is None:
        return {}
    own = effects_in(file.expanduser())
    names = (h.effect for h in DiagnosisContent.of(content).ranking)
    return {"own_effects": {name: str(file) for name in names if lookup(own, name) is not None}}


def following_step(reopened: Reopened, content: dict[str, Any]) -> NextStep:
    """The next step; a mission that ``--set`` changed is written next to its result if there is an effect to add."""
    from edl_filter.report.next_step import next_step

    mission, diagnosis = reopened.mission, DiagnosisContent.of(content)
    if matches_file(mission) or not diagnosis.ranking:
        argument = mission_argument(mission)
    else:
        argument = str(write_mission(mission, mission.text, reopened.folder / AS_RUN))
    return next_step(diagnosis, argument, reopened.folder)


def rms_by_channel(content: DiagnosisContent) -> dict[str, dict[str, float]]:
    """Residuals of a diagnosis as a summary has them: channel → ``overall`` and every regime → normalised RMS."""

    def number(rms: float | None) -> float:
        return float("nan") if rms is None else rms

    by_channel = {name: {OVERALL: number(rms)} for name, rms in content.errors.items()}
    for cell in content.map:
        if cell.regime != CONSTRAINTS:
            by_channel[cell.channel][cell.regime] = number(cell.normalised_rms)
    return by_channel


def _removals(staged: Path) -> list[str]:
    """Files of an earlier diagnosis that a new one in `staged` does not replace."""
    names = (*UPDATE_FILES, REPORT, *figure_files(DIAGNOSIS_FIGURES))
    return [name for name in names if not (staged / name).is_file()]
