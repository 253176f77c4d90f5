"""YAML of a mission file to plain data, and changes of single keys that preserve the rest of the text.

In: text. Out: dicts, lists, text, numbers, true, false, null, according to YAML 1.2's core schema: ``1e13``
is a number, a date is text, ``yes`` is text. Keys are text and unique; anchors are refused.
Every error is an `InputError` that names file and line.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from edl_filter.errors import InputError
from edl_filter.io.yaml_guard import BoundedLoader, cannot_parse, check_size
from edl_filter.mission.shipped import BUILTIN


class _Loader(BoundedLoader):
    """PyYAML with the scalars of YAML 1.2, without repeated keys, anchors and more than `DEEPEST` levels."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise yaml.MarkedYAMLError(
                problem="anchors and aliases (& and *) are not used in mission files",
                problem_mark=event.start_mark,
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict:
        keys = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag != "tag:yaml.org,2002:str":
                name = getattr(key, "value", "a list or mapping")
                raise yaml.MarkedYAMLError(problem=f"key {name!r} is no text", problem_mark=key.start_mark)
            if key.value in keys:
                raise yaml.MarkedYAMLError(problem=f"key '{key.value}' stands twice", problem_mark=key.start_mark)
            keys.add(key.value)
        return super().construct_mapping(node, deep=True)


def _integer(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    text = loader.construct_scalar(node)
    base = {"0o": 8, "0x": 16}.get(text[:2], 10)
    return int(text[2:] if base != 10 else text, base)


def _float(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> float:
    return float(re.sub(r"\.(inf|nan)$", r"\1", loader.construct_scalar(node).lower()))


# Without the implicit scalars of YAML 1.1, which PyYAML stores on the class
_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    ("float", r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?", "-+.0123456789"),
    ("float", r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)", "-+."),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), list(_first))
_Loader.add_constructor("tag:yaml.org,2002:int", _integer)
_Loader.add_constructor("tag:yaml.org,2002:float", _float)


def _yaml_error(label: str, error: yaml.YAMLError) -> InputError:
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    line = f"line {mark.line + 1}: " if mark is not None else ""
    reason = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error)
    return InputError(f"{label}: {line}{reason}; YAML is expected.")


def parse(text: str, label: str) -> Any:
    """Return the data of YAML `text`.

    Raises
    ------
    InputError
        `text` is not YAML, repeats a key or uses an anchor; the message begins with `label`.
    """
    check_size(text, label)
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise _yaml_error(label, error) from None
    except (RecursionError, ValueError) as error:
        raise cannot_parse(label, error) from None


def compose(text: str, label: str) -> yaml.Node | None:
    """Return the tree of YAML nodes of `text` with their positions in it; None where it is empty.

    Raises
    ------
    InputError
        As `parse`.
    """
    check_size(text, label)
    try:
        loader = _Loader(text)
    except yaml.YAMLError as error:
        raise _yaml_error(label, error) from None
    try:
        return loader.get_single_node()
    except yaml.YAMLError as error:
        raise _yaml_error(label, error) from None
    except (RecursionError, ValueError) as error:
        raise cannot_parse(label, error) from None
    finally:
        loader.dispose()


def read_text(path: Path) -> str:
    """Return the text of the mission file at `path`.

    Raises
    ------
    InputError
        The file does not exist, or is not UTF-8 text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is no UTF-8 text; YAML is expected.") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: {reason}; the path of a mission file is expected.") from None


def parse_override(override: str, path_keys: tuple[str, ...] = ()) -> tuple[str, Any]:
    """Return dotted key and value of ``KEY=VALUE``; the value is parsed as YAML.

    Parameters
    ----------
    override : str
        ``KEY=VALUE``.
    path_keys : tuple of str
        Dotted keys that name files, ``*`` for every index of a list: their relative paths start from the current
        folder, also within a section or a list that is the value.

    Raises
    ------
    InputError
        ``=`` is missing, a part of the key is empty, or the value is not YAML.
    """
    key, equals, value = override.partition("=")
    key = key.strip()
    if not equals or not all(key.split(".")):
        raise InputError(f"--set {override}: found no KEY=VALUE; expected for example planet.gravity.j2=0.")
    return key, _with_absolute_paths(key, parse(value, f"--set {key}"), path_keys)


def _with_absolute_paths(key: str, value: Any, path_keys: tuple[str, ...]) -> Any:
    if isinstance(value, dict):
        return {k: _with_absolute_paths(f"{key}.{k}", v, path_keys) for k, v in value.items()}
    if isinstance(value, list):
        return [_with_absolute_paths(f"{key}.{i}", v, path_keys) for i, v in enumerate(value)]
    is_path = isinstance(value, str) and re.sub(r"\.\d+(?=\.|$)", ".*", key) in path_keys
    return str(Path(value).expanduser().absolute()) if is_path and not value.startswith(BUILTIN) else value


def apply_overrides(
    text: str, label: str, overrides: Sequence[str], path_keys: tuple[str, ...] = ()
) -> tuple[str, list[str]]:
    """Return a file's text after ``KEY=VALUE`` changes, and the dotted keys that were changed.

    Parameters
    ----------
    text : str
        YAML.
    label : str
        Name of the file in error messages.
    overrides : sequence of str
        ``KEY=VALUE`` each.
    path_keys : tuple of str
        As in `parse_override`.
    """
    changed = []
    for override in overrides:
        key, value = parse_override(override, path_keys)
        text = set_key(text, key, value, label)
        changed.append(key)
    return text, changed


def set_key(text: str, key: str, value: Any, label: str = "mission") -> str:
    """Return `text` with the value at the dotted `key` changed or added; comments elsewhere are preserved.

    A number in the key is an index of a list, from 0: ``effects.0.fixed``.

    Raises
    ------
    InputError
        `text` is not YAML (the message begins with `label`); a part of `key` before the last names a value, not a
        section; or a list has no element of that index.
    """
    new = flow_text(value)
    node = compose(text, label)
    parts = key.split(".")
    if node is None:
        raise InputError(f"--set {key}: the file is empty.")
    for i, part in enumerate(parts):
        if isinstance(node, yaml.SequenceNode) and part.isdecimal():
            if int(part) >= len(node.value):
                parent = ".".join(parts[:i])
                raise InputError(f"--set {key}: {parent} has {len(node.value)} entries; the first is {parent}.0.")
            node = node.value[int(part)]
            continue
        if not isinstance(node, yaml.MappingNode):
            if node.tag != "tag:yaml.org,2002:null":
                parent = ".".join(parts[:i]) or "the file"
                raise InputError(f"--set {key}: {parent} is no section, no key can be below it.")
            return _replace(text, node, _nested(parts[i:], new))
        children = {k.value: v for k, v in node.value}
        if part not in children:
            return _insert(text, node, part, _nested(parts[i + 1 :], new))
        node = children[part]
    return _replace(text, node, new)


def flow_text(value: Any, indent: str = "") -> str:
    """Return `value` as JSON, which is valid YAML; infinite numbers and NaN, which JSON lacks, as in YAML.

    The text is on one line, or has one line per entry if `indent` is not empty.
    """
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0.0 else "-.inf"
    if isinstance(value, dict):
        parts = [f"{json.dumps(str(k), ensure_ascii=False)}: {flow_text(v, indent)}" for k, v in value.items()]
    elif isinstance(value, (list, tuple)):
        parts = [flow_text(v, indent) for v in value]
    else:
        return json.dumps(value, ensure_ascii=False)
    start, end = "{}" if isinstance(value, dict) else "[]"
    if not parts or not indent:
        return start + ", ".join(parts) + end
    body = ",\n".join(parts).replace("\n", "\n" + indent)
    return f"{start}\n{indent}{body}\n{end}"


def _nested(parts: list[str], new: str) -> str:
    for part in reversed(parts):
        new = f"{{{json.dumps(part, ensure_ascii=False)}: {new}}}"
    return new


def _insert(text: str, mapping: yaml.MappingNode, key: str, new: str) -> str:
    """Insert a key before the first key of `mapping`."""
    if not mapping.value:
        return _replace(text, mapping, _nested([key], new))
    first = mapping.value[0][0].start_mark
    separator = ", " if mapping.flow_style else "\n" + " " * first.column
    return f"{text[: first.index]}{json.dumps(key, ensure_ascii=False)}: {new}{separator}{text[first.index :]}"


def _replace(text: str, node: yaml.Node, new: str) -> str:
    start, end = node.start_mark.index, node.end_mark.index
    if start == end:  # the value was empty: "key:" needs a space before a value
        return f"{text[:start]} {new}{text[end:]}"
    block = not getattr(node, "flow_style", True) or getattr(node, "style", None) in ("|", ">")
    if block:  # the end of a block node is the beginning of the next key
        end -= node.end_mark.column
        new = f" {new}\n"  # indented by one column more than a list that starts in the column of its key
    return text[:start] + new + text[end:]
