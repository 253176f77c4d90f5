"""The file of a mission: its name in commands, whether it still matches the mission, and copies in other folders."""

from __future__ import annotations

import os
from pathlib import Path

from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.mission.mission import PATH_KEYS, Mission
from edl_filter.mission.shipped import BUILTIN, shipped_mission
from edl_filter.mission.yaml_edit import rebase_paths
from edl_filter.mission.yaml_text import read_text


def mission_argument(mission: Mission) -> str:
    """Name of a mission as argument of a command: its file from the current folder, or ``builtin:NAME``."""
    return mission.name if mission.source is None else file_argument(mission.source)


def file_argument(source: Path) -> str:
    """A mission's file as argument of a command: from the current folder, or ``builtin:NAME``."""
    try:
        shipped = shipped_mission(source.stem).resolve() == source.resolve()
    except InputError:  # the package ships no mission of that name
        shipped = False
    if shipped and not _is_below(source, Path()):
        return BUILTIN + source.stem
    return os.path.relpath(source) if _is_below(source, Path()) else str(source)


def matches_file(mission: Mission) -> bool:
    """Whether the mission's file still has the mission's text, so that a command can name the file."""
    return mission.source is not None and file_has_text(mission.source, mission.text)


def file_has_text(source: Path, text: str) -> bool:
    """Whether a mission's file exists and still has the text of a result's mission."""
    return source.is_file() and read_text(source) == text


def source_folder(mission: Mission) -> Path:
    """Folder from which the mission's relative paths start."""
    return Path() if mission.source is None else mission.source.parent


def write_mission(mission: Mission, text: str, target: Path) -> Path:
    """Write a mission file.

    Parameters
    ----------
    mission : Mission
        Mission from whose folder the relative paths in `text` start.
    text : str
        Text of the mission, which may differ from that of `mission`.
    target : Path
        File to write; relative paths are changed to start from its folder.

    Returns
    -------
    Path
        `target`.
    """
    rebased = rebase_paths(text, PATH_KEYS, source_folder(mission), target.parent, str(target))
    return replace_with(target, lambda path: path.write_text(rebased, encoding="utf-8"))


def _is_below(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())
