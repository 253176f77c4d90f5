"""A result taken up again: its mission, with effects at the result's estimates."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import edl_filter
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.results.effects import restored
from edl_filter.results.netcdf import attributes

if TYPE_CHECKING:
    from edl_filter.effects.effect import Active
    from edl_filter.reconstruction import Reconstruction


@dataclass(frozen=True)
class Reopened:
    """What a result says of where it comes from.

    Attributes
    ----------
    path : Path
        ``result.nc``.
    mission : Mission
        As it was run; relative paths start from its file's folder.
    effects : tuple of Active
        In the model, at their estimates.
    told : dict
        ``effects`` as in ``summary.json``, and the channels among its ``residuals``.
    checksums : dict
        File of the telemetry → sha256.
    """

    path: Path
    mission: Mission
    effects: tuple[Active, ...]
    told: dict[str, Any]
    checksums: dict[str, str]

    @property
    def folder(self) -> Path:
        """Folder of the result."""
        return self.path.parent

    def check_same_flight(self, reconstruction: Reconstruction) -> None:
        """Raise InputError if the telemetry that was read now is not what the result came from."""
        if reconstruction.telemetry.files != self.checksums:
            raise InputError(
                f"{self.path}: its telemetry has changed since (another sha256); run the mission again: {again(self)}."
            )


def reopen(result: str | Path) -> Reopened:
    """Open a result to work on.

    Parameters
    ----------
    result : path
        ``result.nc``, or the folder that holds one.

    Raises
    ------
    InputError
        There is no such result, it is of another version, or what its mission names is gone.
    """
    path = Path(result)
    path = path / "result.nc" if path.is_dir() else path
    attrs = attributes(path)
    made_by = str(attrs.get("edl_filter_version", "unknown"))
    if _major(made_by) != _major(edl_filter.__version__):
        raise InputError(
            f"{path}: found a result of edl-filter {made_by}; this is {edl_filter.__version__}, whose results differ. "
            "Run the mission again."
        )
    try:
        text, told = str(attrs["mission_yaml"]), {k: json.loads(attrs[k]) for k in ("effects", "residuals")}
        checksums = json.loads(attrs["input_sha256"])
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{path}: found no {error if isinstance(error, KeyError) else 'JSON'} among its attributes; expected a "
            "result of this version. Run the mission again."
        ) from None
    file = attrs.get("mission_file")
    mission = Mission.from_text(text, f"{path} (its mission)", None if file is None else Path(str(file)))
    return Reopened(path, mission, restored(mission, told["effects"]), told, checksums)


def again(reopened: Reopened) -> str:
    """The command that makes a result again."""
    from edl_filter.mission.naming import name_of

    return f"edl-filter run {name_of(reopened.mission)} -o {reopened.folder}"


def _major(version: str) -> str:
    return version.split(".")[0]
