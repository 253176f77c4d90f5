"""How a person names a mission at a shell, and a mission file that holds just what was run."""

from __future__ import annotations

import os
from pathlib import Path

from edl_filter.errors import InputError
from edl_filter.mission.appending import seen_from
from edl_filter.mission.mission import BUILTIN, PATH_KEYS, Mission, shipped_mission
from edl_filter.mission.text import read_text
from edl_filter.whole_file import replace_with

#: Keys of a mission that name a file, those of users' effects too.
FILE_KEYS = (*PATH_KEYS, "effects.*.file")


def name_of(mission: Mission) -> str:
    """A mission's file from the current folder, or ``builtin:NAME``."""
    source = mission.source
    if source is None:
        return mission.name
    try:
        shipped = shipped_mission(source.stem).resolve() == source.resolve()
    except InputError:  # none of that name is shipped
        shipped = False
    if shipped and not _below(source, Path()):
        return BUILTIN + source.stem
    return os.path.relpath(source) if _below(source, Path()) else str(source)


def unchanged(mission: Mission) -> bool:
    """Whether the mission's file still says what the mission does, so that it can be named instead."""
    return mission.source is not None and mission.source.is_file() and read_text(mission.source) == mission.text


def write_mission(mission: Mission, text: str, target: Path) -> Path:
    """Write a mission's `text` elsewhere, its relative paths changed to be found from there."""
    beside = Path() if mission.source is None else mission.source.parent
    moved = seen_from(text, FILE_KEYS, beside, target.parent, str(target))
    return replace_with(target, lambda path: path.write_text(moved, encoding="utf-8"))


def _below(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())
