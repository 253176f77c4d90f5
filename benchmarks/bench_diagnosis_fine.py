"""A diagnosis of a simulated flight of 200 Hz with a hidden wind, as `bench_diagnosis`.

Run: ``python benchmarks/bench_diagnosis_fine.py``
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from bench_diagnosis import compare, section
from measuring import Section, run

from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import catalogue
from edl_filter.simulation import Scenario, simulate

RATE = 200.0
WIND = {"east": -40.0, "north": 35.0, "h_lo": 8e3, "h_hi": 22e3}


def measure() -> list[Section]:
    """All sections."""
    sampling = [f"sampling.interval_s={1.0 / RATE}", "sampling.substeps=1", "altimeter.interval_s=0.125"]
    with tempfile.TemporaryDirectory() as folder:
        flight = simulate(Scenario.load("builtin:mer", sampling), [EffectInstance(catalogue()["wind"], WIND)], 1)
        path = flight.write(Path(folder) / "flight.h5")
        rows = compare(f"simulated, {RATE:g} Hz", "practice_mer", [f"telemetry.path={path}"])
    return [section(f"Diagnosis: {RATE:g} Hz", "A simulated flight with a hidden wind.", rows)]


if __name__ == "__main__":
    run(measure)
