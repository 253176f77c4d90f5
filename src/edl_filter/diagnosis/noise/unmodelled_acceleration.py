"""Unmodelled acceleration: the hypothesis of a force and moment that follow no named effect.

Body-fixed, each axis an independent first-order Gauss–Markov process (Tapley, Schutz and Born, Statistical Orbit
Determination, 2004, section 4.9) with one amplitude for the force and one for the moment, one correlation time, and
constant or proportional to the dynamic pressure. Amplitudes and correlation time maximise the marginal likelihood over
a grid. A named effect must explain the flight better than this hypothesis, or reduce it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.prediction.predicted_readings import bin_average, triangular_integral
from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.types import FlightCondition
from edl_filter.estimation.linear_state_space import LinearStateSpace, append_constant_states, with_gauss_markov_states
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array

#: Number of states: the axes of force and moment.
_STATES = 6
#: Factor by which the amplitudes on the grid are refined.
_REFINEMENT = 3.0


@dataclass(frozen=True)
class UnmodelledAcceleration:
    """Parameters of the process.

    Attributes
    ----------
    force, moment : float
        One sigma per axis of the specific force (m/s²) and of the angular acceleration (rad/s²), at the flight's
        largest dynamic pressure if they are proportional to it. Zero: none.
    memory : float
        Correlation time, s.
    with_pressure : bool
        Whether both are proportional to the dynamic pressure.
    """

    force: float = 0.0
    moment: float = 0.0
    memory: float = 1.0
    with_pressure: bool = False

    @property
    def is_zero(self) -> bool:
        """Whether both amplitudes are zero."""
        return self.force == self.moment == 0.0


def augment(
    model: LinearStateSpace,
    index: RowIndex,
    bins: TimeBins,
    flow: FlightCondition,
    unmodelled: UnmodelledAcceleration,
) -> LinearStateSpace:
    """The state-space model with an unmodelled force and moment as its last states, three each, in sigmas."""
    if unmodelled.is_zero:
        return model
    columns = np.zeros((index.count, _STATES))
    scale = amplitude(flow, unmodelled)
    sizes = (
        unmodelled.force * bin_average(scale, bins),
        unmodelled.moment * triangular_integral(scale, bins),
    )
    for first, size in zip((0, 3), sizes, strict=True):
        for axis in range(first, first + 3):
            rows = index.bin_rows[: len(size), axis]
            used = rows >= 0
            columns[rows[used], axis] = size[used]
    constant = append_constant_states(model, columns, np.ones(_STATES))
    memory = np.full(_STATES, unmodelled.memory)
    return with_gauss_markov_states(constant, index.step_interval, memory, np.ones(_STATES))


def amplitude(flow: FlightCondition, unmodelled: UnmodelledAcceleration) -> Array:
    """Amplitude at each node ``(M,)``, relative to its value at the largest dynamic pressure."""
    q = flow.dynamic_pressure
    return q / np.max(q) if unmodelled.with_pressure else np.ones_like(q)


def most_likely_process(
    log_likelihood: Callable[[UnmodelledAcceleration], float], settings: DecisionSettings
) -> tuple[UnmodelledAcceleration, float]:
    """The process with the largest marginal likelihood, and that likelihood.

    For each correlation time the amplitudes are increased along their grid one after the other, moment first, as long
    as the likelihood increases; the best process is refined by a factor.

    Parameters
    ----------
    log_likelihood : callable
        Of a process, nats.
    settings : DecisionSettings
        Thresholds of the diagnosis.
    """
    kinds = [(memory, pressure) for pressure in (False, True) for memory in settings.unmodelled_memories_s]
    candidates = [_best_amplitudes(log_likelihood, settings, *kind) for kind in kinds]
    none = UnmodelledAcceleration()
    best, likelihood = max([(none, log_likelihood(none)), *candidates], key=lambda pair: pair[1])
    for name in ("moment", "force"):
        for factor in (_REFINEMENT, 1.0 / _REFINEMENT):
            candidate = replace(best, **{name: getattr(best, name) * factor})
            if (value := log_likelihood(candidate)) > likelihood:
                best, likelihood = candidate, value
    return best, likelihood


def _best_amplitudes(
    log_likelihood: Callable[[UnmodelledAcceleration], float],
    settings: DecisionSettings,
    memory: float,
    with_pressure: bool,
) -> tuple[UnmodelledAcceleration, float]:
    """Amplitudes of moment, then of force, with the largest likelihood for one correlation time."""
    best = UnmodelledAcceleration(0.0, 0.0, memory, with_pressure)
    likelihood = log_likelihood(best)
    for name, grid in (("moment", settings.unmodelled_moments), ("force", settings.unmodelled_forces)):
        for size in grid:
            candidate = replace(best, moment=size) if name == "moment" else replace(best, force=size)
            if (value := log_likelihood(candidate)) <= likelihood:
                break
            best, likelihood = candidate, value
    return best, likelihood
