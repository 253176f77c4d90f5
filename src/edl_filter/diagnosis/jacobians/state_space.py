"""The linear problem in the order of time: every difference's row, and the law by which all unknowns move.

The filter's vector moves along the path (`motion`); the unknowns beside it by their own laws (`unknowns`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.comparison import Differences, Setup
from edl_filter.diagnosis.motion import Motion, differencing_steps
from edl_filter.diagnosis.sensitivity import Rows, bin_sigma
from edl_filter.diagnosis.sparse import Sparse, sparse
from edl_filter.diagnosis.unknowns import Allowance, Unknowns, distances, smooth_step
from edl_filter.diagnosis.whitening import Steps
from edl_filter.navigation import initial as entry
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.layout import Layout, State, sigma_states

Array = NDArray[np.float64]


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
    dt, dh = _passed(steps, motion, found), np.diff(height)[epoch] * moves
    for name, distance in distances(allowance, dt, dh).items():
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
    steps = differencing_steps(layout)
    nav, errors = sigma_states(state, np.concatenate((np.diag(steps), -np.diag(steps))), 2 * n)
    found = c.predict(nav, errors, layout)
    return ((found[:n] - found[n:]) / (2.0 * steps[:, None])).T
