"""Sensitivity of the verdicts to every threshold of the diagnosis: `make study-thresholds` (hours; resumable).

Each key of `DecisionSettings` is multiplied by 2 and by 1/2, one at a time (whole numbers are rounded, values outside
the accepted range are moved to its end), and every practice flight is diagnosed with it. One line per diagnosis is
appended to a JSON-lines file; lines that are there already are not computed again. ``--report`` writes its numbers into
docs/thresholds.md.

Most variations need no diagnosis of their own (`tracked_thresholds`). The diagnosis with the defaults records which
variations change the outcome of a comparison or a number that is used; the others give the same diagnosis, bit for bit,
and have ``"decided": "no comparison changes"`` in their line. This is done for all flights first. The diagnosis is then
repeated, and each remaining variation is continued in a copy of the process from where it first differs.

    python benchmarks/studies/thresholds.py [--flights FOLDER] -o thresholds.jsonl [--workers N | --scheduler ADDRESS]
    python benchmarks/studies/thresholds.py --verify FLIGHT SETTING FACTOR [--flights FOLDER] -o thresholds.jsonl
    python benchmarks/studies/thresholds.py --report thresholds.jsonl
"""

import os
import subprocess
import sys
import time
import traceback
from contextlib import ExitStack, nullcontext
from functools import partial
from pathlib import Path
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from calibration_report import insert
from study_lines import append_line, computed, lines_so_far, read_lines, study_parser
from tracked_thresholds import TrackedSettings, Variations, fork, names_in, tracked_range

from edl_filter import Mission
from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model import linearization
from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.noise import excess_colour, variance_components
from edl_filter.diagnosis.selection import map_fit, outer_loop, ranking, screening
from edl_filter.effects.registry import catalogue
from edl_filter.errors import InputError
from edl_filter.estimation import kalman, parallel
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.mission.shipped import shipped_data
from edl_filter.mission.validators import Within
from edl_filter.pipeline.reconstruct import reconstruct

FACTORS = (0.5, 2.0)
#: Flights of the folder, and the missions that they belong to.
VEHICLES = {3: "phoenix", 5: "phoenix"}
#: Flights to begin with: one effect missing, clean, something unknown.
FIRST = ("practice_04", "practice_06", "practice_08")
#: Settings that are read as plain numbers: tuples, and what becomes a parameter of an effect with hooks of its own.
PLAIN = {"altitude_step_m", *(n for n, f in DecisionSettings.model_fields.items() if isinstance(f.default, tuple))}
#: Modules in which a setting limits the number of iterations.
ITERATING = (linearization, map_fit, outer_loop, screening, variance_components)


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


def variations():
    """Setting and factor of all variations → the setting's value."""
    keys = [(name, factor) for name in DecisionSettings.model_fields for factor in FACTORS]
    return {key: value for key in keys if (value := changed_value(*key)) is not None}


def mission_of(path, name, factor):
    """Mission of a practice flight with one setting changed."""
    number = int(path.stem.rpartition("_")[2])
    changes = [f"telemetry.path={path}"]
    if name is not None:
        changes.append(f"diagnosis.{name}={changed_value(name, factor)}")
    return Mission.load(f"builtin:practice_{VEHICLES.get(number, 'mer')}", changes)


def outcome(mission):
    """What the diagnosis of a mission says: verdict, ranking and probabilities."""
    verdict = diagnose(flight_case(reconstruct(mission, leave_one_out=False)), catalogue().values()).verdict
    leader = verdict.entries[0] if verdict.entries else None
    return {
        "verdict": verdict.verdict,
        "first": None if leader is None else leader.hypothesis.label,
        "same_as": [] if leader is None else list(leader.same_as),
        "none": float(verdict.none),
        "something_else": float(verdict.something_else),
        "ranking": [[e.hypothesis.label, float(e.probability)] for e in verdict.entries],
    }


def diagnosis_line(path, name, factor):
    """Line of one flight with one setting changed, from a diagnosis of its own."""
    begin = time.perf_counter()
    line = {"flight": path.stem, "setting": name, "factor": factor}
    try:
        line |= outcome(mission_of(path, name, factor))
    except InputError as error:
        line["error"] = str(error)
    return line | {"seconds": round(time.perf_counter() - begin, 1)}


def _untracked(self, name):
    """Attribute of settings that are not tracked: an error where the diagnosis reads one."""
    if name in DecisionSettings.model_fields:
        raise RuntimeError(f"{name} was read from settings that are not tracked")
    return object.__getattribute__(self, name)


def tracked_outcome(path, tracked, plain):
    """Outcome of the defaults, or of the variation that this process continues, in one thread and one process."""
    mission = mission_of(path, None, 1.0)
    settings = TrackedSettings(tracked, mission.diagnosis, plain)
    with ExitStack() as stack:
        for module in ITERATING:
            stack.enter_context(patch.object(module, "range", tracked_range, create=True))
        for module in (kalman, excess_colour):
            stack.enter_context(patch.object(module, "map_threads", lambda f, items: [f(item) for item in items]))
        for module in (parallel, ranking):
            stack.enter_context(patch.object(module, "process_count", lambda: 1))
        stack.enter_context(
            patch.object(ranking, "in_background", lambda function: nullcontext(partial(lambda x: x, function())))
        )
        stack.enter_context(patch.object(DecisionSettings, "__getattribute__", _untracked))
        return outcome(mission.model_copy(update={"diagnosis": settings}))


def tracked_run(path, keys, branch):
    """The diagnosis with the defaults and variations of it.

    Returns the variations, whose `current` names the one that this process continued, and the outcome. A setting that
    code refuses because it is no plain number is read as one, from the beginning.
    """
    plain = set(PLAIN)
    while True:
        tracked = Variations({key: value for key, value in variations().items() if key in keys}, branch)
        try:
            return tracked, tracked_outcome(path, tracked, plain)
        except InputError as error:
            return tracked, {"error": str(error)}
        except Exception as error:
            refused = names_in(error) - plain
            if tracked.current is not None:
                # of settings that were refused there is another attempt
                crash = {"error": f"{type(error).__name__}: {error}", "crash": traceback.format_exc()}
                return tracked, {} if refused else crash
            if not refused:
                raise
            print(f"{path.stem}: read as plain numbers: {', '.join(sorted(refused))} ({error})", flush=True)
            plain |= refused


def write_decided(path, keys, result, output):
    """Lines of variations that never differ from the defaults."""
    for name, factor in sorted(keys):
        line = {"flight": path.stem, "setting": name, "factor": factor, "decided": "no comparison changes"}
        append_line(output, line | result)


def place():
    """Function of the package that is running, as text."""
    frames = (frame for frame, _ in traceback.walk_stack(None))
    frame = next(f for f in frames if "edl_filter" in Path(f.f_code.co_filename).parts)
    return f"{frame.f_globals['__name__']}.{frame.f_code.co_qualname}"


def decide_by_comparisons(path, output):
    """Lines of the defaults, and of the variations in which no comparison changes."""
    line, begin = diagnosis_line(path, None, 1.0), time.perf_counter()
    remaining = []

    def record(key):
        remaining.append([*key, round(time.perf_counter() - begin, 1), place()])
        return False

    tracked, result = tracked_run(path, variations(), record)
    differing = [key for key, value in result.items() if line.get(key) != value]
    if differing:
        raise RuntimeError(f"{path.stem}: the diagnosis with tracked settings differs: {', '.join(differing)}")
    write_decided(path, tracked.pending, result, output)
    append_line(output, line | {"remaining": remaining})


def compute_remaining(path, keys, output):
    """Lines of variations, each continued from where it first differs from the defaults."""
    begin = time.perf_counter()

    def branch(key):
        nonlocal begin
        start = time.perf_counter()
        if copied := fork(key):
            begin = start
        return copied

    tracked, result = tracked_run(path, keys, branch)
    if tracked.current is None:
        write_decided(path, tracked.pending, result, output)
        return
    name, factor = tracked.current
    if result:
        line = {"flight": path.stem, "setting": name, "factor": factor} | result
        append_line(output, line | {"seconds": round(time.perf_counter() - begin, 1)})
    os._exit(0)


def compute_separately(path, keys, output):
    """Lines of variations, each from a diagnosis of its own."""
    for key in sorted(keys):
        print(f"{path.stem}: {key} has no line from its copy of the process and is diagnosed", flush=True)
        append_line(output, diagnosis_line(path, *key))


def verify(path, name, factor, lines):
    """Compare a line with a diagnosis of its own."""
    line = next(v for v in lines if (v["flight"], v["setting"], v["factor"]) == (path.stem, name, factor))
    own = diagnosis_line(path, name, factor)
    keys = own.keys() - {"seconds"}
    differing = [key for key in sorted(keys) if line.get(key) != own[key]]
    how = "decided by comparisons" if "decided" in line else "continued"
    print(f"{path.stem} {name} {factor} ({how}): {', '.join(differing) or 'identical'}", flush=True)


def remaining_keys(flight, lines, longest):
    """Variations without a line that differ from the defaults at most `longest` seconds before the end."""
    lines = [line for line in lines if line["flight"] == flight]
    remaining = next(line["remaining"] for line in lines if line["setting"] is None)
    end = max((time for _, _, time, _ in remaining), default=0.0)
    done = {(line["setting"], line["factor"]) for line in lines}
    return {(name, factor) for name, factor, time, _ in remaining if end - time < longest} - done


def compute_flight(path, output, longest):
    """Lines of one flight that the file does not contain."""
    if not any(line["flight"] == path.stem and line["setting"] is None for line in lines_so_far(output)):
        decide_by_comparisons(path, output)
    for attempt in (compute_remaining, compute_separately):
        if keys := remaining_keys(path.stem, lines_so_far(output), longest):
            attempt(path, keys, output)


def run_command(command):
    """Run the study for one flight in a process of its own: `compute_remaining` copies its process."""
    subprocess.run(command, check=True)


def answer(line):
    """What a diagnosis said, in one text."""
    if "error" in line:
        return "crash" if "crash" in line else "refused"
    if line["verdict"] != "missing":
        return line["verdict"]
    return line["first"]


def short(flight):
    """A flight's number, as the table has it."""
    return flight.rpartition("_")[2]


def report(lines):
    """Numbers of the study, as Markdown: defaults and number of variations of each flight, and the table of changes."""
    defaults = {line["flight"]: line for line in lines if line["setting"] is None}
    varied = {(line["flight"], line["setting"], line["factor"]): line for line in lines if line["setting"] is not None}
    keys = variations()
    decided = {case for case, line in varied.items() if "decided" in line}
    changed = {case for case, line in varied.items() if answer(line) != answer(defaults[case[0]])}
    total = len(keys) * len(defaults)
    text = [
        f"{len(DecisionSettings.model_fields)} thresholds have {len(keys)} variations within their ranges, which are "
        f"{total} diagnoses of {len(defaults)} flights: {len(decided)} are decided by comparisons, "
        f"{len(varied) - len(decided)} were computed, {total - len(varied)} are missing. {len(changed)} of the "
        f"{len(varied)} have another answer than the defaults.",
        "",
        "| flight | answer with the defaults | probability | by comparisons | computed | missing | another answer |",
        "|---|---|---|---|---|---|---|",
    ]
    for flight, line in sorted(defaults.items()):
        own = [case for case in varied if case[0] == flight]
        count = sum(case in decided for case in own)
        numbers = (count, len(own) - count, len(keys) - len(own), sum(case in changed for case in own))
        first = line["ranking"][0][1] if line["ranking"] else 0.0
        probability = {"clean": line["none"], "unknown": line["something_else"]}.get(line["verdict"], first)
        text.append(f"| {flight} | {answer(line)} | {probability:.3f} | {' | '.join(map(str, numbers))} |")
    heads = [
        "| threshold | default | factor | value | another answer | by comparisons | computed | missing |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows = {}
    for (name, factor), value in keys.items():
        cases = [(flight, name, factor) for flight in sorted(defaults)]
        changes = [f"{short(case[0])}: {answer(varied[case])}" for case in cases if case in changed]
        missing = [short(case[0]) for case in cases if case not in varied]
        count = sum(case in decided for case in cases)
        cells = [
            f"`{name}`",
            number_text(DecisionSettings.model_fields[name].default),
            f"{factor:g}",
            number_text(value),
        ]
        cells += [", ".join(changes) or "none", str(count), str(len(cases) - count - len(missing)), ", ".join(missing)]
        rows[name, factor] = "| " + " | ".join(cells).rstrip() + " |"
    text += ["", "Variations with another answer; flights are given by their numbers:", "", *heads]
    text += [rows[key] for key in keys if any(case[1:] == key for case in changed)]
    text += ["", "All variations; *missing* lists the flights without a result:", "", *heads, *rows.values()]
    return "\n".join(text)


def number_text(value):
    """A setting's value in a table."""
    return ", ".join(f"{v:g}" for v in value) if isinstance(value, (tuple, list)) else f"{value:g}"


def main():
    parser = study_parser(__doc__.splitlines()[0], "study-results/thresholds.jsonl")
    parser.add_argument(
        "--flights", type=Path, default=Path("tests/data/practice"), help="folder with practice_01.h5, …"
    )
    parser.add_argument(
        "--longest",
        type=float,
        default=float("inf"),
        help="s; only variations that are continued for this long; 0: none",
    )
    parser.add_argument("--flight", help="this flight only, in this process")
    parser.add_argument("--verify", nargs=3, metavar=("FLIGHT", "SETTING", "FACTOR"), help="against its own diagnosis")
    parser.add_argument("--report", type=Path, help="write docs/thresholds.md from this file")
    options = parser.parse_args()
    if options.report is not None:
        page = Path("docs/thresholds.md")
        page.write_text(insert(page.read_text(encoding="utf-8"), report(read_lines(options.report))), encoding="utf-8")
        return
    options.output.parent.mkdir(parents=True, exist_ok=True)
    paths = {path.stem: path for path in (shipped_data("practice_06", ""), *options.flights.glob("practice_*.h5"))}
    if options.verify is not None:
        flight, name, factor = options.verify
        verify(paths[flight], name, float(factor), read_lines(options.output))
        return
    flights = sorted(paths.values(), key=lambda path: (path.stem not in FIRST, path.stem))
    if options.flight is not None:
        compute_flight(paths[options.flight], options.output, options.longest)
        return
    command = (sys.executable, __file__, "--flights", str(options.flights.resolve()))
    for longest in (0.0, options.longest):
        settings = "-o", str(options.output.resolve()), "--longest", str(longest)
        commands = [(*command, *settings, "--flight", path.stem) for path in flights]
        for _ in computed(run_command, commands, options.scheduler, options.workers):
            pass


if __name__ == "__main__":
    main()
