"""``--dry-run``: the files that `run` and `diagnose` would read, write and remove; nothing is written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from edl_filter.io.csv_table import package_data
from edl_filter.mission import Mission
from edl_filter.mission.files import matches_file
from edl_filter.mission.measurements import MerImuConfig
from edl_filter.mission.mission import require_prediction_inputs
from edl_filter.mission.shipped import BUILTIN
from edl_filter.report.figures import FIGURES as RUN_FIGURES
from edl_filter.report.html.bundle import bundle_at_hand
from edl_filter.results.files import (
    AS_RUN,
    BUNDLE,
    DIAGNOSIS,
    DIAGNOSIS_FIGURES,
    FIGURES,
    POSTFLIGHT_TABLES,
    REPORT,
    RESIDUALS,
    RESULT,
    SUMMARY,
    TABLES,
    UPDATE_FILES,
    figure_files,
)
from edl_filter.results.reopen import reopen
from edl_filter.telemetry.fetch import find_mer_imu
from edl_filter.telemetry.mer_compact import FILE_NAMES
from edl_filter.telemetry.pds3 import find_in_volume
from edl_filter.workflow.validate import check_folder


@dataclass(frozen=True)
class FilePlan:
    """Files of a command.

    Attributes
    ----------
    reads : tuple of (str, str)
        Key or purpose, and the path, or ``builtin:NAME`` for a table of the package.
    writes : tuple of Path
    optional : tuple of Path
        Written as far as the flight has the data for them.
    removes : tuple of Path
        Files of an earlier command that exist and are removed or replaced.
    """

    reads: tuple[tuple[str, str], ...]
    writes: tuple[Path, ...]
    optional: tuple[Path, ...]
    removes: tuple[Path, ...]

    def as_json(self) -> dict[str, list[str]]:
        """The plan as data: ``reads``, ``writes``, ``writes_if_data``, ``removes``."""
        return {
            "reads": [path for _, path in self.reads],
            "writes": [str(path) for path in self.writes],
            "writes_if_data": [str(path) for path in self.optional],
            "removes": [str(path) for path in self.removes],
        }


def plan_run(
    name: str, output: Path | None, changes: Sequence[str], figures: bool, formats: Sequence[str] = ("png",)
) -> FilePlan:
    """Files that a run reads, writes and removes.

    Parameters
    ----------
    name : str
        Mission file, or ``builtin:NAME``.
    output, changes, figures, formats
        As in `workflow.run.run_into_folder`.

    Raises
    ------
    InputError
        The mission is wrong, a file that it names does not exist, or the folder cannot be written.
    """
    mission = Mission.load(name, changes)
    folder, figures = output or mission.output_directory(), figures and mission.outputs.figures
    check_folder(folder)
    tables = () if mission.aerodynamics is None else POSTFLIGHT_TABLES
    writes = (
        *(folder / name for name in (RESULT, SUMMARY, REPORT)),
        *(folder / TABLES / name for name in tables),
        *(() if bundle_at_hand(folder) else (folder / BUNDLE,)),
    )
    names = [
        name
        for name, figure in RUN_FIGURES.items()
        if mission.aerodynamics is not None or not any(need.startswith("postflight/") for need in figure.needs)
    ]
    drawn = tuple(folder / FIGURES / f"{name}.{kind}" for name in names for kind in formats) if figures else ()
    earlier = (DIAGNOSIS, RESIDUALS, *UPDATE_FILES, *figure_files((*RUN_FIGURES, *DIAGNOSIS_FIGURES)))
    replaced = dict.fromkeys((*writes, *(folder / name for name in earlier)))
    return FilePlan(tuple(_inputs(mission)), writes, drawn, tuple(path for path in replaced if path.is_file()))


def plan_diagnosis(result: Path, file: Path | None) -> FilePlan:
    """Files that a diagnosis of a result reads and writes.

    Parameters
    ----------
    result : Path
        ``result.nc``, or its folder.
    file : Path or None
        Python file with effects of the user.

    Raises
    ------
    InputError
        No such result, or a mission without a database; a file that its mission names does not exist.
    """
    reopened = reopen(result)
    mission, folder = reopened.mission, reopened.folder
    require_prediction_inputs(mission, str(reopened.path))
    check_folder(folder)
    own = () if file is None else (("--file", str(file)),)
    reads = (("result", str(reopened.path)), *own, *_inputs(mission))
    writes = (
        *(folder / name for name in (DIAGNOSIS, RESIDUALS, REPORT)),
        *(folder / FIGURES / f"{name}.png" for name in DIAGNOSIS_FIGURES[:2]),
    )
    optional = (
        *(folder / FIGURES / f"{name}.png" for name in DIAGNOSIS_FIGURES[2:]),
        *(folder / name for name in UPDATE_FILES),
        *(() if matches_file(mission) else (folder / AS_RUN,)),
    )
    return FilePlan(reads, writes, optional, tuple(path for path in (*writes, *optional) if path.is_file()))


def _inputs(mission: Mission) -> Iterator[tuple[str, str]]:
    """Key and path of every file that a mission names, the mission itself first."""
    if mission.source is not None:
        yield "mission", str(mission.source)
    yield from (("telemetry.path", str(path)) for path in _telemetry_files(mission))
    yield "atmosphere.table", _named(mission.atmosphere.table, mission.atmosphere_path())
    if mission.aerodynamics is not None:
        for key in ("continuum", "rarefied"):
            yield f"aerodynamics.{key}", str(mission.aerodynamic_table(key))
        for key, path in (("damping", mission.damping_path()), ("increments", mission.increments_path())):
            if path is not None:
                yield f"aerodynamics.{key}", _named(getattr(mission.aerodynamics, key), path)
    for k, active in enumerate(mission.active_effects()):
        if active.effect.file is not None:
            yield f"effects.{k}.file", str(active.effect.file)


def _telemetry_files(mission: Mission) -> list[Path]:
    path, telemetry = mission.telemetry_path(), mission.telemetry
    if not isinstance(telemetry, MerImuConfig):
        return [] if path is None else [path]
    if path is None:
        path = find_mer_imu(telemetry.spacecraft) or package_data(FILE_NAMES[telemetry.spacecraft])
    if path.is_file():
        return [path]
    names = [f"{telemetry.spacecraft}{table}.{end}" for table in ("TRANSFORMED", "HIGHRATE") for end in ("LBL", "TAB")]
    return [table for name in names if (table := find_in_volume(path, name)) is not None]


def _named(reference: str, path: Path) -> str:
    return reference if reference.startswith(BUILTIN) else str(path)
