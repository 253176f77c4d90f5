"""Sensitivity of the verdicts to every threshold of the diagnosis: `make study-thresholds` (hours; resumable).

Each key of `DecisionSettings` is multiplied by 2 and by 1/2, one at a time (whole numbers are rounded, values outside
the accepted range are moved to its end), and every practice flight is diagnosed with it. One line per diagnosis is
appended to a JSON-lines file; lines that are there already are not computed again. ``--report`` writes
docs/thresholds.md from it.

    python benchmarks/studies/thresholds.py [--flights FOLDER] -o thresholds.jsonl [--worker K --workers N]
    python benchmarks/studies/thresholds.py --report thresholds.jsonl
"""

import argparse
import json
import os
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from edl_filter import Mission
from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.effects.registry import catalogue
from edl_filter.errors import InputError
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.mission.shipped import shipped_data
from edl_filter.mission.validators import Within
from edl_filter.pipeline.reconstruct import reconstruct

FACTORS = (0.5, 2.0)
#: Flights of the folder, and the missions that they belong to.
VEHICLES = {3: "phoenix", 5: "phoenix"}
#: Flights to begin with: one effect missing, clean, something unknown.
FIRST = ("practice_04", "practice_06", "practice_08")


def limits(name):
    """Least and greatest value of a setting."""
    field = DecisionSettings.model_fields[name]
    within = next((m for m in field.metadata if isinstance(m, Within)), None)
    if within is not None:
        return within.low, within.high
    low = next((m.ge for m in field.metadata if hasattr(m, "ge")), 0)
    return low, next((m.le for m in field.metadata if hasattr(m, "le")), 10**9)


def changed_value(name, factor):
    """A setting's value times a factor, within its range; None where that is the default or an excluded bound."""
    default = DecisionSettings.model_fields[name].default
    if isinstance(default, tuple):
        return [factor * v for v in default]
    low, high = limits(name)
    value = min(max(default * factor, low), high)
    value = round(value) if isinstance(default, int) else float(value)
    if value == default or (value == low and isinstance(default, float)):
        return None
    return value


def cases(flights):
    """Flight, setting, factor: every flight with the defaults, then flight by flight all variations."""
    yield from ((flight, None, 1.0) for flight in flights)
    for flight in flights:
        for name in DecisionSettings.model_fields:
            yield from ((flight, name, f) for f in FACTORS if changed_value(name, f) is not None)


def mission_of(path, name, factor):
    """Mission of a practice flight with one setting changed."""
    number = int(path.stem.rpartition("_")[2])
    changes = [f"telemetry.path={path}"]
    if name is not None:
        changes.append(f"diagnosis.{name}={changed_value(name, factor)}")
    return Mission.load(f"builtin:practice_{VEHICLES.get(number, 'mer')}", changes)


def diagnosis_line(path, name, factor):
    """Verdict of one flight with one setting changed."""
    begin = time.perf_counter()
    line = {"flight": path.stem, "setting": name, "factor": factor}
    try:
        case = flight_case(reconstruct(mission_of(path, name, factor), leave_one_out=False))
        verdict = diagnose(case, catalogue().values()).verdict
        leader = verdict.entries[0] if verdict.entries else None
        line |= {
            "verdict": verdict.verdict,
            "first": None if leader is None else leader.hypothesis.label,
            "same_as": [] if leader is None else list(leader.same_as),
        }
    except InputError as error:
        line["error"] = str(error)
    return line | {"seconds": round(time.perf_counter() - begin, 1)}


def read_lines(path):
    """Lines of the study so far."""
    return [json.loads(text) for text in path.read_text().splitlines()] if path.is_file() else []


def answer(line):
    """What a diagnosis said, in one text."""
    if "error" in line:
        return "error"
    if line["verdict"] != "missing":
        return line["verdict"]
    return line["first"]


def report(lines):
    """Markdown of the study."""
    defaults = {line["flight"]: answer(line) for line in lines if line["setting"] is None}
    by_setting = {}
    for line in lines:
        if line["setting"] is not None:
            by_setting.setdefault(line["setting"], {}).setdefault(line["factor"], []).append(line)
    rows = []
    for name in DecisionSettings.model_fields:
        cells = []
        for factor in FACTORS:
            varied = by_setting.get(name, {}).get(factor)
            if varied is None:
                cells.append("(at its bound)" if changed_value(name, factor) is None else "not run")
                continue
            changes = [f"{v['flight']}: {answer(v)}" for v in varied if answer(v) != defaults.get(v["flight"])]
            count = "" if len(varied) == len(defaults) else f" ({len(varied)} of {len(defaults)} flights run)"
            cells.append(("; ".join(changes) or "none") + count)
        default = DecisionSettings.model_fields[name].default
        rows.append((name, default, *cells))
    cells = [cell for row in rows for cell in row[2:] if cell not in ("not run", "(at its bound)")]
    stable = sum(cell.startswith("none") for cell in cells)
    flights = sorted({line["flight"] for line in lines if line["setting"] is not None})
    text = [
        "# Sensitivity to the thresholds",
        "",
        "Every threshold of the diagnosis (`diagnosis:` of a mission) times 1/2 and times 2, one at a time, on the",
        "practice flights: which verdicts change. `make study-thresholds` repeats the study.",
        "",
        "With the defaults: " + "; ".join(f"{flight}: {verdict}" for flight, verdict in sorted(defaults.items())) + ".",
        "",
        f"{stable} of the {len(cells)} variations that were run change no verdict. They were run on "
        f"{', '.join(flights) or 'no flight'}; the table says where flights are missing.",
        "",
        "| threshold | default | times 1/2 | times 2 |",
        "|---|---|---|---|",
    ]
    text += [f"| `{name}` | {default} | {half} | {double} |" for name, default, half, double in rows]
    return "\n".join(text) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--flights", type=Path, default=Path("tests/data/practice"), help="folder with practice_01.h5, …"
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("study-results/thresholds.jsonl"))
    parser.add_argument("--worker", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--report", type=Path, help="write docs/thresholds.md from this file")
    options = parser.parse_args()
    if options.report is not None:
        Path("docs/thresholds.md").write_text(report(read_lines(options.report)), encoding="utf-8")
        return
    options.output.parent.mkdir(parents=True, exist_ok=True)
    done = {(line["flight"], line["setting"], line["factor"]) for line in read_lines(options.output)}
    paths = {path.stem: path for path in (shipped_data("practice_06", ""), *options.flights.glob("practice_*.h5"))}
    flights = sorted(paths.values(), key=lambda path: (path.stem not in FIRST, path.stem))
    for i, (path, name, factor) in enumerate(cases(flights)):
        if i % options.workers != options.worker or (path.stem, name, factor) in done:
            continue
        line = diagnosis_line(path, name, factor)
        with options.output.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    main()
