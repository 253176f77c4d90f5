"""Opening of a result for further work: its mission, with effects at the result's estimates."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.results.files import result_file
from edl_filter.results.reader import ResultReader
from edl_filter.results.summary import effects_at_estimates

if TYPE_CHECKING:
    from edl_filter.effects.base import EffectInstance
    from edl_filter.pipeline.reconstruct import Reconstruction


@dataclass(frozen=True)
class Reopened:
    """Provenance of a result, and what further work needs of it.

    Attributes
    ----------
    path : Path
        ``result.nc``.
    mission : Mission
        As it was run; relative paths start from its file's folder.
    effects_content, residuals : dict
        ``effects`` as in ``summary.json``, and the channels of its ``residuals``.
    checksums : dict
        File of the telemetry → sha256.
    headline : str or None
        Why the result is not trustworthy; None where it is.
    """

    path: Path
    mission: Mission
    effects_content: dict[str, Any]
    residuals: dict[str, dict[str, float]]
    checksums: dict[str, str]
    headline: str | None

    @cached_property
    def effects(self) -> tuple[EffectInstance, ...]:
        """Effects in the model, at their estimates; the code of a user's effect runs when they are first asked for."""
        return effects_at_estimates(self.mission, self.effects_content)

    @property
    def folder(self) -> Path:
        """Folder of the result."""
        return self.path.parent

    def check_same_flight(self, reconstruction: Reconstruction) -> None:
        """Raise InputError if the telemetry differs from that of the result."""
        if reconstruction.telemetry.files != self.checksums:
            raise InputError(
                f"{self.path}: its telemetry has changed since (another sha256); run the mission again: "
                f"{run_command(self)}."
            )


def reopen(result: str | Path) -> Reopened:
    """Open a result for further work.

    Parameters
    ----------
    result : path
        ``result.nc``, or its folder.

    Raises
    ------
    InputError
        There is no such result, it is of another version, or a file that its mission names no longer exists.
    """
    path = result_file(result)
    with ResultReader.open(path) as reader:
        attrs = reader.groups["/"].attrs
    written_by = str(attrs.get("edl_filter_version", "unknown"))
    if _release(written_by) != _release(__version__):
        raise InputError(
            f"{path}: found a result of edl-filter {written_by}; this is {__version__}, whose results differ. "
            "Run the mission again."
        )
    try:
        text = str(attrs["mission_yaml"])
        effects, residuals, checksums, trust = (
            json.loads(attrs[k]) for k in ("effects", "residuals", "input_sha256", "trust")
        )
        headline = trust["headline"]
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{path}: found no {error if isinstance(error, KeyError) else 'JSON'} among its attributes; expected a "
            "result of this version. Run the mission again."
        ) from None
    file = attrs.get("mission_file")
    mission = Mission.from_text(text, f"{path} (its mission)", None if file is None else Path(str(file)))
    return Reopened(path, mission, effects, residuals, checksums, headline)


def run_command(reopened: Reopened) -> str:
    """The command that computes a result again."""
    from edl_filter.mission.files import mission_argument

    return f"edl-filter run {mission_argument(reopened.mission)} -o {reopened.folder}"


def _release(version: str) -> tuple[str, ...]:
    """Part of a version whose change may change results: the first number, and before 1.0 the second too."""
    numbers = version.split(".")
    return tuple(numbers[: 2 if numbers[0] == "0" else 1])
