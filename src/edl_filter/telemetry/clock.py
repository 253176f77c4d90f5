"""Conversion of spacecraft clock counts (SCLK) to UTC over one entry.

Input: one pair of clock count and UTC. Method: a constant offset, since over the half hour of an entry the clock's rate
is 1 to within 1e-6 and no leap second occurs.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.errors import InputError, quoted


def parse_utc(text: str) -> datetime:
    """Read an ISO 8601 time as an aware datetime; without a time zone it is UTC.

    Raises
    ------
    InputError
        `text` is no ISO 8601 time.
    """
    try:
        time = datetime.fromisoformat(text)
        return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{quoted(text)} is no UTC time; ISO 8601 such as 2004-01-04T04:21:21.532 is accepted."
        ) from None


def _milliseconds(time: datetime) -> str:
    rounded = time + timedelta(microseconds=500)
    return rounded.replace(tzinfo=None).isoformat(timespec="milliseconds")


@dataclass(frozen=True)
class SclkClock:
    """``UTC = reference_utc + (SCLK - reference_sclk)``, with the clock's count in decimal seconds.

    Attributes
    ----------
    reference_sclk : float
        Clock count of the reference, s.
    reference_utc : str
        UTC of the reference, ISO 8601.
    """

    reference_sclk: float
    reference_utc: str

    def __post_init__(self) -> None:
        parse_utc(self.reference_utc)

    def to_utc(self, sclk: float) -> str:
        """UTC of one count (s), ISO 8601, to the millisecond."""
        return _milliseconds(parse_utc(self.reference_utc) + timedelta(seconds=float(sclk) - self.reference_sclk))

    def to_datetime64(self, sclk: ArrayLike) -> NDArray[np.datetime64]:
        """UTC of counts.

        Parameters
        ----------
        sclk : (...) array
            s.

        Returns
        -------
        (...) array of datetime64
            To the microsecond.
        """
        reference = np.datetime64(parse_utc(self.reference_utc).replace(tzinfo=None), "us")
        microseconds = np.rint(1e6 * (np.asarray(sclk, float) - self.reference_sclk)).astype("int64")
        return reference + microseconds.astype("timedelta64[us]")
