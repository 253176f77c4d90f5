"""Denoised readings: the linearisation point of errors that multiply a reading.

A scale error multiplies what was read, noise included. A Jacobian that contains the noise of a bin correlates with that
noise in the bin's residual, and the regression takes the correlation for a scale error (errors in variables).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.telemetry.record import SAME_TIME, ImuRecord
from edl_filter.types import Array


def denoise(record: ImuRecord, length: float, end: float) -> ImuRecord:
    """A record in which every sample is the cubic through four others, ``(4 (a + b) - (c + d)) / 6``.

    The others lie one and two bins away on either side, so none is in the sample's own bin.

    Parameters
    ----------
    record : ImuRecord
        Readings of one IMU, body axes.
    length : float
        Length of a bin, s.
    end : float
        End of the comparison, s. Later samples are not changed: a cubic through a parachute's opening shock would
        change the path.
    """
    p = max(1, round(length / float(np.median(record.interval))))
    count = len(record)
    regular = np.zeros(count, bool)
    if count > 4 * p:
        usual = np.abs(record.interval - np.median(record.interval)) < SAME_TIME
        breaks = np.concatenate(([0], np.cumsum(~usual | (np.diff(record.unit, prepend=record.unit[0]) != 0))))
        # samples from 2 p before to 2 p after have the usual interval and one instrument
        regular[2 * p : count - 2 * p] = breaks[4 * p + 1 :] == breaks[: count - 4 * p]
        regular[: count - 2 * p] &= record.time[2 * p :] <= end

    def interpolate(values: Array) -> Array:
        out = values.copy()
        near = values[p : -3 * p] + values[3 * p : -p]
        far = values[: -4 * p] + values[4 * p :]
        out[2 * p : -2 * p] = (4.0 * near - far) / 6.0
        return np.where(regular[:, None], out, values)

    if not regular.any():
        return record
    return replace(
        record, specific_force=interpolate(record.specific_force), angular_rate=interpolate(record.angular_rate)
    )
