"""Data of a file as a model, and its errors as one message: file, key, what was found, what is expected."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from edl_filter.errors import InputError
from edl_filter.mission.validators import value_text

ModelT = TypeVar("ModelT", bound=BaseModel)

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


def validated(model: type[ModelT], data: Any, label: str, changed: Sequence[str] = ()) -> ModelT:
    """Model of the data of a file.

    Parameters
    ----------
    model : type
        Model of the whole file.
    data : Any
        Plain data in the file's form.
    label, changed
        As in `error_message`.

    Raises
    ------
    InputError
        The data is no mapping, or a key is unknown, missing or wrong.
    """
    check_mapping(model, data, label)
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(error_message(error, model, label, changed)) from None


def check_mapping(model: type[BaseModel], data: Any, label: str) -> None:
    """Raise InputError, which begins with `label`, if the data of a file of a `model` is no mapping of keys."""
    if not isinstance(data, dict):
        actual = {list: "a list", type(None): "nothing"}.get(type(data), value_text(data))
        example = f"name: my_{model.__name__.lower()}"
        raise InputError(f"{label}: found {actual}; expected a mapping of keys, such as '{example}'.")


@cache
def key_descriptions(model: type[BaseModel]) -> dict[str, str]:
    """Every dotted key below `model` with its description.

    ``*`` represents a name that the file chooses, or an index of a list.
    """
    descriptions: dict[str, str] = {}
    for key, description in _walk(model, ""):
        descriptions.setdefault(key, description)  # of several forms the first in the schema
    return descriptions


def _walk(model: type[BaseModel], prefix: str) -> Iterator[tuple[str, str]]:
    for name, field in model.model_fields.items():
        key = prefix + (field.alias or name)
        yield key, field.description or ""
        for submodel, in_collection in _submodels(field.annotation):
            yield from _walk(submodel, f"{key}.*." if in_collection else f"{key}.")


def _submodels(annotation: Any, in_collection: bool = False) -> Iterator[tuple[type[BaseModel], bool]]:
    """Models in an annotation, each with whether it is an element of a dict or tuple."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, in_collection
    for argument in get_args(annotation):
        yield from _submodels(argument, in_collection or get_origin(annotation) in (dict, tuple))


def error_message(error: ValidationError, model: type[BaseModel], label: str, changed: Sequence[str] = ()) -> str:
    """Message of the first problem in `error`, with the number of further problems.

    Parameters
    ----------
    error : ValidationError
        Error of pydantic.
    model : type
        Model of the whole file.
    label : str
        Name of the file in the message.
    changed : sequence of str
        Dotted keys that were changed with --set; the message of a problem at one of them names it in place of the
        file.
    """
    first, *further = error_messages(error, model, label, changed)
    more = len(further)
    return first + (f" (and {more} more problem{'s' if more > 1 else ''})" if more else "")


def error_messages(
    error: ValidationError, model: type[BaseModel], label: str, changed: Sequence[str] = ()
) -> list[str]:
    """Messages of all problems in `error`; parameters as in `error_message`."""
    # An unknown key often explains a missing one, so it comes first
    details = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    return [problem_message(dict(detail), model, label, changed) for detail in details]


def problem_message(detail: dict[str, Any], model: type[BaseModel], label: str, changed: Sequence[str] = ()) -> str:
    """Message of one problem, `detail`, of a validation; other parameters as in `error_message`."""
    key = _dotted_key(detail)
    start = f"{label}: {key}"
    for change in changed:
        if key == change or key.startswith(change + "."):
            start = f"--set {key}"
        elif change.startswith(key + ".") and detail["type"] == "extra_forbidden":
            start = f"--set {change}: {key}"
    return f"{start}: {_message(detail, key, model)}"


def _dotted_key(detail: Any) -> str:
    parts = [str(p) for p in detail["loc"] if not str(p).startswith("<")]
    if detail["type"] == "missing" and isinstance(detail["loc"][-1], int):
        parts.pop()  # a list that is too short: the error is reported for the list
    subkey = detail.get("ctx", {}).get("key", "") if detail["type"] == "mission" else ""
    return ".".join(parts + ([subkey] if subkey else []))


def _message(detail: dict[str, Any], key: str, model: type[BaseModel]) -> str:
    kind, context, value = detail["type"], detail.get("ctx", {}), detail["input"]
    if kind == "mission":
        return f"found {context['actual']}; expected {context['expected']}"
    if kind == "extra_forbidden":
        return f"found an unknown key; {_nearest(key, model)}"
    description = _description(key, model)
    description = f" ({description})" if description else ""
    if kind == "missing" and isinstance(value, (list, tuple)):
        return f"found {value_text(value)}; expected more entries{description}"
    if kind == "missing":
        return f"found nothing; expected a required key{description}"
    if kind == "union_tag_invalid":
        return _tag_message(value, context)
    expected = _EXPECTED.get(kind)
    if kind in ("too_long", "too_short"):
        expected = f"{context.get('min_length', context.get('max_length'))} entries"
    elif kind == "literal_error":
        expected = context["expected"]
    elif kind == "string_pattern_mismatch":
        expected = "letters, digits, _ and - only"
    type_hint = " (text)" if isinstance(value, str) and kind == "float_type" else ""
    actual = "nothing" if value is None else value_text(value)
    return f"found {actual}{type_hint}; expected {expected or detail['msg']}{description}"


def _tag_message(value: Any, context: dict[str, Any]) -> str:
    accepted = context["expected_tags"].replace("<", "").replace(">", "").replace("'", "")
    if not isinstance(value, dict):
        return f"found {value_text(value)}; expected a section of keys"
    if "format" not in value:
        return f"found no key format; expected format: one of {accepted}"
    return f"found format: {value_text(value['format'])}; expected one of {accepted}"


def _expand(pattern: str, key: str) -> str | None:
    """`pattern` with each ``*`` replaced by the part of `key` at its position; None if the depths differ."""
    p, k = pattern.split("."), key.split(".")
    return ".".join(b if a == "*" else a for a, b in zip(p, k, strict=True)) if len(p) == len(k) else None


def _description(key: str, model: type[BaseModel]) -> str:
    descriptions = key_descriptions(model)
    while key:
        for pattern, text in descriptions.items():
            if _expand(pattern, key) == key:
                return text
        section, _, last = key.rpartition(".")
        key = section if last.isdigit() else ""  # an element of a list is described by the list's key
    return ""


def _nearest(key: str, model: type[BaseModel]) -> str:
    """Name the nearest accepted key: in the same section if one is similar, otherwise in any section."""
    section, _, last = key.rpartition(".")
    accepted = [_expand(k, key) or k for k in key_descriptions(model) if not k.endswith("*")]
    siblings = sorted({k.rpartition(".")[2] for k in accepted if k.rpartition(".")[0] == section})
    similar = difflib.get_close_matches(last, siblings, 1, 0.5)
    if similar:
        return "nearest accepted: " + (f"{section}.{similar[0]}" if section else similar[0])
    # An accepted key in the wrong section, or a section that is itself misspelt
    candidates = [k for k in accepted if k.rpartition(".")[2] == last]
    if not candidates and not (section and siblings):
        candidates = difflib.get_close_matches(key, accepted, 1, 0.7)
    if candidates:
        return f"nearest accepted: {candidates[0]}"
    return "accepted here: " + ", ".join(siblings)
