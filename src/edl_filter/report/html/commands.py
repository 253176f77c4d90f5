"""Commands that the report proposes, as they would be typed where the report was made."""

from __future__ import annotations

from collections.abc import Mapping
from shlex import quote
from typing import Any

from edl_filter.errors import InputError
from edl_filter.report.html.source import Source

#: Where the mission's file is not known any more.
_UNKNOWN = "MISSION"


def diagnose(source: Source) -> str:
    """The command that diagnoses the folder."""
    return f"edl-filter diagnose {quote(str(source.folder))}"


def add(source: Source, mission: str, entry: Mapping[str, Any]) -> str:
    """The command that adds one hypothesis to the mission, begun at its estimate."""
    return f"edl-filter add {mission} {quote(str(entry['effect']))} --from {quote(str(source.folder))}"


def mission_name(source: Source) -> str:
    """The mission of a result as a person names it at a shell, quoted; ``MISSION`` where it is gone."""
    from edl_filter.mission.files import matches_file, mission_argument
    from edl_filter.results.reopen import reopen

    try:
        mission = reopen(source.folder).mission
    except InputError:
        return _UNKNOWN
    if matches_file(mission):
        return quote(mission_argument(mission))
    return quote(str(source.as_run)) if source.as_run.is_file() else _UNKNOWN
