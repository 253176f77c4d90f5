"""Several instances of one effect in a model: a torque that changes as a remnant tears, a second layer of wind.

An effect that acts at a place or a time may act at another one too. The second instance is an effect with a name of its
own, ``remnant_torque_2``, and its own parameters; otherwise it is identical to the first.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache

from edl_filter.effects.base import Effect, EffectInstance, EffectKey

#: Largest number of instances of one effect in a model.
MOST = 3
_NUMBERED = re.compile(r"(?P<first>\w+)_(?P<number>[2-9])")


def candidates(
    effects: Iterable[Effect], present: Collection[EffectKey], checking: Sequence[str] = ()
) -> list[EffectInstance]:
    """Effects, at zero, that may be added to a model.

    These are the effects that the model lacks, and further instances of those that act at a place. A sensor effect is
    offered in the driving IMU and in every checking one.

    Parameters
    ----------
    effects : iterable of Effect
        All that are considered.
    present : collection of (str, str or None)
        Keys of the model's effects; None as the IMU is the driving one.
    checking : sequence of str
        Names of the checking IMUs.

    Returns
    -------
    list of EffectInstance
        No two of one key; those in the driving IMU first.
    """
    by_name = {e.name: e for e in effects}
    addable: dict[EffectKey, EffectInstance] = {}
    for imu in (None, *checking):
        for effect in by_name.values():
            if imu is not None and not effect.is_sensor_effect:
                continue
            further = [_numbered(effect, n) for n in range(2, MOST + 1) if _may_repeat(effect)]
            # a different effect may have the name of a further instance
            instances = [effect, *(e for e in further if by_name.get(e.name, e) is e)]
            for e in [e for e in instances if (e.name, imu) not in present][:1]:
                addable[e.name, imu] = EffectInstance(e, {}, imu)
    return list(addable.values())


def lookup(effects: Mapping[str, Effect], name: str) -> Effect | None:
    """The effect called `name`, or the further instance that the name denotes.

    Parameters
    ----------
    effects : mapping of str to Effect
        First instances, by name.
    name : str
        Name of a first or further instance.

    Returns
    -------
    Effect or None
        None where there is no such effect.
    """
    match = _NUMBERED.fullmatch(name)
    if name in effects or match is None:
        return effects.get(name)
    first, number = effects.get(match["first"]), int(match["number"])
    return _numbered(first, number) if first is not None and _may_repeat(first) and number <= MOST else None


def _may_repeat(effect: Effect) -> bool:
    return bool(effect.places) and effect.number == 1


@cache
def _numbered(effect: Effect, number: int) -> Effect:
    """Instance `number` of an effect: an object of a subclass that has another name."""
    cls = type(effect)
    own = {"name": f"{effect.name}_{number}", "number": number, "__module__": cls.__module__, "__doc__": cls.__doc__}
    instance = type(cls.__name__, (cls,), own)()
    instance.file = effect.file
    return instance
