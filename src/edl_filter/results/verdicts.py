"""Names of the verdicts of a diagnosis, and of the forms of what is missing outside the catalogue."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal, get_args

VerdictName = Literal["clean", "missing", "undecided", "unknown"]
#: All verdicts, in the order of their codes in a campaign's store.
VERDICTS: tuple[VerdictName, ...] = get_args(VerdictName)
#: Nothing is missing; an effect is; no hypothesis is probable enough; something is missing that is no known effect.
CLEAN, MISSING, UNDECIDED, UNKNOWN = VERDICTS


class Form(StrEnum):
    """What an unmodelled force and moment are fixed or proportional to, or that they are an error of one IMU."""

    BODY = "fixed to the body"
    RATE = "angular rate"
    ANGLE = "angle of attack"
    IMU = "error of one IMU"

    @property
    def is_regressor(self) -> bool:
        """Whether force and moment are proportional to it."""
        return self in (Form.RATE, Form.ANGLE)
