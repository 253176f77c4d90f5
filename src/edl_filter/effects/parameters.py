"""Parameters of effects: their declaration, and the texts of messages about them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

Values = Mapping[str, float]

#: Kinds of parameter: ``size`` says how large the effect is (it is linear in it, or nearly); the others say where it
#: acts (they are scanned, not linearised at zero).
KINDS = ("size", "time", "altitude", "length", "phase", "mach", "frequency")


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes
    ----------
    name, unit, description : str
    sigma : float
        Plausible size: one sigma of a size about zero. Not used for the other kinds: the values at which the diagnosis
        evaluates them have equal prior probabilities.
    kind : str
        One of `KINDS`. An effect is off when all its parameters of kind ``size`` are zero.
    low, high : float
        Bounds. For a ``time``, infinite bounds mean the flight's own, from entry to parachute.
    scan : int
        For kinds other than ``size``: number of values between the bounds at which the diagnosis evaluates the effect;
        of a phase, over a whole turn, half of which suffices where half a turn changes the sign of a size.
    default : float
        Value where none is stated.
    """

    name: str
    unit: str
    description: str
    sigma: float = 0.0
    kind: str = "size"
    low: float = -np.inf
    high: float = np.inf
    scan: int = 0
    default: float = 0.0


def bounds_text(q: Parameter) -> str:
    """Unit and bounds of a parameter in words."""
    if math.isinf(q.low) and math.isinf(q.high):
        return "any number" + (f" of {q.unit}" if q.unit else "")
    return (f"{q.unit} " if q.unit else "") + f"between {q.low:g} and {q.high:g}"


def unknown_effect(name: str, names: Collection[str]) -> str:
    """Message about an effect name that is not in `names`, with the nearest of them."""
    return f"found no effect {name!r}; {nearest(name, names)}"


def nearest(name: str, names: Collection[str]) -> str:
    """Text of what is accepted in place of `name`: the nearest of `names`, or all where none is similar."""
    similar = get_close_matches(name, names, 2, 0.6)
    similar = similar or [k for k in names if any(part in k for part in name.split("_") if len(part) > 3)]
    return f"nearest accepted: {', '.join(similar)}" if similar else f"accepted: {', '.join(names)}"
