"""How long a diagnosis of the whole catalogue takes, beside a plain refit of each effect in turn, in the same run.

1. Spirit, with ``EDL_FILTER_DATA`` set: no hint, a proxy database, everything rough.
2. A simulated flight of 200 Hz with a hidden wind.

The plain refit is what a user would do by hand: each effect put into the model at its default places, and its
parameters found by Gauss-Newton through the same chain, from the same reconstruction. It ranks nothing, holds
nothing out, and begins at one place only.

Run: ``python benchmarks/bench_diagnosis.py``
"""

import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.diagnose import diagnose
from edl_filter.diagnosis.refit import refit
from edl_filter.diagnosis.rounds import linearise
from edl_filter.effects.catalogue import catalogue
from edl_filter.effects.effect import Active
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.simulation import Scenario, simulate

RATE = 200.0
WIND = {"east": -40.0, "north": 35.0, "h_lo": 8e3, "h_hi": 22e3}


def timed(function):
    """Result and time, s."""
    begin = time.perf_counter()
    found = function()
    return found, time.perf_counter() - begin


def in_turn(case):
    """Every effect of the catalogue refitted, one after the other; the name with the most evidence."""
    linear, evidence = linearise(case), {}
    for name, effect in catalogue().items():
        try:
            evidence[name] = refit(linear, (*case.effects, Active(effect, {})), linear.plain).evidence
        except InputError:
            continue  # this flight has not what it needs
    return max(evidence, key=evidence.get)


def compared(label, mission):
    """Print both times."""
    case, loading = timed(lambda: load_case(mission))
    diagnose(case, [catalogue()["wind"]])  # compiles
    made, whole = timed(lambda: diagnose(case, catalogue().values()))
    best, plain = timed(lambda: in_turn(case))
    print(
        f"{label}: reconstruction {loading:.1f} s, diagnosis {whole:.1f} s ({made.verdict.sentence}), "
        f"plain refits in turn {plain:.1f} s (best: {best}); ratio {whole / plain:.2f}",
        flush=True,
    )


def main():
    if os.environ.get("EDL_FILTER_DATA"):
        compared("Spirit, 8 Hz", Mission.load("builtin:mer_a"))
    fine = Scenario.load(
        "builtin:mer", [f"sampling.interval_s={1.0 / RATE}", "sampling.substeps=1", "altimeter.interval_s=0.125"]
    )
    with tempfile.TemporaryDirectory() as folder:
        path = simulate(fine, [Active(catalogue()["wind"], WIND)], 1).write(Path(folder) / "flight.h5")
        compared(f"simulated, {RATE:g} Hz", Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]))


if __name__ == "__main__":
    main()
