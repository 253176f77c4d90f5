"""The linear problem in the order of time: bins' ends, constraints, changes of the driving instrument.

The filter's vector moves as the filter moves it: its sigma-point propagation, differenced about the path. Where a bin
is compared, the noise of its gyros is an unknown of its own and not process noise (`unknowns`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.comparison import Differences, Frame, Setup
from edl_filter.diagnosis.sensitivity import Rows, bin_sigma
from edl_filter.diagnosis.sparse import Sparse, sparse
from edl_filter.diagnosis.unknowns import Allowance, Unknowns, smooth_step
from edl_filter.diagnosis.whitening import Steps
from edl_filter.navigation import initial as entry
from edl_filter.navigation import strapdown
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.filter import Problem, merge
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, SENSOR_STATES, Layout, State, attitude_errors, sigma_states
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
    epochs = merge(np.concatenate((bins.edges, problem.epochs)))
    wanted = [c.time for c in problem.constraints]
    late = epochs > bins.edges[-1] + 1e-6
    # before the last bin's end only the bins' ends and the constraints matter
    keep = late | np.isin(np.round(epochs, 5), np.round(np.concatenate((bins.edges, wanted)), 5))
    epochs = epochs[keep]
    steps = np.concatenate([np.full(s.stop - s.start, _STEPS[name]) for name, s in layout.slices.items()])
    offsets = np.concatenate((np.zeros((1, layout.size)), np.diag(steps), -np.diag(steps)))
    move, noise, walk, ends, met, path, times = [], [], [], [], [], [], []
    state, done, unit = start, 0, int(samples.unit[0])
    onboard = np.empty((len(problem.constraints), 4)) if len(start.nav) == 14 else None
    bin_of = {round(float(t), 5): k for k, t in enumerate(bins.edges[1:])}
    pending = sorted(range(len(wanted)), key=lambda i: wanted[i])
    for time in epochs:
        stop = samples.index(time)
        part = samples.part(done, stop)
        if stop > done:
            state, f = _step(problem, state, part, offsets, steps)
        else:
            f = np.eye(layout.size)
        inside = int(np.searchsorted(bins.edges, time - 1e-6)) - 1
        walks = 0 <= inside < len(bins.sound) and bool(bins.sound[inside]) and stop > done
        if stop == done:
            q = np.zeros_like(f)
        else:
            q = process_noise(layout, _hidden(part, gyro_density) if walks else part, state.nav[6:10])
        here = []
        while pending and wanted[pending[0]] <= time + 2e-6:
            here.append(pending.pop(0))
            if onboard is not None:
                onboard[here[-1]] = state.nav[10:]
        move.append(f)
        noise.append(q)
        walk.append(float(part.interval.sum()) if walks else 0.0)
        ends.append(bin_of.get(round(float(time), 5), -1))
        met.append(tuple(here))
        path.append(state)
        times.append(float(time))
        done = stop
        if done < len(samples.time) and samples.unit[done] != unit:
            unit = int(samples.unit[done])
            state, f, q = _change(problem, state, unit, errors[unit])
            move.append(f)
            noise.append(q)
            walk.append(0.0)
            ends.append(-1)
            met.append(())
            path.append(state)
            times.append(float(time))
    return Motion(
        np.array(times), np.array(move), np.array(noise), np.array(walk), np.array(ends), tuple(met), path, onboard
    )


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


@dataclass(frozen=True)
class Order:
    """Where each difference stands among the rows.

    Attributes
    ----------
    bin_rows : (B, width) array of int
        Row of each channel of each bin; -1 where it is not used.
    constraint_rows : tuple of slices
        By constraint.
    count : int
    dt : (K,) array
        Time that passes in each step, s.
    time : (R,) array
        Of each row, s.
    place : (R,) array of int
        Of each row within its step's block.
    """

    bin_rows: NDArray[np.int64]
    constraint_rows: tuple[slice, ...]
    count: int
    dt: Array
    time: Array
    place: NDArray[np.int64]

    def stack(self, found: Differences) -> Array:
        """The differences as one column ``(R,)``."""
        out = np.zeros(self.count)
        table = np.full(self.bin_rows.shape, np.nan)
        table[:, :3], table[:-1, 3:6] = found.force, found.turn
        for i, (force, rate) in enumerate(zip(found.other_force, found.other_rate, strict=True)):
            table[:, 6 + 6 * i : 9 + 6 * i], table[:, 9 + 6 * i : 12 + 6 * i] = force, rate
        used = self.bin_rows >= 0
        out[self.bin_rows[used]] = table[used]
        for where, difference in zip(self.constraint_rows, found.constraints, strict=True):
            out[where] = difference
        return out


def in_order(
    setup: Setup,
    bins: Bins,
    motion: Motion,
    rows: Rows,
    unknowns: Unknowns,
    allowance: Allowance,
    found: Differences,
) -> tuple[Steps, Order]:
    """Put everything into the order of time."""
    problem, n = setup.problem, unknowns.layout.size
    widest = max(rows.use.shape[1], max((len(c.measured) for c in problem.constraints), default=1))
    design, noise, starts, count = [], [], [], 0
    where = np.full(rows.use.shape, -1, np.int64)
    at: dict[int, slice] = {}
    steps = _Split(motion)
    halfway = _halfway(motion, len(bins.interval))
    for k in steps.order:
        starts.append(count)
        bin_, constraint = steps.bin[k], steps.constraint[k]
        if bin_ >= 0:
            used = np.flatnonzero(rows.use[bin_])
            where[bin_, used] = count + np.arange(len(used))
            h = rows.design[bin_].copy()
            h[:3, :n] = h[:3, :n] @ halfway[bin_]
            design.append(h[used])
            block = np.zeros((len(used), widest))
            block[:, : len(used)] = rows.noise[bin_][np.ix_(used, used)]
            noise.append(block)
            count += len(used)
        elif constraint >= 0:
            c = problem.constraints[constraint]
            h = np.zeros((len(c.measured), unknowns.size))
            h[:, :n] = _constraint_design(c, motion.reference[steps.epoch[k]], unknowns.layout)
            design.append(h)
            block = np.zeros((len(h), widest))
            block[:, : len(h)] = c.noise
            noise.append(block)
            at[constraint] = slice(count, count + len(h))
            count += len(h)
    starts.append(count)
    sigma = bin_sigma(bins, setup.driving.time, setup.driving.interval, setup.driving.rate_noise)
    sigma = np.where(np.isfinite(sigma), sigma, np.nanmedian(sigma))
    change, process = _law(steps, motion, unknowns, allowance, found, sigma)
    return (
        Steps(
            change=change,
            noise=process,
            rows=np.array(starts, np.int64),
            design=np.concatenate(design) if design else np.zeros((0, unknowns.size)),
            row_noise=np.concatenate(noise) if noise else np.zeros((0, widest)),
            start=_start(setup, unknowns, sigma[0]),
        ),
        Order(
            bin_rows=where,
            constraint_rows=tuple(at[i] for i in range(len(problem.constraints))),
            count=count,
            dt=_passed(steps, motion, found),
            time=np.repeat(motion.time[np.array(steps.epoch)], np.diff(starts)),
            place=np.arange(count) - np.repeat(starts[:-1], np.diff(starts)),
        ),
    )


def _halfway(motion: Motion, count: int) -> Array:
    """From the filter's vector at every bin's end to its mean over the bin ``(B, n, n)``.

    It is half of it and half the one before. A force is a mean over the bin, and half a bin's turn of the body is a
    thousandth of what an attitude error makes.
    """
    eye = np.eye(motion.move.shape[1])
    out, passed = np.tile(eye, (count, 1, 1)), eye
    for move, bin_ in zip(motion.move, motion.bin, strict=True):
        passed = move @ passed
        if bin_ >= 0:
            out[bin_], passed = passed, eye
    out[np.abs(np.linalg.det(out)) < 0.5] = eye  # another instrument took over in between
    return np.asarray(0.5 * (eye + np.linalg.inv(out)), np.float64)


class _Split:
    """Epochs taken apart: the movement, then each thing that is measured there, one step each."""

    def __init__(self, motion: Motion) -> None:
        self.epoch: list[int] = []
        self.moves: list[bool] = []
        self.bin: list[int] = []
        self.constraint: list[int] = []
        for e in range(len(motion.time)):
            things = [(int(motion.bin[e]), -1)] if motion.bin[e] >= 0 else []
            things += [(-1, c) for c in motion.constraints[e]]
            for i, (b, c) in enumerate(things or [(-1, -1)]):
                self.epoch.append(e)
                self.moves.append(i == 0)
                self.bin.append(b)
                self.constraint.append(c)

    @property
    def order(self) -> range:
        """Indices of the steps."""
        return range(len(self.epoch))


def _law(
    steps: _Split,
    motion: Motion,
    unknowns: Unknowns,
    allowance: Allowance,
    found: Differences,
    rate_sigma: Array,
) -> tuple[Sparse, Sparse]:
    """Transition less identity, and process noise, of all unknowns."""
    n = unknowns.layout.size
    moves, epoch = np.array(steps.moves), np.array(steps.epoch)
    here = slice(0, n)
    change: list[tuple[slice, slice, Array]] = [
        (here, here, np.where(moves[:, None, None], motion.move[epoch] - np.eye(n), 0.0))
    ]
    noise: list[tuple[slice, slice, Array]] = [(here, here, np.where(moves[:, None, None], motion.noise[epoch], 0.0))]
    before, after = unknowns["rate_before"], unknowns["rate_after"]
    walk = np.where(moves, motion.walk[epoch], 0.0)
    change.append((unknowns.layout["attitude"], after, -walk[:, None, None] * np.eye(3)))
    ends = np.array(steps.bin)
    # the noise of the bin that ends is kept, that of the next one is fresh
    over = (ends >= 0)[:, None, None] * np.eye(3)
    change += [(before, before, -over), (before, after, over), (after, after, -over)]
    fresh = rate_sigma[np.minimum(ends + 1, len(rate_sigma) - 1)]
    noise.append((after, after, (fresh**2)[:, None, None] * over))
    time = np.concatenate((found.path.time[:1], motion.time))
    height = np.interp(time, found.nodes.time, found.flow.altitude)
    dt, dh = _passed(steps, motion, found), np.abs(np.diff(height))[epoch] * moves
    passed = dict.fromkeys(("density", "wind_east", "wind_north"), dh / allowance.density_correlation)
    passed |= dict.fromkeys(("ca", "cn", "cm"), dt / allowance.coefficient_memory)
    for name, distance in passed.items():
        if name in unknowns:
            at = unknowns[name]
            step, rest = smooth_step(distance)
            change.append((at, at, step - np.eye(2)))
            noise.append((at, at, rest))
    return sparse(unknowns.size, change), sparse(unknowns.size, noise)


def _passed(steps: _Split, motion: Motion, found: Differences) -> Array:
    """Time that passes in each step, s."""
    return np.diff(np.concatenate((found.path.time[:1], motion.time)))[np.array(steps.epoch)] * np.array(steps.moves)


def _start(setup: Setup, unknowns: Unknowns, rate_sigma: float) -> Array:
    """Covariance at the beginning."""
    problem, layout = setup.problem, unknowns.layout
    p = np.zeros((unknowns.size, unknowns.size))
    _, prior = entry.start(
        layout, problem.initial, problem.entry, problem.instruments[int(problem.samples.unit[0])], problem.planet
    )
    p[: layout.size, : layout.size] = prior
    for name, where in unknowns.slices.items():
        width = where.stop - where.start
        if name.startswith("other"):
            i, error = name[5:].split("_", 1)
            sigma = getattr(setup.checking[int(i)].errors[0], error)
        else:
            sigma = {"rate_before": 0.0, "rate_after": rate_sigma}.get(name, 1.0)
        p[where, where] = sigma**2 * np.eye(width)
        if width == 2:
            p[where, where] = np.diag([1.0, 3.0])  # value and slope (`smooth_step`)
    return p


def stated_start(setup: Setup, start: State) -> Array:
    """What the mission states of the filter's vector at the beginning, as an error about `start`, ``(n,)``."""
    problem = setup.problem
    state, _ = entry.start(
        problem.layout,
        problem.initial,
        problem.entry,
        problem.instruments[int(problem.samples.unit[0])],
        problem.planet,
    )
    return state.minus(start)


def _constraint_design(c: Constraint, state: State, layout: Layout) -> Array:
    """Slope of a constraint's prediction, ``(m, n)``."""
    n = layout.size
    steps = np.concatenate([np.full(s.stop - s.start, _STEPS[name]) for name, s in layout.slices.items()])
    nav, errors = sigma_states(state, np.concatenate((np.diag(steps), -np.diag(steps))), 2 * n)
    found = c.predict(nav, errors, layout)
    return ((found[:n] - found[n:]) / (2.0 * steps[:, None])).T


def frame_of(motion: Motion, bins: Bins, start: State, errors: Array) -> Frame:
    """What stays as it is while the model changes."""
    return Frame(bins=bins, start=start.nav[:10], errors=errors, onboard=motion.onboard)


__all__ = ["SENSOR_STATES", "Motion", "Order", "follow", "frame_of", "in_order", "stated_start"]
