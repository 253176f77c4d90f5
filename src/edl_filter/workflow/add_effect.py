"""`edl-filter add`: a mission with one effect more, with starting values from a diagnosis."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from edl_filter.effects.base import EffectKey, label_of
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.edit_effects import append_effect
from edl_filter.mission.files import write_mission
from edl_filter.mission.shipped import BUILTIN
from edl_filter.mission.yaml_text import parse


def add_effect(
    mission: str,
    name: str,
    output: Path | None = None,
    changes: Sequence[str] = (),
    result: Path | None = None,
    imu: str | None = None,
    file: str | None = None,
) -> Path:
    """Write a mission file with one more effect at the end of its ``effects:``.

    Parameters
    ----------
    mission : str
        Mission file, or ``builtin:NAME``.
    name : str
        Name of the effect.
    output : Path, optional
        File to write; by default ``NAME+EFFECT.yaml`` in the folder of the mission, or in the current folder for a
        shipped mission. A file that exists is refused, unless it is the mission file itself.
    changes : sequence of str
        Starting values, ``PARAMETER=VALUE``; they take precedence over those of `result`.
    result : Path, optional
        Folder of a result, or its ``diagnosis.json``: starting values are its estimates.
    imu : str, optional
        IMU that a sensor effect acts on.
    file : str, optional
        Python file with a user's effect, relative to the current folder.

    Returns
    -------
    Path
        The file that was written.

    Raises
    ------
    InputError
        The mission, effect or parameter does not exist; a value is out of bounds; `output` exists; there is no
        diagnosis, or no estimate of the effect in it.
    """
    estimates = {} if result is None else estimates_of(result, (name, imu))
    original = Mission.load(mission)
    source = original.source
    assert source is not None
    folder = Path() if mission.startswith(BUILTIN) else source.parent
    target = folder / f"{source.stem}+{name}.yaml" if output is None else output
    in_place = output is not None and not mission.startswith(BUILTIN) and target.resolve() == source.resolve()
    if target.exists() and not in_place:
        hint = "name another with -o" + ("" if output is None else ", or the mission file itself to change it")
        raise InputError(f"{target}: found a file; nothing is overwritten: {hint}.")
    effect = find_effect(name, None if file is None else Path(file).expanduser())
    values = estimates | dict(_parse_parameter(change) for change in changes)
    entry: dict[str, Any] = {"name": name}
    if file is not None:
        entry["file"] = os.path.relpath(Path(file).expanduser().resolve(), source.parent.resolve())
    if imu is not None:
        entry["imu"] = imu
    # an unknown parameter is not removed, so that the mission's own check names it
    entry["parameters"] = effect.completed(values) | values
    text = append_effect(original.text, effect, entry, str(source))
    # checked in the mission's folder, since the target's folder may not exist yet
    Mission.from_text(text, str(target), source).active_effects()
    return write_mission(original, text, target)


def estimates_of(result: Path, key: EffectKey) -> dict[str, float]:
    """An effect's estimates in a diagnosis, to 8 digits.

    Parameters
    ----------
    result : Path
        ``diagnosis.json``, or its folder.
    key : (str, str or None)
        Name of the effect, and its IMU.

    Raises
    ------
    InputError
        There is no diagnosis, it violates its schema, or it has no estimate of the effect.
    """
    # imported only where there is a result: they take longer than the rest of the command
    from edl_filter.results.files import DIAGNOSIS, read_diagnosis

    hypotheses = read_diagnosis(result).hypotheses()
    hypothesis = hypotheses.get(label_of(key))
    if hypothesis is None:
        path = result / DIAGNOSIS if result.is_dir() else result
        names = ", ".join(hypotheses) or "none"
        raise InputError(f"{path}: found no estimate of {label_of(key)}; it has estimates of {names}.")
    estimates = {p: e.estimate for p, e in hypothesis.parameters.items()}
    return {p: float(f"{x:.8g}") for p, x in estimates.items() if x is not None}


def _parse_parameter(change: str) -> tuple[str, float]:
    name, equals, text = change.partition("=")
    value = parse(text, f"--set {name}") if equals else None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not name.strip():
        raise InputError(f"--set {change}: found no PARAMETER=NUMBER; expected for example k=0.05.")
    return name.strip(), float(value)
