"""The exceptions for wrong input and Ctrl-C, parts of messages, and the exit code of results not to be trusted."""

from collections.abc import Sequence

#: Exit code of a command that is done with a result which is not to be trusted.
UNTRUSTWORTHY = 3
#: Most characters of a quoted value in a message.
_LONGEST = 80


class InputError(Exception):
    """The user's input cannot be used.

    The message is one or two sentences that name the file, key or row, the value found and the accepted values.
    The command line prints it and exits with code 2; no partial output remains.
    """


class InterruptedCommandError(Exception):
    """A command was interrupted by Ctrl-C; the message says what it has kept."""


def quoted(value: object) -> str:
    """A value of a file in a message: quoted, without control characters, and of at most `_LONGEST` characters."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 2]} …"


def enumerated(names: Sequence[str]) -> str:
    """Texts as an enumeration: ``a, b and c``."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1]))) if names else ""
