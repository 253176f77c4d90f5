"""The path followed in time: how the filter's vector moves between the ends of bins, constraints and instruments.

The filter's vector moves as the filter moves it: its sigma-point propagation, differenced about the path. Where a bin
is compared, the noise of its gyros is an unknown of its own and not process noise (`unknowns`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.comparison import Frame
from edl_filter.diagnosis.neighbours import Neighbours
from edl_filter.diagnosis.path import dead_reckon
from edl_filter.navigation import initial as entry
from edl_filter.navigation.filter import Problem, merge
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout, State
from edl_filter.navigation.noise import process_noise

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
    samples = problem.samples
    hidden = _hidden(samples, float(np.min(samples.rate_noise * np.sqrt(samples.interval))))
    times = _epochs(problem, bins)
    ends = np.array([samples.index(t) for t in times])
    begins = np.concatenate(([0], ends[:-1]))
    units = samples.unit[np.minimum(begins, len(samples.unit) - 1)]
    nav = dead_reckon(problem, start.nav[:10], errors).nav
    wanted = [c.time for c in problem.constraints]
    pending = sorted(range(len(wanted)), key=lambda i: wanted[i])
    onboard = np.empty((len(wanted), 4)) if len(start.nav) == 14 else None
    bin_of = {round(float(t), 5): k for k, t in enumerate(bins.edges[1:])}
    found: list[_Epoch] = []
    state = start
    for run in np.split(np.arange(len(times)), np.flatnonzero(np.diff(units)) + 1):
        if found:  # another instrument drives from here on
            state, f, q = _change(problem, state, int(units[run[0]]), errors[units[run[0]]])
            found.append(_Epoch(found[-1].time, f, q, 0.0, -1, (), state))
        states, moves = _stretches(problem, state, nav, begins[run], ends[run])
        for k, moved, f in zip(run, states, moves, strict=True):
            time, before, state = float(times[k]), state, moved
            inside = int(np.searchsorted(bins.edges, time - 1e-6)) - 1
            walks = ends[k] > begins[k] and 0 <= inside < len(bins.sound) and bool(bins.sound[inside])
            part = (hidden if walks else samples).part(begins[k], ends[k])
            q = process_noise(problem.layout, part, before.nav[6:10])
            walk = float(part.interval.sum()) if walks else 0.0
            here = []
            while pending and wanted[pending[0]] <= time + 2e-6:
                here.append(pending.pop(0))
                if onboard is not None:
                    onboard[here[-1]] = state.nav[10:]
            found.append(_Epoch(time, f, q, walk, bin_of.get(round(time, 5), -1), tuple(here), state))
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


def _stretches(
    problem: Problem, start: State, nav: Array, begins: NDArray[np.int64], ends: NDArray[np.int64]
) -> tuple[list[State], Array]:
    """States at the ends of adjoining stretches under one instrument, and the transitions over them.

    Parameters
    ----------
    problem : Problem
    start : State
        At the beginning of the first.
    nav : (N + 1, 10) array
        The path at the ends of all samples.
    begins, ends : (K,) arrays of int
        Samples.
    """
    near = Neighbours.of(problem, start, differencing_steps(problem.layout))
    turns = [near.onboard(a, b) for a, b in zip(begins, ends, strict=True)] if len(start.nav) == 14 else []
    carried = [start.nav[10:]]
    for net, turn in turns:
        carried.append(rotations.multiply(rotations.multiply(carried[-1], net), turn[0]))
    board = np.array(carried) if turns else np.empty((len(ends) + 1, 0))
    at = np.concatenate((nav[np.append(begins[:1], ends)], board), axis=1)
    moves = near.transitions(at[:-1], begins, ends, turns)
    return [State(row, start.errors.copy()) for row in at[1:]], moves


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
