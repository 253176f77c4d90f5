"""Normalised RMS of every channel over the flight, with a hypothesis in the model and without."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.hypotheses import Hypothesis
from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.where import channels, normalised

Array = NDArray[np.float64]

#: RMS from which a channel is said to fail, where it is asked whether an effect mends it.
_FAILS = 1.5
#: Part of its excess (mean square beyond noise) that is nearly all of it.
_WHOLE = 0.9
#: Part of its error that an effect may leave in the channel that it is about.
_LEFT = 0.2


def errors_of(linear: Linear) -> dict[str, float]:
    """Channel or constraint → normalised RMS of a model as it is."""
    return _by_channel(linear, normalised(linear)) | _by_constraint(linear, normalised(linear))


def errors_with(h: Hypothesis) -> dict[str, float]:
    """The same with a hypothesis in the model."""
    scaled = _scaled(h)
    return _by_channel(h.linear, scaled) | _by_constraint(h.linear, scaled)


def most_lessened(h: Hypothesis, before: dict[str, float], after: dict[str, float]) -> str:
    """The channel whose mean square falls most with a hypothesis; a constraint only where no channel's falls.

    A constraint is one number or a few, which anything can meet.
    """
    fall = {name: before[name] ** 2 - after[name] ** 2 for name in before if np.isfinite(before[name] - after[name])}
    lessened = [name for name, _ in channels(h.linear) if fall.get(name, 0.0) > 0.0]
    return max(lessened or fall, key=lambda name: fall[name])


def mends_its_channel(linear: Linear, h: Hypothesis) -> bool:
    """Whether the channel that a hypothesis lessens by the largest factor fails without it, and not with it."""
    before, after = max(_both(linear, h), key=lambda pair: pair[0] / pair[1], default=(1.0, 1.0))
    return before > _FAILS >= after and after**2 - 1.0 < (1.0 - _WHOLE) * (before**2 - 1.0)


def lessens_its_channel(linear: Linear, h: Hypothesis) -> bool:
    """Whether the channel that a hypothesis takes most from fails without it, and a fifth as much or less with it."""
    before, after = max(_both(linear, h), key=lambda pair: pair[0] ** 2 - pair[1] ** 2, default=(1.0, 1.0))
    return before > _FAILS and after < _LEFT * before


def _both(linear: Linear, h: Hypothesis) -> list[tuple[float, float]]:
    """Error without and with a hypothesis, of every channel of forces, moments and other IMUs.

    Constraints do not count: one landing can be met by anything.
    """
    before, after = _by_channel(linear, normalised(linear)), _by_channel(h.linear, _scaled(h))
    return [(before[name], after[name]) for name in before if name in after]


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
