"""What effects add to the nominal loads, as the kernel takes it: numbers at the beginning, middle and end of steps.

Hooks are Python, vectorised over time, and may do anything; the kernel cannot call them. So a window of the flight is
integrated with assumed increments, the hooks are asked along that flight, and it is integrated again until nothing
changes (Picard's iteration). Coefficients go over with their slopes over the angle, which makes the iteration nearly
Newton's: what most effects follow within a window is the angle.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.effects.effect import Active, Flow, Totals
from edl_filter.effects.world import World
from edl_filter.simulation.dynamics import INCREMENTS

Array = NDArray[np.float64]

#: Step of the angle for the slopes, rad.
_STEP = 1e-5
#: Change of the increments, relative to their largest, at which the iteration ends; and the least change that counts.
TOLERANCE, _FLOOR = 1e-9, (1e-12, 1e-7)
NOTHING = np.zeros((1, INCREMENTS))


@dataclass(frozen=True)
class Increments:
    """The effects of a world whose hooks the kernel needs told.

    Attributes
    ----------
    world : World
    shaping, pushing : tuple of Active
        Those that change coefficients, and those that add a force and moment.
    """

    world: World
    shaping: tuple[Active, ...]
    pushing: tuple[Active, ...]

    @classmethod
    def of(cls, world: World) -> Increments:
        """Of all effects that are on."""
        return cls(
            world,
            tuple(a for a in world.effects if a.effect.acts("coefficients")),
            tuple(a for a in world.effects if a.effect.acts("force_moment")),
        )

    @property
    def needed(self) -> bool:
        """Whether there are any."""
        return bool(self.shaping or self.pushing)

    def at(self, time: Array, states: Array) -> Array:
        """Increments ``(N, 17)`` (`edl_filter.simulation.dynamics.INCREMENTS`) at times (N,), states (N, 13+)."""
        n = len(time)
        flow = self.world.flow(time, states[:, :3], states[:, 3:6], states[:, 6:10], states[:, 10:13])
        out = np.zeros((n, INCREMENTS))
        out[:, 16] = flow.alpha_total
        if self.shaping:
            change = self._coefficients(_twice(flow))
            out[:, :5] = change[:n]
            out[:, 5:10] = (change[n:] - change[:n]) / _STEP
        for a in self.pushing:
            force, moment = a.effect.force_moment(a.values, flow)
            out[:, 10:13] += force
            out[:, 13:16] += moment
        return out

    def _coefficients(self, flow: Flow) -> Array:
        """Change of the five coefficients, ``(N, 5)``."""
        n, world = len(flow.time), self.world
        ca, cn, cm = world.database.at(flow.mach, flow.knudsen, flow.speed).evaluate(flow.alpha_total)
        base = Totals(ca, cn, cm, np.zeros(n), world.damping.at(flow.mach))
        totals = base
        for a in self.shaping:
            totals = a.effect.coefficients(a.values, flow, totals)
        return np.column_stack([getattr(totals, f.name) - getattr(base, f.name) for f in fields(Totals)])


def with_middles(step: float, state: Array, slope: Array) -> Array:
    """States at the beginnings, middles and ends of steps, ``(2 n + 1, 13)``; the middles by cubic Hermite, order 4.

    Parameters
    ----------
    step : float
        s.
    state, slope : (n + 1, 13 or more) arrays
    """
    out = np.empty((2 * len(state) - 1, 13))
    out[::2] = state[:, :13]
    d = slope[:, :13]
    out[1::2] = 0.5 * (out[:-2:2] + out[2::2]) + step / 8.0 * (d[:-1] - d[1:])
    out[1::2, 6:10] = rotations.normalise(out[1::2, 6:10])
    return out


def change(used: Array, found: Array) -> float:
    """Largest difference between the increments that were used and those found, relative; 1 is the tolerance."""
    off = (found[:, 16] - used[:, 16])[:, None]
    coefficients = used[:, :5] + used[:, 5:10] * off
    largest = 0.0
    for a, b, floor in ((coefficients, found[:, :5], _FLOOR[0]), (used[:, 10:16], found[:, 10:16], _FLOOR[1])):
        scale = np.max(np.abs(b), axis=0, initial=0.0) * TOLERANCE + floor
        largest = max(largest, float(np.max(np.abs(a - b) / scale)))
    return largest


def _twice(flow: Flow) -> Flow:
    """The flow, and after it the same flow at a slightly larger angle."""
    values = {f.name: getattr(flow, f.name) for f in fields(Flow)}
    twice: dict[str, Any] = {k: np.concatenate((x, x)) for k, x in values.items() if isinstance(x, np.ndarray)}
    both = replace(flow, **twice)
    both.alpha_total[len(flow.time) :] += _STEP
    return both
