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


class BoundedLoader(yaml.SafeLoader):
    """PyYAML's safe loader, which raises RecursionError beyond `DEEPEST` levels, before it looks any further ahead."""

    def fetch_flow_collection_start(self, token: type[yaml.Token]) -> None:
        """Begin a list or mapping in brackets."""
        self._check_depth()
        super().fetch_flow_collection_start(token)

    def add_indent(self, column: int) -> bool:
        """Begin a list or mapping by indentation, if this column is further to the right."""
        if self.indent < column:
            self._check_depth()
        return bool(super().add_indent(column))

    def _check_depth(self) -> None:
        if self.flow_level + len(self.indents) >= DEEPEST:
            raise RecursionError


def check_size(text: str, label: str) -> None:
    """Raise InputError, which begins with `label`, if a text is longer than `LARGEST`."""
    if len(text) > LARGEST:
        raise InputError(f"{label}: has {len(text)} characters; at most {LARGEST} are read as YAML.")


def refuse_aliases(text: str, label: str) -> None:
    """Raise InputError, which begins with `label`, if a text is too long or too deep, or has anchors or aliases.

    Raises
    ------
    InputError
    yaml.YAMLError
        It is not YAML.
    """
    check_size(text, label)
    try:
        for token in yaml.scan(text, Loader=BoundedLoader):
            if isinstance(token, yaml.AliasToken | yaml.AnchorToken):
                line = token.start_mark.line + 1
                raise InputError(f"{label}, line {line}: anchors and aliases (& and *) are not used here.")
    except RecursionError as error:
        raise cannot_parse(label, error) from None


def cannot_parse(label: str, error: RecursionError | ValueError) -> InputError:
    """Error for what PyYAML cannot convert: too many levels, or a number of too many digits."""
    reason = "it has too many levels" if isinstance(error, RecursionError) else str(error)
    return InputError(f"{label}: cannot be read as YAML: {reason}.")
