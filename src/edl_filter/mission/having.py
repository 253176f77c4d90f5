"""A mission with further effects, in memory: what a notebook's loop goes through.

An effect that a file can name is written into the mission's text, so that the mission runs anywhere. One that lives in
this Python session alone, a class in a notebook, goes beside it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from edl_filter.effects.effect import Active, Effect
from edl_filter.effects.loading import checked_values, find_effect, has_home, of_session
from edl_filter.errors import InputError
from edl_filter.mission.adding import with_effect as text_with_effect
from edl_filter.mission.mission import Mission
from edl_filter.mission.text import set_key


def with_effect(
    mission: Mission,
    effect: str | Effect | type[Effect] | Active | None,
    imu: str | None = None,
    fixed: bool = False,
    values: Mapping[str, float] | None = None,
) -> Mission:
    """A mission with one effect more.

    Parameters
    ----------
    mission : Mission
    effect : str, Effect, class or Active
        Its name, itself, its class, or the effect as it acts, such as the leader of a diagnosis.
    imu : str, optional
        IMU that a sensor effect sits in.
    fixed : bool
        Held at its values instead of being refitted.
    values : mapping
        Parameter → starting value; what is not named keeps the effect's own.

    Raises
    ------
    InputError
        There is no such effect or parameter, or the mission has the effect already.
    """
    if effect is None:
        raise InputError("with_effect: found no effect; a diagnosis has a leader only where its verdict is 'missing'.")
    if isinstance(effect, Active):
        active = effect
    else:
        active = Active(find_effect(effect) if isinstance(effect, str) else of_session(effect), {})
    active = replace(
        active,
        effect=of_session(active.effect),
        values=checked_values(active.effect, active.values | dict(values or {})),
        imu=imu or active.imu,
        fixed=fixed or active.fixed,
    )
    if any((a.name, a.imu) == (active.name, active.imu) for a in mission.active_effects()):
        raise InputError(f"{mission.name}: found {active.name} in the mission already; an effect is added once.")
    return with_effects(mission, (*mission.active_effects(), active))


def with_effects(mission: Mission, model: Sequence[Active]) -> Mission:
    """A mission with the effects of a model, its own ones first; see `text_with`."""
    text, session = text_with(mission, model)
    made = Mission.from_text(text, str(mission.source or mission.name), mission.source)
    made.active_effects()  # an IMU or a file that is not there is told here
    made._session = session
    return made


def text_with(mission: Mission, model: Sequence[Active]) -> tuple[str, tuple[Active, ...]]:
    """A mission's text with a model's effects at their values, and those that no file can name.

    Parameters
    ----------
    mission : Mission
    model : sequence of Active
        The mission's own effects first, in its order; then further ones.

    Raises
    ------
    InputError
        The model does not begin with the mission's own effects.
    """
    where, text = str(mission.source or mission.name), mission.text
    own = mission.active_effects()
    if [a.name for a in own] != [a.name for a in model[: len(own)]]:
        names = ", ".join(a.name for a in model) or "none"
        raise InputError(f"{where}: found the effects {names}; expected first {', '.join(a.name for a in own)}.")
    stated = len(mission.effects)
    for k, (was, now) in enumerate(zip(own[:stated], model[:stated], strict=True)):
        for name, value in rounded(now.values).items():
            if value != was.values[name]:
                text = set_key(text, f"effects.{k}.parameters.{name}", value, where)
    session = list(model[stated : len(own)])
    for active in model[len(own) :]:
        if has_home(active.effect):
            text = text_with_effect(text, active.effect, _entry(mission, active), where)
        else:
            session.append(active)
    return text, tuple(session)


def rounded(values: Mapping[str, float]) -> dict[str, float]:
    """Parameters to ten digits, which is what a file shows of them."""
    return {name: float(f"{value:.10g}") for name, value in values.items()}


def _entry(mission: Mission, active: Active) -> dict[str, Any]:
    """An effect as an entry of the mission's ``effects:``."""
    entry: dict[str, Any] = {"name": active.name}
    if active.effect.file is not None:
        beside = Path() if mission.source is None else mission.source.parent
        entry["file"] = os.path.relpath(active.effect.file, beside.resolve())
    if active.imu is not None:
        entry["imu"] = active.imu
    if active.fixed:
        entry["fixed"] = True
    entry["parameters"] = rounded(active.values)
    return entry
