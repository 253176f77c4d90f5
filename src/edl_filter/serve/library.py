"""Missions and results in the served folder, read from its files on every request."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from edl_filter.errors import InputError
from edl_filter.mission.shipped import BUILTIN, shipped_mission, shipped_names
from edl_filter.mission.yaml_text import parse, read_text
from edl_filter.results.files import DIAGNOSIS, RESIDUALS
from edl_filter.results.hdf5 import read_groups
from edl_filter.results.netcdf import attributes
from edl_filter.results.plain import finite
from edl_filter.serve.safety import ForbiddenError, inside, leads_inside

#: Greatest depth of folders and number of files that are searched, so that serving a home folder stays fast.
_MAX_DEPTH, _MAX_FILES = 5, 5000
#: Top-level keys that distinguish a mission from other YAML files.
_MISSION_KEYS = {"name", "planet", "telemetry"}


@dataclass(frozen=True)
class ServedResult:
    """A result in the served folder.

    Attributes
    ----------
    path : str
        Folder of the result, relative to the served folder.
    title, mission : str
        Title and name of its mission.
    flight : str
        Identifier of its flight: name of the mission and checksum of the telemetry.
    effects : dict
        Effects in its model: name → parameters with estimate, sigma and unit.
    diagnosis : dict, optional
        Content of ``diagnosis.json``.
    changed : float
        Modification time, s.
    """

    path: str
    title: str
    mission: str
    flight: str
    effects: dict[str, Any]
    diagnosis: dict[str, Any] | None
    changed: float

    @property
    def verdict(self) -> str | None:
        """Verdict of its diagnosis; None without a diagnosis."""
        return None if self.diagnosis is None else str(self.diagnosis["verdict"])


def missions(root: Path) -> list[dict[str, Any]]:
    """Missions in the folder, then shipped missions: ``name`` (for a command), ``title``, ``shipped``."""
    own = []
    for path in _files(root, (".yaml", ".yml")):
        if (title := _title(path)) is not None:
            own.append({"name": path.relative_to(root).as_posix(), "title": title, "shipped": False})
    shipped = [
        {"name": BUILTIN + name, "title": _title(shipped_mission(name)) or name, "shipped": True}
        for name in shipped_names()
    ]
    return sorted(own, key=lambda m: str(m["name"])) + shipped


def find_mission(root: Path, name: str) -> Path:
    """File of a mission in the folder, or of a shipped mission.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        The mission does not exist.
    """
    if name.startswith(BUILTIN):
        if name.removeprefix(BUILTIN) not in shipped_names():  # a name must not contain a path
            raise InputError(f"{name}: found no such mission; expected one of {', '.join(shipped_names())}.")
        return shipped_mission(name.removeprefix(BUILTIN))
    path = inside(root, name)
    if not path.is_file():
        raise InputError(f"{name}: found no such mission in the served folder.")
    return path


def results(root: Path) -> list[ServedResult]:
    """Results in the folder, the newest first, without those of another version of the package."""
    readable = []
    for path in _files(root, (".nc",)):
        if path.name == "result.nc":
            try:
                readable.append(find_result(root, path.parent.relative_to(root).as_posix()))
            except (InputError, ForbiddenError):
                continue
    return sorted(readable, key=lambda r: -r.changed)


def find_result(root: Path, name: str) -> ServedResult:
    """Result in a folder below `root`.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        The result does not exist, or its diagnosis cannot be read.
    """
    path = inside(root, f"{name}/result.nc")
    attrs = attributes(path)
    try:
        effects = {k: v["parameters"] for k, v in json.loads(attrs["effects"]).items()}
        flight = f"{attrs['mission']} {attrs['input_sha256']}"
        mission, title = str(attrs["mission"]), str(attrs.get("title") or attrs["mission"])
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InputError(f"{name}: found no result of this version ({error!r}); run the mission again.") from None
    return ServedResult(name, title, mission, flight, effects, _diagnosis(root, name), path.stat().st_mtime)


def residual(root: Path, name: str, channel: str) -> dict[str, Any]:
    """Residual of one channel against time from ``residuals.nc``, at the times at which it was computed.

    Returns
    -------
    dict
        ``time`` (s), ``residual`` and ``sigma`` (in ``unit``), ``normalised``: lists of one length.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        The file or channel does not exist.
    """
    path = inside(root, f"{name}/{RESIDUALS}")
    if not path.is_file():
        raise InputError(f"{name}: found no {RESIDUALS}; diagnose the result again, which writes it.")
    try:
        variables = read_groups(path)["/"].variables
        names = [str(c) for c in variables["channel"].values]
        if channel not in names:
            raise InputError(f"{name}: found no residual of {channel} against time; there are {', '.join(names)}.")
        k = names.index(channel)
        used = variables["normalised"].values[k] == variables["normalised"].values[k]  # NaN where it was not computed
        series = {q: finite(variables[q].values[k][used]) for q in ("residual", "sigma", "normalised")}
        return {"unit": str(variables["unit"].values[k]), "time": finite(variables["time"].values[used]), **series}
    except (OSError, KeyError, IndexError) as error:
        raise InputError(f"{name}: {RESIDUALS} cannot be read ({error!r}); diagnose the result again.") from None


def lineage(result: ServedResult, candidates: list[ServedResult]) -> list[ServedResult]:
    """Results of the same flight that precede a result, each with fewer effects than the next; the result is last.

    The effects of a predecessor are a proper subset of the successor's. Of several predecessors the one whose folder
    name the successor's begins with is chosen, then the one with the most effects, then the newest.
    """
    steps = [result]
    while True:
        first = steps[0]
        predecessors = [c for c in candidates if c.flight == first.flight and set(c.effects) < set(first.effects)]
        if not predecessors:
            return steps
        steps.insert(
            0, max(predecessors, key=lambda p: (first.path.startswith(f"{p.path}+"), len(p.effects), p.changed))
        )


def _diagnosis(root: Path, name: str) -> dict[str, Any] | None:
    path = inside(root, f"{name}/{DIAGNOSIS}")
    if not path.is_file():
        return None
    try:
        diagnosis = json.loads(path.read_text(encoding="utf-8"))
        required = ("verdict", "map", "ranking", "errors")
        if not isinstance(diagnosis, Mapping) or any(k not in diagnosis for k in required):
            raise ValueError("verdict, map, ranking or errors are missing")
    except (OSError, ValueError) as error:
        raise InputError(f"{name}: {DIAGNOSIS} cannot be read ({error}); diagnose the result again.") from None
    return dict(diagnosis)


def _files(root: Path, suffixes: tuple[str, ...]) -> Iterator[Path]:
    """Files below the folder, without hidden files and links that lead out of the folder."""
    count = 0
    for folder_name, subfolders, names in os.walk(root):
        folder = Path(folder_name)
        at_max_depth = len(folder.relative_to(root).parts) >= _MAX_DEPTH
        subfolders[:] = [] if at_max_depth else sorted(f for f in subfolders if not f.startswith("."))
        for name in sorted(names):
            count += 1
            if count > _MAX_FILES:
                return
            path = folder / name
            if name.endswith(suffixes) and not name.startswith(".") and leads_inside(root, path):
                yield path


def _title(path: Path) -> str | None:
    """Title of a mission file, or its name; None for a file that is not a mission."""
    try:
        stat = path.stat()
        return _cached_title(path, stat.st_mtime_ns, stat.st_size)
    except OSError:
        return None


@lru_cache(maxsize=1024)
def _cached_title(path: Path, changed: int, size: int) -> str | None:
    """As `_title`; modification time and size are part of the key of the cache."""
    try:
        data = parse(read_text(path), path.name)
    except InputError:
        return None
    if not isinstance(data, dict) or not set(data) >= _MISSION_KEYS:
        return None
    return str(data.get("title") or data["name"])
