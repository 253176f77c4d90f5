"""Spacecraft clock (SCLK) to UTC and back, over one entry.

Over the half hour of an entry the clock's rate is 1 to a millionth, and no leap second falls within it,
so the relation is an offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.errors import InputError


def parse_utc(text: str) -> datetime:
    """ISO 8601 time as an aware datetime; without a zone it is UTC.

    Raises
    ------
    InputError
        `text` is no ISO 8601 time.
    """
    try:
        time = datetime.fromisoformat(text)
    except (TypeError, ValueError):
        raise InputError(f"{text!r} is no UTC time; ISO 8601 such as 2004-01-04T04:21:21.532 is accepted.") from None
    return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)


def _milliseconds(time: datetime) -> str:
    rounded = time + timedelta(microseconds=500)
    return rounded.replace(tzinfo=None).isoformat(timespec="milliseconds")


@dataclass(frozen=True)
class SclkClock:
    """``UTC = reference_utc + (SCLK - reference_sclk)``, the clock's count in decimal seconds.

    Attributes
    ----------
    reference_sclk : float
        Count of the reference, s.
    reference_utc : str
        ISO 8601 time of the reference.
    """

    reference_sclk: float
    reference_utc: str

    def __post_init__(self) -> None:
        parse_utc(self.reference_utc)

    def to_utc(self, sclk: float) -> str:
        """ISO 8601 time of one count, to the millisecond."""
        return _milliseconds(parse_utc(self.reference_utc) + timedelta(seconds=float(sclk) - self.reference_sclk))

    def to_datetime64(self, sclk: ArrayLike) -> NDArray[np.datetime64]:
        """UTC of an array of counts, to the microsecond."""
        reference = np.datetime64(parse_utc(self.reference_utc).replace(tzinfo=None), "us")
        microseconds = np.rint(1e6 * (np.asarray(sclk, float) - self.reference_sclk)).astype("int64")
        return reference + microseconds.astype("timedelta64[us]")

    def from_utc(self, utc: str) -> float:
        """Count at an ISO 8601 time, s."""
        return self.reference_sclk + (parse_utc(utc) - parse_utc(self.reference_utc)).total_seconds()

    def since(self, epoch_utc: str, sclk: ArrayLike) -> NDArray[np.float64]:
        """Seconds from the epoch to the counts `sclk`; shape of `sclk`."""
        return np.asarray(sclk, float) - self.from_utc(epoch_utc)


def label_utc(clock: SclkClock, count: str) -> str:
    """UTC that MER's PDS labels give for a clock count such as ``"126461185.125"``.

    The tables' clock column is in decimal seconds. The labels' UTC was made by software that takes the digits
    after the point as a number of ticks of 1/256 s (NAIF's convention for this clock): .125 became 125/256 s,
    .500 became 500/256 s = 1.953 s. Times in labels are therefore late by up to 2.5 s; this function
    reproduces them, and nothing else should use it.

    Raises
    ------
    InputError
        `count` is not digits, a point and digits.
    """
    whole, point, ticks = count.partition(".")
    if not (whole.isdigit() and point and ticks.isdigit()):
        raise InputError(f"{count!r} is no spacecraft clock count; digits.digits is accepted.")
    return clock.to_utc(int(whole) + int(ticks) / 256.0)
