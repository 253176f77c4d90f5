"""Increments of effects over the nominal loads, at the beginning, middle and end of every step of the kernel.

Hooks are Python functions, vectorised over time; the kernel cannot call them. So a window of the flight is integrated
with assumed increments, the hooks are evaluated along that trajectory, and the window is integrated again until the
increments converge (Picard iteration). Coefficients have their slopes by the angle, which makes the iteration nearly
that of Newton: within a window, the increments of most effects depend mainly on the angle.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import ForwardModel, compose_coefficients, compose_loads
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.simulation.dynamics import INCREMENTS
from edl_filter.types import Array

#: Step of the angle for the slopes, rad.
_STEP = 1e-5
#: Change of the increments at which the iteration ends: relative to the largest, and absolute (coefficients; N, N m).
TOLERANCE, _FLOOR = 1e-9, (1e-12, 1e-7)
NOTHING = np.zeros((1, INCREMENTS))


@dataclass(frozen=True)
class Increments:
    """The effects of a model whose hooks the kernel cannot evaluate.

    Attributes
    ----------
    forward_model : ForwardModel
    on_coefficients, on_loads : tuple of EffectInstance
        Those that change coefficients, and those that add a force and moment.
    """

    forward_model: ForwardModel
    on_coefficients: tuple[EffectInstance, ...]
    on_loads: tuple[EffectInstance, ...]

    @classmethod
    def of(cls, forward_model: ForwardModel) -> Increments:
        """Increments of all effects of a model."""
        return cls(
            forward_model,
            tuple(a for a in forward_model.effects if a.effect.acts("coefficients")),
            tuple(a for a in forward_model.effects if a.effect.acts("force_moment")),
        )

    @property
    def needed(self) -> bool:
        """Whether any effect has increments."""
        return bool(self.on_coefficients or self.on_loads)

    def at(self, time: Array, states: Array) -> Array:
        """Increments along a trajectory.

        Parameters
        ----------
        time : (N,) array
            s.
        states : (N, 13 or more) array
            As in `edl_filter.simulation.dynamics`.

        Returns
        -------
        (N, 17) array
            As `edl_filter.simulation.dynamics.INCREMENTS` says.
        """
        n = len(time)
        flow = self.forward_model.flow(time, states[:, :3], states[:, 3:6], states[:, 6:10], states[:, 10:13])
        out = np.zeros((n, INCREMENTS))
        out[:, 16] = flow.alpha_total
        if self.on_coefficients:
            change = self._coefficients(_twice(flow))
            out[:, :5] = change[:n]
            out[:, 5:10] = (change[n:] - change[:n]) / _STEP
        out[:, 10:13], out[:, 13:16] = compose_loads(out[:, 10:13], out[:, 13:16], self.on_loads, flow)
        return out

    def _coefficients(self, flow: FlightCondition) -> Array:
        """Change of the five coefficients, ``(N, 5)``."""
        n, forward_model = len(flow.time), self.forward_model
        ca, cn, cm = forward_model.database.at(flow.mach, flow.knudsen, flow.speed).evaluate(flow.alpha_total)
        base = AeroCoefficients(ca, cn, cm, np.zeros(n), forward_model.damping.at(flow.mach))
        totals = compose_coefficients(base, self.on_coefficients, flow)
        return np.column_stack([getattr(totals, f.name) - getattr(base, f.name) for f in fields(AeroCoefficients)])


def with_middles(step: float, state: Array, slope: Array) -> Array:
    """States at the beginnings, middles and ends of steps; the middles by cubic Hermite interpolation, of order 4.

    Parameters
    ----------
    step : float
        s.
    state, slope : (n + 1, 13 or more) arrays
        States at the ends of n steps, and their derivatives by time.

    Returns
    -------
    (2 n + 1, 13) array
    """
    out = np.empty((2 * len(state) - 1, 13))
    out[::2] = state[:, :13]
    d = slope[:, :13]
    out[1::2] = 0.5 * (out[:-2:2] + out[2::2]) + step / 8.0 * (d[:-1] - d[1:])
    out[1::2, 6:10] = rotations.normalise(out[1::2, 6:10])
    return out


def change(used: Array, evaluated: Array) -> float:
    """Largest difference of increments from those of the iteration before, in units of the tolerance.

    Parameters
    ----------
    used, evaluated : (N, 17) arrays
        Increments with which the window was integrated, and those along the resulting trajectory.
    """
    angle = (evaluated[:, 16] - used[:, 16])[:, None]
    coefficients = used[:, :5] + used[:, 5:10] * angle
    largest = 0.0
    for a, b, floor in ((coefficients, evaluated[:, :5], _FLOOR[0]), (used[:, 10:16], evaluated[:, 10:16], _FLOOR[1])):
        scale = np.max(np.abs(b), axis=0, initial=0.0) * TOLERANCE + floor
        largest = max(largest, float(np.max(np.abs(a - b) / scale)))
    return largest


def _twice(flow: FlightCondition) -> FlightCondition:
    """The flow, followed by the same flow at a slightly larger angle."""
    values = {f.name: getattr(flow, f.name) for f in fields(FlightCondition)}
    twice: dict[str, Any] = {k: np.concatenate((x, x)) for k, x in values.items() if isinstance(x, np.ndarray)}
    both = replace(flow, **twice)
    both.alpha_total[len(flow.time) :] += _STEP
    return both
