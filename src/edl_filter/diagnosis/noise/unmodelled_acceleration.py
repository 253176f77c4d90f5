"""A missing force and moment that nobody named: the hypothesis *something else*, the ground on which names are judged.

Body-fixed, each axis a Gauss–Markov process of its own, of a size, a memory, and with the dynamic pressure or without
it. Size and memory are those under which the flight is most likely. A name must explain the flight better than this
does, or make it smaller.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.comparison import averaged, triangle
from edl_filter.diagnosis.sparse import joined, sparse
from edl_filter.diagnosis.timeline import Order
from edl_filter.diagnosis.whitening import Steps
from edl_filter.effects.effect import Flow

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Missing:
    """Size of what nobody named.

    Attributes
    ----------
    force, moment : float
        One sigma per axis: of the specific force (m/s²) and of the angular acceleration (rad/s²), at the flight's
        largest dynamic pressure if they follow it. Zero: none.
    memory : float
        Correlation time, s.
    with_pressure : bool
        Both go with the dynamic pressure, as what the air does; else they are the same throughout.
    """

    force: float = 0.0
    moment: float = 0.0
    memory: float = 1.0
    with_pressure: bool = False


#: What is tried: memories (s) with and without dynamic pressure, and the sizes of force and moment.
MEMORIES = (0.5, 10.0)
FORCES = (0.0, 3e-3, 3e-2, 0.3)
MOMENTS = (0.0, 1e-3, 1e-2, 0.1)


def allow(steps: Steps, order: Order, bins: Bins, flow: Flow, missing: Missing) -> Steps:
    """The linear problem with a missing force and moment behind its unknowns, three each, in sigmas."""
    if missing.force == missing.moment == 0.0:
        return steps
    n, there = len(steps.start), slice(len(steps.start), len(steps.start) + 6)
    design, start = np.pad(steps.design, ((0, 0), (0, 6))), np.eye(n + 6)
    start[:n, :n] = steps.start
    push = strength(flow, missing)
    sizes = (missing.force * averaged(push, bins), missing.moment * triangle(push, bins))
    for first, size in zip((0, 3), sizes, strict=True):
        for axis in range(first, first + 3):
            rows = order.bin_rows[: len(size), axis]
            used = rows >= 0
            design[rows[used], n + axis] = size[used]
    decay = np.exp(-order.dt / missing.memory)[:, None, None]
    change, noise = (sparse(n + 6, [(there, there, v * np.eye(6))]) for v in (decay - 1.0, 1.0 - decay**2))
    return replace(
        steps,
        design=design,
        change=joined(steps.change, change, n + 6),
        noise=joined(steps.noise, noise, n + 6),
        start=start,
    )


def strength(flow: Flow, missing: Missing) -> Array:
    """By how much both are larger or smaller at each node than their size says."""
    q = flow.dynamic_pressure
    return q / np.max(q) if missing.with_pressure else np.ones_like(q)


def most_likely(value: Callable[[Missing], float]) -> tuple[Missing, float]:
    """The missing force and moment under which a flight is most likely, and its log-likelihood, `value` of it.

    Sizes are searched one after the other on their grid, for each memory; then the best is refined by a factor.
    """
    kinds = [(memory, with_pressure) for with_pressure in (False, True) for memory in MEMORIES]
    searched = [_sized(value, *kind) for kind in kinds]
    best, found = max([(Missing(), value(Missing())), *searched], key=lambda pair: pair[1])
    for name in ("moment", "force"):
        for factor in (3.0, 1.0 / 3.0):
            if (v := value(other := replace(best, **{name: getattr(best, name) * factor}))) > found:
                best, found = other, v
    return best, found


def _sized(value: Callable[[Missing], float], memory: float, with_pressure: bool) -> tuple[Missing, float]:
    """Sizes of moment, then of force, that make `value` greatest."""
    best = Missing(0.0, 0.0, memory, with_pressure)
    at = value(best)
    for name, sizes in (("moment", MOMENTS), ("force", FORCES)):
        for size in sizes[1:]:
            other = replace(best, moment=size) if name == "moment" else replace(best, force=size)
            if (v := value(other)) <= at:
                break
            best, at = other, v
    return best, at
