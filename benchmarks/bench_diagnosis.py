"""A diagnosis with the whole catalogue against a plain fit of each effect in turn, and its memory.

Spirit (8 Hz, a proxy database) and a simulated flight of 200 Hz with a hidden wind, each with and without the
discrepancy field of the database. The plain fit is what a user would do by hand: each effect in the model at its
default places, and its parameters estimated by Gauss-Newton through the same chain, from the same reconstruction. It
has no ranking, no held-out score and one starting place only. Each measurement is a process of its own.

Run: ``python benchmarks/bench_diagnosis.py``
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from measuring import Row, Section, at_most, run

RATE = 200.0
WIND = {"east": -40.0, "north": 35.0, "h_lo": 8e3, "h_hi": 22e3}
FIELD, NO_FIELD = "aerodynamics.coefficient_sigma=1", "aerodynamics.coefficient_sigma=0"


def fit_in_turn(case: Any) -> str:
    """Every effect of the catalogue fitted, one after the other; the name with the largest evidence."""
    from edl_filter.diagnosis.linear_model.linearization import linearize
    from edl_filter.diagnosis.selection.map_fit import fit_map
    from edl_filter.effects.base import EffectInstance
    from edl_filter.effects.registry import catalogue
    from edl_filter.errors import InputError

    model, evidence = linearize(case), {}
    for name, effect in catalogue().items():
        effects = (*case.effects, EffectInstance(effect, {}))
        try:
            evidence[name] = fit_map(model, effects, model.stated_noise_filter).evidence
        except InputError:
            continue  # the flight lacks what the effect needs
    return max(evidence, key=lambda name: evidence[name])


def one(kind: str, name: str, changes: list[str]) -> dict[str, Any]:
    """Processor time, largest memory and answer of one computation, in this process."""
    from edl_filter.diagnosis.diagnosis import diagnose
    from edl_filter.diagnosis.linear_model.flight_case import load_case
    from edl_filter.effects.registry import catalogue
    from edl_filter.mission import Mission

    begin = time.process_time()
    case = load_case(Mission.load(f"builtin:{name}", changes))
    loading = time.process_time() - begin
    if kind == "diagnose":
        diagnose(case, [catalogue()["wind"]])  # compiles
    begin = time.process_time()
    answer = diagnose(case, catalogue().values()).verdict.sentence if kind == "diagnose" else fit_in_turn(case)
    spent = time.process_time() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    return {"seconds": spent, "loading": loading, "memory": memory, "answer": answer}


def measured(kind: str, name: str, changes: list[str]) -> dict[str, Any]:
    """The same in a process of its own."""
    command = [sys.executable, __file__, "--one", kind, name, *changes]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    result: dict[str, Any] = json.loads(output.splitlines()[-1])
    print(kind, name, changes, result, file=sys.stderr, flush=True)
    return result


def compare(label: str, name: str, changes: list[str]) -> list[Row]:
    """Rows of one flight."""
    with_field, without = (measured("diagnose", name, [*changes, c]) for c in (FIELD, NO_FIELD))
    plain, plain_without = (measured("refit", name, [*changes, c]) for c in (FIELD, NO_FIELD))
    answer = f"diagnosis: {with_field['answer']} plain: {plain['answer']}"
    rows = [
        Row(
            f"{label}: diagnosis with the whole catalogue",
            "plain refit of each effect in turn",
            with_field["seconds"] / plain["seconds"],
            None,
            at_most(0.25),
            answer,
        ),
        Row(
            f"{label}, no discrepancy field: diagnosis with the whole catalogue",
            "plain refit of each effect in turn",
            without["seconds"] / plain_without["seconds"],
            None,
            at_most(0.25),
            f"diagnosis: {without['answer']} plain: {plain_without['answer']}",
        ),
        Row(
            f"{label}: diagnosis with",
            "diagnosis without discrepancy field",
            with_field["seconds"] / without["seconds"],
        ),
        Row(f"{label}: diagnosis", "reconstruction of the same flight", with_field["seconds"] / with_field["loading"]),
        Row(
            f"{label}: largest memory of reconstruction and diagnosis",
            "1 MB",
            with_field["memory"],
            None,
            at_most(400.0),
        ),
    ]
    return rows


def measure() -> list[Section]:
    """All sections."""
    from edl_filter.effects.base import EffectInstance
    from edl_filter.effects.registry import catalogue
    from edl_filter.simulation import Scenario, simulate

    rows = compare("Spirit, 8 Hz", "mer_a", [])
    fine = Scenario.load(
        "builtin:mer", [f"sampling.interval_s={1.0 / RATE}", "sampling.substeps=1", "altimeter.interval_s=0.125"]
    )
    with tempfile.TemporaryDirectory() as folder:
        path = simulate(fine, [EffectInstance(catalogue()["wind"], WIND)], 1).write(Path(folder) / "flight.h5")
        rows += compare(f"simulated, {RATE:g} Hz", "practice_mer", [f"telemetry.path={path}"])
    text = f"""
The discrepancy field is that of the database's error ([](diagnosis.md)); the missions have `{FIELD}` or
`{NO_FIELD}`. A refit has one starting place and no ranking, no held-out score and no residual map. The
flight of {RATE:g} Hz has a hidden wind. Each computation was measured once.
"""
    return [Section("Diagnosis", text, rows)]


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(one(sys.argv[2], sys.argv[3], sys.argv[4:])))
    else:
        run(measure)
