"""Missions with further effects: as the text of a mission file, and in memory.

An effect that a file can name is written into the mission's text, so that the mission runs in any session. An effect
whose class exists in this Python session only, such as a class of a notebook, is stored in the `Mission` object.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.registry import find_effect, nameable_in_mission, validated_effect
from edl_filter.errors import InputError
from edl_filter.mission.files import source_folder
from edl_filter.mission.mission import Mission
from edl_filter.mission.yaml_edit import append_entry
from edl_filter.mission.yaml_text import set_key

#: An effect as an argument: name in the catalogue, object or class.
EffectLike = str | Effect | type[Effect]
#: Column in which the comments on an effect's parameters begin.
_COMMENT_COLUMN = 33


def without_code(mission: Mission) -> Mission:
    """The mission without the effects of Python files, whose code a check of its data must not run."""
    effects = tuple(entry for entry in mission.effects if entry.file is None)
    return mission if len(effects) == len(mission.effects) else mission.model_copy(update={"effects": effects})


def append_effect(text: str, effect: Effect, entry: dict[str, Any], label: str) -> str:
    """Return a mission's text with one more entry at the end of its ``effects:``, with comments on its parameters.

    Parameters
    ----------
    text : str
        Text of the mission.
    effect : Effect
        The effect, from which the comments are taken.
    entry : dict
        ``name`` and ``parameters``, and ``file``, ``imu`` or ``fixed`` where they are needed.
    label : str
        Name of the file, in messages.
    """
    return append_entry(text, "effects", entry, _entry_lines(effect, entry), label)


def _entry_lines(effect: Effect, entry: Mapping[str, Any]) -> list[str]:
    """An entry as lines of YAML, with unit and description of each parameter as comment."""
    parameters = {q.name: q for q in effect.parameters}
    lines = [_with_comment(f"name: {entry['name']}", effect.summary)]
    lines += [
        f"{key}: {json.dumps(entry[key], ensure_ascii=False)}" for key in ("file", "imu", "fixed") if key in entry
    ]
    if entry["parameters"]:
        lines.append("parameters:")
    for name, value in entry["parameters"].items():
        line = f"  {name}: {_number_text(value)}"
        lines.append(_with_comment(line, _parameter_comment(parameters[name])) if name in parameters else line)
    return lines


def _with_comment(line: str, comment: str) -> str:
    """A line with its comment at the common column, or directly after a longer line."""
    return f"{line:<{_COMMENT_COLUMN - 3}} # {comment}"


def _parameter_comment(q: Parameter) -> str:
    return f"{q.unit}, {q.description}" if q.unit else q.description


def _number_text(value: float) -> str:
    if math.isinf(value):
        return ".inf" if value > 0.0 else "-.inf"
    return repr(value)


def resolve_effect(effect: EffectLike) -> Effect:
    """Return an effect from its name, its class or the effect itself.

    Raises
    ------
    InputError
        No effect has that name, or the class is declared wrongly or uses a name of the catalogue.
    """
    return find_effect(effect) if isinstance(effect, str) else validated_effect(effect)


def with_effect(
    mission: Mission,
    effect: EffectLike | EffectInstance | None,
    *,
    imu: str | None = None,
    fixed: bool = False,
    **values: float,
) -> Mission:
    """Return a mission with one more effect.

    Parameters
    ----------
    mission : Mission
        Mission to extend; it is not changed.
    effect : str, Effect, class or EffectInstance
        Name of the effect, the effect or its class, or an instance with values, such as the leader of a diagnosis.
    imu : str, optional
        IMU that a sensor effect acts on.
    fixed : bool
        Whether the effect is held at its values instead of being refitted.
    **values : float
        Starting values by parameter; other parameters have the values of `effect`.

    Returns
    -------
    Mission
        The extended mission.

    Raises
    ------
    InputError
        The effect or a parameter does not exist, or the mission has the effect already.
    """
    if effect is None:
        raise InputError("with_effect: found no effect; a diagnosis has a leader only where its verdict is 'missing'.")
    instance = effect if isinstance(effect, EffectInstance) else EffectInstance(resolve_effect(effect), {})
    instance = replace(
        instance,
        effect=validated_effect(instance.effect),
        values=instance.effect.checked(instance.values | values),
        imu=imu or instance.imu,
        fixed=fixed or instance.fixed,
    )
    if any(a.key == instance.key for a in mission.active_effects()):
        raise InputError(f"{mission.name}: found {instance.label} in the mission already; an effect is added once.")
    return with_effects(mission, (*mission.active_effects(), instance))


def with_effects(mission: Mission, model: Sequence[EffectInstance]) -> Mission:
    """Return a mission with the effects of a model.

    Parameters
    ----------
    mission : Mission
        Mission to extend; it is not changed.
    model : sequence of EffectInstance
        The mission's own effects first, in its order, with new values; then further effects.

    Raises
    ------
    InputError
        The model does not begin with the mission's own effects, or names an IMU or a file that does not exist.
    """
    text, session = text_with_effects(mission, model)
    extended = Mission.from_text(text, mission.label, mission.source)
    extended.active_effects()  # raises InputError for a wrong IMU or a missing file
    extended._session = session
    return extended


def text_with_effects(mission: Mission, model: Sequence[EffectInstance]) -> tuple[str, tuple[EffectInstance, ...]]:
    """Return a mission's text with the effects of a model.

    Parameters
    ----------
    mission : Mission
        Mission whose text is changed.
    model : sequence of EffectInstance
        The mission's own effects first, in its order, with new values; then further effects.

    Returns
    -------
    text : str
        Text with the effects that a file can name, at their values in the model.
    session : tuple of EffectInstance
        Effects that exist in this Python session only, which no file can name.

    Raises
    ------
    InputError
        The model does not begin with the mission's own effects.
    """
    text, own = mission.text, mission.active_effects()
    if [a.key for a in own] != [a.key for a in model[: len(own)]]:
        labels = ", ".join(a.label for a in model) or "none"
        raise InputError(
            f"{mission.label}: found the effects {labels}; expected first {', '.join(a.label for a in own)}."
        )
    stated = len(mission.effects)
    for k, (original, instance) in enumerate(zip(own[:stated], model[:stated], strict=True)):
        for name, value in _rounded_values(instance.values).items():
            if value != original.values[name]:
                text = set_key(text, f"effects.{k}.parameters.{name}", value, mission.label)
    session = list(model[stated : len(own)])
    for instance in model[len(own) :]:
        if nameable_in_mission(instance.effect):
            text = append_effect(text, instance.effect, _effect_entry(mission, instance), mission.label)
        else:
            session.append(instance)
    return text, tuple(session)


def _rounded_values(values: Mapping[str, float]) -> dict[str, float]:
    """Parameter values rounded to ten digits, as they are written into a file."""
    return {name: float(f"{value:.10g}") for name, value in values.items()}


def _effect_entry(mission: Mission, instance: EffectInstance) -> dict[str, Any]:
    """An effect as an entry of the mission's ``effects:``."""
    entry: dict[str, Any] = {"name": instance.name}
    if instance.effect.file is not None:
        entry["file"] = os.path.relpath(instance.effect.file, source_folder(mission).resolve())
    if instance.imu is not None:
        entry["imu"] = instance.imu
    if instance.fixed:
        entry["fixed"] = True
    entry["parameters"] = _rounded_values(instance.values)
    return entry
