"""Residuals against time, channel by channel: what `edl-filter diagnose` writes to ``residuals.nc``.

Innovations of the comparison (`where`): measured less predicted, after all that the allowed errors explain. Beside them
stands one sigma of what is stated; a model that holds stays within.
"""

from __future__ import annotations

import numpy as np

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.where import channels, normalised
from edl_filter.results.groups import Group, Groups


def residual_series(linear: Linear) -> Groups:
    """Groups of ``residuals.nc``.

    Returns
    -------
    dict of Group
        Root: ``time`` (bins' middles, s), ``channel``, ``unit`` (text by channel), ``residual`` and ``sigma``
        ``(channel, time)`` in the channel's unit, and ``normalised``, their ratio; NaN where nothing is compared.
    """
    order, bins = linear.ground.order, linear.bins
    scaled, stated = normalised(linear), linear.plain.innovation_sigma
    named = channels(linear)
    whole, sigma = (np.full((len(named), len(bins.interval)), np.nan) for _ in range(2))
    for c in range(len(named)):
        used = np.flatnonzero(order.bin_rows[:, c] >= 0)
        rows = order.bin_rows[used, c]
        scale = 1.0 / bins.interval[used] if 3 <= c < 6 else 1.0  # steps of the rate, as accelerations
        whole[c, used], sigma[c, used] = scaled[rows], stated[rows] * scale
    group = Group()
    group.add("time", ("time",), bins.middle, "s", "time since the epoch, middle of the bin")
    group.label("channel", [name for name, _ in named], "what is compared")
    group.text("unit", "channel", [unit for _, unit in named], "unit of residual and sigma")
    dims = ("channel", "time")
    group.add("residual", dims, whole * sigma, "1", "measured less predicted, allowed errors taken out, in its unit")
    group.add("sigma", dims, sigma, "1", "one sigma of the residual as stated, in its unit")
    group.add("normalised", dims, whole, "1", "residual over sigma")
    return {"/": group}
