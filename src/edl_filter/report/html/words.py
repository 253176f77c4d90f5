"""Units as people write them."""

from __future__ import annotations

_POWERS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def readable(text: str) -> str:
    """A text with the powers of its units raised: ``m/s^2`` → ``m/s²``."""
    first, *others = text.split("^")
    made = first
    for part in others:
        length = len(part) - len(part.lstrip("0123456789-"))
        made += part[:length].translate(_POWERS) + part[length:]
    return made
