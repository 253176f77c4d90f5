"""A mission with one effect more: the text of its file, checked and written."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from edl_filter.effects.effect import Effect, Parameter
from edl_filter.effects.loading import find_effect
from edl_filter.errors import InputError
from edl_filter.mission.appending import append_entry, seen_from
from edl_filter.mission.mission import BUILTIN, PATH_KEYS, Mission
from edl_filter.mission.text import parse
from edl_filter.whole_file import replace_with

#: Column of the comments beside an effect's parameters.
_COMMENT = 33


def add_effect(
    mission: str,
    name: str,
    output: Path | None = None,
    changes: Sequence[str] = (),
    result: Path | None = None,
    imu: str | None = None,
    file: str | None = None,
) -> Path:
    """Write a mission file with the effect `name` at the end of its ``effects:``.

    Parameters
    ----------
    mission : str
        Mission file, or ``builtin:NAME``.
    name : str
        The effect's.
    output : Path, optional
        File to write; otherwise ``NAME+EFFECT.yaml`` beside the mission, or in the current folder for one that is built
        in. The mission file itself may be given, and only it may be there already.
    changes : sequence of str
        ``PARAMETER=VALUE``.
    result : Path, optional
        Folder of a result, or its ``diagnosis.json``: starting values are its estimates.
    imu : str, optional
        IMU that a sensor effect sits in.
    file : str, optional
        Python file with a user's effect, from the current folder.

    Returns
    -------
    Path
        What was written.

    Raises
    ------
    InputError
        No such mission, effect or parameter; a value out of bounds; nothing about the effect in the diagnosis; `output`
        exists.
    """
    before = Mission.load(mission)
    source = before.source
    assert source is not None
    beside = Path() if mission.startswith(BUILTIN) else source.parent
    target = beside / f"{source.stem}+{name}.yaml" if output is None else output
    in_place = output is not None and not mission.startswith(BUILTIN) and target.resolve() == source.resolve()
    if target.exists() and not in_place:
        hint = "name another with -o" + ("" if output is None else ", or the mission file itself to change it")
        raise InputError(f"{target}: found a file; nothing is overwritten: {hint}.")
    effect = find_effect(name, None if file is None else Path(file).expanduser())
    values: dict[str, float] = {}
    if result is not None:
        estimates, found_imu = estimates_of(result, name)
        values, imu = values | estimates, imu or found_imu
    values |= dict(_value(change) for change in changes)
    entry: dict[str, Any] = {"name": name}
    if file is not None:
        entry["file"] = os.path.relpath(Path(file).expanduser().resolve(), source.parent.resolve())
    if imu is not None:
        entry["imu"] = imu
    # a parameter that is not the effect's stays, for the mission's own check to name it
    entry["parameters"] = effect.completed(values) | values
    text = with_effect(before.text, effect, entry, str(source))
    # checked from the mission's folder: that of the target may not be there yet
    Mission.from_text(text, str(target), source).active_effects()
    text = seen_from(text, (*PATH_KEYS, "effects.*.file"), source.parent, target.parent, str(source))
    return replace_with(target, lambda path: path.write_text(text, encoding="utf-8"))


def with_effect(text: str, effect: Effect, entry: dict[str, Any], where: str) -> str:
    """A mission's `text` with one `entry` more at the end of its ``effects:``, said in comments.

    Parameters
    ----------
    text : str
    effect : Effect
    entry : dict
        ``name`` and ``parameters``, and ``file``, ``imu`` or ``fixed`` where they are needed.
    where : str
        The file, in messages.
    """
    return append_entry(text, "effects", entry, _lines(effect, entry), where)


def estimates_of(result: Path, name: str) -> tuple[dict[str, float], str | None]:
    """An effect's estimates in a diagnosis, to 8 digits, and the IMU that it found it in, if it says one.

    Parameters
    ----------
    result : Path
        ``diagnosis.json``, or the folder that holds it.
    name : str

    Raises
    ------
    InputError
        There is no diagnosis, it is no such file, or it has no estimate of the effect.
    """
    path = result / "diagnosis.json" if result.is_dir() else result
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise InputError(
            f"{path}: found no diagnosis; expected a folder in which 'edl-filter diagnose' wrote diagnosis.json."
        ) from None
    except ValueError as error:
        raise InputError(f"{path}: {error}; JSON is expected.") from None
    try:
        ranking = by_name(told["ranking"])
        if name not in ranking:
            names = ", ".join(ranking) or "none"
            raise InputError(f"{path}: found no estimate of {name}; it has estimates of {names}.")
        found = {p: value["estimate"] for p, value in ranking[name]["parameters"].items()}
        values = {p: float(f"{x:.8g}") for p, x in found.items() if x is not None}
        return values, ranking[name].get("imu")
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: found no ranking of effects with estimates ({error!r} is missing).") from None


def by_name(ranking: Iterable[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Hypotheses of a ``diagnosis.json`` by name, those among them that the flight does not tell from another too."""
    entries = list(ranking)
    others = {name: other for e in entries for name, other in e.get("alternatives", {}).items()}
    return others | {e["effect"]: e for e in entries}


def _value(change: str) -> tuple[str, float]:
    name, equals, text = change.partition("=")
    value = parse(text, f"--set {name}") if equals else None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not name.strip():
        raise InputError(f"--set {change}: found no PARAMETER=NUMBER; expected for example k=0.05.")
    return name.strip(), float(value)


def _lines(effect: Effect, entry: Mapping[str, Any]) -> list[str]:
    """An entry as lines of YAML, each parameter with its unit and meaning."""
    meaning = {q.name: q for q in effect.parameters}
    lines = [_beside(f"name: {entry['name']}", effect.summary)]
    lines += [
        f"{key}: {json.dumps(entry[key], ensure_ascii=False)}" for key in ("file", "imu", "fixed") if key in entry
    ]
    if entry["parameters"]:
        lines.append("parameters:")
    for name, value in entry["parameters"].items():
        line = f"  {name}: {_number(value)}"
        lines.append(_beside(line, _said(meaning[name])) if name in meaning else line)
    return lines


def _beside(line: str, comment: str) -> str:
    """A line with its comment at the usual column, or behind it where it is longer."""
    return f"{line:<{_COMMENT - 3}} # {comment}"


def _said(q: Parameter) -> str:
    return f"{q.unit}, {q.description}" if q.unit else q.description


def _number(value: float) -> str:
    if math.isinf(value):
        return ".inf" if value > 0.0 else "-.inf"
    return repr(value)
