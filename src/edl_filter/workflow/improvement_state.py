"""Where an interrupted improvement goes on: the model of the next step, with the steps that are complete.

``resume.json`` in the folder of the results has the model with all digits of its estimates and a fingerprint of what
the improvement depends on. It is written after each complete step and removed when the final model is written, so
that a command that was killed goes on at the step that was not complete. With another mission, telemetry, catalogue
or version the improvement begins at the first step.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from edl_filter._version import __version__
from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.io.atomic import replace_with
from edl_filter.mission import Mission

NAME = "resume.json"


@dataclass(frozen=True)
class NextStep:
    """The step at which an improvement goes on.

    Attributes
    ----------
    number : int
    model : tuple of EffectInstance
        That it diagnoses.
    """

    number: int
    model: tuple[EffectInstance, ...]


def fingerprint(mission: Mission, candidates: Sequence[Effect], file: Path | None = None) -> str:
    """SHA-256 of the mission's text, the telemetry's size and time, the candidates, the user's file and the version.

    Parameters
    ----------
    mission : Mission
        The mission, with its changes.
    candidates : sequence of Effect
        Effects that may be added.
    file : Path, optional
        Python file with a user's effects.

    Returns
    -------
    str
    """
    telemetry = mission.telemetry_path()
    stat = telemetry.stat() if telemetry is not None else None
    content = {
        "version": __version__,
        "mission": mission.text,
        "telemetry": None if stat is None else [str(telemetry), stat.st_size, stat.st_mtime_ns],
        "candidates": [effect.name for effect in candidates],
        "file": None if file is None else file.expanduser().read_text(encoding="utf-8"),
    }
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def write(folder: Path, mark: str, step: NextStep) -> Path:
    """Write the next step; the file is replaced as a whole.

    Parameters
    ----------
    folder : Path
        Of the results.
    mark : str
        `fingerprint`.
    step : NextStep
        At which a later command goes on.
    """
    model = [{"effect": a.name, "values": a.values, "imu": a.imu, "fixed": a.fixed} for a in step.model]
    text = json.dumps({"fingerprint": mark, "step": step.number, "model": model}, indent=1)
    return replace_with(folder / NAME, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def read(folder: Path, mark: str, effects: Sequence[Effect]) -> NextStep | None:
    """The step at which the improvement in a folder goes on; None if it begins.

    Parameters
    ----------
    folder : Path
        Of the results.
    mark : str
        `fingerprint` of the improvement.
    effects : sequence of Effect
        Of which a model may consist: the candidates and the effects of the mission.
    """
    try:
        content = json.loads((folder / NAME).read_text(encoding="utf-8"))
        if content["fingerprint"] != mark:
            return None
        known = {effect.name: effect for effect in effects}
        model = tuple(EffectInstance(known[e["effect"]], e["values"], e["imu"], e["fixed"]) for e in content["model"])
        return NextStep(int(content["step"]), model)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def remove(folder: Path) -> None:
    """Remove the file: the improvement is complete, or begins anew."""
    (folder / NAME).unlink(missing_ok=True)
