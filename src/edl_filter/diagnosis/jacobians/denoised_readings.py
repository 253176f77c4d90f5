"""Denoised readings: the linearisation point of errors that multiply a reading.

A scale error multiplies what was read, noise included. A Jacobian that contains the noise of a bin correlates with that
noise in the bin's residual, and the regression takes the correlation for a scale error (errors in variables).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from edl_filter.telemetry.record import SAME_TIME, ImuRecord
from edl_filter.types import Array

#: Bins on either side of a sample from which it is interpolated: by the polynomial of third degree through these
#: points, or of fifth degree without the nearest ones.
_NEAREST, _WITHOUT_NEIGHBOURS = (1, 2), (2, 3, 4)


def denoise(record: ImuRecord, length: float, end: float, coarse: Collection[str] = ()) -> ImuRecord:
    """A record in which every sample is interpolated from samples in other bins, on both sides of it.

    The rounding error of readings with coarse steps may be carried from sample to sample (`telemetry.quantisation`).
    The errors of neighbours are then anticorrelated: an interpolation that contains the neighbours correlates with the
    sample's own error, and the regression takes that for a scale error of the opposite sign.

    Parameters
    ----------
    record : ImuRecord
        Readings of one IMU, body axes.
    length : float
        Length of a bin, s.
    end : float
        End of the comparison, s. Later samples are not changed: an interpolation through a parachute's opening shock
        would change the path.
    coarse : collection of str
        Triads with coarse steps, ``force`` or ``rate``: interpolated without the neighbouring bins.
    """
    force, rate = (
        _interpolated(record, values, length, end, _WITHOUT_NEIGHBOURS if triad in coarse else _NEAREST)
        for triad, values in (("force", record.specific_force), ("rate", record.angular_rate))
    )
    if force is record.specific_force and rate is record.angular_rate:
        return record
    return replace(record, specific_force=force, angular_rate=rate)


def _interpolated(record: ImuRecord, values: Array, length: float, end: float, distances: tuple[int, ...]) -> Array:
    """Values ``(N, 3)`` interpolated from those so many bins away; the given ones where these are not regular."""
    p = max(1, round(length / float(np.median(record.interval))))
    count, reach = len(record), distances[-1] * p
    regular = np.zeros(count, bool)
    if count > 2 * reach:
        usual = np.abs(record.interval - np.median(record.interval)) < SAME_TIME
        breaks = np.concatenate(([0], np.cumsum(~usual | (np.diff(record.unit, prepend=record.unit[0]) != 0))))
        # samples up to `reach` before and after have the usual interval and one instrument
        regular[reach : count - reach] = breaks[2 * reach + 1 :] == breaks[: count - 2 * reach]
        regular[: count - reach] &= record.time[reach:] <= end
    if not regular.any():
        return values
    sides = np.zeros((count - 2 * reach, 3))
    for a in distances:
        # Lagrange, of points that are symmetric about the sample
        weight = 0.5 * np.prod([b**2 / (b**2 - a**2) for b in distances if b != a])
        before, after = (values[reach + k : count - reach + k] for k in (-a * p, a * p))
        sides += weight * (before + after)
    out = values.copy()
    out[reach : count - reach] = sides
    return np.where(regular[:, None], out, values)
