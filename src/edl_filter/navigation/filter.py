"""The way forwards through the flight: predict to each epoch, fuse what is known there, keep it all.

Epochs are the constraints' times, the changes of the driving instrument, the mission's times of interest
and a regular grid between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from edl_filter.errors import InputError
from edl_filter.navigation import initial as entry_state
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.layout import ONBOARD, Layout, State
from edl_filter.navigation.ukf import ErrorStateUKF, Innovation, Transition
from edl_filter.planet import Planet
from edl_filter.telemetry.record import InitialState, SensorErrors

Array = NDArray[np.float64]
SAME_TIME = 2e-6  # s: times nearer than this are one


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
    """

    alpha: float = 0.5
    beta: float = 2.0
    kappa: float = 0.0
    longest_interval: float = 5.0
    gate_probability: float = 0.99999


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
        By time.
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
    """The filter at one epoch, after all that was known there.

    Attributes
    ----------
    time : float
    unit : int
        Instrument that drives from here on.
    arrival : Transition or None
        How it came here from the node before.
    state, covariance : State, (n, n) array
        After the updates.
    """

    time: float
    unit: int
    arrival: Transition | None
    state: State
    covariance: Array


@dataclass(frozen=True)
class Fused:
    """One constraint as it was met on the way forwards.

    Attributes
    ----------
    constraint : Constraint
    node : int
        Index of the epoch.
    innovation : Innovation
    accepted : bool
    """

    constraint: Constraint
    node: int
    innovation: Innovation
    accepted: bool


@dataclass(frozen=True)
class Forward:
    """The way forwards.

    Attributes
    ----------
    layout : Layout
    nodes : list of Node
    fused : list of Fused
    """

    layout: Layout
    nodes: list[Node]
    fused: list[Fused]


def pose(
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
    times : sequence of float
        Further epochs of interest, s; those outside the samples are ignored.

    Raises
    ------
    InputError
        A constraint outside the telemetry, or an initial state outside it.
    """
    first, last = samples.time[0] - samples.interval[0], samples.time[-1]
    if not first - 1e-6 <= initial.time < last:
        raise InputError(
            f"initial_state: its time {initial.time:g} s is outside the telemetry, {first:g} to {last:g} s."
        )
    for c in constraints:
        if not initial.time - 1e-6 <= c.time <= last + 1e-6:
            raise InputError(
                f"constraints.{c.name}: its time {c.time:g} s is outside the reconstruction, "
                f"{initial.time:g} to {last:g} s."
            )
    wanted = [initial.time, *(c.time for c in constraints), *(t for t in times if initial.time < t < last)]
    samples = samples.split(np.array(wanted))
    samples = samples.part(samples.index(initial.time), len(samples.time))
    changes = samples.time[np.flatnonzero(np.diff(samples.unit))]
    epochs = merge(np.array([*wanted, *changes, last]))
    grid = np.arange(epochs[0], last, settings.longest_interval)
    regular = samples.time[[max(samples.index(t) - 1, 0) for t in grid]]
    far = [t for t in regular if np.min(np.abs(epochs - t)) > 0.25 * settings.longest_interval]
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
    """Sorted times, those within `SAME_TIME` of each other taken as one."""
    ordered = np.sort(times)
    return ordered[np.concatenate(([True], np.diff(ordered) > SAME_TIME))]


def forward(problem: Problem) -> Forward:
    """Walk through the flight once.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    Forward
    """
    unit = int(problem.samples.unit[0])
    state, covariance = entry_state.start(
        problem.layout, problem.initial, problem.entry, problem.instruments[unit], problem.planet
    )
    start = Node(problem.initial.time, unit, None, state, covariance)
    return _march(problem, start, problem.constraints, [], [])


def forward_without(problem: Problem, way: Forward, name: str) -> Forward:
    """Walk again without the constraints called `name`, from the epoch before the first of them on.

    Parameters
    ----------
    problem : Problem
    way : Forward
        With all constraints; what lies before the first left-out one is taken from it.
    name : str
    """
    first = min(f.node for f in way.fused if f.constraint.name == name)
    if first == 0:
        return forward(replace(problem, constraints=_others(problem.constraints, name)))
    nodes, fused = way.nodes[:first], [f for f in way.fused if f.node < first]
    later = tuple(c for c in problem.constraints if c.time > nodes[-1].time + SAME_TIME)
    return _march(problem, nodes[-1], _others(later, name), nodes, fused)


def _others(constraints: tuple[Constraint, ...], name: str) -> tuple[Constraint, ...]:
    return tuple(c for c in constraints if c.name != name)


def _march(
    problem: Problem, start: Node, constraints: tuple[Constraint, ...], nodes: list[Node], fused: list[Fused]
) -> Forward:
    """Go on from `start` through the epochs that are left; `nodes` and `fused` hold what was before."""
    samples, settings, unit = problem.samples, problem.settings, start.unit
    ukf = ErrorStateUKF(
        problem.layout,
        start.state,
        start.covariance,
        problem.planet,
        settings.alpha,
        settings.beta,
        settings.kappa,
    )
    nodes, fused, pending = list(nodes), list(fused), list(constraints)
    done = samples.index(start.time)
    left = problem.epochs if not nodes else problem.epochs[problem.epochs > start.time + SAME_TIME]
    arrival: Transition | None = None
    for epoch in left:
        stop = samples.index(epoch)
        if stop > done:
            arrival = ukf.advance(samples.part(done, stop))
            done = stop
        while pending and pending[0].time <= epoch + SAME_TIME:
            fused.append(_fuse(ukf, pending.pop(0), len(nodes), settings.gate_probability))
        nodes.append(Node(float(epoch), unit, arrival, ukf.state, ukf.P.copy()))
        if done < len(samples.time) and samples.unit[done] != unit:
            unit = int(samples.unit[done])
            arrival = _change_unit(ukf, problem, unit)
            nodes.append(Node(float(epoch), unit, arrival, ukf.state, ukf.P.copy()))
    return Forward(problem.layout, nodes, fused)


@lru_cache
def quantile(probability: float, dof: int) -> float:
    """Quantile of the chi-square distribution."""
    return float(chdtri(dof, 1.0 - probability))


def _fuse(ukf: ErrorStateUKF, constraint: Constraint, node: int, gate: float) -> Fused:
    """Meet one constraint: predict it, test it, use it if it passes."""
    sigmas = ukf.sigmas_f
    nav, errors = ukf.states(sigmas)
    predicted = constraint.predict(nav, errors, ukf.layout)
    innovation = ukf.innovate(constraint.measured, constraint.noise, predicted)
    accepted = innovation.nis <= quantile(gate, len(innovation.residual))
    if accepted:
        ukf.absorb(constraint.measured, constraint.noise, predicted)
    return Fused(constraint, node, innovation, bool(accepted))


def _change_unit(ukf: ErrorStateUKF, problem: Problem, unit: int) -> Transition:
    """Let another instrument drive: its errors are new, and its attitude on board is another."""
    layout = ukf.layout
    sensor = layout.sensor
    keep = np.eye(layout.size)
    keep[sensor, sensor] = 0.0
    noise = np.zeros_like(keep)
    noise[sensor, sensor] = entry_state.sensor_prior(layout, problem.instruments[unit])
    if ONBOARD in layout:
        where = layout[ONBOARD]
        noise[where, where] = problem.unit_change_sigma**2 * np.eye(3)
    errors = ukf.state.errors.copy()
    errors[sensor] = 0.0
    for name, sigma in problem.entry.instrument_prior(layout).items():
        where = layout[name]
        keep[where, where] = 0.0
        noise[where, where] = sigma**2 * np.eye(3)
        errors[where] = 0.0
    return ukf.replace(keep, noise, errors)
