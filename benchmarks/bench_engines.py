"""The compiled filter and smoother against those on filterpy, and against the bare kernel, in the same run.

The bare kernel is `strapdown.propagate` over the same samples with the same number of sigma points, without anything
between epochs: no filter can be faster. Times are processor time, the least of several runs, so that other jobs on the
machine change the ratios little.

Run: ``python benchmarks/bench_engines.py``
"""

import gc
import time
from dataclasses import replace

import numpy as np

from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.mission import Mission
from edl_filter.navigation import strapdown
from edl_filter.navigation.filter import run_filter
from edl_filter.navigation.leave_one_out import check_constraints
from edl_filter.navigation.smoother import smooth
from edl_filter.pipeline.reconstruct import reconstruct

MISSIONS = {"mer_a": ("telemetry.path=builtin:mer_a",), "mer_b": ("telemetry.path=builtin:mer_b",), "practice_mer": ()}


def milliseconds(function, repeats=7):
    """Least processor time of a call."""
    function()
    gc.collect()
    spent = []
    for _ in range(repeats):
        begin = time.process_time()
        function()
        spent.append(time.process_time() - begin)
    return 1e3 * min(spent)


def bare_kernel(problem):
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


def compare(name, changes):
    """Print the times of one mission."""
    problem = reconstruct(Mission.load(f"builtin:{name}", changes), leave_one_out=False).problem
    passes = {}
    for engine in ("compiled", "filterpy"):
        chosen = replace(problem, settings=replace(problem.settings, engine=engine))
        passes[engine] = chosen, run_filter(chosen)
    _, filter_pass = passes["compiled"]
    print(
        f"{name}: {len(problem.samples.time)} samples, {problem.layout.size} states, {len(filter_pass.nodes)} nodes, "
        f"{len(filter_pass.fused)} measurements"
    )
    bare = milliseconds(bare_kernel(problem))
    print(f"    bare kernel              {bare:8.2f} ms")
    stages = {
        "filter": lambda engine: run_filter(passes[engine][0]),
        "smoother": lambda engine: smooth(passes[engine][1]),
        "leave-one-out": lambda engine: check_constraints(*passes[engine]),
    }
    for stage, run in stages.items():
        compiled, filterpy = (milliseconds(lambda e=engine, r=run: r(e)) for engine in passes)
        print(
            f"    {stage:<13} compiled   {compiled:8.2f} ms, {compiled / bare:5.1f} times the kernel; "
            f"filterpy {filterpy:8.2f} ms, {filterpy / compiled:4.1f} times compiled"
        )


def main():
    with one_blas_thread():
        for name, changes in MISSIONS.items():
            compare(name, changes)


if __name__ == "__main__":
    main()
