"""What is in the served folder: missions and results, as its files say now."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from edl_filter.errors import InputError
from edl_filter.mission.mission import BUILTIN, shipped_mission, shipped_names
from edl_filter.mission.text import parse, read_text
from edl_filter.results.hdf5 import read_groups
from edl_filter.results.netcdf import attributes
from edl_filter.results.outputs import DIAGNOSIS, RESIDUALS
from edl_filter.results.plain import finite
from edl_filter.serve.safety import ForbiddenError, inside, leads_inside

#: Folders below the served one that are searched, and files that are looked at: a home folder is not a workbench.
_DEPTH, _MOST = 5, 5000
#: Top-level keys by which a mission is told from other YAML.
_MISSION_KEYS = {"name", "planet", "telemetry"}


@dataclass(frozen=True)
class Result:
    """A result in the served folder.

    Attributes
    ----------
    path : str
        Its folder, from the served one.
    title, mission, flight : str
        Title and name of its mission; what tells its flight from others.
    effects : dict
        In its model: name → parameters with estimate, sigma and unit.
    diagnosis : dict, optional
        Content of ``diagnosis.json``.
    changed : float
        When it was written, s.
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
        """Of its diagnosis."""
        return None if self.diagnosis is None else str(self.diagnosis["verdict"])


def missions(root: Path) -> list[dict[str, Any]]:
    """Missions in the folder, then shipped ones: ``name`` (for a command), ``title``, ``shipped``."""
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
    """File of a mission in the folder, or of a shipped one.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        There is no such mission.
    """
    if name.startswith(BUILTIN):
        if name.removeprefix(BUILTIN) not in shipped_names():  # no path may hide in a name
            raise InputError(f"{name}: found no such mission; expected one of {', '.join(shipped_names())}.")
        return shipped_mission(name.removeprefix(BUILTIN))
    path = inside(root, name)
    if not path.is_file():
        raise InputError(f"{name}: found no such mission in the served folder.")
    return path


def results(root: Path) -> list[Result]:
    """Results in the folder, the newest first; those of another version are left out."""
    found = []
    for path in _files(root, (".nc",)):
        if path.name == "result.nc":
            try:
                found.append(find_result(root, path.parent.relative_to(root).as_posix()))
            except (InputError, ForbiddenError):
                continue
    return sorted(found, key=lambda r: -r.changed)


def find_result(root: Path, name: str) -> Result:
    """Result in a folder below `root`.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        There is no such result, or its diagnosis cannot be read.
    """
    path = inside(root, f"{name}/result.nc")
    attrs = attributes(path)
    try:
        effects = {k: v["parameters"] for k, v in json.loads(attrs["effects"]).items()}
        flight = f"{attrs['mission']} {attrs['input_sha256']}"
        mission, title = str(attrs["mission"]), str(attrs.get("title") or attrs["mission"])
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InputError(f"{name}: found no result of this version ({error!r}); run the mission again.") from None
    return Result(name, title, mission, flight, effects, _diagnosis(root, name), path.stat().st_mtime)


def residual(root: Path, name: str, channel: str) -> dict[str, Any]:
    """One channel of ``residuals.nc`` against time, where it was compared.

    Returns
    -------
    dict
        ``time`` (s), ``residual`` and ``sigma`` (in ``unit``), ``normalised``: lists of one length.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        There is no such file or channel.
    """
    path = inside(root, f"{name}/{RESIDUALS}")
    if not path.is_file():
        raise InputError(f"{name}: found no {RESIDUALS}; diagnose the result again, which writes it.")
    try:
        held = read_groups(path)["/"].variables
        names = [str(c) for c in held["channel"].values]
        if channel not in names:
            raise InputError(f"{name}: found no residual of {channel} against time; there are {', '.join(names)}.")
        k = names.index(channel)
        used = held["normalised"].values[k] == held["normalised"].values[k]  # not NaN: it was compared
        series = {q: finite(held[q].values[k][used]) for q in ("residual", "sigma", "normalised")}
        return {"unit": str(held["unit"].values[k]), "time": finite(held["time"].values[used]), **series}
    except (OSError, KeyError, IndexError) as error:
        raise InputError(f"{name}: {RESIDUALS} cannot be read ({error!r}); diagnose the result again.") from None


def lineage(result: Result, others: list[Result]) -> list[Result]:
    """The way to a result: of the same flight, each with fewer effects than the next, the result last.

    A step before has all effects but one or more of those after; where several do, the one whose folder the name of the
    next begins with, then the newest.
    """
    way = [result]
    while True:
        now = way[0]
        before = [o for o in others if o.flight == now.flight and set(o.effects) < set(now.effects)]
        if not before:
            return way
        way.insert(0, max(before, key=lambda o: (now.path.startswith(f"{o.path}+"), len(o.effects), o.changed)))


def _diagnosis(root: Path, name: str) -> dict[str, Any] | None:
    path = inside(root, f"{name}/{DIAGNOSIS}")
    if not path.is_file():
        return None
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(told, Mapping) or any(k not in told for k in ("verdict", "map", "ranking", "errors")):
            raise ValueError("verdict, map, ranking or errors are missing")
    except (OSError, ValueError) as error:
        raise InputError(f"{name}: {DIAGNOSIS} cannot be read ({error}); diagnose the result again.") from None
    return dict(told)


def _files(root: Path, suffixes: tuple[str, ...]) -> Iterator[Path]:
    """Files below the folder, hidden ones and those that lead out of it left out."""
    seen = 0
    for here, folders, names in os.walk(root):
        folder = Path(here)
        deep = len(folder.relative_to(root).parts) >= _DEPTH
        folders[:] = [] if deep else sorted(f for f in folders if not f.startswith("."))
        for name in sorted(names):
            seen += 1
            if seen > _MOST:
                return
            path = folder / name
            if name.endswith(suffixes) and not name.startswith(".") and leads_inside(root, path):
                yield path


def _title(path: Path) -> str | None:
    """Title of a mission file, or its name; None for a file that is no mission."""
    try:
        stat = path.stat()
        return _title_of(path, stat.st_mtime_ns, stat.st_size)
    except OSError:
        return None


@lru_cache(maxsize=1024)
def _title_of(path: Path, changed: int, size: int) -> str | None:
    """As `_title`; time and size tell a changed file."""
    try:
        data = parse(read_text(path), path.name)
    except InputError:
        return None
    if not isinstance(data, dict) or not set(data) >= _MISSION_KEYS:
        return None
    return str(data.get("title") or data["name"])
