"""The post-flight layer against the reconstruction it follows, and its growth with the samples.

Run: ``python benchmarks/bench_postflight.py``
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from measuring import Grid, Row, Section, interleaved, run

from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.postflight.derive import derive
from edl_filter.postflight.flight import derived_quantities, postflight_inputs
from edl_filter.types import Array

RATES = (8.0, 25.0, 100.0, 200.0)
FLIGHTS = {"practice flight": "practice_mer", "Spirit": "mer_a"}


def resampled(given: Any, rate: float) -> Any:
    """Layer inputs on a regular grid: every array along the flight, linearly."""
    grid = np.arange(given.time[0], given.time[-1], 1.0 / rate)

    def along(values: Array) -> Array:
        columns = values.reshape(len(given.time), -1).T
        return np.stack([np.interp(grid, given.time, c) for c in columns], axis=1).reshape(-1, *values.shape[1:])

    arrays = {f.name: getattr(given, f.name) for f in fields(given) if f.name not in ("time", "inertia", "bias_sigma")}
    changed = {k: along(v) for k, v in arrays.items() if isinstance(v, np.ndarray) and v.shape[:1] == given.time.shape}
    return replace(given, time=grid, **changed)


def measure() -> list[Section]:
    """All sections."""
    functions: dict[str, Callable[[], Any]] = {}
    for label, name in FLIGHTS.items():
        mission = Mission.load(f"builtin:{name}")
        result = reconstruct(mission)
        given = postflight_inputs(result, derived_quantities(result).air)
        functions[f"reconstruction {label}"] = lambda m=mission: reconstruct(m)
        functions[f"layer {label}"] = lambda g=given: derive(g)
        if label == "practice flight":
            functions |= {f"{rate:g} Hz": partial(derive, resampled(given, rate)) for rate in RATES}
    times = interleaved(functions, rounds=3)
    rows: list[Row] = [
        times.row(f"post-flight layer of {label}", "its reconstruction", f"layer {label}", f"reconstruction {label}")
        for label in FLIGHTS
    ]
    unit = times.least("8 Hz")
    grid = Grid(
        "sampling",
        [f"{r:g} Hz" for r in RATES],
        {"time": [times.least(f"{r:g} Hz") / unit for r in RATES], "samples": [r / RATES[0] for r in RATES]},
    )
    return [
        Section("Post-flight layer", "Growth with the samples of the practice flight, relative to 8 Hz.", rows, grid)
    ]


if __name__ == "__main__":
    run(measure)
