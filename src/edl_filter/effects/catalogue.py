"""The catalogue: every built-in effect by name, in one order for tables, files and people."""

from __future__ import annotations

from collections.abc import Collection
from difflib import get_close_matches
from functools import cache

from edl_filter.effects import aerodynamics, atmosphere, entry, gravity, sensors, vehicle
from edl_filter.effects.effect import Effect
from edl_filter.errors import InputError

_FAMILIES = (sensors, vehicle, gravity, atmosphere, aerodynamics, entry)


@cache
def _built_in() -> dict[str, Effect]:
    return {cls.name: cls() for family in _FAMILIES for cls in family.EFFECTS}


def catalogue() -> dict[str, Effect]:
    """Built-in effects by name: sensors, vehicle, planet, atmosphere, aerodynamics, entry state."""
    return dict(_built_in())


def effect_named(name: str) -> Effect:
    """The built-in effect called `name`.

    Raises
    ------
    InputError
        There is none; the message has the nearest names.
    """
    known = _built_in()
    if name not in known:
        raise InputError(unknown(name, known))
    return known[name]


def unknown(name: str, known: Collection[str]) -> str:
    """Message about a name that is not among the `known`, with what comes nearest."""
    return f"found no effect {name!r}; {nearest(name, known)}"


def nearest(name: str, known: Collection[str]) -> str:
    """What is accepted in place of `name`: the nearest names, or all where none is alike."""
    alike = get_close_matches(name, known, 2, 0.6)
    alike = alike or [k for k in known if any(part in k for part in name.split("_") if len(part) > 3)]
    return f"nearest accepted: {', '.join(alike)}" if alike else f"accepted: {', '.join(known)}"
