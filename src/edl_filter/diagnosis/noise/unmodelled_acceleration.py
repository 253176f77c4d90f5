"""Unmodelled acceleration: the hypothesis of a force and moment that follow no named effect.

Either of two kinds of stochastic processes, each with one correlation time:

fixed to the body
    Every axis of force and moment is an independent first-order Gauss–Markov process (Tapley, Schutz and Born,
    Statistical Orbit Determination, 2004, section 4.9), constant or proportional to the dynamic pressure, with one
    amplitude for the force and one for the moment.
proportional to a regressor
    The lateral force and moment are the products of a regressor, the lateral rate or the direction of the flow, and of
    factors that are first-order Gauss–Markov processes, with one amplitude for the force and one for the moment. A
    moment of 1e-4 rad/s² that keeps its phase over a hundred oscillations is significant, and a process that is fixed
    to the body cannot have it: this is a test for regressors that the model omits (model structure determination: Klein
    and Morelli, Aircraft System Identification, 2006, chapter 5).

With the lateral components (y, z) of the regressor, which are those of the angular rate (q, r) or the direction cosines
(v, w) / V of the flow, force and moment are along (y, z) and across it, along (-z, y). In proportion to the dynamic
pressure, the force along and the moment across the direction of the flow, and the moment along the rate, are those of
the database and of effects of the catalogue (normal force, static stability, damping). The others are the side force
and the Magnus moment with the angle of attack, a force and a moment across the rate.

Amplitudes and correlation time maximise the marginal likelihood over a grid. A named effect must explain the flight
better than this hypothesis, or reduce it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from edl_filter.diagnosis.prediction.predicted_readings import bin_average, triangular_integral
from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.types import FlightCondition
from edl_filter.estimation.linear_state_space import LinearStateSpace, append_constant_states, with_gauss_markov_states
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array

#: Factor by which the amplitudes on the grid are refined.
_REFINEMENT = 3.0
#: Gain of an amplitude below which it is zero, nats: the price of one parameter (Akaike, IEEE TAC 19 (1974) 716).
_LEAST_GAIN = 1.0


class Regressor(StrEnum):
    """Quantity to which the unmodelled force and moment are proportional."""

    NONE = "none"
    RATE = "angular rate"
    ANGLE = "angle of attack"


@dataclass(frozen=True)
class UnmodelledAcceleration:
    """Parameters of the process.

    Attributes
    ----------
    force, moment : float
        One sigma per axis of the specific force (m/s²) and of the angular acceleration (rad/s²), at the flight's
        largest dynamic pressure if they are proportional to it. Zero: none. With a regressor, they are one sigma for a
        regressor of one, rad/s or rad.
    memory : float
        Correlation time, s.
    with_pressure : bool
        Whether both are proportional to the dynamic pressure.
    regressor : Regressor
        Quantity to which both are proportional.
    """

    force: float = 0.0
    moment: float = 0.0
    memory: float = 1.0
    with_pressure: bool = False
    regressor: Regressor = Regressor.NONE

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
    """The state-space model with the processes of an unmodelled force and moment, in sigmas, as its last states."""
    if unmodelled.is_zero:
        return model
    at_nodes = accelerations(flow, unmodelled)
    columns = np.zeros((index.count, at_nodes.shape[2]))
    sizes = (bin_average(at_nodes[:, :3], bins), triangular_integral(at_nodes[:, 3:], bins))
    for first, size in zip((0, 3), sizes, strict=True):
        rows = index.bin_rows[: len(size), first : first + 3]
        used = rows >= 0
        columns[rows[used]] = size[used]
    one_sigma = np.ones(columns.shape[1])
    constant = append_constant_states(model, columns, one_sigma)
    return with_gauss_markov_states(constant, index.step_interval, unmodelled.memory * one_sigma, one_sigma)


def accelerations(flow: FlightCondition, unmodelled: UnmodelledAcceleration) -> Array:
    """Specific force (m/s²) and angular acceleration (rad/s²) of one sigma of each process.

    Parameters
    ----------
    flow : FlightCondition
        M nodes.
    unmodelled : UnmodelledAcceleration
        With c processes: one for each axis, or for each direction along and across a regressor.

    Returns
    -------
    (M, 6, c) array
    """
    scale = flow.dynamic_pressure / np.max(flow.dynamic_pressure) if unmodelled.with_pressure else 1.0
    scale = np.broadcast_to(scale, flow.dynamic_pressure.shape)
    sizes = (unmodelled.force, unmodelled.moment)
    if unmodelled.regressor is Regressor.NONE:
        return scale[:, None, None] * np.diag(np.repeat(sizes, 3))
    of_rate = unmodelled.regressor is Regressor.RATE
    y, z = scale * (flow.rate[:, 1:] if of_rate else flow.velocity_body[:, 1:] / flow.speed[:, None]).T
    along, across = (y, z), (-z, y)
    of_force = of_moment = [along, across]
    if unmodelled.with_pressure:
        of_force, of_moment = [across], [across if of_rate else along]
    count = len(of_force)
    out = np.zeros((len(scale), 6, 2 * count))
    for row, column, size, directions in ((1, 0, sizes[0], of_force), (4, count, sizes[1], of_moment)):
        out[:, row : row + 2, column : column + count] = size * np.transpose(directions, (2, 1, 0))
    return out


def in_words(unmodelled: UnmodelledAcceleration) -> str:
    """What acts, and in proportion to what."""
    names = ("force", unmodelled.force), ("moment", unmodelled.moment)
    text = "a " + " and a ".join(name for name, size in names if size > 0.0)
    quantities = [] if unmodelled.regressor is Regressor.NONE else [unmodelled.regressor.value]
    if not quantities:
        text += " fixed to the body"
    if unmodelled.with_pressure:
        quantities.append("dynamic pressure")
    return f"{text} in proportion to the {' and to the '.join(quantities)}" if quantities else text


def largest_sigmas(flow: FlightCondition, unmodelled: UnmodelledAcceleration) -> tuple[float, float]:
    """Largest one sigma of an axis during the flight: of the specific force (m/s²), of the angular acceleration."""
    sigma = np.sqrt(np.sum(accelerations(flow, unmodelled) ** 2, axis=2))
    return float(np.max(sigma[:, :3])), float(np.max(sigma[:, 3:]))


def most_likely_process(
    log_likelihood: Callable[[UnmodelledAcceleration], float], settings: DecisionSettings
) -> tuple[UnmodelledAcceleration, float]:
    """The process with the largest marginal likelihood, and its evidence.

    For each kind and correlation time the amplitudes are increased along their grid one after the other, moment first,
    as long as the likelihood increases, and are zero if they gain less than a nat; the best process is refined by a
    factor. A priori all kinds and correlation times are equally probable: the evidence is the likelihood less the
    logarithm of their number. The process is zero, with its likelihood, where that is not smaller.

    Parameters
    ----------
    log_likelihood : callable
        Of a process, nats.
    settings : DecisionSettings
        Thresholds of the diagnosis.
    """
    starts = [
        UnmodelledAcceleration(0.0, 0.0, memory, with_pressure, regressor)
        for regressor in Regressor
        for with_pressure in (False, True)
        for memory in _memories(regressor, settings)
    ]
    none = UnmodelledAcceleration()
    without = log_likelihood(none)
    candidates = [_best_amplitudes(log_likelihood, settings, start, without) for start in starts]
    best, likelihood = max(candidates, key=lambda pair: pair[1])
    for name, _ in _amplitudes(best.regressor, settings):
        for factor in (_REFINEMENT, 1.0 / _REFINEMENT):
            candidate = replace(best, **{name: getattr(best, name) * factor})
            if (value := log_likelihood(candidate)) > likelihood:
                best, likelihood = candidate, value
    evidence = likelihood - float(np.log(len(starts)))
    return (best, evidence) if evidence > without else (none, without)


def _best_amplitudes(
    log_likelihood: Callable[[UnmodelledAcceleration], float],
    settings: DecisionSettings,
    start: UnmodelledAcceleration,
    likelihood: float,
) -> tuple[UnmodelledAcceleration, float]:
    """Amplitudes of one kind of process with the largest likelihood, from zero amplitudes and their likelihood."""
    best = start
    for name, grid in _amplitudes(start.regressor, settings):
        without = best, likelihood
        for size in grid:
            candidate = replace(best, moment=size) if name == "moment" else replace(best, force=size)
            if (value := log_likelihood(candidate)) <= likelihood:
                break
            best, likelihood = candidate, value
        if likelihood - without[1] < _LEAST_GAIN:
            best, likelihood = without
    return best, likelihood


def _memories(regressor: Regressor, settings: DecisionSettings) -> tuple[float, ...]:
    """Correlation times that are tried, s."""
    return settings.unmodelled_memories_s if regressor is Regressor.NONE else settings.unmodelled_factor_memories_s


def _amplitudes(regressor: Regressor, settings: DecisionSettings) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Amplitudes, in the order of the search, with their grids."""
    if regressor is Regressor.NONE:
        return ("moment", settings.unmodelled_moments), ("force", settings.unmodelled_forces)
    return ("moment", settings.unmodelled_factors), ("force", settings.unmodelled_factors)
