"""Propagation of the filter's error vector along the path, from epoch to epoch.

The transition matrices are central differences of the filter's own propagation about the path. In bins that are
compared, the gyros' noise is a nuisance parameter (`nuisance`) and not process noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from edl_filter import rotations
from edl_filter.diagnosis.prediction.dead_reckoning import dead_reckon
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.navigation import initial as entry
from edl_filter.navigation import strapdown
from edl_filter.navigation.ekf import difference_steps
from edl_filter.navigation.filter import SAME_EPOCH, Problem, merge
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, State, sensor_maps, sigma_states
from edl_filter.navigation.noise import process_noise_of_intervals
from edl_filter.navigation.propagation import OnboardRotations
from edl_filter.telemetry.record import SAME_TIME
from edl_filter.types import Array, BoolArray, IntArray


@dataclass(frozen=True)
class PathTransitions:
    """Transitions of the filter's error vector from epoch to epoch.

    Attributes
    ----------
    time : (K,) array
        Epochs after the start, s; an epoch at which the driving instrument changes occurs twice.
    transition, process_noise : (K, n, n) arrays
    gyro_noise_time : (K,) array
        Time over which the noise of the current bin's gyros rotates the attitude, s.
    bin : (K,) array of int
        Bin that ends at the epoch, or -1.
    constraints : tuple of tuples of int
        Indices of the constraints at the epoch.
    states : list of State
        The path at the epochs.
    onboard : (C, 4) array or None
        On-board attitude propagated to each constraint.
    """

    time: Array
    transition: Array
    process_noise: Array
    gyro_noise_time: Array
    bin: IntArray
    constraints: tuple[tuple[int, ...], ...]
    states: list[State]
    onboard: Array | None


class _Epoch(NamedTuple):
    """One row of `PathTransitions`."""

    time: float
    transition: Array
    process_noise: Array
    gyro_noise_time: float
    bin: int
    constraints: tuple[int, ...]
    state: State


def propagate_path(problem: Problem, bins: TimeBins, start: State, errors: Array) -> PathTransitions:
    """Propagate the path and its error vector from epoch to epoch.

    Parameters
    ----------
    problem : Problem
        The filter's problem: samples, planet, constraints.
    bins : TimeBins
        Time bins of the comparison.
    start : State
        At the initial state's time, with the first instrument's errors.
    errors : (U, n) array
        Sensor errors by instrument.
    """
    samples = problem.samples
    times = _epoch_times(problem, bins)
    ends = samples.indices(times)
    begins = np.concatenate(([0], ends[:-1]))
    inside = np.searchsorted(bins.edges, times - SAME_TIME) - 1
    compared = (ends > begins) & (inside >= 0) & (inside < len(bins.valid))
    compared[compared] = bins.valid[inside[compared]]
    sample_noise = _without_gyro_noise(samples, _sample_mask(len(samples.time), begins, ends, compared))
    gyro_noise_time = [
        float(samples.interval[a:b].sum()) if c else 0.0 for a, b, c in zip(begins, ends, compared, strict=True)
    ]
    units = samples.unit[np.minimum(begins, len(samples.unit) - 1)]
    nav = dead_reckon(problem, start.nav[:10], errors).nav
    constraint_times = [c.time for c in problem.constraints]
    pending = sorted(range(len(constraint_times)), key=lambda i: constraint_times[i])
    onboard = np.empty((len(constraint_times), 4)) if len(start.nav) == 14 else None
    ending = _same_epoch(times, bins.edges) - 1
    epochs: list[_Epoch] = []
    state = start
    for run in np.split(np.arange(len(times)), np.flatnonzero(np.diff(units)) + 1):
        if epochs:  # another instrument drives from this epoch on
            state, f, q = _change_instrument(problem, state, int(units[run[0]]), errors[units[run[0]]])
            epochs.append(_Epoch(epochs[-1].time, f, q, 0.0, -1, (), state))
        states, transitions = _propagate_run(problem, state, nav, begins[run], ends[run])
        attitudes = np.array([s.nav[6:10] for s in (state, *states[:-1])])
        noise = process_noise_of_intervals(problem.layout, sample_noise, attitudes, begins[run], ends[run])
        for k, end_state, f, q in zip(run, states, transitions, noise, strict=True):
            time, state = float(times[k]), end_state
            at_epoch = []
            while pending and constraint_times[pending[0]] <= time + SAME_EPOCH:
                at_epoch.append(pending.pop(0))
                if onboard is not None:
                    onboard[at_epoch[-1]] = state.nav[10:]
            epochs.append(_Epoch(time, f, q, gyro_noise_time[k], max(int(ending[k]), -1), tuple(at_epoch), state))
    return PathTransitions(
        time=np.array([e.time for e in epochs]),
        transition=np.array([e.transition for e in epochs]),
        process_noise=np.array([e.process_noise for e in epochs]),
        gyro_noise_time=np.array([e.gyro_noise_time for e in epochs]),
        bin=np.array([e.bin for e in epochs]),
        constraints=tuple(e.constraints for e in epochs),
        states=[e.state for e in epochs],
        onboard=onboard,
    )


def _epoch_times(problem: Problem, bins: TimeBins) -> Array:
    """Times of the epochs: bins' ends and constraints up to the last bin's end, all of the filter's epochs after it."""
    epochs = merge(np.concatenate((bins.edges, problem.epochs)))
    after = epochs > bins.edges[-1] + SAME_TIME
    required = np.sort(np.concatenate((bins.edges, [c.time for c in problem.constraints])))
    return np.asarray(epochs[after | (_same_epoch(epochs, required) >= 0)], np.float64)


def _same_epoch(times: Array, ordered: Array) -> IntArray:
    """Index of the value of `ordered` (M,) nearest to each of `times` (N,), s; -1 where none is the same epoch."""
    after = np.clip(np.searchsorted(ordered, times), 1, len(ordered) - 1)
    nearest = after - (times - ordered[after - 1] < ordered[after] - times)
    return np.where(np.abs(ordered[nearest] - times) <= SAME_EPOCH, nearest, -1)


def _sample_mask(count: int, begins: IntArray, ends: IntArray, chosen: BoolArray) -> BoolArray:
    """Mask of `count` samples that lie in the chosen ones of K intervals."""
    mask = np.zeros(count, bool)
    for begin, end in zip(begins[chosen], ends[chosen], strict=True):
        mask[begin:end] = True
    return mask


def _without_gyro_noise(samples: Samples, affected: BoolArray) -> Samples:
    """Samples of which the rate noise of those that are `affected` ``(N,)`` is the motion within the samples alone."""
    root = np.sqrt(samples.interval)[:, None]
    gyro = float(np.min(samples.rate_noise * root)) / root
    motion = np.sqrt(np.maximum(samples.rate_noise**2 - gyro**2, 0.0))
    noise = np.where(affected[:, None], motion, samples.rate_noise)
    return replace(samples, rate_noise=noise, shared_rate_noise=np.minimum(samples.shared_rate_noise, noise))


def _change_instrument(problem: Problem, state: State, unit: int, errors: Array) -> tuple[State, Array, Array]:
    """Replace the sensor-error states by those of another driving instrument, as the filter does."""
    layout = problem.layout
    replaced = [layout.sensor, *(layout[n] for n in problem.entry.instrument_prior(layout))]
    transition, noise = np.eye(layout.size), np.zeros((layout.size, layout.size))
    for part in replaced:
        transition[part, part] = 0.0
    noise[layout.sensor, layout.sensor] = entry.sensor_prior(layout, problem.instruments[unit])
    for name, sigma in problem.entry.instrument_prior(layout).items():
        noise[layout[name], layout[name]] = sigma**2 * np.eye(3)
    if ONBOARD in layout:
        noise[layout[ONBOARD], layout[ONBOARD]] = problem.unit_change_sigma**2 * np.eye(3)
    new_errors = state.errors.copy()
    for part in replaced:
        new_errors[part] = errors[part]
    return State(state.nav, new_errors), transition, noise


def _propagate_run(
    problem: Problem, start: State, nav: Array, begins: IntArray, ends: IntArray
) -> tuple[list[State], Array]:
    """States at the ends of adjoining intervals under one instrument, and the transitions over them.

    Parameters
    ----------
    problem : Problem
        The filter's problem: samples, planet, constraints.
    start : State
        At the beginning of the first interval.
    nav : (N + 1, 10) array
        The path at the ends of all samples.
    begins, ends : (K,) arrays of int
        First sample of each interval, and the one after its last.
    """
    differences = PropagationDifferences.at_state(problem, start, difference_steps(problem.layout))
    turns, attitudes = None, np.empty((len(ends) + 1, 0))
    if len(start.nav) == 14:
        turns = OnboardRotations.over(problem.layout, problem.samples, begins, ends)
        attitudes = differences.onboard_attitudes(start.nav[10:], turns)
    states = np.concatenate((nav[np.append(begins[:1], ends)], attitudes), axis=1)
    transitions = differences.transitions(states[:-1], begins, ends, turns)
    return [State(row, start.errors.copy()) for row in states[1:]], transitions


@dataclass(frozen=True)
class PropagationDifferences:
    """Central differences of the propagation under one instrument, over many intervals at once.

    All displaced states are propagated as the filter propagates its sigma points. What does not depend on the state
    (the maps that correct the sensor errors, the rotation computed on board) is computed once.

    Attributes
    ----------
    problem : Problem
    steps : (n,) array
        Displacement of each component.
    offsets : (2n + 1, n) array
        No displacement, each component increased, each decreased.
    errors : (n, S) array
        Sensor errors of each displaced state, padded as `strapdown.propagate` requires.
    force_map, rate_map : arrays
        Corrections for them.
    """

    problem: Problem
    steps: Array
    offsets: Array
    errors: Array
    force_map: Array
    rate_map: Array

    @classmethod
    def at_state(cls, problem: Problem, state: State, steps: Array) -> PropagationDifferences:
        """Differences about states with a given state's sensor errors; `steps` ``(n,)`` in the filter's units."""
        offsets = np.concatenate((np.zeros((1, len(steps))), np.diag(steps), -np.diag(steps)))
        errors = sigma_states(state, offsets, strapdown.padded(len(offsets)))[1]
        return cls(problem, steps, offsets, errors, *sensor_maps(problem.layout, errors))

    def onboard_attitudes(self, start: Array, turns: OnboardRotations) -> Array:
        """On-board attitudes at the ends of K intervals, without displacement: ``(K + 1, 4)``, the first is `start`."""
        steps = rotations.multiply(turns.net, turns.corrections(self.problem.layout, self.errors[:, :1])[:, 0])
        attitudes = [start]
        for step in steps:
            attitudes.append(rotations.multiply(attitudes[-1], step))
        return np.array(attitudes)

    def transitions(self, nav: Array, begins: IntArray, ends: IntArray, turns: OnboardRotations | None) -> Array:
        """Transition matrices over intervals of samples.

        Parameters
        ----------
        nav : (K, 10) or (K, 14) array
            States at the beginnings.
        begins, ends : (K,) arrays of int
            First sample of each interval, and the one after its last.
        turns : OnboardRotations or None
            Over the intervals; None where no attitude was computed on board.

        Returns
        -------
        (K, n, n) array
        """
        count, p, samples = len(self.offsets), self.problem.planet, self.problem.samples
        states = np.repeat(nav[:, :10, None], self.errors.shape[1], axis=2)
        states[:, :6, :count] += self.offsets.T[:6]
        states[:, 6:, :count] = np.swapaxes(_rotated(nav[:, 6:10], self.offsets[:, 6:9]), 1, 2)
        for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
            part = slice(begin, end)
            strapdown.propagate(
                states[k], self.force_map, self.rate_map, samples.interval[part], samples.force[part],
                samples.rate[part], p.mu, p.j2, p.gravity_radius,
            )  # fmt: skip
        deltas = np.repeat((self.errors[:, :count] - self.errors[:, :1]).T[None], len(nav), axis=0)
        deltas[..., :6] = np.swapaxes(states[:, :6, :count] - states[:, :6, :1], 1, 2)
        attitude = np.swapaxes(states[:, 6:, :count], 1, 2)
        deltas[..., 6:9] = rotations.rotation_vector_between(attitude[:, :1], attitude)
        if turns is not None:
            displaced = _rotated(nav[:, 10:], self.offsets[:, -3:])
            correction = turns.corrections(self.problem.layout, self.errors[:, :count])
            computed = rotations.multiply(rotations.multiply(displaced, turns.net[:, None]), correction)
            deltas[..., -3:] = rotations.rotation_vector_between(computed[:, :1], computed)
        n = len(self.steps)
        return np.swapaxes((deltas[:, 1 : n + 1] - deltas[:, n + 1 :]) / (2.0 * self.steps[:, None]), 1, 2)


def _rotated(attitude: Array, phi: Array) -> Array:
    """Each attitude ``(K, 4)`` rotated by each rotation vector ``(S, 3)``: ``(K, S, 4)``."""
    return rotations.normalise(rotations.multiply(attitude[:, None], rotations.from_rotation_vector(phi)))
