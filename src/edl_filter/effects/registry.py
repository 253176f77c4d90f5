"""Effects by name wherever they come from: the catalogue, a user's Python file, an installed package.

A package offers its effects under the entry-point group ``edl_filter.effects``: name → class. In a file they are the
subclasses of `Effect` that it defines. Both are guarded (`edl_filter.effects.guard`).
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

from edl_filter.effects.again import among
from edl_filter.effects.catalogue import catalogue, nearest, unknown
from edl_filter.effects.effect import KINDS, Effect, Parameter
from edl_filter.effects.guard import guarded, last_line
from edl_filter.errors import InputError

GROUP = "edl_filter.effects"


def find_effect(name: str, file: Path | None = None) -> Effect:
    """The effect called `name`, from `file` if one is given, else from the catalogue or an installed package.

    Raises
    ------
    InputError
        There is none of that name (the nearest are named), or the file or package cannot be used.
    """
    if file is not None:
        return _one_of(effects_in(file), name, f"{file}: ", ".")
    known = catalogue()
    if name in known:
        return known[name]
    return _one_of(known_effects(), name)


def _one_of(known: dict[str, Effect], name: str, before: str = "", after: str = "") -> Effect:
    """By its name, or by that of an effect that is there once more."""
    found = among(known, name)
    if found is None:
        raise InputError(f"{before}{unknown(name, known)}{after}")
    return found


def known_effects() -> dict[str, Effect]:
    """The catalogue, and what installed packages bring, by name.

    Raises
    ------
    InputError
        As `installed`.
    """
    return catalogue() | installed()


def effects_in(file: Path) -> dict[str, Effect]:
    """Effects that a Python file defines, by name.

    Raises
    ------
    InputError
        It cannot be read, raises, defines none, or declares one wrongly.
    """
    if not file.is_file():
        raise InputError(f"{file}: there is no such file; a Python file with an effect is expected.")
    return _effects_in(file.resolve(), file.stat().st_mtime_ns)


@cache
def _effects_in(file: Path, changed: int) -> dict[str, Effect]:
    spec = importlib.util.spec_from_file_location(f"edl_filter_user_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise InputError(f"{file}: found a file of another kind; a Python file (.py) with an effect is expected.")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{file}: raised {last_line(error, str(file))} when it was read.") from error
    classes = [c for c in vars(module).values() if _is_effect(c) and c.__module__ == module.__name__]
    if not classes:
        raise InputError(f"{file}: found no effect; a subclass of edl_filter.effects.Effect is expected.")
    found = {c.name: _user(c, str(file)) for c in classes}
    for effect in found.values():
        effect.file = file
    return found


@cache
def installed() -> dict[str, Effect]:
    """Effects of installed packages (entry-point group ``edl_filter.effects``), by name.

    Raises
    ------
    InputError
        One cannot be loaded, is no effect, or takes a name of the catalogue.
    """
    found: dict[str, Effect] = {}
    for point in entry_points(group=GROUP):
        where = f"entry point {point.name} = {point.value}"
        try:
            cls = point.load()
        except Exception as error:
            raise InputError(f"{where}: raised {last_line(error)} when it was loaded.") from error
        if not _is_effect(cls):
            raise InputError(f"{where}: found {cls!r}; a subclass of edl_filter.effects.Effect is expected.")
        effect = _user(cls, where)
        if effect.name in catalogue():
            raise InputError(f"{where}: the name {effect.name!r} is taken by the catalogue; another one is expected.")
        found[effect.name] = effect
    return found


def of_session(given: Effect | type[Effect]) -> Effect:
    """An effect that was given as an object: as it is if it has a home, else of this Python session, and guarded.

    Parameters
    ----------
    given : Effect or subclass of it
        A class that was written in a notebook, say.

    Raises
    ------
    InputError
        It is declared wrongly, or takes a name of the catalogue.
    """
    cls = given if isinstance(given, type) else type(given)
    if not _is_effect(cls):
        raise InputError(f"found {given!r}; expected an effect, its class, or its name.")
    if not isinstance(given, type) and (has_home(given) or getattr(cls, "guarded", False)):
        return given
    known = known_effects().get(cls.name)
    if known is not None and type(known) is cls:
        return known
    if known is not None:
        raise InputError(f"effect {cls.__name__}: the name {cls.name!r} is taken; another one is expected.")
    return _user(cls, "this session")


def has_home(effect: Effect) -> bool:
    """Whether a mission file can name the effect: one of the catalogue, of an installed package or of a file."""
    return effect.file is not None or type(among(known_effects(), effect.name)) is type(effect)


class Problem(NamedTuple):
    """What is wrong with a value: which parameter, what was found, what is expected."""

    parameter: str
    found: str
    expected: str


def checked_values(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """All parameters of an effect, those that `values` leaves out at their defaults.

    Raises
    ------
    InputError
        The message begins with the parameter's name: there is no such parameter, or it is out of its bounds.
    """
    wrong = first_problem(effect, values)
    if wrong is not None:
        raise InputError(f"{wrong.parameter}: found {wrong.found}; expected {wrong.expected}")
    return effect.completed(values)


def first_problem(effect: Effect, values: Mapping[str, float]) -> Problem | None:
    """The first of `values` that is of no parameter of the effect, or out of its bounds."""
    parameters = {q.name: q for q in effect.parameters}
    for name, value in values.items():
        if name not in parameters:
            return Problem(name, "an unknown key", f"a parameter of {effect.name}; {nearest(name, parameters)}")
        q = parameters[name]
        if not q.low <= value <= q.high:  # not a number fails as well
            return Problem(name, f"{value:g}", bounds_text(q))
    return None


def bounds_text(q: Parameter) -> str:
    """Unit and bounds of a parameter in words."""
    if math.isinf(q.low) and math.isinf(q.high):
        return "any number" + (f" of {q.unit}" if q.unit else "")
    return (f"{q.unit} " if q.unit else "") + f"between {q.low:g} and {q.high:g}"


def _is_effect(value: Any) -> bool:
    return isinstance(value, type) and issubclass(value, Effect) and value is not Effect


def _user(cls: type[Effect], where: str) -> Effect:
    """An instance of a user's class, guarded, after its declaration was checked."""
    start = f"{where}: effect {cls.__name__}"
    if not isinstance(cls.name, str) or not cls.name.isidentifier():
        raise InputError(f"{start}: name: found {cls.name!r}; letters, digits and _ are expected.")
    if not isinstance(cls.parameters, tuple) or not all(isinstance(q, Parameter) for q in cls.parameters):
        raise InputError(f"{start}: parameters: found {cls.parameters!r}; a tuple of Parameter is expected.")
    names = [q.name for q in cls.parameters]
    if len(set(names)) < len(names) or not all(n.isidentifier() for n in names):
        raise InputError(f"{start}: parameters: found the names {names}; different ones of letters, digits and _.")
    for q in cls.parameters:
        what = f"{start}: parameter {q.name}"
        if q.kind not in KINDS:
            raise InputError(f"{what}: found the kind {q.kind!r}; expected one of {', '.join(KINDS)}.")
        if q.kind == "size" and not (q.sigma > 0.0 and q.low < 0.0 < q.high and q.default == 0.0):
            raise InputError(f"{what}: a size needs a positive sigma, bounds on both sides of zero and default 0.")
        if not q.low <= q.default <= q.high:
            raise InputError(f"{what}: found the default {q.default:g}; expected {bounds_text(q)}.")
    try:
        return guarded(cls)()
    except Exception as error:
        raise InputError(f"{start}: raised {last_line(error)} when it was made.") from error
