"""Kill -9 at random moments of `run`, `diagnose` and `improve`: is a folder's result ever torn?

A command replaces an earlier result and is killed at a moment between its start and its end. Then the folder must hold
the earlier or the new result, whole: result and summary of one mission, a diagnosis that can be read or none, a ledger
with whole lines. ``python kills.py --moments 50``
"""

from __future__ import annotations

import argparse
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from edl_filter.results.files import DIAGNOSIS, RESIDUALS, RESULT, SUMMARY, read_diagnosis, read_ledger, read_summary
from edl_filter.results.netcdf import load
from edl_filter.results.reopen import reopen

MISSION = "builtin:practice_mer"
COMMANDS = {
    "run": ["run", MISSION, "--set", "name=new", "--no-figures", "-o"],
    "diagnose": ["diagnose", "--effect", "base_pressure"],
    "improve": ["improve", MISSION, "--most", "0", "--effect", "base_pressure", "-o"],
}


def start(name: str, folder: Path) -> subprocess.Popen[bytes]:
    """Start a command on a folder, in a process of its own."""
    command = [sys.executable, "-m", "edl_filter", *COMMANDS[name], str(folder)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def state(folder: Path) -> str:
    """What a folder holds: the mission's name of its result, and whether it has a diagnosis.

    Raises
    ------
    AssertionError, InputError
        It is torn.
    """
    read_ledger(folder)
    if not (folder / RESULT).is_file():
        assert not (folder / SUMMARY).is_file(), "a summary without a result"
        return "none"
    load(folder)
    name, summary = reopen(folder).mission.name, read_summary(folder)
    assert summary.mission == name, f"result of {name}, summary of {summary.mission}"
    diagnosed = (folder / DIAGNOSIS).is_file()
    assert diagnosed == (folder / RESIDUALS).is_file(), "diagnosis and residuals do not belong together"
    if diagnosed:
        assert read_diagnosis(folder).mission == name, "the diagnosis of another result"
    return f"{name}{', diagnosed' if diagnosed else ''}"


def killed(name: str, template: Path, folder: Path, after: float) -> str:
    """State of a copy of the folder `template` after a command was killed."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(template, folder)
    process = start(name, folder)
    try:
        process.wait(after)
        ended = " (had ended)"
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        ended = ""
    return state(folder) + ended


def main() -> None:
    """Kill each command at random moments and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=50, help="of each command")
    parser.add_argument("--commands", nargs="*", default=list(COMMANDS))
    parser.add_argument("--last", type=float, default=0.6, help="share of the moments in the last tenth of the time")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng, torn = random.Random(arguments.seed), 0
    with tempfile.TemporaryDirectory() as name:
        old, work = Path(name, "old"), Path(name, "work")
        subprocess.run(
            [sys.executable, "-m", "edl_filter", "run", MISSION, "--no-figures", "-o", str(old)],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        for command in arguments.commands:
            shutil.copytree(old, work, dirs_exist_ok=True)
            begin = time.monotonic()
            start(command, work).wait()
            duration = time.monotonic() - begin
            counts: dict[str, int] = {}
            for _ in range(arguments.moments):
                share = rng.uniform(0.85, 1.0) if rng.random() < arguments.last else rng.uniform(0.0, 0.85)
                try:
                    outcome = killed(command, old, work, share * duration)
                except Exception as error:
                    outcome, torn = f"TORN: {error}", torn + 1
                counts[outcome] = counts.get(outcome, 0) + 1
            print(f"{command}, {duration:.1f} s, killed at {arguments.moments} moments: {counts}", flush=True)
    sys.exit(1 if torn else 0)


if __name__ == "__main__":
    main()
