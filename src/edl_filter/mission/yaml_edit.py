"""Changes of a mission's text that go beyond a key's value: an entry appended to a list, paths seen from elsewhere.

Comments and layout of the rest stay.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from edl_filter.mission.text import compose, parse, set_key


def append_entry(text: str, key: str, entry: dict[str, Any], lines: list[str], where: str) -> str:
    """`text` with `entry` at the end of the list at the top-level `key`, which is made if it is not there.

    Parameters
    ----------
    text, key : str
    entry : dict
        The entry as data: what is written into a list in brackets.
    lines : list of str
        The entry as lines of block YAML, the first without its dash: what is written into any other list.
    where : str
        The file, in messages.

    Raises
    ------
    InputError
        `text` is not YAML.
    """
    root = compose(text, where)
    block = isinstance(root, yaml.MappingNode) and not root.flow_style
    there = {k.value: v for k, v in root.value} if isinstance(root, yaml.MappingNode) else {}
    node = there.get(key)
    if block and node is None:
        start = text if not text or text.endswith("\n") else text + "\n"
        return f"{start}\n{key}:\n{_indented(lines, 2)}"
    if isinstance(node, yaml.SequenceNode) and not node.flow_style:
        place = _line_after(text, _deepest(node))
        start = text[:place] if text[:place].endswith("\n") else text[:place] + "\n"
        return start + _indented(lines, node.start_mark.column) + text[place:]
    before = parse(text, where).get(key) or []
    return set_key(text, key, [*before, entry], where)


def seen_from(text: str, keys: tuple[str, ...], old: Path, new: Path, where: str) -> str:
    """`text` with its relative paths, which start in `old`, changed so that they start in `new`.

    Parameters
    ----------
    text : str
    keys : tuple of str
        Dotted keys that name files, ``*`` for the places of a list.
    old, new : Path
        Folders.
    where : str
        The file, in messages.
    """
    if old.resolve() == new.resolve():
        return text
    root = compose(text, where)
    nodes = [n for key in keys for n in _at(root, key.split(".")) if n.tag == "tag:yaml.org,2002:str"]
    for node in sorted(nodes, key=lambda n: n.start_mark.index, reverse=True):
        path = Path(node.value)
        if node.value.startswith(("builtin:", "~")) or path.is_absolute():
            continue
        moved = json.dumps(os.path.relpath((old / path).resolve(), new.resolve()), ensure_ascii=False)
        text = text[: node.start_mark.index] + moved + text[node.end_mark.index :]
    return text


def _at(node: yaml.Node | None, parts: list[str]) -> Iterator[yaml.ScalarNode]:
    """Scalars at a dotted key below `node`."""
    if isinstance(node, yaml.ScalarNode) and not parts:
        yield node
    elif isinstance(node, yaml.SequenceNode) and parts and parts[0] == "*":
        for below in node.value:
            yield from _at(below, parts[1:])
    elif isinstance(node, yaml.MappingNode) and parts:
        for key, below in node.value:
            if key.value == parts[0]:
                yield from _at(below, parts[1:])


def _deepest(node: yaml.Node) -> yaml.Node:
    """The last node within `node` that ends where its own text ends, not where the next begins."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _deepest(last[1] if isinstance(last, tuple) else last)
    return node


def _line_after(text: str, node: yaml.Node) -> int:
    """Beginning of the line after a node's last."""
    end = node.end_mark.index
    if end > 0 and text[end - 1] == "\n":
        return end
    newline = text.find("\n", end)
    return len(text) if newline < 0 else newline + 1


def _indented(lines: list[str], column: int) -> str:
    space = " " * column
    return "".join(f"{space}{'- ' if k == 0 else '  '}{line}\n" for k, line in enumerate(lines))
