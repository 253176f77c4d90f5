"""Normalised residuals of a reconstruction, channel by channel, for the summary of a run."""

from __future__ import annotations

from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.residual_analysis.channel_rms import model_rms
from edl_filter.diagnosis.residual_analysis.residual_map import residual_map
from edl_filter.pipeline.reconstruct import Reconstruction

#: Key of the whole flight beside those of the regimes.
OVERALL = "overall"


def residual_rms(reconstruction: Reconstruction) -> dict[str, dict[str, float]]:
    """Normalised RMS of every channel and constraint: 1 if the model holds.

    Returns
    -------
    dict
        Channel → ``overall`` and every regime → normalised RMS, as a diagnosis has them.
    """
    model = linearize(flight_case(reconstruction))
    by_channel = {name: {OVERALL: rms} for name, rms in model_rms(model).items()}
    for cell in residual_map(model):
        if cell.regime != "constraints":
            by_channel[cell.channel][cell.regime] = cell.rms
    return by_channel
