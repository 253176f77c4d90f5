"""One IMU against another: the thesis's comparison of rover and backshell (its section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from edl_filter.telemetry.calibration import (
    THESIS_WINDOWS,
    MisalignmentEstimate,
    at_centre_of_mass,
    misalignment,
)
from edl_filter.telemetry.record import ImuRecord
from edl_filter.telemetry.smoothing import batch_polynomial, differentiated_rates

BATCH = 7  # points of the second-order batch polynomial that the thesis used at 8 Hz


def compare(
    reference: ImuRecord, other: ImuRecord, until: float, windows: Sequence[tuple[float, float]] = THESIS_WINDOWS
) -> MisalignmentEstimate | None:
    """Misalignment and bias difference of `other` against `reference`, both moved to the centre of mass.

    Parameters
    ----------
    reference, other : ImuRecord
        The thesis: backshell and rover.
    until : float
        End of the last window at the latest, s: parachute deployment.
    windows : sequence of (start, end)
        s since the epoch. A window that either record does not cover is left out.

    Returns
    -------
    MisalignmentEstimate or None
        None if no window is covered.
    """
    first = max(reference.start, other.start)
    last = min(reference.time[-1], other.time[-1], until)
    covered = [(a, min(b, last)) for a, b in windows if a >= first - 1e-6 and min(b, last) - a > 5.0]
    if not covered:
        return None
    return misalignment(centred(reference.between(first, last)), centred(other.between(first, last)), covered)


def centred(record: ImuRecord) -> ImuRecord:
    """`record` at the centre of mass, by smoothed rates and their smoothed differences (thesis eq. 3.3)."""
    middle = record.time - 0.5 * record.interval
    rate = batch_polynomial(middle, record.angular_rate, BATCH)
    acceleration = differentiated_rates(middle, rate, lambda t, v: batch_polynomial(t, v, BATCH))
    return at_centre_of_mass(record, np.asarray(acceleration))
