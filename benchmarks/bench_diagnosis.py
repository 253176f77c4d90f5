"""Time of a diagnosis with the whole catalogue, compared in the same run with a plain fit of each effect in turn.

1. Spirit: all effects, a proxy database, excess variance in all channels.
2. A simulated flight of 200 Hz with a hidden wind.

The plain fit is what a user would do by hand: each effect in the model at its default places, and its parameters
estimated by Gauss-Newton through the same chain, from the same reconstruction. It has no ranking, no held-out score and
one starting place only.

Run: ``python benchmarks/bench_diagnosis.py``
"""

import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.selection.map_fit import fit_map
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import catalogue
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.simulation import Scenario, simulate

RATE = 200.0
WIND = {"east": -40.0, "north": 35.0, "h_lo": 8e3, "h_hi": 22e3}


def timed(function):
    """Result, time and processor time of all threads, s."""
    begin, begin_cpu = time.perf_counter(), time.process_time()
    result = function()
    return result, time.perf_counter() - begin, time.process_time() - begin_cpu


def fit_in_turn(case):
    """Every effect of the catalogue fitted, one after the other; the name with the largest evidence."""
    model, evidence = linearize(case), {}
    for name, effect in catalogue().items():
        effects = (*case.effects, EffectInstance(effect, {}))
        try:
            evidence[name] = fit_map(model, effects, model.stated_noise_filter).evidence
        except InputError:
            continue  # the flight lacks what the effect needs
    return max(evidence, key=evidence.get)


def compare(label, mission):
    """Print both times; on a shared machine the ratio of the processor times is the more certain one."""
    case, loading, _ = timed(lambda: load_case(mission))
    diagnose(case, [catalogue()["wind"]])  # compiles
    diagnosis, diagnosis_time, diagnosis_cpu = timed(lambda: diagnose(case, catalogue().values()))
    best, fit_time, fit_cpu = timed(lambda: fit_in_turn(case))
    print(
        f"{label}: reconstruction {loading:.1f} s, diagnosis {diagnosis_time:.1f} s ({diagnosis.verdict.sentence}), "
        f"plain fits in turn {fit_time:.1f} s (best: {best}); ratio {diagnosis_time / fit_time:.2f}; processor time "
        f"{diagnosis_cpu:.1f} s and {fit_cpu:.1f} s, ratio {diagnosis_cpu / fit_cpu:.2f}",
        flush=True,
    )


def main():
    compare("Spirit, 8 Hz", Mission.load("builtin:mer_a"))
    fine = Scenario.load(
        "builtin:mer", [f"sampling.interval_s={1.0 / RATE}", "sampling.substeps=1", "altimeter.interval_s=0.125"]
    )
    with tempfile.TemporaryDirectory() as folder:
        path = simulate(fine, [EffectInstance(catalogue()["wind"], WIND)], 1).write(Path(folder) / "flight.h5")
        compare(f"simulated, {RATE:g} Hz", Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]))


if __name__ == "__main__":
    main()
