"""Units and numbers as people write them."""

from __future__ import annotations

import re

_POWERS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def readable(text: str) -> str:
    """A text with the powers of its units raised, ``m/s^2`` → ``m/s²``, and a minus before its negative numbers."""
    first, *others = text.split("^")
    made = first
    for part in others:
        length = len(part) - len(part.lstrip("0123456789-"))
        made += part[:length].translate(_POWERS) + part[length:]
    return re.sub(r"(?<![\w.])-(?=\.?\d)", "−", made)
