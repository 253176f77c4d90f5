"""A guard about users' effects: a hook that raises or gives the wrong thing is told by name, not by a traceback."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from edl_filter.effects.effect import Body, Effect, Totals
from edl_filter.errors import InputError

_TOTALS = ("ca", "cn", "cm_nose", "cl", "cmq")


class _WrongError(Exception):
    """What a hook gave is not what it must give; the message says both."""


def guarded(cls: type[Effect]) -> type[Effect]:
    """A class like `cls` whose hooks, as far as it overrides them, raise `InputError` for whatever goes wrong in them.

    The message names the effect, the hook, the line of the user's file and what was raised; or the shape that was found
    and the one that is expected.
    """
    hooks = {hook: _wrapped(cls, hook, check) for hook, check in _CHECKS.items() if cls().acts(hook)}
    return type(cls.__name__, (cls,), {**hooks, "__module__": cls.__module__, "__doc__": cls.__doc__, "guarded": True})


def _wrapped(cls: type[Effect], hook: str, check: Callable[..., None]) -> Callable[..., Any]:
    inner = getattr(cls, hook)

    def call(self: Effect, p: Any, *arguments: Any) -> Any:
        try:
            found = inner(self, p, *arguments)
        except InputError:  # from a hook that this one calls
            raise
        except Exception as error:
            raise InputError(
                f"effect {cls.name!r}: its hook {hook} raised {last_line(error, inner.__code__.co_filename)}."
            ) from error
        try:
            check(found, *arguments)
        except _WrongError as wrong:
            raise InputError(f"effect {cls.name!r}: its hook {hook} gave {wrong}.") from None
        return found

    call.__name__, call.__doc__ = hook, inner.__doc__
    return call


def last_line(error: BaseException, file: str = "") -> str:
    """The traceback's last line, and where it comes from: the last place in `file`, if it came through there."""
    told = traceback.format_exception_only(error)[-1].strip().rstrip(".")
    all_frames = list(traceback.extract_tb(error.__traceback__))
    frames = [f for f in all_frames if f.filename == file] or all_frames
    return f"{told} ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else told


def _array(value: Any, shape: tuple[int, ...], what: str = "") -> None:
    what = f" for {what}" if what else ""
    if not isinstance(value, np.ndarray) or not np.issubdtype(value.dtype, np.number):
        raise _WrongError(f"{type(value).__name__}{what}; expected an array of shape {shape}")
    if value.shape != shape:
        raise _WrongError(f"an array of shape {value.shape}{what}; expected {shape}")


def _finite(value: Any, what: str = "") -> None:
    if not np.all(np.isfinite(value)):
        what = f" for {what}" if what else ""
        raise _WrongError(
            f"{int(np.sum(~np.isfinite(value)))} values that are not finite{what}; expected finite numbers"
        )


def _full(value: Any, shape: tuple[int, ...], what: str = "") -> None:
    _array(value, shape, what)
    _finite(value, what)


def _pair(found: Any, names: tuple[str, str], n: int) -> None:
    if not isinstance(found, tuple) or len(found) != 2:
        raise _WrongError(f"{type(found).__name__}; expected a tuple of {names[0]} and {names[1]}")
    for value, name in zip(found, names, strict=True):
        _array(value, (n, 3), name)


def _readings(found: Any, time: Any, force: Any, rate: Any) -> None:
    _pair(found, ("force", "rate"), len(time))
    for value, name, given in zip(found, ("force", "rate"), (force, rate), strict=True):
        _finite(value[np.isfinite(given)], name)  # what was unknown may stay so


def _force_moment(found: Any, flow: Any) -> None:
    _pair(found, ("force", "moment"), len(flow.time))
    _finite(found[0], "force")
    _finite(found[1], "moment")


def _totals(found: Any, flow: Any, totals: Any) -> None:
    if not isinstance(found, Totals):
        raise _WrongError(f"{type(found).__name__}; expected Totals, as replace(totals, …) makes them")
    for name in _TOTALS:
        _full(getattr(found, name), (len(flow.time),), name)


def _body(found: Any, body: Any) -> None:
    if not isinstance(found, Body):
        raise _WrongError(f"{type(found).__name__}; expected a Body, as replace(body, …) makes one")
    _number(found.mass, "mass")
    if found.mass <= 0.0:
        raise _WrongError(f"a mass of {found.mass:g} kg; expected a positive one")
    _full(found.inertia, (3, 3), "inertia")
    _full(found.offset, (3,), "offset")


def _planet(found: Any, planet: Any) -> None:
    if type(found) is not type(planet):
        raise _WrongError(f"{type(found).__name__}; expected a Planet, as replace(planet, …) makes one")
    for name in ("mu", "j2", "gravity_radius"):
        _number(getattr(found, name), name)


def _initial(found: Any, initial: Any) -> None:
    if type(found) is not type(initial):
        raise _WrongError(f"{type(found).__name__}; expected an InitialState, as replace(initial, …) makes one")
    for name, shape in (("position", (3,)), ("velocity", (3,)), ("inertial_from_body", (4,)), ("covariance", (9, 9))):
        _full(getattr(found, name), shape, name)


def _number(found: Any, what: str = "") -> None:
    if np.ndim(found) != 0 or not isinstance(found, (float, int, np.floating, np.integer)):
        raise _WrongError(f"{type(found).__name__}{' for ' + what if what else ''}; expected one number")
    _finite(found, what)


#: Hook → what it must give, checked against its arguments.
_CHECKS: dict[str, Callable[..., None]] = {
    "imu": _readings,
    "corrected": _readings,
    "imu_position": lambda found: _full(found, (3,)),
    "gravity": _planet,
    "atmosphere_rate": _number,
    "wind": lambda found, altitude: _full(found, (len(altitude), 2)),
    "density": lambda found, altitude: _full(found, (len(altitude),)),
    "coefficients": _totals,
    "force_moment": _force_moment,
    "vehicle": _body,
    "entry_state": _initial,
}
