"""Normalised residuals of a reconstruction, channel by channel: what a run says of its own model."""

from __future__ import annotations

from edl_filter.diagnosis.case import case_of
from edl_filter.diagnosis.channel_errors import errors_of
from edl_filter.diagnosis.rounds import linearise
from edl_filter.diagnosis.where import survey
from edl_filter.reconstruction import Reconstruction

#: Key of the whole flight beside those of the regimes.
OVERALL = "overall"


def residuals(reconstruction: Reconstruction) -> dict[str, dict[str, float]]:
    """Normalised RMS of every channel and constraint: 1 where the model holds.

    Returns
    -------
    dict
        Channel → ``overall`` and every regime → normalised RMS, as a diagnosis has them.
    """
    linear = linearise(case_of(reconstruction))
    found = {name: {OVERALL: rms} for name, rms in errors_of(linear).items()}
    for cell in survey(linear):
        if cell.regime != "constraints":
            found[cell.channel][cell.regime] = cell.rms
    return found
