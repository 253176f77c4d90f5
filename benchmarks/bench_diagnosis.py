"""A diagnosis of Spirit with the whole catalogue against a plain fit of each effect in turn, and its memory.

With and without the discrepancy field of the (proxy) database; `bench_diagnosis_fine` has a flight of 200 Hz. The plain
fit is what a user would do by hand: each effect in the model at its default places, and its parameters estimated by
Gauss-Newton through the same chain, from the same reconstruction. It has no ranking, no held-out score and one starting
place only. Each measurement is a process of its own.

Run: ``python benchmarks/bench_diagnosis.py``
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from measuring import Row, Section, at_most, run

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


def processor_time() -> float:
    """Of this process and of those that have ended which it started, s."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def compute(kind: str, name: str, changes: list[str]) -> dict[str, Any]:
    """Processor time, largest memory of one process and answer of one computation, in this process and its copies."""
    from edl_filter.diagnosis.diagnosis import diagnose
    from edl_filter.diagnosis.linear_model.flight_case import load_case
    from edl_filter.effects.registry import catalogue
    from edl_filter.mission import Mission

    begin = processor_time()
    case = load_case(Mission.load(f"builtin:{name}", changes))
    loading = processor_time() - begin
    if kind == "diagnose":
        diagnose(case, [catalogue()["wind"]])  # compiles
    begin = processor_time()
    answer = diagnose(case, catalogue().values()).verdict.sentence if kind == "diagnose" else fit_in_turn(case)
    spent = processor_time() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    return {"seconds": spent, "loading": loading, "memory": memory, "answer": answer}


def measured(kind: str, name: str, changes: list[str]) -> dict[str, Any]:
    """The same in a process of its own."""
    command = [sys.executable, str(Path(__file__).with_name("bench_diagnosis.py")), "--one", kind, name, *changes]
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
            f"{label}: diagnosis with the discrepancy field",
            "diagnosis without it",
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


def section(title: str, text: str, rows: list[Row]) -> Section:
    """Section of one flight."""
    explanation = f"""
The discrepancy field is that of the database's error ([](diagnosis.md)): it is on with `{FIELD}` and
off with `{NO_FIELD}`. A refit has one starting point and no ranking, no held-out score and no residual map. Each
computation was measured once, in a process of its own.
"""
    return Section(title, f"{text}\n{explanation.strip()}", rows)


def measure() -> list[Section]:
    """All sections."""
    return [section("Diagnosis: Spirit", "", compare("Spirit, 8 Hz", "mer_a", []))]


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(compute(sys.argv[2], sys.argv[3], sys.argv[4:])))
    else:
        run(measure)
