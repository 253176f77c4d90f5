"""Physical effects that a mission switches on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Field, StringConstraints

from edl_filter.mission.checks import Switch, problem, shown
from edl_filter.mission.sections import Section

if TYPE_CHECKING:
    from edl_filter.mission.mission import Mission


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


def check_effects(mission: Mission) -> None:
    """Raise the error of the first effect that is not known, or has a parameter that it cannot have.

    Effects of files are left to `Mission.active_effects`, which knows where the mission's folder is.
    """
    if not mission.effects:
        return
    from edl_filter.effects.loading import first_problem, known_effects, nearest

    known = known_effects()
    for k, entry in enumerate(mission.effects):
        if entry.file is not None:
            continue
        if entry.name not in known:
            expected = f"the name of an effect; {nearest(entry.name, known)}"
            raise problem(shown(entry.name), expected, f"effects.{k}.name")
        effect = known[entry.name]
        wrong = first_problem(effect, entry.parameters)
        if wrong is not None:
            raise problem(wrong.found, wrong.expected, f"effects.{k}.parameters.{wrong.parameter}")
        if entry.imu is not None and not any(effect.acts(h) for h in ("imu", "corrected", "imu_position")):
            raise problem(shown(entry.imu), f"none: {entry.name} sits in no IMU", f"effects.{k}.imu")
