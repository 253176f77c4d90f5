"""Time of the samples of an IMU that counts increments with an oscillator of its own.

An IMU sums increments of angle and velocity of nominal length τ (2.5 ms); a computer with another clock reads the sums
at equal steps of its own time. An IMU that is fast by the ratio d delivers one increment more than nominal once in τ/d
seconds (150 to 195 s for MER's IMUs, which are fast by 13 to 16 parts per million). In that sample, force and rate
computed with the nominal length are one part in fifty too large. Between two such samples the last increment ends
earlier and earlier before the computer reads it: by a sawtooth from 0 to τ.

Input: clock counts at which the computer read, and what it read. Method: a sample with an additional increment is
recognised from the data alone, by its excess over the interpolation between its neighbours (`extra_increments`); the
sawtooth through the recognised samples gives the end of every sample (`IncrementClock`). Output: times on the
computer's clock at which the increments of a reading end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.errors import InputError
from edl_filter.estimation.series import ROBUST_SIGMA
from edl_filter.types import Array, IntArray

#: Length of an increment of MER's LN-200S, s (400 Hz).
INCREMENT = 0.0025
#: Central interpolation of eighth order from the four samples on each side, nearest first.
_WEIGHTS = np.array([56.0, -28.0, 8.0, -1.0]) / 70.0
_REACH = len(_WEIGHTS)
#: Samples on each side whose scatter is that of the statistic.
_SCATTER_REACH = 40
#: Largest scatter at which a sample is tested, and largest distance from a whole number, increments.
_LARGEST_SCATTER, _LARGEST_DISTANCE = 0.1, 0.25


def excess_increments(values: Array, interval: Array) -> Array:
    """Number of increments by which a sample exceeds the interpolation between its neighbours.

    The sums over equal intervals change smoothly; a sample of n + 1 instead of n increments is larger by the factor
    1 + 1/n. The excess is projected on the interpolated vector.

    Parameters
    ----------
    values : (N, 3) array
        Sums over the samples (angle, rad, or velocity, m/s); NaN where missing.
    interval : (N,) array
        Nominal lengths of the samples, s; samples next to a change of length are not tested.

    Returns
    -------
    (N,) array
        NaN where it cannot be computed.
    """
    excess = np.full(len(values), np.nan)
    if len(values) <= 2 * _REACH:
        return excess
    middle = slice(_REACH, len(values) - _REACH)
    interpolated = np.zeros_like(values[middle])
    equal = np.ones(len(interpolated), bool)
    for k, weight in enumerate(_WEIGHTS, start=1):
        for offset in (-k, k):
            shifted = slice(_REACH + offset, len(values) - _REACH + offset)
            interpolated += weight * values[shifted]
            equal &= np.abs(interval[shifted] - interval[middle]) < 0.5 * INCREMENT
    square = np.sum(interpolated**2, axis=1)
    ratio = np.divide(
        np.sum((values[middle] - interpolated) * interpolated, axis=1),
        square,
        out=np.full(len(square), np.nan),
        where=equal & (square > 0.0),
    )
    excess[middle] = ratio * interval[middle] / INCREMENT
    return excess


def extra_increments(interval: Array, *channels: Array) -> tuple[IntArray, IntArray]:
    """Find the samples that have one increment more or less than nominal.

    Every channel must have an excess of the same whole number, ±1, while the scatter of the samples around is at most a
    tenth of an increment; and the correction must remove the excess of the neighbours, too, which it does not where
    the sample has another error.

    Parameters
    ----------
    interval : (N,) array
        Nominal lengths of the samples, s.
    *channels : (N, 3) arrays
        Sums over the samples; NaN where missing.

    Returns
    -------
    index : (K,) integer array
        Samples.
    extra : (K,) integer array
        +1 or -1.
    """
    excesses = [excess_increments(values, interval) for values in channels]
    number = np.sign(excesses[0])
    candidate = np.ones(len(interval), bool)
    for excess in excesses:
        candidate &= np.abs(excess - number) < _LARGEST_DISTANCE
    index = [
        i
        for i in np.flatnonzero(candidate)
        if all(_is_corrected(values, interval, int(i), float(number[i])) for values in channels)
    ]
    return np.array(index, np.int64), number[index].astype(np.int64)


def _is_corrected(values: Array, interval: Array, i: int, number: float) -> bool:
    """Whether another count of increments in sample `i` removes the excess of it and of its neighbours."""
    around = slice(max(0, i - _SCATTER_REACH), i + _SCATTER_REACH + 1)
    near = i - around.start
    corrected = values[around].copy()
    corrected[near] /= 1.0 + number * INCREMENT / interval[i]
    excess = np.abs(excess_increments(corrected, interval[around]))
    if not np.isfinite(excess[near]):
        return False
    scatter = ROBUST_SIGMA * float(np.nanmedian(excess))
    neighbours = excess[max(0, near - _REACH) : near + _REACH + 1]
    return scatter < _LARGEST_SCATTER and bool(np.all(neighbours[np.isfinite(neighbours)] < _LARGEST_DISTANCE))


@dataclass(frozen=True)
class IncrementClock:
    """Ends of an IMU's samples on the computer's clock.

    Attributes
    ----------
    slips : (S,) array
        Clock counts of the samples with another number of increments, s, increasing.
    extra : int
        +1 if the IMU is fast (one increment more), -1 if it is slow.
    """

    slips: Array
    extra: int = 1

    @classmethod
    def from_slips(cls, slips: Array, extra: IntArray, name: str) -> IncrementClock:
        """Clock of an IMU.

        Parameters
        ----------
        slips : (S,) array
            Clock counts of the samples with another number of increments, s, in any order.
        extra : (S,) integer array
            Their additional increments, +1 or -1.
        name : str
            Of the IMU, for messages.

        Raises
        ------
        InputError
            Some samples have one increment more, others one less: no difference of rate explains both.
        """
        if len(slips) and np.ptp(extra):
            raise InputError(
                f"telemetry: the {name}'s IMU has samples with one increment more and with one less "
                f"(SCLK {', '.join(f'{t:.3f}' for t in np.sort(slips))}); a clock of constant rate has one kind only."
            )
        return cls(np.sort(np.asarray(slips, float)), int(extra[0]) if len(slips) else 1)

    def _periods(self) -> Array:
        """Number of periods between one sample of `slips` and the next, whole numbers (S - 1,)."""
        steps = np.diff(self.slips)
        return np.maximum(1.0, np.round(steps / steps.min(initial=np.inf)))

    @property
    def rate_error(self) -> float:
        """Relative rate of the IMU's oscillator against the computer's clock; 0 with fewer than two samples."""
        if len(self.slips) < 2:
            return 0.0
        return float(self.extra * INCREMENT * self._periods().sum() / (self.slips[-1] - self.slips[0]))

    def lag(self, sclk: Array) -> Array:
        """Time from the end of the last increment to the computer's reading, s.

        Between two recognised samples the oscillator's rate is constant; beyond the first and the last it is that of
        the nearest two. A sample that was not recognised is interpolated: the number of periods between two recognised
        ones is a whole number. With a single one, the lag is one increment before it and zero after it.

        Parameters
        ----------
        sclk : (N,) array
            Clock counts at which the computer read, s.

        Returns
        -------
        (N,) array
        """
        sclk = np.asarray(sclk, float)
        if not len(self.slips):
            return np.zeros_like(sclk)
        if len(self.slips) == 1:
            fast = sclk < self.slips[0]
            return np.where(fast if self.extra > 0 else ~fast, INCREMENT, 0.0)
        steps, periods = np.diff(self.slips), self._periods()
        piece = np.clip(np.searchsorted(self.slips, sclk, side="right") - 1, 0, len(steps) - 1)
        phase = (sclk - self.slips[piece]) * periods[piece] / steps[piece]
        phase = np.round(phase, 9)  # a reading at a slip is after it, whatever the rounding of the clock count
        fraction = phase - np.floor(phase)
        return INCREMENT * (fraction if self.extra > 0 else 1.0 - fraction)

    def time(self, sclk: Array) -> Array:
        """Ends of the increments that were read, s of the computer's clock.

        Parameters
        ----------
        sclk : (N,) array
            Clock counts at which the computer read, s.

        Returns
        -------
        (N,) array
        """
        return np.asarray(sclk, float) - self.lag(sclk)
