"""Two IMUs of one rigid vehicle that disagree for seconds: one of them is at fault, and they do not show which.

Input: records of both in body axes, bad samples NaN. Method: the parity of two redundant sensors (Potter & Suman 1977,
AGARD-AG-224; Gertler 1998, Fault Detection and Diagnosis in Engineering Systems, chapter 5): the difference between one
IMU and the other transferred to it (`transfer`) has only the noise of both, and their stated scale errors, whatever the
motion is. In blocks of `_BLOCK` s the median of its squared length, in units of that variance, is compared with that of
the chi-square distribution with three degrees of freedom. The median ignores spikes, which `spikes` attributes. Output:
the triads and times of the blocks that disagree.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from edl_filter.telemetry.record import ImuRecord, SampleFinding, finite_rows
from edl_filter.telemetry.transfer import transferred
from edl_filter.types import BoolArray

#: Length of a block, s, and the least number of its samples that both IMUs have.
_BLOCK, _FEWEST = 5.0, 20
#: Ratio of the difference to its sigma beyond which a block disagrees. It is 1.0 to 1.3 for the rates of Spirit,
#: Opportunity and all simulated flights. The mounts of the rovers' accelerometers bend and vibrate: there, the forces
#: differ by up to 25 sigmas, and by up to 1.2 % of the force.
RATE_RATIO, FORCE_RATIO = 4.0, 35.0
#: Part of the specific force by which forces must differ, too.
_FORCE_PART = 0.05
_MEDIAN = float(chdtri(3, 0.5))


def disagreements(reference: ImuRecord, checked: ImuRecord, end: float) -> list[SampleFinding]:
    """Stretches over which two IMUs disagree.

    Parameters
    ----------
    reference, checked : ImuRecord
        Records in body axes; NaN where samples are lost.
    end : float
        End of the time over which the vehicle is rigid, s: the parachute.

    Returns
    -------
    list of SampleFinding
        At most one for each triad, of the reference: from the first block that disagrees to the last one.
    """
    source = transferred(reference, checked, end)
    nearest = checked.index_at(reference.time)
    rate_scale = np.hypot(reference.errors[0].gyro_scale, checked.errors[0].gyro_scale)
    findings = []
    for triad, own, other, noises, scale, ratio in (
        (
            "force",
            reference.specific_force,
            source.force,
            (reference.force_noise, checked.force_noise),
            0.0,
            FORCE_RATIO,
        ),
        (
            "rate",
            reference.angular_rate,
            source.rate,
            (reference.rate_noise, checked.rate_noise),
            rate_scale,
            RATE_RATIO,
        ),
    ):
        square = np.sum(own**2, axis=1)
        variance = noises[0] ** 2 + noises[1][nearest] ** 2 + scale**2 * square / 3.0
        deviation = np.sum((own - other) ** 2, axis=1)
        used = finite_rows(own) & finite_rows(other) & (reference.time <= end) & _direct(reference, triad)
        blocks = np.floor(reference.time / _BLOCK).astype(int)
        bad = np.zeros(len(reference), bool)
        for block in np.unique(blocks[used]):
            rows = np.flatnonzero(used & (blocks == block))
            if len(rows) < _FEWEST or np.median(deviation[rows] / variance[rows]) < ratio**2 * _MEDIAN:
                continue
            if triad == "force" and np.median(deviation[rows]) < _FORCE_PART**2 * np.median(square[rows]):
                continue
            bad[rows] = True
        if bad.any():
            rows = np.flatnonzero(bad)
            start = float(reference.time[rows[0]] - reference.interval[rows[0]])
            last = float(reference.time[rows[-1]])
            findings.append(SampleFinding(reference.name, triad, start, last, len(rows), "disagreement"))
    return findings


def _direct(record: ImuRecord, triad: str) -> BoolArray:
    """Samples (N,) that are direct readings of the triad."""
    return ~record.sculling_corrected if triad == "force" else ~record.coning_corrected
