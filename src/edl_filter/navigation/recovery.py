"""Recovery of a filter whose state has diverged from its measurements.

The state is the outlier, and not a measurement, where readings that agree with each other contradict it
(`outlier_screening`), and where two constraints of different sources do, such as the landing site and the rest on the
surface. Where samples were lost and filled, one constraint is sufficient to test these, and if they explain it they are
the cause. Then the covariance of the state was too small, and the filter runs again with more. Three causes are
compared, each with one size:

- **gap**: the samples that stand for lost ones are wrong by more than their sigmas say;
- **entry_state**: the stated entry state is wrong by more than its covariance says;
- **process_noise**: all samples before the contradiction are, whatever the reason.

The sigmas of filled samples and of the entry state are multiplied; those of filled samples, which are calibrated
(docs/calibration.md), by 25 at most: with more, a few filled samples explain any error of the other ones. The noise of
all samples, and of those that stand for lost ones without a sigma of their own, is increased by a share of how much
force and rate vary over the flight up to the contradiction, which is what an unknown sample could be wrong by. The size
maximises the likelihood of all constraints in the filter's own predictions (prediction-error decomposition: Harvey
1989, *Forecasting, Structural Time Series Models and the Kalman Filter*, section 3.4; Särkkä 2013, section 12.1), each
truncated at the gate where it is one of many readings so that outliers do not determine it; the cause is the one with
the greatest maximum. Lost samples are a known cause: where they explain all contradictions, no other is tried. The
added noise is part of the problem that the smoother, the leave-one-out checks and all later stages use, so that sigmas
hold it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import fsum
from typing import Literal

import numpy as np

from edl_filter.navigation.consensus import quantile
from edl_filter.navigation.filter import FilterPass, Fused, Problem, run_filter
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.iterated import iterate, may_be_nonlinear
from edl_filter.navigation.outlier_screening import Divergence
from edl_filter.telemetry.record import SAME_TIME
from edl_filter.types import Array, BoolArray

Cause = Literal["gap", "entry_state", "process_noise"]

#: Sizes that are tried: shares of the variation, factors of the entry state's sigmas, and of those of filled samples.
#: The steps about the best of them are halved `REFINEMENTS` times.
SHARES, FACTORS, FILL_FACTORS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0), (3.0, 10.0, 30.0, 100.0, 300.0), (3.0, 10.0)
REFINEMENTS = 2
#: Least gain in log likelihood for which another cause is preferred to one before it, nats.
LEAST_GAIN = 3.0
_ATTITUDE = ("onboard_attitude", "pre_entry_zero_force", "rest_rate")


@dataclass(frozen=True)
class Recovery:
    """What was changed after a divergence.

    Attributes
    ----------
    divergence : Divergence
        Why.
    cause : str or None
        ``gap``, ``entry_state`` or ``process_noise``; None: no change removes the contradiction.
    size : float
        Factor of the sigmas of filled samples or of the entry state; for noise that is added, its share of the
        variation.
    force_noise, rate_noise : float
        Noise that was added to the samples, root mean square of all axes, m/s² and rad/s; zero for the entry state.
    start, end : float
        First and last time whose samples have it, s; of the entry state its time.
    gain : float
        In log likelihood of the constraints, nats.
    """

    divergence: Divergence
    cause: Cause | None
    size: float
    force_noise: float
    rate_noise: float
    start: float
    end: float
    gain: float

    @property
    def recovered(self) -> bool:
        """Whether a change removes the contradiction."""
        return self.cause is not None


def first_pass(problem: Problem) -> FilterPass:
    """Run of the filter, linearised again about its smoothed path where it may not be linear (`iterated`).

    Where a poorly known entry state is the reason and the path does not converge, the run itself is returned: its
    contradictions show what is wrong.
    """
    filter_pass = run_filter(problem)
    if problem.samples.filled.any():
        return iterate(problem, filter_pass)
    if not may_be_nonlinear(filter_pass):
        return filter_pass
    iterated = iterate(problem, filter_pass)
    return iterated if iterated.converged else filter_pass


def run_with_recovery(
    problem: Problem,
    lost: Sequence[tuple[float, float]] = (),
    first: FilterPass | None = None,
    gap_only: bool = False,
) -> tuple[Problem, FilterPass, Recovery | None]:
    """Run the filter; if its state diverges, run it again with the covariance that its measurements require.

    Parameters
    ----------
    problem : Problem
        Samples, initial state, constraints, settings.
    lost : sequence of (float, float)
        Start and end of the stretches whose samples were lost and filled, s.
    first : FilterPass, optional
        Of this problem (`first_pass`), where it was run already.
    gap_only : bool
        Test the lost samples as the only cause.

    Returns
    -------
    problem : Problem
        With the added noise; the given one where nothing was added.
    filter_pass : FilterPass
        Of that problem.
    recovery : Recovery or None
        None: the state does not contradict its measurements.
    """
    first = first_pass(problem) if first is None else first
    divergence = contradiction(first, 1 if lost else 2)
    if divergence is None or not first.converged:  # a contradiction is measured in a linear model
        return problem, first, None
    # one measurement is sufficient to test filled samples, and only these
    only_gap = gap_only or contradiction(first) is None
    stop = problem.samples.index(divergence.time)
    before = log_likelihood(problem, first)
    best: _Attempt | None = None
    for cause, sizes, change in _changes(problem, stop, lost):
        if only_gap and cause != "gap":
            break
        attempt = _best_size(cause, sizes, change, first_pass)
        if attempt is not None and (best is None or attempt.better_than(best, LEAST_GAIN)):
            best = attempt
        if best is not None and best.cause == "gap" and best.accepted:
            break
    if only_gap and (best is None or not best.accepted):
        return problem, first, None
    if best is None:
        return problem, first, Recovery(divergence, None, 0.0, 0.0, 0.0, np.nan, np.nan, 0.0)
    force, rate, start, end = 0.0, 0.0, problem.initial.time, problem.initial.time
    if best.cause != "entry_state":
        samples = problem.samples
        added = [_added_variance(samples, best.problem.samples, triad) for triad in ("force", "rate")]
        rows = np.flatnonzero(np.any(np.hstack(added) > 0.0, axis=1))
        force, rate = (float(np.sqrt(np.mean(variance[rows]))) for variance in added)
        start, end = samples.time[rows[0]] - samples.interval[rows[0]], samples.time[rows[-1]]
    recovery = Recovery(
        divergence, best.cause, best.size, force, rate, float(start), float(end), best.likelihood - before
    )
    return best.problem, best.filter_pass, recovery


def _added_variance(before: Samples, after: Samples, triad: str) -> Array:
    """What the variance of a triad's samples (N, 3), of noise and fill, is larger by."""
    names = f"{triad}_noise", f"{triad}_fill_sigma"
    return np.asarray(sum(getattr(after, name) ** 2 - getattr(before, name) ** 2 for name in names), float)


@dataclass(frozen=True)
class _Attempt:
    """The filter's run with one change."""

    cause: Cause
    size: float
    problem: Problem
    filter_pass: FilterPass
    likelihood: float

    @property
    def accepted(self) -> bool:
        """Whether every constraint that is used once was accepted."""
        return all(f.accepted for f in self.filter_pass.fused if used_once(self.filter_pass, f))

    def better_than(self, best: _Attempt, margin: float = 0.0) -> bool:
        """Whether this run rejects less than another one, or as much and is more likely by more than `margin` nats."""
        if self.accepted != best.accepted:
            return self.accepted
        return self.likelihood > best.likelihood + margin


def _best_size(
    cause: Cause,
    sizes: tuple[float, ...],
    change: Callable[[float], Problem],
    run: Callable[[Problem], FilterPass],
) -> _Attempt | None:
    """The best run without a contradiction, over the `sizes` and between them; None if there is none."""
    best: _Attempt | None = None

    def attempt(size: float) -> None:
        nonlocal best
        problem = change(size)
        try:
            filter_pass = run(problem)
        except np.linalg.LinAlgError:  # a covariance too large for the linearised motion
            return
        if contradiction(filter_pass) is not None:
            return
        tried = _Attempt(cause, size, problem, filter_pass, log_likelihood(problem, filter_pass))
        if best is None or tried.better_than(best):
            best = tried

    for size in sizes:
        attempt(size)
    step = float(np.sqrt(sizes[1] / sizes[0]))
    for _ in range(REFINEMENTS):
        if best is None:
            return None
        centre = best.size
        for size in (centre / step, centre * step):
            attempt(size)
        step = float(np.sqrt(step))
    return best


def contradiction(filter_pass: FilterPass, least: int = 2) -> Divergence | None:
    """The first contradiction that shows the state to be the outlier; None if there is none.

    Parameters
    ----------
    filter_pass : FilterPass
        Two of its constraints that are used once and have different names are of different sources; rest on the surface
        counts as one. What the gyros and the on-board attitude say is about attitude alone, and does not count.
    least : int
        Number of sources that must contradict the state.
    """
    if filter_pass.divergence is not None:
        return filter_pass.divergence
    rejected = [
        f
        for f in filter_pass.fused
        if not f.accepted and used_once(filter_pass, f) and f.constraint.name not in _ATTITUDE
    ]
    names = tuple(f.constraint.name for f in rejected)
    if len({name.split("_")[0] for name in names}) < least:
        return None
    nis = fsum(f.innovation.nis for f in rejected)
    dof = sum(len(f.innovation.residual) for f in rejected)
    return Divergence(rejected[0].constraint.time, names, len(rejected), nis, 0.0, dof)


def used_once(filter_pass: FilterPass, fused: Fused) -> bool:
    """Whether no other measurement of a filter pass has the name of this one."""
    return sum(f.constraint.name == fused.constraint.name for f in filter_pass.fused) == 1


def log_likelihood(problem: Problem, filter_pass: FilterPass) -> float:
    """Log likelihood of all constraints in the filter's predictions, nats.

    The NIS of readings that are one of many is truncated at the gate: a few of them may be outliers.

    Parameters
    ----------
    problem : Problem
        With the gate.
    filter_pass : FilterPass
        Of this problem.
    """
    total = 0.0
    for fused in filter_pass.fused:
        innovation = fused.innovation
        limit = np.inf
        if not used_once(filter_pass, fused):
            limit = quantile(problem.settings.gate_probability, len(innovation.residual))
        covariance = innovation.predicted_covariance + innovation.noise_covariance
        total -= 0.5 * (min(innovation.nis, limit) + float(np.linalg.slogdet(covariance)[1]))
    return total


def _changes(
    problem: Problem, stop: int, lost: Sequence[tuple[float, float]]
) -> list[tuple[Cause, tuple[float, ...], Callable[[float], Problem]]]:
    """Causes with the sizes to be tried and the change of the problem; `stop`: samples before the contradiction."""
    samples = problem.samples
    before = np.arange(len(samples.time)) < stop
    variation = _variation(samples.part(0, stop))

    def noisier(selected: BoolArray) -> Callable[[float], Problem]:
        return lambda size: replace(problem, samples=_noisier(samples, selected, size * variation))

    def worse_filled(size: float) -> Problem:
        factor = np.where(inside, size, 1.0)[:, None]
        sigmas = {name: factor * getattr(samples, name) for name in ("force_fill_sigma", "rate_fill_sigma")}
        return replace(problem, samples=replace(samples, **sigmas))

    def wider(size: float) -> Problem:
        initial = problem.initial
        return replace(problem, initial=replace(initial, covariance=size**2 * initial.covariance))

    inside = before & np.array([any(a + SAME_TIME < t <= b + SAME_TIME for a, b in lost) for t in samples.time])
    gap: list[tuple[Cause, tuple[float, ...], Callable[[float], Problem]]] = []
    if np.any(samples.filled & inside):
        gap.append(("gap", FILL_FACTORS, worse_filled))
    if np.any(~samples.filled & inside):
        gap.append(("gap", SHARES, noisier(~samples.filled & inside)))
    return [*gap, ("entry_state", FACTORS, wider), ("process_noise", SHARES, noisier(before))]


def _variation(samples: Samples) -> Array:
    """Root mean square deviation of force (m/s²) and rate (rad/s) from their means, per axis, ``(2,)``."""
    return np.array([np.sqrt(np.mean(np.var(values, axis=0))) for values in (samples.mean_force, samples.mean_rate)])


def _noisier(samples: Samples, selected: BoolArray, noise: Array) -> Samples:
    """Samples of which the `selected` (N,) have additional `noise` ``(2,)`` of force and rate, m/s² and rad/s."""
    rows = selected[:, None]
    return replace(
        samples,
        force_noise=np.where(rows, np.hypot(samples.force_noise, noise[0]), samples.force_noise),
        rate_noise=np.where(rows, np.hypot(samples.rate_noise, noise[1]), samples.rate_noise),
    )
