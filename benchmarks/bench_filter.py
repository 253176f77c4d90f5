"""The filter against filterpy with Python callbacks and against the extended filter, on the same problem.

1. Spirit's flight (37 states, two instruments, an attitude computed on board) and the built-in practice flight (24
   states, every altimeter reading fused) through our filter and through filterpy's own `UnscentedKalmanFilter` with
   callbacks: `fx` steps one sigma point through the samples of an interval, `hx` predicts its measurement.
2. filterpy as its tutorials use it, one `predict` for each sample, on part of the flight and scaled up.
3. The stages of a reconstruction.

Run: ``python benchmarks/bench_filter.py``
"""

from __future__ import annotations

import time
from dataclasses import replace

from measuring import Row, Section, at_least, interleaved, run
from plain_filter import PlainFilter, largest_difference, without_gate

from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.mission import Mission
from edl_filter.navigation.filter import Problem, run_filter
from edl_filter.pipeline.reconstruct import reconstruct

FLIGHTS = {"Spirit": ("mer_a", ("telemetry.path=builtin:mer_a",)), "practice flight": ("practice_mer", ())}
TOLERANCE = 1e-6  # sigmas
PART = 100  # samples with one predict each


def compare(label: str, problem: Problem) -> list[Row]:
    """Rows of one flight."""
    estimates = PlainFilter(problem).run()
    difference = largest_difference(problem, estimates)
    assert difference < TOLERANCE, difference
    extended = replace(problem, settings=replace(problem.settings, method="ekf"))
    ours = interleaved({"ukf": lambda: run_filter(problem), "ekf": lambda: run_filter(extended)}, rounds=9)
    # the plain filter takes many seconds; before and after it ours, so that both meet the same load
    rounds: dict[str, list[float]] = {"plain": [], "ukf": []}
    for _ in range(2):
        rounds["ukf"].append(interleaved({"ukf": lambda: run_filter(problem)}, rounds=5).least("ukf"))
        begin = time.process_time()
        PlainFilter(problem).run()
        rounds["plain"].append(time.process_time() - begin)
    least = min(rounds["ukf"] + ours.seconds["ukf"])
    plain = PlainFilter(problem)
    begin = time.process_time()
    for i in range(PART):
        plain.predict(problem.samples.part(i, i + 1))
    each = (time.process_time() - begin) / PART * len(problem.samples.time)
    agreement = f"equal to {difference:.0e} sigma at every epoch (asserted: {TOLERANCE:g})"
    size = f"{label}, {problem.layout.size} states"
    return [
        Row(
            f"{size}: filterpy, callbacks over the samples of an interval",
            "compiled UKF",
            min(rounds["plain"]) / least,
            None,
            at_least(1000.0) if label == "Spirit" else None,
            agreement,
        ),
        Row(
            f"{size}: filterpy, callbacks, one `predict` a sample",
            "compiled UKF",
            each / least,
            None,
            None,
            f"not compared: redraws its points each sample; scaled from {PART} samples, without updates",
        ),
        ours.row(f"{size}: EKF", "compiled UKF", "ekf", "ukf"),
    ]


def stages(label: str, name: str, changes: tuple[str, ...]) -> list[Row]:
    """Share of each stage of a reconstruction, %."""
    mission = Mission.load(f"builtin:{name}", changes)
    timing = min((reconstruct(mission).timing for _ in range(5)), key=lambda t: sum(t.values()))
    total = sum(timing.values())
    return [
        Row(f"{label}: {stage}, %", "reconstruction, elapsed time", 100.0 * s / total) for stage, s in timing.items()
    ]


def measure() -> list[Section]:
    """All sections."""
    rows, shares = [], []
    with one_blas_thread():
        for label, (name, changes) in FLIGHTS.items():
            problem = reconstruct(Mission.load(f"builtin:{name}", changes), leave_one_out=False).problem
            rows += compare(label, without_gate(problem))
            shares += stages(label, name, changes)
    text = """
The callbacks are numpy, one sigma point at a time, with the measurement models and the process noise of the package, so
that the mathematics is the same.
"""
    return [Section("Filter: against filterpy with Python callbacks", text, rows), Section("Stages", "", shares)]


if __name__ == "__main__":
    run(measure)
