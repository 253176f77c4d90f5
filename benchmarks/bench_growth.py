"""Growth with the length of the flight, with the number of states and with the number of effects.

Run: ``python benchmarks/bench_growth.py``
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from bench_epochs import LAYOUTS, epoch, samples_of
from measuring import Grid, Section, interleaved, run

from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.effects.registry import catalogue
from edl_filter.mission import Mission
from edl_filter.navigation.compiled_ukf import CompiledUKF
from edl_filter.navigation.filter import Problem, run_filter
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.smoother import smooth
from edl_filter.pipeline.reconstruct import reconstruct

LENGTHS = (1, 2, 4, 8)  # times a coast of 100 s
COAST = 100.0
EFFECTS = (1, 4, 16)


def lengthened(problem: Problem, times: int) -> Problem:
    """The flight's first samples before entry, many times over, with an epoch every 5 s and no constraints."""
    s = problem.samples
    count = s.index(problem.initial.time + COAST)
    index = np.tile(np.arange(count), times)
    arrays = {name: getattr(s, name)[index] for name in s.__dataclass_fields__}
    samples = Samples(**(arrays | {"time": problem.initial.time + np.cumsum(arrays["interval"])}))
    epochs = np.append(problem.initial.time, samples.time[39::40])
    return replace(problem, samples=samples, constraints=(), epochs=epochs)


def flight_length() -> Section:
    """Filter and smoother."""
    problem = reconstruct(Mission.load("builtin:practice_mer"), leave_one_out=False).problem
    functions: dict[str, Callable[[], Any]] = {}
    for n in LENGTHS:
        longer = lengthened(problem, n)
        functions[str(n)] = lambda p=longer: smooth(run_filter(p))
    times = interleaved(functions, rounds=5)
    unit = times.least("1")
    grid = Grid(
        "flight",
        [f"{COAST * n:g} s" for n in LENGTHS],
        {"filter + smoother": [times.least(str(n)) / unit for n in LENGTHS]},
    )
    return Section(
        "Growth: length of the flight", "8 Hz, an epoch every 5 s, 24 states, relative to the first column.", grid=grid
    )


def states() -> Section:
    """UKF with 57 samples an epoch, as Spirit."""
    s = samples_of(57)
    functions = {str(n): epoch(CompiledUKF, layout, s) for n, layout in LAYOUTS.items()}
    times = interleaved(functions, rounds=7)
    unit = times.least("15")
    lines = {
        "UKF epoch": [times.least(str(n)) / unit for n in LAYOUTS],
        "n": [n / 15.0 for n in LAYOUTS],
        "n³": [(n / 15.0) ** 3 for n in LAYOUTS],
    }
    return Section(
        "Growth: number of states",
        "57 samples an epoch, relative to 15 states.",
        grid=Grid("states", [str(n) for n in LAYOUTS], lines),
    )


def effects() -> Section:
    """Diagnosis of the practice flight with some of the catalogue."""
    case = load_case(Mission.load("builtin:practice_mer"))
    candidates = list(catalogue().values())
    functions = {str(n): (lambda n=n: diagnose(case, candidates[:n])) for n in EFFECTS if n <= len(candidates)}
    diagnose(case, candidates[:1])  # compiles
    times = interleaved(functions, rounds=1, warm=False)
    unit = times.least("1")
    lines = {"diagnosis": [times.least(n) / unit for n in functions]}
    text = f"""
The first effects of the catalogue (of {len(candidates)}) on the practice flight, relative to one; each was measured
once. Every effect is also a candidate in combination with those that are accepted.
"""
    return Section("Growth: number of effects", text, grid=Grid("effects", list(functions), lines))


def measure() -> list[Section]:
    """All sections."""
    return [flight_length(), states(), effects()]


if __name__ == "__main__":
    run(measure)
