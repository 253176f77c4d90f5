"""Unmodelled acceleration: a force and moment, or an error of an IMU, that follow no named effect.

The hypothesis is one of three forms of stochastic processes, each with one correlation time:

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
error of one IMU
    The difference of the readings of two IMUs has a first-order Gauss–Markov process per axis, with one amplitude for
    the accelerometers and one for the gyros: a drift that no constant error of a sensor has (bias instability: IEEE Std
    952, annex C).

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

import numpy as np

from edl_filter.diagnosis.prediction.predicted_readings import bin_average, triangular_integral
from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.types import FlightCondition
from edl_filter.estimation.linear_state_space import LinearStateSpace, append_constant_states, with_gauss_markov_states
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.results.verdicts import Form
from edl_filter.types import Array

#: Factor by which the amplitudes on the grid are refined.
_REFINEMENT = 3.0
#: Gain of an amplitude below which it is zero, nats: the penalty of one parameter (Akaike, IEEE TAC 19 (1974) 716).
_LEAST_GAIN = 1.0


@dataclass(frozen=True)
class UnmodelledAcceleration:
    """Parameters of the process.

    Attributes
    ----------
    force, moment : float
        One sigma per axis of the specific force (m/s²) and of the angular acceleration (rad/s²), at the flight's
        largest dynamic pressure if they are proportional to it. Zero: none. In proportion to rate or angle, they are
        one sigma at one rad/s or rad. As an error of one IMU, they are those of its accelerometers (m/s²) and of its
        gyros (rad/s).
    memory : float
        Correlation time, s.
    with_pressure : bool
        Whether both are proportional to the dynamic pressure.
    form : Form
        What they act on, or in proportion to what.
    """

    force: float = 0.0
    moment: float = 0.0
    memory: float = 1.0
    with_pressure: bool = False
    form: Form = Form.BODY

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
    if unmodelled.form is Form.IMU:
        columns = _drift_columns(index, unmodelled)
    else:
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


def _drift_columns(index: RowIndex, unmodelled: UnmodelledAcceleration) -> Array:
    """Derivatives ``(R, 6 p)`` of the residuals with respect to one sigma of the drift of p checking IMUs."""
    rows_of_imus = index.bin_rows[:, 6:]
    columns = np.zeros((index.count, rows_of_imus.shape[1]))
    for column, rows in enumerate(rows_of_imus.T):
        columns[rows[rows >= 0], column] = unmodelled.force if column % 6 < 3 else unmodelled.moment
    return columns


def accelerations(flow: FlightCondition, unmodelled: UnmodelledAcceleration) -> Array:
    """Specific force (m/s²) and angular acceleration (rad/s²) of one sigma of each process that acts on the vehicle.

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
    if unmodelled.form is Form.BODY:
        return scale[:, None, None] * np.diag(np.repeat(sizes, 3))
    of_rate = unmodelled.form is Form.RATE
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
    amplitudes, is_error = (unmodelled.force, unmodelled.moment), unmodelled.form is Form.IMU
    names = ("accelerometers", "gyros") if is_error else ("a force", "a moment")
    acting = " and ".join(name for name, size in zip(names, amplitudes, strict=True) if size > 0.0)
    if is_error:
        return f"a drift of the {acting} of one IMU"
    quantities = [unmodelled.form.value] if unmodelled.form.is_regressor else []
    if unmodelled.with_pressure:
        quantities.append("dynamic pressure")
    fixed = "" if unmodelled.form.is_regressor else f" {unmodelled.form}"
    return f"{acting}{fixed}" + (f" in proportion to the {' and to the '.join(quantities)}" if quantities else "")


def largest_sigmas(flow: FlightCondition, unmodelled: UnmodelledAcceleration) -> tuple[float, float, float]:
    """Largest one sigma of an axis during the flight.

    Returns
    -------
    specific_force : float
        m/s²; as an error of one IMU, that of its accelerometers.
    angular_acceleration : float
        rad/s².
    rate : float
        Of the gyros of one IMU, rad/s.
    """
    if unmodelled.form is Form.IMU:
        return unmodelled.force, 0.0, unmodelled.moment
    sigma = np.sqrt(np.sum(accelerations(flow, unmodelled) ** 2, axis=2))
    return float(np.max(sigma[:, :3])), float(np.max(sigma[:, 3:])), 0.0


def most_likely_process(
    log_likelihood: Callable[[UnmodelledAcceleration], float], settings: DecisionSettings
) -> tuple[UnmodelledAcceleration, float]:
    """The process with the largest marginal likelihood, and its evidence.

    For each form and correlation time the amplitudes are increased along their grid one after the other, moment first,
    as long as the likelihood increases, and are zero if they gain less than a nat; the best process is refined by a
    factor. A priori all forms and correlation times are equally probable: the evidence is the likelihood less the
    logarithm of their number. The process is zero, with its likelihood, where that is not smaller.

    Parameters
    ----------
    log_likelihood : callable
        Of a process, nats.
    settings : DecisionSettings
        Thresholds of the diagnosis.
    """
    starts = [
        UnmodelledAcceleration(0.0, 0.0, memory, with_pressure, form)
        for form in Form
        for with_pressure in ((False,) if form is Form.IMU else (False, True))
        for memory in _memories(form, settings)
    ]
    none = UnmodelledAcceleration()
    without = log_likelihood(none)
    candidates = [_best_amplitudes(log_likelihood, settings, start, without) for start in starts]
    best, likelihood = max(candidates, key=lambda pair: pair[1])
    for name, _ in _amplitudes(best.form, settings):
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
    """Amplitudes of one form of process with the largest likelihood, from zero amplitudes and their likelihood."""
    best = start
    for name, grid in _amplitudes(start.form, settings):
        without = best, likelihood
        for size in grid:
            candidate = replace(best, moment=size) if name == "moment" else replace(best, force=size)
            if (value := log_likelihood(candidate)) <= likelihood:
                break
            best, likelihood = candidate, value
        if likelihood - without[1] < _LEAST_GAIN:
            best, likelihood = without
    return best, likelihood


def _memories(form: Form, settings: DecisionSettings) -> tuple[float, ...]:
    """Correlation times that are tried, s."""
    if form is Form.BODY:
        return settings.unmodelled_memories_s
    return settings.unmodelled_drift_memories_s if form is Form.IMU else settings.unmodelled_factor_memories_s


def _amplitudes(form: Form, settings: DecisionSettings) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Amplitudes, in the order of the search, with their grids."""
    if form is Form.BODY:
        return ("moment", settings.unmodelled_moments), ("force", settings.unmodelled_forces)
    if form is Form.IMU:
        return ("moment", settings.unmodelled_rate_drifts), ("force", settings.unmodelled_force_drifts)
    return ("moment", settings.unmodelled_factors), ("force", settings.unmodelled_factors)
