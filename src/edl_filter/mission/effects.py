"""Section of the physical effects, and the effects that its entries name."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Field, StringConstraints, ValidationError
from pydantic_core import InitErrorDetails

from edl_filter.errors import InputError
from edl_filter.mission.fields import Section
from edl_filter.mission.validators import Switch, field_error, value_text

if TYPE_CHECKING:
    from edl_filter.effects.base import Effect, EffectInstance


def _not_nan(value: float) -> float:
    if math.isnan(value):
        raise field_error("nan", "a number, or .inf for an effect that never ends")
    return value


#: A number that may be infinite: the end time of an effect that never ends.
ParameterValue = Annotated[float, Field(strict=True), AfterValidator(_not_nan)]


class EffectConfig(Section):
    """One physical effect with its parameters; it is off if all its sizes are zero."""

    name: Annotated[str, StringConstraints(min_length=1)] = Field(
        description="name in the catalogue ('edl-filter effects'), of an installed package's effect, or in the file"
    )
    file: str | None = Field(
        default=None, description="Python file with a user's effect, relative to the mission's folder"
    )
    imu: str | None = Field(default=None, description="IMU that a sensor effect acts on; absent: the driving IMU")
    fixed: Switch = Field(default=False, description="true: held at its values instead of being refitted")
    parameters: dict[str, ParameterValue] = Field(
        default_factory=dict, description="value by parameter, SI and rad; absent: sizes 0, others their default"
    )


def _problems(entry: EffectConfig, catalogue: Mapping[str, Effect]) -> Iterator[tuple[tuple[str, ...], str, str]]:
    """Yield place, value and what is accepted for an unknown effect, each wrong parameter and a wrong IMU."""
    from edl_filter.effects.instances import lookup
    from edl_filter.effects.parameters import nearest

    effect = lookup(catalogue, entry.name)
    if effect is None:
        yield ("name",), value_text(entry.name), f"the name of an effect; {nearest(entry.name, catalogue)}"
        return
    for problem in effect.problems(entry.parameters):
        yield ("parameters", problem.parameter), problem.actual, problem.expected
    if entry.imu is not None and not effect.is_sensor_effect:
        yield ("imu",), value_text(entry.imu), f"none: {entry.name} sits in no IMU"


def _checked(effects: tuple[EffectConfig, ...]) -> tuple[EffectConfig, ...]:
    """The entries, if every effect, parameter and IMU in them exists; those of files are checked by `effect_instances`.

    The path of a user's file depends on the folder of the file that lists it.
    """
    if not effects:
        return effects
    from edl_filter.effects.registry import known_effects

    catalogue = known_effects()
    errors = [
        InitErrorDetails(type=field_error(actual, expected), loc=(k, *place), input=entry.name)
        for k, entry in enumerate(effects)
        if entry.file is None
        for place, actual, expected in _problems(entry, catalogue)
    ]
    if errors:
        raise ValidationError.from_exception_data("effects", errors)
    return effects


#: The effects that a mission or a scenario lists.
Effects = Annotated[tuple[EffectConfig, ...], AfterValidator(_checked)]


def effect_instances(
    effects: Sequence[EffectConfig], locate: Callable[[str, str], Path], label: str
) -> tuple[EffectInstance, ...]:
    """Instances of the effects that a file lists, in its order, with all their parameters.

    Parameters
    ----------
    effects : sequence of EffectConfig
        Entries of the file.
    locate : callable
        Returns the path of a user's file from its key and the reference in the entry; raises `InputError` where the
        file does not exist.
    label : str
        Name of the file that lists the effects, in messages.

    Raises
    ------
    InputError
        The file of a user's effect is missing or cannot be used, or has no such effect or parameter.
    """
    if not effects:
        return ()
    from edl_filter.effects.base import EffectInstance
    from edl_filter.effects.registry import find_effect

    instances = []
    for k, entry in enumerate(effects):
        key = f"effects.{k}"
        effect = find_effect(entry.name, None if entry.file is None else locate(f"{key}.file", entry.file))
        try:
            values = effect.checked(entry.parameters)
        except InputError as error:
            raise InputError(f"{label}: {key}.parameters.{error}.") from None
        instances.append(EffectInstance(effect, values, entry.imu, entry.fixed))
    return tuple(instances)
