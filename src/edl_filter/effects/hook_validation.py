"""Validation of the hooks of users' effects: an error in a hook, or a wrong return value, is an `InputError`.

The message names the effect and the hook, so that its author needs no traceback through this package.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from edl_filter.effects.base import Effect
from edl_filter.effects.types import AeroCoefficients, Body
from edl_filter.errors import InputError


class _InvalidValueError(Exception):
    """The value that a hook returned is invalid; the message has the actual and the expected value."""


def validated_class(cls: type[Effect]) -> type[Effect]:
    """A subclass of `cls` whose overridden hooks raise `InputError` for every error in them.

    The message names the effect, the hook, the line of the user's file and the exception; or the actual and the
    expected shape.
    """
    hooks = {hook: _wrapped(cls, hook, check) for hook, check in _CHECKS.items() if cls().acts(hook)}
    own = {"__module__": cls.__module__, "__doc__": cls.__doc__, "validated": True}
    return type(cls.__name__, (cls,), hooks | own)


def _wrapped(cls: type[Effect], hook: str, check: Callable[..., None]) -> Callable[..., Any]:
    """The hook of `cls` with its exceptions turned into `InputError` and its return value checked."""
    inner = getattr(cls, hook)

    def call(self: Effect, p: Any, *arguments: Any) -> Any:
        try:
            value = inner(self, p, *arguments)
        except InputError:  # from a hook that this one calls
            raise
        except Exception as error:
            raise InputError(
                f"effect {cls.name!r}: its hook {hook} raised {last_line(error, inner.__code__.co_filename)}."
            ) from error
        try:
            check(value, *arguments)
        except _InvalidValueError as error:
            raise InputError(f"effect {cls.name!r}: its hook {hook} gave {error}.") from None
        return value

    call.__name__, call.__doc__ = hook, inner.__doc__
    return call


def last_line(error: BaseException, file: str = "") -> str:
    """Last line of the traceback with file and line: the last frame in `file` if there is one, else the last frame."""
    text = traceback.format_exception_only(error)[-1].strip().rstrip(".")
    all_frames = list(traceback.extract_tb(error.__traceback__))
    frames = [f for f in all_frames if f.filename == file] or all_frames
    return f"{text} ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else text


def _array(value: Any, shape: tuple[int, ...], what: str = "") -> None:
    what = f" for {what}" if what else ""
    if not isinstance(value, np.ndarray) or not np.issubdtype(value.dtype, np.number):
        raise _InvalidValueError(f"{type(value).__name__}{what}; expected an array of shape {shape}")
    if value.shape != shape:
        raise _InvalidValueError(f"an array of shape {value.shape}{what}; expected {shape}")


def _finite(value: Any, what: str = "") -> None:
    if not np.all(np.isfinite(value)):
        what = f" for {what}" if what else ""
        raise _InvalidValueError(
            f"{int(np.sum(~np.isfinite(value)))} values that are not finite{what}; expected finite numbers"
        )


def _full(value: Any, shape: tuple[int, ...], what: str = "") -> None:
    _array(value, shape, what)
    _finite(value, what)


def _pair(values: Any, names: tuple[str, str], n: int) -> None:
    if not isinstance(values, tuple) or len(values) != 2:
        raise _InvalidValueError(f"{type(values).__name__}; expected a tuple of {names[0]} and {names[1]}")
    for value, name in zip(values, names, strict=True):
        _array(value, (n, 3), name)


def _readings(values: Any, time: Any, force: Any, rate: Any) -> None:
    _pair(values, ("force", "rate"), len(time))
    for value, name, argument in zip(values, ("force", "rate"), (force, rate), strict=True):
        _finite(value[np.isfinite(argument)], name)  # samples that are NaN may stay NaN


def _force_moment(values: Any, flow: Any) -> None:
    _pair(values, ("force", "moment"), len(flow.time))
    _finite(values[0], "force")
    _finite(values[1], "moment")


def _totals(value: Any, flow: Any, totals: Any) -> None:
    if not isinstance(value, AeroCoefficients):
        raise _InvalidValueError(f"{type(value).__name__}; expected AeroCoefficients, as replace(totals, …) makes them")
    for field in fields(AeroCoefficients):
        _full(getattr(value, field.name), (len(flow.time),), field.name)


def _body(value: Any, body: Any) -> None:
    if not isinstance(value, Body):
        raise _InvalidValueError(f"{type(value).__name__}; expected a Body, as replace(body, …) makes one")
    _number(value.mass, "mass")
    if value.mass <= 0.0:
        raise _InvalidValueError(f"a mass of {value.mass:g} kg; expected a positive one")
    _full(value.inertia, (3, 3), "inertia")
    _full(value.offset, (3,), "offset")


def _planet(value: Any, planet: Any) -> None:
    if type(value) is not type(planet):
        raise _InvalidValueError(f"{type(value).__name__}; expected a Planet, as replace(planet, …) makes one")
    for name in ("mu", "j2", "gravity_radius"):
        _number(getattr(value, name), name)


def _initial(value: Any, initial: Any) -> None:
    if type(value) is not type(initial):
        raise _InvalidValueError(f"{type(value).__name__}; expected an InitialState, as replace(initial, …) makes one")
    for name, shape in (("position", (3,)), ("velocity", (3,)), ("inertial_from_body", (4,)), ("covariance", (9, 9))):
        _full(getattr(value, name), shape, name)


def _number(value: Any, what: str = "") -> None:
    if np.ndim(value) != 0 or not isinstance(value, (float, int, np.floating, np.integer)):
        raise _InvalidValueError(f"{type(value).__name__}{' for ' + what if what else ''}; expected one number")
    _finite(value, what)


#: Hook → check of its return value against its arguments.
_CHECKS: dict[str, Callable[..., None]] = {
    "imu": _readings,
    "corrected": _readings,
    "imu_position": lambda value: _full(value, (3,)),
    "gravity": _planet,
    "atmosphere_rate": _number,
    "wind": lambda value, altitude: _full(value, (len(altitude), 2)),
    "density": lambda value, altitude: _full(value, (len(altitude),)),
    "coefficients": _totals,
    "force_moment": _force_moment,
    "vehicle": _body,
    "entry_state": _initial,
}
