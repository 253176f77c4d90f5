"""Residuals against time, channel by channel: the content of ``residuals.nc``.

Innovations (`channel_rms`) are measured minus predicted, after the nuisance parameters have been estimated from all
earlier residuals. One sigma of the stated noise is given with them; if the model holds, most residuals lie within it.
"""

from __future__ import annotations

import numpy as np

from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.residual_analysis.channel_rms import channels, normalised_innovations
from edl_filter.results.groups import Group, Groups


def residual_series(model: LinearizedModel) -> Groups:
    """Groups of ``residuals.nc``.

    Returns
    -------
    dict of Group
        Root: ``time`` (bins' middles, s), ``channel``, ``unit`` (text by channel), ``residual`` and ``sigma``
        ``(channel, time)`` in the channel's unit, and ``normalised``, their ratio; NaN where nothing is compared.
    """
    index, bins = model.index, model.bins
    normalised, stated = normalised_innovations(model), model.stated_noise_filter.innovation_sigma
    named = channels(model)
    ratio, sigma = (np.full((len(named), len(bins.interval)), np.nan) for _ in range(2))
    for c in range(len(named)):
        used = np.flatnonzero(index.bin_rows[:, c] >= 0)
        rows = index.bin_rows[used, c]
        scale = 1.0 / bins.interval[used] if 3 <= c < 6 else 1.0  # steps of the rate, as accelerations
        ratio[c, used], sigma[c, used] = normalised[rows], stated[rows] * scale
    group = Group()
    group.add("time", ("time",), bins.middle, "s", "time since the epoch, middle of the bin")
    group.label("channel", [name for name, _ in named], "what is compared")
    group.text("unit", "channel", [unit for _, unit in named], "unit of residual and sigma")
    dims = ("channel", "time")
    group.add(
        "residual", dims, ratio * sigma, "1", "measured less predicted, nuisance parameters estimated, in its unit"
    )
    group.add("sigma", dims, sigma, "1", "one sigma of the residual as stated, in its unit")
    group.add("normalised", dims, ratio, "1", "residual over sigma")
    return {"/": group}
