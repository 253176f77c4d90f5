"""Every key of a mission or scenario file, from the models that check it: value, unit and range, default, meaning."""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from edl_filter.mission.validators import Within

#: Placeholder between the key of a mapping or list of sections and the keys of one section.
NAMED, LISTED = "NAME", "N"
_PLAIN = {float: "number", int: "whole number", str: "text", bool: "true or false"}


@dataclass(frozen=True)
class Part:
    """A section of the file.

    Attributes
    ----------
    path : str
        Dotted key.
    model : type
        Model that checks it.
    form : str
        The value that selects this form among several of the same key; empty if there is only one.
    """

    path: str
    model: type[BaseModel]
    form: str = ""


def keys_text(model: type[BaseModel]) -> str:
    """Markdown of all sections of `model`: a heading and a table each."""
    return "\n\n".join(_section_text(part) for part in parts(Part("", model)))


def parts(part: Part) -> Iterator[Part]:
    """`part` and all parts below it, in the file's order."""
    yield part
    for key, field in part.model.model_fields.items():
        path = ".".join(filter(None, (part.path, field.alias or key)))
        below = list(_models(field.annotation, path))
        for where, model in below:
            yield from parts(Part(where, model, _form(model) if len(below) > 1 else ""))


def _models(annotation: Any, path: str) -> Iterator[tuple[str, type[BaseModel]]]:
    """Models in an annotation, each with its dotted key."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield path, annotation
        return
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        yield from _models(args[0], path)
    elif origin is dict:
        yield from _models(args[1], f"{path}.{NAMED}")
    elif origin is tuple and args[-1] is Ellipsis:
        yield from _models(args[0], f"{path}.{LISTED}")
    elif origin in (Union, types.UnionType):
        for each in args:
            yield from _models(each, path)


def _form(model: type[BaseModel]) -> str:
    """The key that selects this form, such as ``format: mer-imu``; otherwise a text that the values are stated."""
    for key, field in model.model_fields.items():
        if get_origin(field.annotation) is Literal and key in ("format", "from_"):
            return f"{field.alias or key}: {get_args(field.annotation)[0]}"
    return getattr(model, "form", "stated in the file")


def _section_text(part: Part) -> str:
    title = f"`{part.path}`" if part.path else "At the top of the file"
    if part.form:
        title += f" ({part.form})"
    intro = "" if not part.path else (part.model.__doc__ or "").strip().split("\n\n")[0] + "\n\n"
    rows = ["| key | value | default | what it is |", "|---|---|---|---|"]
    for key, field in part.model.model_fields.items():
        value = kind(field.annotation, field.metadata)
        cells = (f"`{field.alias or key}`", value, _default(field), field.description or "")
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return f"## {title}\n\n{intro}" + "\n".join(rows)


def kind(annotation: Any, metadata: Any = ()) -> str:
    """Accepted values of an annotation as text: kind, unit and range; a range in `metadata` replaces the type."""
    ranges = [m.expected for m in metadata if isinstance(m, Within)]
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return kind(args[0], (*metadata, *args[1:]))
    if origin in (Union, types.UnionType):
        kinds = [kind(each, metadata) for each in args if each is not type(None)]
        return ", or ".join(dict.fromkeys(filter(None, kinds)))
    if origin is Literal:
        return " or ".join(f"`{each}`" for each in args)
    if origin is tuple:
        return _tuple(args, ranges)
    if origin is dict:
        return f"mapping from name to {kind(args[1]) or 'section'}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "section"
    if ranges:
        return ranges[0]
    return _PLAIN.get(annotation, "") + _bounds(metadata)


def _tuple(args: tuple[Any, ...], ranges: list[str]) -> str:
    if args[-1] is Ellipsis:
        inner = kind(args[0])
        return "rows of numbers" if inner.startswith("list") else f"list of {inner}s"
    if get_origin(args[0]) is tuple or (get_origin(args[0]) is Annotated and get_origin(get_args(args[0])[0]) is tuple):
        return f"{len(args)} rows of {len(get_args(args[0]))} numbers"
    inner = kind(args[0])
    size = f", its length {ranges[0]}" if ranges else "" if inner == "number" else f", each {inner}"
    return f"list of {len(args)} numbers{size}"


def _bounds(metadata: Any) -> str:
    """Bounds of a whole number."""
    low = next((m.ge for m in metadata if hasattr(m, "ge")), None)
    high = next((m.le for m in metadata if hasattr(m, "le")), None)
    if low is None:
        return ""
    return f", at least {low}" if high is None else f", {low} to {high}"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return "all its defaults"
    if value is None:
        return "absent"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if value in ("", (), {}):
        return "empty"
    return f"`{list(value) if isinstance(value, tuple) else value}`"
