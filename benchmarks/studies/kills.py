"""Kill -9 at random moments of `run`, `diagnose`, `improve` and `campaign`: is a folder's result ever torn?

A command replaces an earlier result and is killed at a moment between its start and its end. Then the folder must hold
the earlier or the new result, whole: result and summary of one mission, a diagnosis that can be read or none, a ledger
with whole lines. A campaign continues in the same folder after each kill, and begins anew when it is complete; each of
its records must be that of a campaign that was never killed, number for number. ``python kills.py --moments 50``
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from edl_filter.results.files import DIAGNOSIS, RESIDUALS, RESULT, SUMMARY, read_diagnosis, read_ledger, read_summary
from edl_filter.results.netcdf import load
from edl_filter.results.reopen import reopen
from edl_filter.workflow.campaign_files import read_failures, read_records

MISSION = "builtin:practice_mer"
COMMANDS = {
    "run": ["run", MISSION, "--set", "name=new", "--no-figures", "-o"],
    "diagnose": ["diagnose", "--effect", "base_pressure"],
    "improve": ["improve", MISSION, "--most", "0", "--effect", "base_pressure", "-o"],
}
#: A campaign of Spirit's telemetry with other errors of the IMU in each case.
CAMPAIGN = """
name: kills
seed: 19
cases: 24
time_limit_s: 60.0
flights:
  spirit: {mission: builtin:mer_a}
dispersions:
  imu: {imu_errors: 1.0}
"""
CAMPAIGN_CASES = 24


def start(arguments: list[str], folder: Path) -> subprocess.Popen[bytes]:
    """Start a command on a folder, in a process and a session of its own."""
    command = [sys.executable, "-m", "edl_filter", *arguments, str(folder)]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )  # fmt: skip


def end_after(process: subprocess.Popen[bytes], seconds: float) -> bool:
    """Wait, then kill the process, and after it those that it started; whether it had ended by itself."""
    try:
        process.wait(seconds)
        ended = True
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        ended = False
    time.sleep(0.2)  # processes that it started go on for a moment
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    return ended


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


def killed(name: str, template: Path, folder: Path, after: float) -> tuple[str, bool]:
    """State of a copy of the folder `template` after a command was killed, and whether it had ended before."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(template, folder)
    ended = end_after(start(COMMANDS[name], folder), after)
    return state(folder), ended


def records(folder: Path) -> dict[int, Any]:
    """Values of the cases of a campaign by number.

    Raises
    ------
    AssertionError
        A case failed, or a file is not complete.
    """
    assert not read_failures(folder), f"failures: {read_failures(folder)}"
    return {r["case"]: r["values"] for r in read_records(folder, 0)}


def killed_campaign(file: Path, folder: Path, reference: dict[int, Any], after: float) -> tuple[str, bool]:
    """As `killed`, of a campaign that continues in `folder`; the folder is removed when all cases are done."""
    ended = end_after(start(["campaign", str(file), "--workers", "1", "-o"], folder), after)
    values = records(folder)
    differing = [n for n, v in values.items() if v != reference[n]]
    assert not differing, f"cases {differing} differ"
    complete = len(values) == CAMPAIGN_CASES
    assert complete or not ended, f"it ended with {len(values)} cases"
    if complete:
        shutil.rmtree(folder)
    return "complete" if complete else "part of the cases", ended


def kill_often(
    name: str, duration: float, kill: Callable[[float], tuple[str, bool]], rng: random.Random, options: Any
) -> int:
    """Kill a command at random moments and print the states after it; the number of those that are torn.

    A share of the moments is in the last part of the time, in which a run and a diagnosis write. Where the command had
    ended before the moment, another one is drawn.
    """
    torn, kills, attempts, counts = 0, 0, 0, dict[str, int]()
    while kills < options.moments and attempts < 6 * options.moments:
        share = rng.uniform(0.85, 1.05) if rng.random() < options.last else rng.uniform(0.0, 0.85)
        attempts += 1
        try:
            outcome, ended = kill(share * duration)
        except Exception as error:
            outcome, ended, torn = f"TORN: {error}", False, torn + 1
        if not ended:
            kills, counts[outcome] = kills + 1, counts.get(outcome, 0) + 1
    print(f"{name}, {duration:.1f} s, killed at {kills} moments of {attempts}: {counts}", flush=True)
    return torn


def duration_of(arguments: list[str], folder: Path) -> float:
    """Time of a command that is not killed, s: the median of three."""
    seconds = []
    for _ in range(3):
        begin = time.monotonic()
        start(arguments, folder).wait()
        seconds.append(time.monotonic() - begin)
    return sorted(seconds)[1]


def main() -> None:
    """Kill each command at random moments and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=50, help="of each command")
    parser.add_argument("--commands", nargs="*", default=[*COMMANDS, "campaign"])
    parser.add_argument("--last", type=float, default=0.6, help="share of the moments after 85 %% of the time")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng, torn = random.Random(options.seed), 0
    with tempfile.TemporaryDirectory() as name:
        old, work, campaign = Path(name, "old"), Path(name, "work"), Path(name, "campaign.yaml")
        start([*COMMANDS["run"][:2], "--no-figures", "-o"], old).wait()
        campaign.write_text(CAMPAIGN, encoding="utf-8")
        for command in options.commands:
            if command == "campaign":
                whole, arguments = Path(name, "whole"), ["campaign", str(campaign), "--workers", "1", "-o"]
                begin = time.monotonic()
                start(arguments, whole).wait()
                duration, reference = time.monotonic() - begin, records(whole)
                assert len(reference) == CAMPAIGN_CASES

                def kill(after: float, reference: dict[int, Any] = reference) -> tuple[str, bool]:
                    return killed_campaign(campaign, Path(name, "killed"), reference, after)
            else:
                shutil.copytree(old, work, dirs_exist_ok=True)
                duration = duration_of(COMMANDS[command], work)

                def kill(after: float, command: str = command) -> tuple[str, bool]:
                    return killed(command, old, work, after)

            torn += kill_often(command, duration, kill, rng, options)
    sys.exit(1 if torn else 0)


if __name__ == "__main__":
    main()
