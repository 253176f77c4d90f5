"""All that one run leaves: result, summary and figures in one folder."""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from edl_filter.errors import InputError
from edl_filter.results.effects import Judged
from edl_filter.results.netcdf import tree_of, write
from edl_filter.results.plain import finite
from edl_filter.results.summary import summary
from edl_filter.whole_file import cannot_write, replace_with

if TYPE_CHECKING:
    from edl_filter.reconstruction import Reconstruction

#: What `edl-filter diagnose` writes beside a result: the figures in ``figures/``.
DIAGNOSIS, DIAGNOSIS_FIGURES = "diagnosis.json", ("diagnosis_heatmap", "diagnosis_ranking", "diagnosis_missing")
#: Residuals of that diagnosis against time; the mission that `--set` changed, as it was run; steps of the loop.
RESIDUALS, AS_RUN, LEDGER = "residuals.nc", "mission_as_run.yaml", "ledger.jsonl"


def write_outputs(
    reconstruction: Reconstruction, directory: str | Path, figures: bool, judged: Judged | None = None
) -> dict[str, Any]:
    """Write ``result.nc``, ``summary.json``, ``report.html``, tables in ``tables/`` and, if wanted, ``figures/``.

    All is made in a hidden folder first and takes its place at the end, so that a failure leaves what was there;
    figures of an earlier run go, and a diagnosis of it.

    Parameters
    ----------
    reconstruction : Reconstruction
    directory : path
        Made if it is not there.
    figures : bool
    judged : Judged, optional
        What the comparison of model and measurement adds.

    Returns
    -------
    dict
        ``result``, ``summary`` and ``report``: `Path`; ``figures``: list of `Path`; ``content``: the summary itself.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    for active in reconstruction.mission.session_effects:
        raise InputError(
            f"{directory}: found the effect {active.name}, which lives in this Python session only; a result that "
            f"is to be read again needs it in a file: edl_filter.effect({active.name!r}, file='my_effect.py')."
        )
    directory = Path(directory)
    result, path = directory / "result.nc", directory / "summary.json"
    for place in (result, path):
        if place.is_dir():
            raise cannot_write(place, "it is a folder")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".edl-filter.", dir=directory) as hidden:
            staged = Path(hidden)
            made, told = _make(reconstruction, staged, figures, judged or Judged())
            _remove_figures(directory / "figures")
            for name in (DIAGNOSIS, RESIDUALS):
                (directory / name).unlink(missing_ok=True)
            places = [directory / path.relative_to(staged) for path in made]
            for place in places:
                place.parent.mkdir(exist_ok=True)
            for place in (*places, result, path):
                (staged / place.relative_to(directory)).replace(place)
    except OSError as error:
        raise cannot_write(Path(error.filename2 or error.filename or directory), error) from None
    from edl_filter.report.html import write_report

    drawn = [place for place in places if place.suffix == ".png"]
    return {
        "result": result, "summary": path, "report": write_report(directory), "figures": drawn, "content": told,
    }  # fmt: skip


def _make(
    reconstruction: Reconstruction, folder: Path, figures: bool, judged: Judged
) -> tuple[list[Path], dict[str, Any]]:
    """Write everything into `folder`; the paths of figures and tables, and the summary."""
    from edl_filter.results.content import content, derive
    from edl_filter.results.postflight import tables

    begin = time.perf_counter()
    derived = derive(reconstruction)
    groups = content(reconstruction, derived, judged)
    timing = {"postflight": time.perf_counter() - begin}
    begin = time.perf_counter()
    write(groups, folder / "result.nc")
    timing["write"] = time.perf_counter() - begin
    made: list[Path] = []
    if derived.aftermath is not None:
        (folder / "tables").mkdir()
        for name, text in tables(derived.aftermath).items():
            made.append(folder / "tables" / name)
            made[-1].write_text(text, encoding="utf-8")
    if figures:
        from edl_filter.report.figures import draw_all

        begin = time.perf_counter()
        made += draw_all(tree_of(groups), folder / "figures")
        timing["figures"] = time.perf_counter() - begin
    told = summary(reconstruction, derived, judged)
    told["timing_s"] |= timing
    write_json(told, folder / "summary.json")
    return made, told


def _remove_figures(folder: Path) -> None:
    """Remove the figures that a run draws, and the folder if nothing else is in it."""
    if not any(folder.glob("*.png")):
        return
    from edl_filter.report.figures import FIGURES

    for name in (*FIGURES, *DIAGNOSIS_FIGURES):
        (folder / f"{name}.png").unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()


def write_json(data: Any, path: Path) -> Path:
    """Write JSON whole or not at all; what is not finite becomes null."""
    text = json.dumps(finite(data), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    return replace_with(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
