"""Names of the verdicts of a diagnosis."""

from __future__ import annotations

from typing import Literal, get_args

VerdictName = Literal["clean", "missing", "undecided", "unknown"]
#: All verdicts, in the order of their codes in a campaign's store.
VERDICTS: tuple[VerdictName, ...] = get_args(VerdictName)
#: Nothing is missing; an effect is; no hypothesis is probable enough; something is missing that is no known effect.
CLEAN, MISSING, UNDECIDED, UNKNOWN = VERDICTS
