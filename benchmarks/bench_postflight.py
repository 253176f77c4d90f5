"""How long the post-flight layer takes, and beside it the reconstruction it follows, in the same run.

1. A mission's reconstruction and its layer: the built-in practice flight and Spirit.
2. The built-in flight's layer inputs on a grid of 200 Hz: how the time grows with the samples.

Run: ``python benchmarks/bench_postflight.py``
"""

import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.postflight.derive import derive
from edl_filter.postflight.flight import derived_quantities, postflight_inputs

MISSIONS = Path(__file__).parent.parent / "missions"
RATE = 200.0


def best(function, repeats=5):
    """Shortest time of several runs, s, after one that compiles."""
    function()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return min(times)


def resampled(given, rate):
    """Layer inputs on a regular grid: every array along the flight, linearly."""
    grid = np.arange(given.time[0], given.time[-1], 1.0 / rate)

    def along(values):
        columns = values.reshape(len(given.time), -1).T
        return np.stack([np.interp(grid, given.time, c) for c in columns], axis=1).reshape(-1, *values.shape[1:])

    arrays = {f.name: getattr(given, f.name) for f in fields(given) if f.name not in ("time", "inertia", "bias_sigma")}
    changed = {k: along(v) for k, v in arrays.items() if isinstance(v, np.ndarray) and v.shape[:1] == given.time.shape}
    return replace(given, time=grid, **changed)


def mission(name):
    """Time of the reconstruction and of the layer; the layer's inputs."""
    loaded = Mission.load(MISSIONS / f"{name}.yaml")
    reconstruction = reconstruct(loaded)
    given = postflight_inputs(reconstruction, derived_quantities(reconstruction).air)
    reconstruction, layer = best(lambda: reconstruct(loaded), 3), best(lambda: derive(given))
    print(f"{name}: reconstruction {reconstruction:.3f} s, layer {layer:.3f} s ({layer / reconstruction:.0%} of it)")
    return given, layer


def main():
    given, layer = mission("practice_mer")
    mission("mer_a")
    before = len(given.until_parachute().time)
    fine = resampled(given, RATE)
    after, spent = fine.until_parachute(), best(lambda: derive(fine), 3)
    span = after.time[-1] - after.time[0]
    print(
        f"layer over {span:.0f} s at {RATE:g} Hz: {spent:.2f} s, {spent / layer:.1f} times as long for "
        f"{len(after.time) / before:.1f} times the samples; 350 s would take {spent * 350.0 / span:.2f} s"
    )


if __name__ == "__main__":
    main()
