"""Missions and results in the served folder, read from its files on every request."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from edl_filter.errors import InputError
from edl_filter.mission.problems import mission_problems
from edl_filter.mission.shipped import BUILTIN, shipped_mission, shipped_names
from edl_filter.mission.yaml_text import parse, read_text
from edl_filter.results.files import DIAGNOSIS, RESULT, read_diagnosis
from edl_filter.results.reader import ResultReader
from edl_filter.results.schema import DiagnosisContent
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
    diagnosis : DiagnosisContent, optional
        Content of ``diagnosis.json``.
    headline : str or None
        Why the result is not to be trusted; None where it is.
    changed : float
        Modification time, s.
    """

    path: str
    title: str
    mission: str
    flight: str
    effects: dict[str, Any]
    diagnosis: DiagnosisContent | None
    headline: str | None
    changed: float

    @property
    def verdict(self) -> str | None:
        """Verdict of its diagnosis; None without a diagnosis."""
        return None if self.diagnosis is None else self.diagnosis.verdict


def missions(root: Path) -> list[dict[str, Any]]:
    """Missions in the folder, then shipped missions: ``name`` (for a command), ``title``, ``shipped``, ``problems``.

    A file that has the keys of a mission, but cannot be read or is wrong, is listed with its problems.
    """
    own = []
    for path in _files(root, (".yaml", ".yml")):
        if (title := _title(path)) is not None:
            entry = {"name": path.relative_to(root).as_posix(), "title": title, "shipped": False}
            own.append(entry | {"problems": _problems(path, root)})
    shipped = [
        {"name": BUILTIN + name, "title": _title(path) or name, "shipped": True, "problems": _problems(path, root)}
        for name in shipped_names()
        if (path := shipped_mission(name))
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
        if path.name == RESULT:
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
    path = inside(root, f"{name}/{RESULT}")
    with ResultReader.open(path) as reader:
        effects, checksums = reader.mapping("", "effects"), reader.mapping("", "input_sha256")
        headline = reader.mapping("", "trust").get("headline")
        if not reader.attribute("", "mission") or None in (
            reader.attribute("", k) for k in ("effects", "input_sha256", "trust")
        ):
            raise InputError(f"{name}: found no result of this version; run the mission again.")
        title, mission = reader.title, reader.mission
    parameters = {key: effect["parameters"] for key, effect in effects.items()}
    flight = f"{mission} {sorted(checksums.items())}"
    changed = path.stat().st_mtime
    return ServedResult(name, title, mission, flight, parameters, _diagnosis(root, name), headline, changed)


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


def _diagnosis(root: Path, name: str) -> DiagnosisContent | None:
    path = inside(root, f"{name}/{DIAGNOSIS}")
    return read_diagnosis(path) if path.is_file() else None


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
        text = read_text(path)
    except InputError:
        return None
    try:
        data = parse(text, path.name)
    except InputError:
        keys = set(re.findall(r"^(\w+):", text, re.MULTILINE))
        return path.name if keys >= _MISSION_KEYS else None
    if not isinstance(data, dict) or not set(data) >= _MISSION_KEYS:
        return None
    return str(data.get("title") or data["name"])


#: Modification time and size of missions without problems.
_VALID: dict[Path, tuple[int, int]] = {}


def _problems(path: Path, root: Path) -> list[str]:
    """Problems of a mission, which are looked for again until there are none: a missing file may appear."""
    stat = path.stat()
    version = (stat.st_mtime_ns, stat.st_size)
    if _VALID.get(path) == version:
        return []
    label = str(path.relative_to(root)) if path.is_relative_to(root) else str(path)
    problems = [text.replace(str(path), label) for text in mission_problems(path)]
    if not problems:
        _VALID[path] = version
    return problems
