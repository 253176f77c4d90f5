"""Normalised RMS of every channel over the flight, with a hypothesis in the model and without."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.case import Linear
from edl_filter.diagnosis.ranking import Hypothesis
from edl_filter.diagnosis.where import channels, normalised

Array = NDArray[np.float64]

#: RMS from which a channel is said to fail, where it is asked whether an effect mends it.
_FAILS = 1.5
#: Part of its excess (mean square beyond noise) that is nearly all of it.
_WHOLE = 0.9


def errors_of(linear: Linear) -> dict[str, float]:
    """Channel or constraint → normalised RMS of a model as it is."""
    return _by_channel(linear, normalised(linear)) | _by_constraint(linear, normalised(linear))


def errors_with(h: Hypothesis) -> dict[str, float]:
    """The same with a hypothesis in the model."""
    scaled = _scaled(h)
    return _by_channel(h.linear, scaled) | _by_constraint(h.linear, scaled)


def mends_its_channel(linear: Linear, h: Hypothesis) -> bool:
    """Whether the channel that a hypothesis lessens most fails without it, and comes to its noise with it."""
    before, after = _lessened(linear, h)
    return before > _FAILS >= after and after**2 - 1.0 < (1.0 - _WHOLE) * (before**2 - 1.0)


def halves_a_channel(linear: Linear, h: Hypothesis) -> bool:
    """Whether the channel that a hypothesis lessens most fails without it, and half as much with it."""
    before, after = _lessened(linear, h)
    return before > _FAILS and after < 0.5 * before


def _lessened(linear: Linear, h: Hypothesis) -> tuple[float, float]:
    """Error without and with a hypothesis of the channel that it lessens most, by the factor; ones where there is none.

    Channels of forces, moments and other IMUs count, constraints do not: one landing can be met by anything.
    """
    before, after = _by_channel(linear, normalised(linear)), _by_channel(h.linear, _scaled(h))
    both = [(before[name], after[name]) for name in before if name in after]
    return max(both, key=lambda pair: pair[0] / pair[1], default=(1.0, 1.0))


def _scaled(h: Hypothesis) -> Array:
    return h.whiten.innovations(h.refit.white) / h.linear.plain.innovation_sigma


def _by_channel(linear: Linear, scaled: Array) -> dict[str, float]:
    found = {}
    for c, (name, _) in enumerate(channels(linear)):
        rows = linear.ground.order.bin_rows[:, c]
        found[name] = _rms(scaled[rows[rows >= 0]])
    return found


def _by_constraint(linear: Linear, scaled: Array) -> dict[str, float]:
    by_name: dict[str, list[float]] = {}
    order = linear.ground.order
    for constraint, where in zip(linear.ground.setup.problem.constraints, order.constraint_rows, strict=True):
        by_name.setdefault(constraint.name, []).extend(scaled[where])
    return {name: _rms(np.array(values)) for name, values in by_name.items()}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
