"""How objects of lower layers are displayed and written by higher layers, without an import of a higher layer.

A method of a lower layer requests a form of its object (``"html"``, ``"plot"``, ``"save"``) from `render`. The root of
the package registers which function of a higher layer provides the form. The function is registered as
``"module:attribute"`` and imported when it is first called, so that registering imports nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

#: (form, "module.Class") → "module:function".
_RENDERERS: dict[tuple[str, str], str] = {}


def register(renderers: Mapping[tuple[str, str], str]) -> None:
    """Add renderers.

    Parameters
    ----------
    renderers : mapping
        ``(form, "module.Class")`` → ``"module:function"``; the object is the first argument of the function.
    """
    _RENDERERS.update(renderers)


def render(form: str, instance: object, *arguments: Any) -> Any:
    """Call the function that is registered for a form of an object.

    Parameters
    ----------
    form : str
        ``"html"``, ``"plot"`` or ``"save"``.
    instance : object
        Object to display or write; the function registered for a base class is used for its subclasses.
    *arguments
        Further arguments of the function.

    Raises
    ------
    LookupError
        No function is registered for the object's class.
    """
    for cls in type(instance).__mro__:
        target = _RENDERERS.get((form, f"{cls.__module__}.{cls.__qualname__}"))
        if target is not None:
            module, _, name = target.partition(":")
            return getattr(import_module(module), name)(instance, *arguments)
    raise LookupError(f"nothing is registered to make {form!r} of {type(instance).__qualname__}")
