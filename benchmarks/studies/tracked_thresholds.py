"""Settings that record whether a run would go differently with another value.

A run is a function of its settings. `Variations` has the defaults and, for each variation, one setting with another
value. Every setting is a `TrackedThreshold`: its value in the run, and its values in the variations that are pending,
i.e. have given the same results so far. Arithmetic computes all of them. A comparison, or any other use, returns the
result of the run; a variation with a different result diverges there. A variation that never diverges gives the same
outcome as the run, bit for bit. One that diverges is handed to a function, which may continue it in a copy of the
process (`fork`): everything before the divergence is computed once for all variations. An array of comparisons is not
a use yet: what counts is what is made of it, such as whether all hold.

The class is no subclass of float: code that needs a float converts it, which is a use of the value. Code that accepts
neither raises an exception; `names_in` finds the settings that were refused, which are then read as plain numbers.
"""

from __future__ import annotations

import operator
import os
import sys
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

#: A variation: name of the setting, factor.
Key = tuple[str, float]


def fork(key: Key) -> bool:
    """Continue a variation in a copy of this process, wait for its end; whether this is the copy."""
    sys.stdout.flush()
    sys.stderr.flush()
    process = os.fork()
    if process:
        os.waitpid(process, 0)
    return process == 0


class Variations:
    """The variations of one run.

    Attributes
    ----------
    values : dict
        Variation → value of its setting.
    branch : callable
        Called with a variation where it diverges; returns whether this process continues with it.
    pending : set
        Variations that have not diverged.
    current : tuple or None
        The variation that this process computes; None: the defaults.
    """

    def __init__(self, values: dict[Key, Any], branch: Callable[[Key], bool] = lambda key: False) -> None:
        self.values, self.branch = dict(values), branch
        self.pending: set[Key] = set(values)
        self.current: Key | None = None

    def setting(self, name: str, default: Any) -> Any:
        """A setting: tracked while a variation of it is pending."""
        if self.current is not None:
            return self.values[self.current] if self.current[0] == name else default
        own = {key: value for key, value in self.values.items() if key[0] == name and key in self.pending}
        return TrackedThreshold(self, default, own) if own else default

    def diverge(self, key: Key) -> None:
        """A variation differs from here on."""
        if key in self.pending:
            self.pending.discard(key)
            if self.branch(key):
                self.current = key
                self.pending.clear()

    def evaluate(self, function: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
        """A function without side effects, in the run and in all pending variations."""
        tracked = [a for a in (*arguments, *keywords.values()) if isinstance(a, TrackedThreshold)]

        def value_at(key: Key | None) -> Any:
            return function(*(_at(a, key) for a in arguments), **{k: _at(a, key) for k, a in keywords.items()})

        try:
            result = value_at(self.current)
        except Exception:  # the exception is the result; a variation need not raise it
            for a in tracked:
                a.settled()
            return value_at(self.current)
        varied = {}
        for key in sorted({key for a in tracked for key in a.varied} & self.pending):
            try:
                value = value_at(key)
            except Exception:  # raised again in the branch, where it happens
                self.diverge(key)
                if self.current is not None:
                    return value_at(self.current)
                continue
            if not _same(value, result):
                varied[key] = value
        return TrackedThreshold(self, result, varied) if varied else result


class TrackedThreshold:
    """A number or array of a run, and its different values in pending variations."""

    def __init__(self, variations: Variations, default: Any, varied: dict[Key, Any]) -> None:
        self.variations, self.default, self.varied = variations, default, varied

    def settled(self) -> Any:
        """The plain value: all variations in which it differs diverge."""
        for key in sorted(self.varied):
            self.variations.diverge(key)
        return _at(self, self.variations.current)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **keywords: Any) -> Any:
        function = getattr(ufunc, method)
        if method != "__call__" or keywords.get("out") is not None:  # changes an array in place
            return function(*_all_settled(inputs), **_all_settled(keywords))
        return _without_truth(self.variations.evaluate(function, *inputs, **keywords))

    def __array_function__(self, function: Any, types: Any, arguments: Any, keywords: Any) -> Any:
        nested = any(isinstance(a, (list, tuple, dict)) for a in (*arguments, *keywords.values()))
        if nested or keywords.get("out") is not None:
            return function(*_all_settled(arguments), **_all_settled(keywords))
        return _without_truth(self.variations.evaluate(function, *arguments, **keywords))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.settled(), dtype)

    def __round__(self, digits: int | None = None) -> Any:
        return self.variations.evaluate(round, self, digits)

    def __repr__(self) -> str:
        return f"TrackedThreshold({self.default!r}, {self.varied!r})"

    def __format__(self, form: str) -> str:
        return format(self.settled(), form)

    def __getitem__(self, index: Any) -> Any:
        return self.settled()[index]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.settled(), name)


def tracked_range(*bounds: Any) -> Any:
    """`range` whose end is compared with the index before each iteration."""
    if not any(isinstance(b, TrackedThreshold) for b in bounds):
        return range(*bounds)
    begin, end = bounds if len(bounds) == 2 else (0, *bounds)

    def indices() -> Any:
        i = _settled(begin)
        while i < end:
            yield i
            i += 1

    return indices()


class TrackedSettings:
    """In place of settings: gives each field tracked, or settled where its name is in `plain`."""

    def __init__(self, variations: Variations, settings: Any, plain: Collection[str]) -> None:
        self._variations, self._plain = variations, plain
        self._values = {name: getattr(settings, name) for name in type(settings).model_fields}

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._values:
            raise AttributeError(name)
        value = self._variations.setting(name, self._values[name])
        return _settled(value) if name in self._plain else value

    def model_dump(self) -> dict[str, Any]:
        """All fields by name, tracked."""
        return {name: self._variations.setting(name, value) for name, value in self._values.items()}


def names_in(error: BaseException) -> set[str]:
    """Names of the settings that were local variables where an exception was raised, up to the call of the run."""
    names, trace = set(), error.__traceback__
    while trace is not None:
        for value in list(trace.tb_frame.f_locals.values()):
            members = value if isinstance(value, (list, tuple)) else value.values() if isinstance(value, dict) else ()
            fields = getattr(value, "__dict__", {}).values()
            for a in (value, *members, *fields):
                if isinstance(a, TrackedThreshold):
                    names |= {name for name, _ in a.varied}
        trace = trace.tb_next
    return names


def _at(value: Any, key: Key | None) -> Any:
    return value.varied.get(key, value.default) if isinstance(value, TrackedThreshold) else value


def _settled(value: Any) -> Any:
    return value.settled() if isinstance(value, TrackedThreshold) else value


def _without_truth(value: Any) -> Any:
    """Settled if it is true or false: callers may test such a result with ``is``."""
    truth = isinstance(value, TrackedThreshold) and isinstance(value.default, (bool, np.bool_))
    return value.settled() if truth else value


def _all_settled(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return type(value)(_all_settled(v) for v in value)
    if isinstance(value, dict):
        return {k: _all_settled(v) for k, v in value.items()}
    return _settled(value)


def _same(a: Any, b: Any) -> bool:
    """Whether two results are the same in type and value; NaN is never the same."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(_same, a, b))
    return bool(a == b)


def _define_operators() -> None:
    def arithmetic(function: Any) -> Any:
        return lambda self, operand: self.variations.evaluate(function, self, operand)

    def reflected(function: Any) -> Any:
        return lambda self, operand: self.variations.evaluate(function, operand, self)

    def comparison(function: Any) -> Any:
        return lambda self, operand: _without_truth(self.variations.evaluate(function, self, operand))

    def unary(function: Any) -> Any:
        return lambda self: self.variations.evaluate(function, self)

    def conversion(function: Any) -> Any:
        return lambda self: function(self.settled())

    for name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "and_", "or_", "xor"):
        function, name = getattr(operator, name), name.rstrip("_")
        setattr(TrackedThreshold, f"__{name}__", arithmetic(function))
        setattr(TrackedThreshold, f"__r{name}__", reflected(function))
    for name in ("lt", "le", "gt", "ge", "eq", "ne"):
        setattr(TrackedThreshold, f"__{name}__", comparison(getattr(operator, name)))
    for name in ("neg", "pos", "abs", "invert"):
        setattr(TrackedThreshold, f"__{name}__", unary(getattr(operator, name)))
    conversions = {"float": float, "int": int, "index": operator.index, "bool": bool, "complex": complex}
    for name, function in (conversions | {"hash": hash, "str": str, "len": len, "iter": iter}).items():
        setattr(TrackedThreshold, f"__{name}__", conversion(function))


_define_operators()
