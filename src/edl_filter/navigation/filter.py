"""The filter's run through a flight: predict to each epoch, update with what was measured there, store everything.

Epochs are the constraints' times, the changes of the driving instrument, the mission's times of interest
and a regular grid between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.compiled_ukf import CompiledUKF
from edl_filter.navigation.consensus import quantile
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.ekf import ErrorStateEKF
from edl_filter.navigation.estimator import ErrorStateFilter, Innovation, Transition
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.initial import EntryErrors, initial_estimate, sensor_prior
from edl_filter.navigation.layout import ONBOARD, Layout, State
from edl_filter.navigation.outlier_screening import Divergence, Screening
from edl_filter.navigation.robust import Robust, measurement_weight, weighted
from edl_filter.planet import Planet
from edl_filter.telemetry.record import SAME_TIME, InitialState
from edl_filter.types import Array

Engine = Literal["compiled", "filterpy"]

#: Times that differ by less than this are one epoch, s: each may be `SAME_TIME` from the end of one sample, before or
#: after it, and between two epochs at the same sample there would be no motion.
SAME_EPOCH = 2.0 * SAME_TIME


@dataclass(frozen=True)
class Settings:
    """How to filter.

    Attributes
    ----------
    alpha, beta, kappa : float
        Of the unscented transform.
    longest_interval : float
        Between epochs, s.
    gate_probability : float
        A constraint beyond this quantile of its NIS is not accepted.
    method : str
        ``ukf``: unscented; ``ekf``: extended Kalman filter, which has no use for alpha, beta and kappa.
    robust : str
        Update with a measurement: ``none``: Gaussian; ``huber`` or ``student_t``: see `robust`.
    engine : str
        Of the unscented filter and the smoother: ``compiled``: numba; ``filterpy``: the readable reference. The results
        are the same to rounding. The extended filter has one implementation.
    """

    alpha: float = 0.5
    beta: float = 2.0
    kappa: float = 0.0
    longest_interval: float = 5.0
    gate_probability: float = 0.99999
    method: Literal["ukf", "ekf"] = "ukf"
    robust: Robust = "none"
    engine: Engine = "compiled"


@dataclass(frozen=True)
class Problem:
    """All that the filter needs.

    Attributes
    ----------
    samples : Samples
        From the initial state's time on, with edges at all of `epochs`.
    initial : InitialState
    entry : EntryErrors
    instruments : tuple of SensorErrors
        By the samples' `unit`.
    unit_change_sigma : float
        By how much the on-board attitudes of two instruments differ, rad per axis.
    constraints : tuple of Constraint
        In the order of time.
    epochs : (K,) array
        s, beginning with the initial state's time.
    planet : Planet
    settings : Settings
    """

    samples: Samples
    initial: InitialState
    entry: EntryErrors
    instruments: tuple[SensorErrors, ...]
    unit_change_sigma: float
    constraints: tuple[Constraint, ...]
    epochs: Array
    planet: Planet
    settings: Settings

    @cached_property
    def layout(self) -> Layout:
        """Of the filter's vector."""
        return Layout.of(self.instruments, self.entry.states)


@dataclass(frozen=True)
class Node:
    """The filter at one epoch, after the updates with all that was measured there.

    Attributes
    ----------
    time : float
        s.
    unit : int
        Instrument that drives from this epoch on.
    transition : Transition or None
        From the node before to this one; None at the first node.
    state : State
    covariance : (n, n) array
    """

    time: float
    unit: int
    transition: Transition | None
    state: State
    covariance: Array


@dataclass(frozen=True)
class Fused:
    """One constraint as the filter used it.

    Attributes
    ----------
    constraint : Constraint
    node : int
        Index of the epoch.
    innovation : Innovation
    accepted : bool
        Whether it passed the gate and agrees with the other readings of its instrument, so that the estimate was
        updated with it.
    weight : float
        By which its noise covariance was divided in a robust update; 1 otherwise.
    screened : bool
        Whether it contradicts the other readings of its instrument (`outlier_screening`), whatever its gate says.
    """

    constraint: Constraint
    node: int
    innovation: Innovation
    accepted: bool
    weight: float = 1.0
    screened: bool = False

    @property
    def noise_covariance(self) -> Array:
        """Covariance of the measurement as the update used it, ``(m, m)``."""
        return weighted(self.innovation, self.weight).noise_covariance


@dataclass(frozen=True)
class FilterPass:
    """One run of the filter through the flight.

    Attributes
    ----------
    layout : Layout
    nodes : list of Node
    fused : list of Fused
    divergence : Divergence or None
        The first one.
    engine : str
        As in `Settings`.
    references : list of State, optional
        About which motion and measurements were linearised, one per node (`iterated`); the covariances are those of
        errors about them. None: about the filter's own estimates.
    converged : bool
        False: the path about which it was linearised still moved in the last iteration.
    """

    layout: Layout
    nodes: list[Node]
    fused: list[Fused]
    divergence: Divergence | None = None
    engine: Engine = "compiled"
    references: list[State] | None = None
    converged: bool = True


def build_problem(
    samples: Samples,
    initial: InitialState,
    entry: EntryErrors,
    instruments: tuple[SensorErrors, ...],
    constraints: Sequence[Constraint],
    planet: Planet,
    settings: Settings,
    times: Sequence[float] = (),
    unit_change_sigma: float = 0.0,
) -> Problem:
    """Put a problem together: cut the samples at the epochs and order the constraints.

    Parameters
    ----------
    samples : Samples
        Of the driving instrument.
    initial : InitialState
        Stated state and covariance.
    entry : EntryErrors
        Errors of the entry state in addition to its covariance.
    instruments : tuple of SensorErrors
        By the samples' `unit`.
    constraints : sequence of Constraint
        In any order.
    planet : Planet
        Gravity and rotation.
    settings : Settings
        How to filter.
    times : sequence of float
        Further epochs of interest, s; those outside the samples are ignored.
    unit_change_sigma : float
        As in `Problem`, rad.

    Returns
    -------
    Problem

    Raises
    ------
    InputError
        A constraint outside the telemetry, or an initial state outside it.
    """
    first, last = samples.time[0] - samples.interval[0], samples.time[-1]
    if not first - SAME_TIME <= initial.time < last:
        raise InputError(
            f"initial_state: its time {initial.time:g} s is outside the telemetry, {first:g} to {last:g} s."
        )
    for c in constraints:
        if not initial.time - SAME_TIME <= c.time <= last + SAME_TIME:
            raise InputError(
                f"constraints.{c.name}: its time {c.time:g} s is outside the reconstruction, "
                f"{initial.time:g} to {last:g} s; remove the constraint, or read telemetry that contains its time."
            )
    stops = [initial.time, *(c.time for c in constraints), *(t for t in times if initial.time < t < last)]
    samples = samples.split(np.array(stops))
    samples = samples.part(samples.index(initial.time), len(samples.time))
    epochs = merge(np.array([*stops, *samples.unit_changes, last]))
    grid = np.arange(epochs[0], last, settings.longest_interval)
    regular = samples.time[np.maximum(samples.indices(grid) - 1, 0)]
    far = regular[np.min(np.abs(epochs - regular[:, None]), axis=1) > 0.25 * settings.longest_interval]
    return Problem(
        samples=samples,
        initial=initial,
        entry=entry,
        instruments=instruments,
        unit_change_sigma=unit_change_sigma,
        constraints=tuple(sorted(constraints, key=lambda c: c.time)),
        epochs=merge(np.concatenate((epochs, far))),
        planet=planet,
        settings=settings,
    )


def merge(times: Array) -> Array:
    """Sorted times (K,), s, of which those within `SAME_EPOCH` of each other are taken as one."""
    ordered = np.sort(times)
    return ordered[np.concatenate(([True], np.diff(ordered) > SAME_EPOCH))]


def new_filter(problem: Problem, state: State, covariance: Array) -> ErrorStateFilter:
    """The filter that the problem's settings ask for.

    Parameters
    ----------
    problem : Problem
        Samples, initial state, constraints, settings.
    state : State
        Reference.
    covariance : (n, n) array
        Of the error about it, in the units of `layout.UNITS`.
    """
    s = problem.settings
    if s.method == "ekf":
        return ErrorStateEKF(problem.layout, state, covariance, problem.planet)
    if s.engine == "compiled":
        return CompiledUKF(problem.layout, state, covariance, problem.planet, s.alpha, s.beta, s.kappa)
    from edl_filter.navigation.ukf import ErrorStateUKF  # with filterpy comes scipy.stats, a third of all imports

    return ErrorStateUKF(problem.layout, state, covariance, problem.planet, s.alpha, s.beta, s.kappa)


def run_filter(problem: Problem) -> FilterPass:
    """Run the filter through the whole flight.

    Parameters
    ----------
    problem : Problem
        Samples, initial state, constraints, settings.

    Returns
    -------
    FilterPass

    Raises
    ------
    InputError
        The sigma of the position becomes larger than the planet.
    """
    unit = int(problem.samples.unit[0])
    state, covariance = initial_estimate(
        problem.layout, problem.initial, problem.entry, problem.instruments[unit], problem.planet
    )
    start = Node(problem.initial.time, unit, None, state, covariance)
    return _continue(problem, start, problem.constraints, [], [])


def run_filter_without(problem: Problem, filter_pass: FilterPass, name: str) -> FilterPass:
    """Run the filter without the constraints called `name`.

    Parameters
    ----------
    problem : Problem
        Samples, initial state, constraints, settings.
    filter_pass : FilterPass
        With all constraints; everything before the first omitted constraint is taken from it.
    name : str
        Of the constraints to leave out.

    Returns
    -------
    FilterPass
    """
    first = min(f.node for f in filter_pass.fused if f.constraint.name == name)
    if first == 0:
        return run_filter(replace(problem, constraints=_without(problem.constraints, name)))
    nodes, fused = filter_pass.nodes[:first], [f for f in filter_pass.fused if f.node < first]
    later = tuple(c for c in problem.constraints if c.time > nodes[-1].time + SAME_EPOCH)
    outliers = [f.constraint for f in filter_pass.fused if f.screened]
    return _continue(problem, nodes[-1], _without(later, name), nodes, fused, outliers)


def _without(constraints: tuple[Constraint, ...], name: str) -> tuple[Constraint, ...]:
    return tuple(c for c in constraints if c.name != name)


def _continue(
    problem: Problem,
    start: Node,
    constraints: tuple[Constraint, ...],
    nodes: list[Node],
    fused: list[Fused],
    outliers: Sequence[Constraint] = (),
) -> FilterPass:
    """Run on from `start` through the remaining epochs; `nodes` and `fused` hold what was before.

    `outliers` are readings that the screening of another pass rejected.
    """
    samples, settings, unit = problem.samples, problem.settings, start.unit
    estimator = new_filter(problem, start.state, start.covariance)
    nodes, fused, pending = list(nodes), list(fused), list(constraints)
    done = samples.index(start.time)
    epochs = problem.epochs if not nodes else problem.epochs[problem.epochs > start.time + SAME_EPOCH]
    screening = Screening(
        samples,
        problem.constraints,
        settings.gate_probability,
        lambda at: new_filter(problem, at.state, at.covariance),
        outliers,
    )
    transition: Transition | None = None
    for epoch in epochs:
        stop = samples.index(epoch)
        if stop > done:
            transition = estimator.predict(samples.part(done, stop))
            done = stop
            _check_position_sigma(problem, float(epoch), estimator.covariance)
        while pending and pending[0].time <= epoch + SAME_EPOCH:
            constraint = pending.pop(0)
            innovation = estimator.innovation(constraint)
            outlier = screening.is_outlier(estimator, innovation, constraint, pending)
            accepted = not outlier and innovation.nis <= quantile(settings.gate_probability, len(innovation.residual))
            weight = measurement_weight(innovation, settings.robust) if accepted else 1.0
            if accepted:
                estimator.update(constraint, weighted(innovation, weight))
            fused.append(Fused(constraint, len(nodes), innovation, bool(accepted), weight, outlier))
        nodes.append(Node(float(epoch), unit, transition, estimator.state, estimator.covariance.copy()))
        if done < len(samples.time) and samples.unit[done] != unit:
            unit = int(samples.unit[done])
            transition = _change_unit(estimator, problem, unit)
            nodes.append(Node(float(epoch), unit, transition, estimator.state, estimator.covariance.copy()))
    return FilterPass(problem.layout, nodes, fused, screening.divergence, settings.engine)


def _check_position_sigma(problem: Problem, time: float, covariance: Array) -> None:
    """Raise InputError where the position is less well known than the planet's size: gravity cannot be linearised."""
    variance = covariance[0, 0] + covariance[1, 1] + covariance[2, 2]
    if not variance < problem.planet.equatorial_radius**2:  # NaN too
        raise InputError(
            f"At {time:.3f} s the position has a sigma of {np.sqrt(variance):.3g} m, more than the planet's radius: "
            "the initial state or the telemetry before this time cannot be used. 'edl-filter validate' lists its bad "
            "samples; the largest sigmas are those of filled stretches and of initial_state."
        )


def _change_unit(estimator: ErrorStateFilter, problem: Problem, unit: int) -> Transition:
    """Change the driving instrument."""
    return estimator.transform(*unit_change(problem, unit, estimator.state.errors))


def unit_change(problem: Problem, unit: int, errors: Array) -> tuple[Array, Array, Array]:
    """Change of the driving instrument: its errors start from their prior, and its on-board attitude is another.

    Parameters
    ----------
    problem : Problem
        With the instruments.
    unit : int
        The new one.
    errors : (n,) array
        `State.errors` before the change.

    Returns
    -------
    matrix, noise : (n, n) arrays
        Of the error vector, ``error ← matrix @ error + noise``.
    errors : (n,) array
        `State.errors` after it.
    """
    layout = problem.layout
    sensor = layout.sensor
    matrix = np.eye(layout.size)
    matrix[sensor, sensor] = 0.0
    noise = np.zeros_like(matrix)
    noise[sensor, sensor] = sensor_prior(layout, problem.instruments[unit])
    if ONBOARD in layout:
        block = layout[ONBOARD]
        noise[block, block] = problem.unit_change_sigma**2 * np.eye(3)
    errors = errors.copy()
    errors[sensor] = 0.0
    for name, sigma in problem.entry.instrument_prior(layout).items():
        block = layout[name]
        matrix[block, block] = 0.0
        noise[block, block] = sigma**2 * np.eye(3)
        errors[block] = 0.0
    return matrix, noise, errors
