"""Changes of a mission's text that go beyond the value of one key: an appended list entry, rebased relative paths.

Comments and layout of the rest of the text are preserved.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

from edl_filter.mission.shipped import BUILTIN
from edl_filter.mission.yaml_text import compose, parse, set_key


def append_entry(text: str, key: str, entry: dict[str, Any], lines: list[str], label: str) -> str:
    """Return `text` with an entry at the end of a list, which is created if it does not exist.

    Parameters
    ----------
    text : str
        Text of the mission file.
    key : str
        Top-level key of the list.
    entry : dict
        The entry as data: written into a list in brackets.
    lines : list of str
        The entry as lines of block YAML, the first without its dash: written into any other list.
    label : str
        Name of the file, in messages.

    Raises
    ------
    InputError
        `text` is not YAML.
    """
    root = compose(text, label)
    block = isinstance(root, yaml.MappingNode) and not root.flow_style
    children = {k.value: v for k, v in root.value} if isinstance(root, yaml.MappingNode) else {}
    node = children.get(key)
    if block and node is None:
        head = text if not text or text.endswith("\n") else text + "\n"
        return f"{head}\n{key}:\n{_indented(lines, 2)}"
    if isinstance(node, yaml.SequenceNode) and not node.flow_style:
        end = _next_line_start(text, _last_descendant(node))
        head = text[:end] if text[:end].endswith("\n") else text[:end] + "\n"
        return head + _indented(lines, node.start_mark.column) + text[end:]
    entries = parse(text, label).get(key) or []
    return set_key(text, key, [*entries, entry], label)


def remove_section(text: str, key: str, label: str) -> str:
    """Return `text` without a top-level section, the comments within it and the empty line before it.

    Parameters
    ----------
    text : str
        Text of the mission file, in block style.
    key : str
        Top-level key; a text without it is not changed.
    label : str
        Name of the file, in messages.
    """
    root = compose(text, label)
    if not isinstance(root, yaml.MappingNode) or root.flow_style:
        return text
    for name, value in root.value:
        if name.value == key:
            start, end = name.start_mark.index, _next_line_start(text, _last_descendant(value))
            return text[:start].removesuffix("\n\n") + ("\n" if text[:start].endswith("\n\n") else "") + text[end:]
    return text


def rebase_paths(text: str, keys: tuple[str, ...], old: Path, new: Path, label: str) -> str:
    """Return `text` with its relative paths, which start from folder `old`, changed to start from folder `new`.

    Parameters
    ----------
    text : str
        Text of the mission file.
    keys : tuple of str
        Dotted keys that name files, ``*`` for every index of a list.
    old, new : Path
        Folders.
    label : str
        Name of the file, in messages.
    """
    if old.resolve() == new.resolve():
        return text

    def rebased(path: Path) -> str | None:
        return None if path.is_absolute() else os.path.relpath((old / path).resolve(), new.resolve())

    return _with_paths(text, keys, rebased, label)


def shorten_paths(text: str, keys: tuple[str, ...], folder: Path, label: str) -> str:
    """Return `text` with absolute paths of files below `folder` changed to start from it; arguments as above."""

    def shortened(path: Path) -> str | None:
        below = path.is_absolute() and path.resolve().is_relative_to(folder.resolve())
        return str(path.resolve().relative_to(folder.resolve())) if below else None

    return _with_paths(text, keys, shortened, label)


def hide_folders(text: str, keys: tuple[str, ...], label: str) -> str:
    """Return `text` with absolute paths changed to the names of their files, to be shown to others; as above."""
    return _with_paths(text, keys, lambda path: path.name if path.is_absolute() else None, label)


def _with_paths(text: str, keys: tuple[str, ...], change: Callable[[Path], str | None], label: str) -> str:
    """Change the paths at `keys`, except ``builtin:`` and ``~``, to what `change` returns for them; None: unchanged."""
    root = compose(text, label)
    nodes = [n for key in keys for n in _scalars_at(root, key.split(".")) if n.tag == "tag:yaml.org,2002:str"]
    for node in sorted(nodes, key=lambda n: n.start_mark.index, reverse=True):
        changed = None if node.value.startswith((BUILTIN, "~")) else change(Path(node.value))
        if changed is not None:
            quoted = json.dumps(changed, ensure_ascii=False)
            text = text[: node.start_mark.index] + quoted + text[node.end_mark.index :]
    return text


def _scalars_at(node: yaml.Node | None, parts: list[str]) -> Iterator[yaml.ScalarNode]:
    """Scalars at a dotted key below `node`."""
    if isinstance(node, yaml.ScalarNode) and not parts:
        yield node
    elif isinstance(node, yaml.SequenceNode) and parts and parts[0] == "*":
        for child in node.value:
            yield from _scalars_at(child, parts[1:])
    elif isinstance(node, yaml.MappingNode) and parts:
        for key, child in node.value:
            if key.value == parts[0]:
                yield from _scalars_at(child, parts[1:])


def _last_descendant(node: yaml.Node) -> yaml.Node:
    """The last node within `node` whose end mark is the end of its own text, not the beginning of the next node."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _last_descendant(last[1] if isinstance(last, tuple) else last)
    return node


def _next_line_start(text: str, node: yaml.Node) -> int:
    """Index of the beginning of the line after the last line of a node."""
    end = node.end_mark.index
    if end > 0 and text[end - 1] == "\n":
        return end
    newline = text.find("\n", end)
    return len(text) if newline < 0 else newline + 1


def _indented(lines: list[str], column: int) -> str:
    space = " " * column
    return "".join(f"{space}{'- ' if k == 0 else '  '}{line}\n" for k, line in enumerate(lines))
