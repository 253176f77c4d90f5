"""Figures of a result on demand: those of the run, and those of its diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from edl_filter.report.diagnosis import draw_diagnosis
from edl_filter.report.figure_process import FigureProcess
from edl_filter.results.files import FIGURES
from edl_filter.results.reader import ResultReader


def draw_figures(folder: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw all figures of a result folder into its ``figures/``.

    Parameters
    ----------
    folder : Path
        Folder of a run, with or without a diagnosis.
    formats : sequence of str
        Of `results.files.FIGURE_FORMATS`.

    Returns
    -------
    list of Path
        Those of the run, then those of the diagnosis.

    Raises
    ------
    InputError
        There is no valid result, or the folder cannot be written.
    """
    with FigureProcess() as process, ResultReader.open(folder) as reader:
        process.start(folder, folder / FIGURES, formats)
        paths: list[Path] = []
        if reader.diagnosis is not None:
            paths = draw_diagnosis(reader.diagnosis, reader.title, folder / FIGURES, reader.database_update, formats)
        return [*process.wait(), *paths]
