"""Effects by name from all sources: the built-in catalogue, a user's Python file, an installed package.

A package registers its effects in the entry-point group ``edl_filter.effects``: name → class. In a file they are the
subclasses of `Effect` that it defines. The hooks of both are validated (`edl_filter.effects.hook_validation`).
"""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Sequence
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from edl_filter.effects import aerodynamics, atmosphere, gravity, initial_state, sensors, vehicle
from edl_filter.effects.base import Effect
from edl_filter.effects.hook_validation import last_line, validated_class
from edl_filter.effects.instances import lookup
from edl_filter.effects.parameters import KINDS, Parameter, bounds_text, unknown_effect
from edl_filter.errors import InputError

GROUP = "edl_filter.effects"
_FAMILIES = (sensors, vehicle, gravity, atmosphere, aerodynamics, initial_state)


@cache
def _built_in() -> dict[str, Effect]:
    return {cls.name: cls() for family in _FAMILIES for cls in family.EFFECTS}


def catalogue() -> dict[str, Effect]:
    """Built-in effects by name: sensors, vehicle, planet, atmosphere, aerodynamics, entry state."""
    return dict(_built_in())


def find_effect(name: str, file: Path | None = None) -> Effect:
    """The effect called `name`: from `file` if there is one, else from the catalogue or an installed package.

    Raises
    ------
    InputError
        There is none of that name (the message has the nearest names), or the file or package cannot be used.
    """
    if file is not None:
        return _lookup_or_raise(effects_in(file), name, f"{file}: ", ".")
    built_in = catalogue()
    if name in built_in:
        return built_in[name]
    return _lookup_or_raise(known_effects(), name)


def _lookup_or_raise(effects: dict[str, Effect], name: str, before: str = "", after: str = "") -> Effect:
    """The effect or the further instance called `name`; `before` and `after` enclose the message of the error."""
    effect = lookup(effects, name)
    if effect is None:
        raise InputError(f"{before}{unknown_effect(name, effects)}{after}")
    return effect


def known_effects() -> dict[str, Effect]:
    """Effects of the catalogue and of installed packages, by name.

    Raises
    ------
    InputError
        As `installed`.
    """
    return catalogue() | installed()


def selected_effects(names: Sequence[str] = (), file: Path | None = None) -> list[Effect]:
    """Effects that a command considers: those that the user selects by name, or all.

    Parameters
    ----------
    names : sequence of str
        Only these; empty: all of the catalogue, of installed packages and of `file`.
    file : Path, optional
        Python file with a user's effects.

    Raises
    ------
    InputError
        There is none of a name (the message has the nearest names), or the file cannot be used.
    """
    effects = known_effects() | (effects_in(file.expanduser()) if file is not None else {})
    selected = {name: lookup(effects, name) for name in names}
    for name, effect in selected.items():
        if effect is None:
            raise InputError(f"--effect: {unknown_effect(name, effects)}.")
    return [e for e in selected.values() if e is not None] if names else list(effects.values())


def effects_in(file: Path) -> dict[str, Effect]:
    """Effects that a Python file defines, by name.

    Raises
    ------
    InputError
        It cannot be read, raises, defines no effect, or declares one wrongly.
    """
    if not file.is_file():
        raise InputError(f"{file}: there is no such file; a Python file with an effect is expected.")
    return _effects_in(file.resolve(), file.stat().st_mtime_ns)


@cache
def _effects_in(file: Path, modified_ns: int) -> dict[str, Effect]:
    """As `effects_in`; the time of modification makes the cache read a changed file again."""
    spec = importlib.util.spec_from_file_location(f"edl_filter_user_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise InputError(f"{file}: found a file of another kind; a Python file (.py) with an effect is expected.")
    module = importlib.util.module_from_spec(spec)
    logging.getLogger("edl_filter").info("runs the code of %s", file)  # the command line prints it
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{file}: raised {last_line(error, str(file))} when it was read.") from error
    classes = [c for c in vars(module).values() if _is_effect(c) and c.__module__ == module.__name__]
    if not classes:
        raise InputError(f"{file}: found no effect; a subclass of edl_filter.effects.Effect is expected.")
    effects = {c.name: _checked_instance(c, str(file)) for c in classes}
    for effect in effects.values():
        effect.file = file
    return effects


@cache
def installed() -> dict[str, Effect]:
    """Effects of installed packages (entry-point group ``edl_filter.effects``), by name.

    Raises
    ------
    InputError
        One cannot be loaded, is no effect, or has a name of the catalogue.
    """
    effects: dict[str, Effect] = {}
    for point in entry_points(group=GROUP):
        where = f"entry point {point.name} = {point.value}"
        try:
            cls = point.load()
        except Exception as error:
            raise InputError(f"{where}: raised {last_line(error)} when it was loaded.") from error
        if not _is_effect(cls):
            raise InputError(f"{where}: found {cls!r}; a subclass of edl_filter.effects.Effect is expected.")
        effect = _checked_instance(cls, where)
        if effect.name in catalogue():
            raise InputError(f"{where}: the name {effect.name!r} is taken by the catalogue; another one is expected.")
        effects[effect.name] = effect
    return effects


def validated_effect(effect: Effect | type[Effect]) -> Effect:
    """An effect that is passed as an object or class, with its declaration checked and its hooks validated.

    An effect that a mission file can name, or that is validated already, is returned as it is. Any other is an effect
    of this Python session, such as a class in a notebook.

    Raises
    ------
    InputError
        It is declared wrongly, or has a name of the catalogue.
    """
    cls = effect if isinstance(effect, type) else type(effect)
    if not _is_effect(cls):
        raise InputError(f"found {effect!r}; expected an effect, its class, or its name.")
    if not isinstance(effect, type) and (nameable_in_mission(effect) or getattr(cls, "validated", False)):
        return effect
    registered = known_effects().get(cls.name)
    if registered is not None and type(registered) is cls:
        return registered
    if registered is not None:
        raise InputError(f"effect {cls.__name__}: the name {cls.name!r} is taken; another one is expected.")
    return _checked_instance(cls, "this session")


def nameable_in_mission(effect: Effect) -> bool:
    """Whether a mission file can name the effect: one of the catalogue, of an installed package or of a file."""
    return effect.file is not None or type(lookup(known_effects(), effect.name)) is type(effect)


def _is_effect(value: Any) -> bool:
    return isinstance(value, type) and issubclass(value, Effect) and value is not Effect


def _checked_instance(cls: type[Effect], where: str) -> Effect:
    """An instance of a user's class with validated hooks, after its declaration has been checked."""
    start = f"{where}: effect {cls.__name__}"
    if not isinstance(cls.name, str) or not cls.name.isidentifier():
        raise InputError(f"{start}: name: found {cls.name!r}; letters, digits and _ are expected.")
    if not isinstance(cls.parameters, tuple) or not all(isinstance(q, Parameter) for q in cls.parameters):
        raise InputError(f"{start}: parameters: found {cls.parameters!r}; a tuple of Parameter is expected.")
    if cls.interpolates_rates and cls.imu is Effect.imu:
        raise InputError(f"{start}: interpolates_rates: the hook imu is expected, of which corrected is the inverse.")
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
        return validated_class(cls)()
    except Exception as error:
        raise InputError(f"{start}: raised {last_line(error)} when it was made.") from error
