"""Pydantic's errors as one message that a person can act on: file, key, what was found, what is expected."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from edl_filter.mission.checks import shown

_EXPECTED = {
    "bool_type": "true or false",
    "dict_type": "a section of keys",
    "finite_number": "a finite number",
    "float_type": "a number",
    "model_attributes_type": "a section of keys",
    "model_type": "a section of keys",
    "string_type": "text",
    "tuple_type": "a list",
}


@cache
def keys(model: type[BaseModel]) -> dict[str, str]:
    """Every dotted key below `model` with its description.

    ``*`` stands for names that the file chooses, or places in a list.
    """
    found: dict[str, str] = {}
    for key, description in _walk(model, ""):
        found.setdefault(key, description)  # of several forms the first in the schema
    return found


def _walk(model: type[BaseModel], above: str) -> Iterator[tuple[str, str]]:
    for name, field in model.model_fields.items():
        key = above + (field.alias or name)
        yield key, field.description or ""
        for below, star in _models(field.annotation):
            yield from _walk(below, f"{key}.*." if star else f"{key}.")


def _models(annotation: Any, star: bool = False) -> Iterator[tuple[type[BaseModel], bool]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, star
    for part in get_args(annotation):
        yield from _models(part, star or get_origin(annotation) in (dict, tuple))


def describe(error: ValidationError, model: type[BaseModel], where: str, changed: Sequence[str] = ()) -> str:
    """Message of the first problem in `error`, and how many more there are.

    Parameters
    ----------
    error : ValidationError
    model : type
        Model of the whole file.
    where : str
        The file, as the message names it.
    changed : sequence of str
        Dotted keys that came from --set; a problem at one of them names it in place of the file.
    """
    # An unknown key explains a missing one, so it comes first
    details = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    key = _key(details[0])
    message = _message(dict(details[0]), key, model)
    start = f"{where}: {key}"
    for change in changed:
        if key == change or key.startswith(change + "."):
            start = f"--set {key}"
        elif change.startswith(key + ".") and details[0]["type"] == "extra_forbidden":
            start = f"--set {change}: {key}"
    more = len(details) - 1
    tail = f" (and {more} more problem{'s' if more > 1 else ''})" if more else ""
    return f"{start}: {message}{tail}"


def _key(detail: Any) -> str:
    parts = [str(p) for p in detail["loc"] if not str(p).startswith("<")]
    if detail["type"] == "missing" and isinstance(detail["loc"][-1], int):
        parts.pop()  # a list too short: told of the list
    below = detail.get("ctx", {}).get("key", "") if detail["type"] == "mission" else ""
    return ".".join(parts + ([below] if below else []))


def _message(detail: dict[str, Any], key: str, model: type[BaseModel]) -> str:
    kind, context, value = detail["type"], detail.get("ctx", {}), detail["input"]
    if kind == "mission":
        return f"found {context['found']}; expected {context['expected']}"
    if kind == "extra_forbidden":
        return f"found an unknown key; {_nearest(key, model)}"
    about = _description(key, model)
    about = f" ({about})" if about else ""
    if kind == "missing" and isinstance(value, (list, tuple)):
        return f"found {shown(value)}; expected more entries{about}"
    if kind == "missing":
        return f"found nothing; expected a required key{about}"
    if kind == "union_tag_invalid":
        return _tag_message(value, context)
    expected = _EXPECTED.get(kind)
    if kind in ("too_long", "too_short"):
        expected = f"{context.get('min_length', context.get('max_length'))} entries"
    elif kind == "literal_error":
        expected = context["expected"]
    elif kind == "string_pattern_mismatch":
        expected = "letters, digits, _ and - only"
    text = " (text)" if isinstance(value, str) and kind == "float_type" else ""
    return f"found {shown(value)}{text}; expected {expected or detail['msg']}{about}"


def _tag_message(value: Any, context: dict[str, Any]) -> str:
    accepted = context["expected_tags"].replace("<", "").replace(">", "").replace("'", "")
    if not isinstance(value, dict):
        return f"found {shown(value)}; expected a section of keys"
    if "format" not in value:
        return f"found no key format; expected format: one of {accepted}"
    return f"found format: {shown(value['format'])}; expected one of {accepted}"


def _fits(pattern: str, key: str) -> str | None:
    """`pattern` with its stars filled from `key`, if both are equally deep."""
    p, k = pattern.split("."), key.split(".")
    return ".".join(b if a == "*" else a for a, b in zip(p, k, strict=True)) if len(p) == len(k) else None


def _description(key: str, model: type[BaseModel]) -> str:
    known = keys(model)
    while key:
        for pattern, text in known.items():
            if _fits(pattern, key) == key:
                return text
        head, _, last = key.rpartition(".")
        key = head if last.isdigit() else ""  # an element of a list is described by the list's key
    return ""


def _nearest(key: str, model: type[BaseModel]) -> str:
    """Name the nearest accepted key: in the same section if one is alike, anywhere else if not."""
    head, _, last = key.rpartition(".")
    filled = [_fits(k, key) or k for k in keys(model) if not k.endswith("*")]
    beside = sorted({k.rpartition(".")[2] for k in filled if k.rpartition(".")[0] == head})
    alike = difflib.get_close_matches(last, beside, 1, 0.5)
    if alike:
        return "nearest accepted: " + (f"{head}.{alike[0]}" if head else alike[0])
    # A known key in the wrong section, or a section that is itself misspelt
    elsewhere = [k for k in filled if k.rpartition(".")[2] == last]
    if not elsewhere and not (head and beside):
        elsewhere = difflib.get_close_matches(key, filled, 1, 0.7)
    if elsewhere:
        return f"nearest accepted: {elsewhere[0]}"
    return "accepted here: " + ", ".join(beside)
