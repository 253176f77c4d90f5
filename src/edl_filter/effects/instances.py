"""The same effect once more: a torque that changes as a remnant tears, a second layer of wind.

An effect that acts at a place may act at another one as well. The second is an effect under a name of its own,
``remnant_torque_2``, with its own parameters; in all else it is the first.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from functools import cache

from edl_filter.effects.effect import Effect

#: How often an effect may be in a model.
MOST = 3
_NUMBERED = re.compile(r"(?P<first>\w+)_(?P<number>[2-9])")


def offered(candidates: Iterable[Effect], present: Collection[str]) -> list[Effect]:
    """What may be added to a model that has the effects `present`: those that it lacks, and places once more.

    Parameters
    ----------
    candidates : iterable of Effect
    present : collection of str
        Names of the model's effects.

    Returns
    -------
    list of Effect
        No two of one name.
    """
    known = {e.name: e for e in candidates}
    found: dict[str, Effect] = {}
    for effect in known.values():
        twins = [_numbered(effect, n) for n in range(2, MOST + 1) if _may_repeat(effect)]
        kind = [effect, *(t for t in twins if known.get(t.name, t) is t)]  # another effect may have that name
        found |= {e.name: e for e in [e for e in kind if e.name not in present][:1]}
    return list(found.values())


def kind_of(effect: Effect) -> str:
    """The name of the effect that it is, whichever in a model."""
    return effect.name.removesuffix(f"_{effect.number}") if effect.number > 1 else effect.name


def among(known: Mapping[str, Effect], name: str) -> Effect | None:
    """The effect of that name among the `known`, or the one that is there once more if it has its number.

    Parameters
    ----------
    known : mapping of str to Effect
    name : str

    Returns
    -------
    Effect or None
    """
    told = _NUMBERED.fullmatch(name)
    if name in known or told is None:
        return known.get(name)
    first, number = known.get(told["first"]), int(told["number"])
    return _numbered(first, number) if first is not None and _may_repeat(first) and number <= MOST else None


def _may_repeat(effect: Effect) -> bool:
    return bool(effect.places) and effect.number == 1


@cache
def _numbered(effect: Effect, number: int) -> Effect:
    cls = type(effect)
    own = {"name": f"{effect.name}_{number}", "number": number, "__module__": cls.__module__, "__doc__": cls.__doc__}
    twin = type(cls.__name__, (cls,), own)()
    twin.file = effect.file
    return twin
