"""Quiet records: readings without their own noise, to differentiate by what multiplies them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.telemetry.record import ImuRecord

Array = NDArray[np.float64]


def quiet(record: ImuRecord, length: float, end: float) -> ImuRecord:
    """A record in which every sample is the cubic through four others, ``(4 (a + b) - (c + d)) / 6``.

    The others are one and two bins away on either side, `length` (s) being that of a bin: none is in the sample's own
    bin. A scale error multiplies what was read, noise and all. A signature with the noise of a bin in it would find
    that noise in the bin's difference again, and call it a scale error. After `end` (s), where nothing is compared,
    samples stay: a cubic through a parachute's shock would lead the path astray.
    """
    p = max(1, round(length / float(np.median(record.interval))))
    count = len(record)
    even = np.zeros(count, bool)
    if count > 4 * p:
        usual = np.abs(record.interval - np.median(record.interval)) < 1e-6
        broken = np.concatenate(([0], np.cumsum(~usual | (np.diff(record.unit, prepend=record.unit[0]) != 0))))
        # samples from 2 p before to 2 p after are as long as usual and of one unit
        even[2 * p : count - 2 * p] = broken[4 * p + 1 :] == broken[: count - 4 * p]
        even[: count - 2 * p] &= record.time[2 * p :] <= end

    def smooth(values: Array) -> Array:
        out = values.copy()
        near = values[p : -3 * p] + values[3 * p : -p]
        far = values[: -4 * p] + values[4 * p :]
        out[2 * p : -2 * p] = (4.0 * near - far) / 6.0
        return np.where(even[:, None], out, values)

    if not even.any():
        return record
    return replace(record, specific_force=smooth(record.specific_force), angular_rate=smooth(record.angular_rate))
