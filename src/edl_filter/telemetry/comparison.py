"""Comparison of two IMUs, as the thesis compares rover and backshell (section 3.2).

Input: two records. Method: both are transferred to the centre of mass with smoothed rates
(`record_at_centre_of_mass`), then misalignment and bias difference are estimated by least squares
(`calibration.misalignment`). Output: the estimate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from edl_filter.telemetry.calibration import (
    THESIS_WINDOWS,
    MisalignmentEstimate,
    at_centre_of_mass,
    misalignment,
)
from edl_filter.telemetry.record import SAME_TIME, ImuRecord
from edl_filter.telemetry.smoothing import batch_polynomial, differentiated_rates

#: Points of the second-order batch polynomial, as in the thesis at 8 Hz.
BATCH = 7


def compare(
    reference: ImuRecord, checked: ImuRecord, until: float, windows: Sequence[tuple[float, float]] = THESIS_WINDOWS
) -> MisalignmentEstimate | None:
    """Misalignment and bias difference of `checked` relative to `reference`, both at the centre of mass.

    Parameters
    ----------
    reference, checked : ImuRecord
        In the thesis: backshell and rover.
    until : float
        Latest end of the last window, s since the epoch: parachute deployment.
    windows : sequence of (start, end)
        s since the epoch. Windows that one of the records does not cover are omitted.

    Returns
    -------
    MisalignmentEstimate or None
        None if no window is covered.
    """
    first = max(reference.start, checked.start)
    last = min(reference.time[-1], checked.time[-1], until)
    covered = [(a, min(b, last)) for a, b in windows if a >= first - SAME_TIME and min(b, last) - a > 5.0]
    if not covered:
        return None
    return misalignment(
        record_at_centre_of_mass(reference.between(first, last)),
        record_at_centre_of_mass(checked.between(first, last)),
        covered,
    )


def record_at_centre_of_mass(record: ImuRecord) -> ImuRecord:
    """Transfer a record to the centre of mass (thesis eq. 3.3), with smoothed rates and accelerations from them."""
    middle = record.time - 0.5 * record.interval
    rate = batch_polynomial(middle, record.angular_rate, BATCH)
    acceleration = differentiated_rates(middle, rate, lambda t, v: batch_polynomial(t, v, BATCH))
    return at_centre_of_mass(record, np.asarray(acceleration))
