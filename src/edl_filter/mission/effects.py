"""Physical effects that a mission switches on."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Field, StringConstraints

from edl_filter.errors import InputError
from edl_filter.mission.checks import Switch, problem, shown
from edl_filter.mission.sections import Section

if TYPE_CHECKING:
    from edl_filter.effects.effect import Active


def _number(value: float) -> float:
    if math.isnan(value):
        raise problem("nan", "a number, or .inf for an effect that never ends")
    return value


#: A number that may be infinite: the end of an effect that never ends.
Value = Annotated[float, Field(strict=True), AfterValidator(_number)]


class EffectEntry(Section):
    """One physical effect with its parameters; off where all its sizes are zero."""

    name: Annotated[str, StringConstraints(min_length=1)] = Field(
        description="name in the catalogue ('edl-filter effects'), of an installed package's effect, or in the file"
    )
    file: str | None = Field(default=None, description="Python file with a user's effect, from the mission's folder")
    imu: str | None = Field(default=None, description="IMU that a sensor effect sits in; absent: the driving one")
    fixed: Switch = Field(default=False, description="true: held at its values instead of being refitted")
    parameters: dict[str, Value] = Field(
        default_factory=dict, description="value by parameter, SI and rad; absent: sizes 0, others their default"
    )


def check_effects(effects: Sequence[EffectEntry]) -> None:
    """Raise the error of the first effect that is not known, or has a parameter that it cannot have.

    Effects of files are left to `Mission.active_effects`, which knows where the mission's folder is.
    """
    if not effects:
        return
    from edl_filter.effects.again import among
    from edl_filter.effects.loading import first_problem, known_effects, nearest

    known = known_effects()
    for k, entry in enumerate(effects):
        if entry.file is not None:
            continue
        effect = among(known, entry.name)
        if effect is None:
            expected = f"the name of an effect; {nearest(entry.name, known)}"
            raise problem(shown(entry.name), expected, f"effects.{k}.name")
        wrong = first_problem(effect, entry.parameters)
        if wrong is not None:
            raise problem(wrong.found, wrong.expected, f"effects.{k}.parameters.{wrong.parameter}")
        if entry.imu is not None and not any(effect.acts(h) for h in ("imu", "corrected", "imu_position")):
            raise problem(shown(entry.imu), f"none: {entry.name} sits in no IMU", f"effects.{k}.imu")


def switched_on(effects: Sequence[EffectEntry], locate: Callable[[str, str], Path], where: str) -> tuple[Active, ...]:
    """Effects as they act, in the file's order, with all their parameters.

    Parameters
    ----------
    effects : sequence of EffectEntry
    locate : callable
        Key and reference of a file to its path; raises `InputError` where there is none.
    where : str
        The file that lists them, for messages.

    Raises
    ------
    InputError
        The file of a user's effect is missing or cannot be used, or has no such effect or parameter.
    """
    if not effects:
        return ()
    from edl_filter.effects.effect import Active
    from edl_filter.effects.loading import checked_values, find_effect

    active = []
    for k, entry in enumerate(effects):
        key = f"effects.{k}"
        effect = find_effect(entry.name, None if entry.file is None else locate(f"{key}.file", entry.file))
        try:
            values = checked_values(effect, entry.parameters)
        except InputError as error:
            raise InputError(f"{where}: {key}.parameters.{error}.") from None
        active.append(Active(effect, values, entry.imu, entry.fixed))
    return tuple(active)
