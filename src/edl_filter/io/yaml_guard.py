"""Limits of YAML from an unknown source: its size, its depth, and aliases that multiply it.

A few lines of aliases of aliases stand for more data than any memory holds. PyYAML needs some hundred bytes for each
number of a text, and its parser calls itself for each level.
"""

from __future__ import annotations

import yaml

from edl_filter.errors import InputError

#: Largest text, characters: twenty times the longest mission that the package ships.
LARGEST = 256 * 1024
#: Deepest level: beyond some hundred the parser's recursion ends, and its time grows with the square.
DEEPEST = 64
_BEGIN = (
    yaml.FlowSequenceStartToken,
    yaml.FlowMappingStartToken,
    yaml.BlockSequenceStartToken,
    yaml.BlockMappingStartToken,
)
_END = (yaml.FlowSequenceEndToken, yaml.FlowMappingEndToken, yaml.BlockEndToken)


def check_size(text: str, label: str) -> None:
    """Raise InputError, which begins with `label`, if a text is longer than `LARGEST`."""
    if len(text) > LARGEST:
        raise InputError(f"{label}: has {len(text)} characters; at most {LARGEST} are read as YAML.")


def refuse_aliases(text: str, label: str) -> None:
    """Raise InputError, which begins with `label`, if a text is too long or has anchors or aliases.

    Raises
    ------
    InputError
    yaml.YAMLError
        It is not YAML.
    """
    check_size(text, label)
    depth = 0
    for token in yaml.scan(text, Loader=yaml.SafeLoader):
        if isinstance(token, yaml.AliasToken | yaml.AnchorToken):
            line = token.start_mark.line + 1
            raise InputError(f"{label}, line {line}: anchors and aliases (& and *) are not used here.")
        depth += isinstance(token, _BEGIN) - isinstance(token, _END)
        if depth > DEEPEST:
            raise cannot_parse(label, RecursionError())


def cannot_parse(label: str, error: RecursionError | ValueError) -> InputError:
    """Error for what PyYAML cannot convert: too many levels, or a number of too many digits."""
    reason = "it has too many levels" if isinstance(error, RecursionError) else str(error)
    return InputError(f"{label}: cannot be read as YAML: {reason}.")
