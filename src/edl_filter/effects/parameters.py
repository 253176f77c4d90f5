"""Parameters of effects: their declaration, and the check of values against it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import NamedTuple, Protocol

import numpy as np

from edl_filter.errors import InputError

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
        For kinds other than ``size``: number of values between the bounds at which the diagnosis evaluates the effect.
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


class Declares(Protocol):
    """Anything that declares a name and parameters: an effect, or its class."""

    @property
    def name(self) -> str:
        """As in missions and tables."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """In the order of the declaration."""


class Problem(NamedTuple):
    """An invalid value: name of the parameter, text of the actual value, text of what is expected."""

    parameter: str
    actual: str
    expected: str


def checked_values(effect: Declares, values: Mapping[str, float]) -> dict[str, float]:
    """All parameters of an effect by name; those that `values` does not name are at their defaults.

    Raises
    ------
    InputError
        The message begins with the parameter's name: there is no such parameter, or it is out of its bounds.
    """
    for problem in problems(effect, values):
        raise InputError(f"{problem.parameter}: found {problem.actual}; expected {problem.expected}")
    return completed_values(effect, values)


def problems(effect: Declares, values: Mapping[str, float]) -> Iterator[Problem]:
    """Yield a problem for each of `values` that names no parameter of the effect or is out of its bounds."""
    parameters = {q.name: q for q in effect.parameters}
    for name, value in values.items():
        if name not in parameters:
            yield Problem(name, "an unknown key", f"a parameter of {effect.name}; {nearest(name, parameters)}")
            continue
        q = parameters[name]
        if not q.low <= value <= q.high:  # NaN fails too
            yield Problem(name, f"{value:g}", bounds_text(q))


def bounds_text(q: Parameter) -> str:
    """Unit and bounds of a parameter in words."""
    if math.isinf(q.low) and math.isinf(q.high):
        return "any number" + (f" of {q.unit}" if q.unit else "")
    return (f"{q.unit} " if q.unit else "") + f"between {q.low:g} and {q.high:g}"


def completed_values(effect: Declares, values: Values) -> dict[str, float]:
    """All parameters of an effect by name: those of `values`, all others at their defaults; nothing is checked."""
    return {q.name: float(values.get(q.name, q.default)) for q in effect.parameters}


def unknown_effect(name: str, names: Collection[str]) -> str:
    """Message about an effect name that is not in `names`, with the nearest of them."""
    return f"found no effect {name!r}; {nearest(name, names)}"


def nearest(name: str, names: Collection[str]) -> str:
    """Text of what is accepted in place of `name`: the nearest of `names`, or all where none is similar."""
    similar = get_close_matches(name, names, 2, 0.6)
    similar = similar or [k for k in names if any(part in k for part in name.split("_") if len(part) > 3)]
    return f"nearest accepted: {', '.join(similar)}" if similar else f"accepted: {', '.join(names)}"
