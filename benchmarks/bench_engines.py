"""The compiled filter and smoother against those on filterpy, and against the bare kernel, in the same run.

The bare kernel is `strapdown.propagate` over the same samples with the same number of sigma points, without anything
between epochs: no filter can be faster.

Run: ``python benchmarks/bench_engines.py``
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from measuring import Row, Section, at_most, interleaved, run

from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.mission import Mission
from edl_filter.navigation import strapdown
from edl_filter.navigation.filter import Problem, run_filter
from edl_filter.navigation.leave_one_out import check_constraints
from edl_filter.navigation.smoother import smooth
from edl_filter.pipeline.reconstruct import reconstruct

FLIGHTS = {
    "Spirit": ("mer_a", ("telemetry.path=builtin:mer_a",)),
    "Opportunity": ("mer_b", ("telemetry.path=builtin:mer_b",)),
    "practice flight": ("practice_mer", ()),
}
TOLERANCE = 1e-6  # sigmas


def bare_kernel(problem: Problem) -> Callable[[], None]:
    """Propagation of all sigma points over all samples."""
    columns = strapdown.padded(2 * problem.layout.size + 1)
    nav = np.concatenate((problem.initial.position, problem.initial.velocity, problem.initial.inertial_from_body))
    states = np.repeat(nav[:, None], columns, axis=1)
    force_map, rate_map = np.zeros((12, columns)), np.zeros((6, columns))
    force_map[[0, 4, 8]], rate_map[:3] = 1.0, 1.0
    s, p = problem.samples, problem.planet
    return lambda: strapdown.propagate(
        states.copy(), force_map, rate_map, s.interval, s.force, s.rate, p.mu, p.j2, p.gravity_radius
    )


def compare(label: str, problem: Problem) -> list[Row]:
    """Rows of one flight."""
    problems = {e: replace(problem, settings=replace(problem.settings, engine=e)) for e in ("compiled", "filterpy")}
    passes = {engine: run_filter(p) for engine, p in problems.items()}
    smoothed = {engine: smooth(p) for engine, p in passes.items()}
    worst = 0.0
    theirs = smoothed["filterpy"]
    for a, b, covariance in zip(smoothed["compiled"].states, theirs.states, theirs.covariance, strict=True):
        worst = max(worst, np.max(np.abs(a.minus(b)) / np.sqrt(np.diag(covariance))))
    assert worst < TOLERANCE, worst
    functions: dict[str, Callable[[], object]] = {"kernel": bare_kernel(problem)}
    for engine in problems:
        functions |= {
            f"{engine} filter": lambda e=engine: run_filter(problems[e]),
            f"{engine} smoother": lambda e=engine: smooth(passes[e]),
            f"{engine} both": lambda e=engine: smooth(run_filter(problems[e])),
            f"{engine} leave-one-out": lambda e=engine: check_constraints(problems[e], passes[e]),
        }
    times = interleaved(functions, rounds=9)
    nodes = len(passes["compiled"].nodes)
    size = f"{label} ({len(problem.samples.time)} samples, {problem.layout.size} states, {nodes} nodes)"
    goal = at_most(10.0) if label == "Spirit" else None
    rows = [times.row(f"{size}: filter + smoother", "bare kernel", "compiled both", "kernel", goal)]
    for stage in ("filter", "smoother", "leave-one-out"):
        rows.append(times.row(f"{label}: {stage}", "bare kernel", f"compiled {stage}", "kernel"))
    for stage in ("filter", "smoother", "leave-one-out"):
        rows.append(
            times.row(
                f"{label}: {stage} of `engine: filterpy` (one kernel for all sigma points)",
                f"{stage}, compiled",
                f"filterpy {stage}",
                f"compiled {stage}",
                agreement=f"equal to {worst:.0e} sigma (asserted: {TOLERANCE:g})" if stage == "smoother" else "",
            )
        )
    return rows


def measure() -> list[Section]:
    """All sections."""
    rows = []
    with one_blas_thread():
        for label, (name, changes) in FLIGHTS.items():
            rows += compare(label, reconstruct(Mission.load(f"builtin:{name}", changes), leave_one_out=False).problem)
    text = """
The bare kernel propagates the same sigma points over the same samples in one call, without noise, covariances,
measurements or anything else between epochs.
"""
    return [Section("Filter and smoother", text, rows)]


if __name__ == "__main__":
    run(measure)
