"""The path followed in time: how the filter's vector moves between the ends of bins, constraints and instruments.

The filter's vector moves as the filter moves it: its sigma-point propagation, differenced about the path. Where a bin
is compared, the noise of its gyros is an unknown of its own and not process noise (`unknowns`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.comparison import Frame
from edl_filter.navigation import initial as entry
from edl_filter.navigation import strapdown
from edl_filter.navigation.filter import Problem, merge
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout, State, attitude_errors, sigma_states
from edl_filter.navigation.noise import process_noise
from edl_filter.navigation.ukf import propagate_states

Array = NDArray[np.float64]

#: Steps by which the filter's vector is moved to difference its propagation.
_STEPS = {
    "position": 10.0, "velocity": 0.05, "attitude": 1e-5, "accelerometer_bias": 1e-4, "accelerometer_scale": 1e-5,
    "accelerometer_misalignment": 1e-5, "gyro_bias": 1e-7, "gyro_scale": 1e-6, "entry_epoch": 1e-2,
    "entry_frame": 1e-5, "onboard_rate": 1e-7, "onboard_mounting": 1e-6, ONBOARD: 1e-5,
}  # fmt: skip


@dataclass(frozen=True)
class Motion:
    """How the filter's vector moves from epoch to epoch.

    Attributes
    ----------
    time : (K,) array
        Epochs after the start, s; two of the same time where the instrument changes.
    move, noise : (K, n, n) arrays
    walk : (K,) array
        Time over which a bin's gyro noise turns the attitude, s.
    bin : (K,) array of int
        Bin that ends at the epoch, or -1.
    constraints : tuple of tuples of int
        Indices of the constraints met at the epoch.
    reference : (K, …) list of State
    onboard : (C, 4) array or None
        On-board attitude carried to each constraint.
    """

    time: Array
    move: Array
    noise: Array
    walk: Array
    bin: NDArray[np.int64]
    constraints: tuple[tuple[int, ...], ...]
    reference: list[State]
    onboard: Array | None


def follow(problem: Problem, bins: Bins, start: State, errors: Array) -> Motion:
    """Propagate the path and its neighbours from epoch to epoch.

    Parameters
    ----------
    problem : Problem
    bins : Bins
    start : State
        Where the path begins, with the first instrument's errors.
    errors : (U, n) array
        By instrument.
    """
    layout, samples = problem.layout, problem.samples
    gyro_density = float(np.min(samples.rate_noise * np.sqrt(samples.interval)))
    wanted = [c.time for c in problem.constraints]
    steps = differencing_steps(layout)
    offsets = np.concatenate((np.zeros((1, layout.size)), np.diag(steps), -np.diag(steps)))
    found: list[_Epoch] = []
    state, done, unit = start, 0, int(samples.unit[0])
    onboard = np.empty((len(problem.constraints), 4)) if len(start.nav) == 14 else None
    bin_of = {round(float(t), 5): k for k, t in enumerate(bins.edges[1:])}
    pending = sorted(range(len(wanted)), key=lambda i: wanted[i])
    for time in _epochs(problem, bins):
        stop = samples.index(time)
        f, q, walk = np.eye(layout.size), np.zeros((layout.size, layout.size)), 0.0
        if stop > done:
            part = samples.part(done, stop)
            state, f = _step(problem, state, part, offsets, steps)
            inside = int(np.searchsorted(bins.edges, time - 1e-6)) - 1
            walks = 0 <= inside < len(bins.sound) and bool(bins.sound[inside])
            q = process_noise(layout, _hidden(part, gyro_density) if walks else part, state.nav[6:10])
            walk = float(part.interval.sum()) if walks else 0.0
        here = []
        while pending and wanted[pending[0]] <= time + 2e-6:
            here.append(pending.pop(0))
            if onboard is not None:
                onboard[here[-1]] = state.nav[10:]
        found.append(_Epoch(float(time), f, q, walk, bin_of.get(round(float(time), 5), -1), tuple(here), state))
        done = stop
        if done < len(samples.time) and samples.unit[done] != unit:
            unit = int(samples.unit[done])
            state, f, q = _change(problem, state, unit, errors[unit])
            found.append(_Epoch(float(time), f, q, 0.0, -1, (), state))
    return Motion(
        time=np.array([e.time for e in found]),
        move=np.array([e.move for e in found]),
        noise=np.array([e.noise for e in found]),
        walk=np.array([e.walk for e in found]),
        bin=np.array([e.bin for e in found]),
        constraints=tuple(e.constraints for e in found),
        reference=[e.reference for e in found],
        onboard=onboard,
    )


class _Epoch(NamedTuple):
    """One row of a `Motion`."""

    time: float
    move: Array
    noise: Array
    walk: float
    bin: int
    constraints: tuple[int, ...]
    reference: State


def _epochs(problem: Problem, bins: Bins) -> Array:
    """Where the path is stopped at: the filter's epochs, before the last bin's end the bins' ends and constraints."""
    epochs = merge(np.concatenate((bins.edges, problem.epochs)))
    late = epochs > bins.edges[-1] + 1e-6
    wanted = np.concatenate((bins.edges, [c.time for c in problem.constraints]))
    return np.asarray(epochs[late | np.isin(np.round(epochs, 5), np.round(wanted, 5))], np.float64)


def _hidden(samples: Samples, gyro_density: float) -> Samples:
    """The same samples with that part of the rate noise only which is not the gyros' own."""
    own = gyro_density / np.sqrt(samples.interval)
    rest = np.sqrt(np.maximum(samples.rate_noise**2 - own**2, 0.0))
    return replace(samples, rate_noise=rest, shared_rate_noise=np.minimum(samples.shared_rate_noise, rest))


def _step(problem: Problem, state: State, part: Samples, offsets: Array, steps: Array) -> tuple[State, Array]:
    """Propagate a state and its neighbours; new state and transition."""
    n, count = problem.layout.size, len(offsets)
    nav, errors = sigma_states(state, offsets, strapdown.padded(count))
    propagate_states(problem.layout, problem.planet, part, nav, errors)
    centre = State(nav[:, 0].copy(), state.errors.copy())
    moved = errors[:, :count].T - centre.errors
    moved[:, :6] = (nav[:6, :count] - centre.nav[:6, None]).T
    moved[:, 6:9] = attitude_errors(centre.nav[6:10], nav[6:10, :count])
    if len(nav) == 14:
        moved[:, -3:] = attitude_errors(centre.nav[10:], nav[10:, :count])
    return centre, ((moved[1 : n + 1] - moved[n + 1 :]) / (2.0 * steps[:, None])).T


def _change(problem: Problem, state: State, unit: int, errors: Array) -> tuple[State, Array, Array]:
    """Let another instrument drive, as the filter does."""
    layout = problem.layout
    fresh = [layout.sensor, *(layout[n] for n in problem.entry.instrument_prior(layout))]
    keep, noise = np.eye(layout.size), np.zeros((layout.size, layout.size))
    for where in fresh:
        keep[where, where] = 0.0
    noise[layout.sensor, layout.sensor] = entry.sensor_prior(layout, problem.instruments[unit])
    for name, sigma in problem.entry.instrument_prior(layout).items():
        noise[layout[name], layout[name]] = sigma**2 * np.eye(3)
    if ONBOARD in layout:
        noise[layout[ONBOARD], layout[ONBOARD]] = problem.unit_change_sigma**2 * np.eye(3)
    new = state.errors.copy()
    for where in fresh:
        new[where] = errors[where]
    return State(state.nav, new), keep, noise


def frame_of(motion: Motion, bins: Bins, start: State, errors: Array) -> Frame:
    """What stays as it is while the model changes."""
    return Frame(bins=bins, start=start.nav[:10], errors=errors, onboard=motion.onboard)


def differencing_steps(layout: Layout) -> Array:
    """Steps by which each component of the filter's vector is moved to difference it, ``(n,)``."""
    return np.concatenate([np.full(s.stop - s.start, _STEPS[name]) for name, s in layout.slices.items()])
