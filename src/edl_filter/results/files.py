"""Names of the files in a result folder, and writing and reading of JSON files.

The readers check a file against its schema (`edl_filter.results.schema`), so that no other code reads it by bare keys.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with

if TYPE_CHECKING:  # building the models takes longer than some commands
    from edl_filter.results.schema import Content, DiagnosisContent, LedgerLine, Summary

    ContentT = TypeVar("ContentT", bound=Content)

#: Files and folders that `edl-filter run` writes.
RESULT, SUMMARY, REPORT, FIGURES, TABLES = "result.nc", "summary.json", "report.html", "figures", "tables"
#: Plotting library of the report, in its folder or in the folder above.
BUNDLE = "plotly.min.js"
#: Tables of a run in ``tables/``, where the mission has an aerodynamic database.
POSTFLIGHT_TABLES = ("average_differences.csv", "atmosphere_differences.csv", "verdicts.csv", "atmosphere.csv")
#: Formats of figures.
FIGURE_FORMATS = ("png", "svg", "pdf")
#: Files that `edl-filter diagnose` adds: the diagnosis, its residuals against time, its figures in ``figures/``.
DIAGNOSIS, RESIDUALS = "diagnosis.json", "residuals.nc"
DIAGNOSIS_FIGURES = ("diagnosis_heatmap", "diagnosis_ranking", "diagnosis_database", "diagnosis_missing")
#: Increments of the database that a diagnosis estimates, and their tables in ``tables/``: continuum, rarefied flow.
DATABASE_UPDATE = "database_update.nc"
UPDATE_TABLES = ("database_update.csv", "database_update_rarefied.csv")
UPDATE_FILES = (DATABASE_UPDATE, *(f"{TABLES}/{name}" for name in UPDATE_TABLES))
#: The mission as it was run, where ``--set`` changed it; the ledger of ``edl-filter improve``.
AS_RUN, LEDGER = "mission_as_run.yaml", "ledger.jsonl"


def figure_files(names: Iterable[str]) -> list[str]:
    """Files of figures in all formats, from the folder of the result."""
    return [f"{FIGURES}/{name}.{kind}" for name in names for kind in FIGURE_FORMATS]


def result_file(path: str | Path) -> Path:
    """``result.nc`` of a folder; the path of a file as it is."""
    path = Path(path)
    return path / RESULT if path.is_dir() else path


def finite(data: Any) -> Any:
    """`data` with None for every number that is not finite, and arrays as lists."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [finite(value) for value in data]
    if isinstance(data, np.floating):
        return finite(float(data))
    if isinstance(data, np.ndarray | np.generic):
        return finite(data.tolist())
    return None if isinstance(data, float) and not math.isfinite(data) else data


def write_json(data: Any, path: Path) -> Path:
    """Write a JSON file, which appears only when it is complete; a number that is not finite becomes null."""
    text = json.dumps(finite(data), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    return replace_with(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def read_summary(path: Path) -> Summary:
    """Read a ``summary.json``.

    Parameters
    ----------
    path : Path
        The file, or its folder.

    Returns
    -------
    Summary

    Raises
    ------
    InputError
        There is no such file, or it violates the schema; the message has the file and the key.
    """
    from edl_filter.results.schema import Summary

    return _read(path, SUMMARY, Summary, "edl-filter run")


def read_diagnosis(path: Path) -> DiagnosisContent:
    """Read a ``diagnosis.json``.

    Parameters
    ----------
    path : Path
        The file, or its folder.

    Raises
    ------
    InputError
        There is no such file, or it violates the schema; the message has the file and the key.
    """
    from edl_filter.results.schema import DiagnosisContent

    return _read(path, DIAGNOSIS, DiagnosisContent, "edl-filter diagnose")


def read_ledger(path: Path) -> list[LedgerLine]:
    """Read the lines of a ``ledger.jsonl``; none where there is no such file.

    Parameters
    ----------
    path : Path
        The file, or its folder.

    Raises
    ------
    InputError
        A line is not JSON, or violates the schema; the message has the file, the line and the key.
    """
    from edl_filter.results.schema import LedgerEnd, LedgerStep

    path = _in_folder(path, LEDGER)
    if not path.is_file():
        return []
    lines: list[LedgerLine] = []
    try:
        texts = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: the ledger cannot be read ({error}).") from None
    for n, text in enumerate(texts, 1):
        where = f"{path}, line {n}"
        added = _parse(text, where, "remove the line").get("added") is not None
        lines.append(_validate(text, where, LedgerStep) if added else _validate(text, where, LedgerEnd))
    return lines


def _in_folder(path: Path, name: str) -> Path:
    return path / name if path.is_dir() else path


def _read(path: Path, name: str, model: type[ContentT], command: str) -> ContentT:
    path = _in_folder(path, name)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        what = name.removesuffix(".json")
        raise InputError(f"{path}: found no {what}; expected a folder in which '{command}' wrote {name}.") from None
    _parse(text, str(path), f"expected the {name} that '{command}' writes")
    return _validate(text, str(path), model, f"; run '{command}' again.")


def _parse(text: str, where: str, hint: str) -> dict[str, Any]:
    """The object that a JSON text contains, or InputError."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:  # also a number of too many digits, and too many levels
        raise InputError(f"{where}: found no JSON ({getattr(error, 'msg', None) or error}); {hint}.") from None
    if not isinstance(data, dict):
        raise InputError(f"{where}: found no object with keys; {hint}.")
    return data


def _validate(text: str, where: str, model: type[ContentT], hint: str = ".") -> ContentT:
    from pydantic import ValidationError

    from edl_filter.mission.error_messages import error_message

    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        raise InputError(error_message(error, model, where) + hint) from None
