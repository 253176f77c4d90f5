"""Faults in the increments of one IMU of Spirit and Opportunity: is the answer still that of the flawless telemetry?

Each fault of `faults.SAMPLE_FAULTS` that changes values is put into the columns of one IMU of the table HIGHRATE, whose
other IMU is complete up to the backshell's separation, at a random time between `FIRST_S` and `BEFORE_DEPLOYMENT_S`
before the parachute. Those of a stretch of forces are also put into the accelerations of the table TRANSFORMED, at a
random time in `BEFORE_HIGHRATE_S`. The truth is unknown: position and velocity at the parachute's deployment are
compared with those of the flawless telemetry, in the sigmas of the former. ``python rover_faults.py -o FILE.jsonl``
goes on where it stopped, and reports.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from faults import FORCE, RATE, SAMPLE_FAULTS, THREE_SIGMAS
from lost_seconds import ROVERS, at_deployment
from study_lines import append_missing, read_lines, study_parser

from edl_filter import Mission
from edl_filter.errors import InputError
from edl_filter.pipeline import load
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.pipeline.trust import judge
from edl_filter.telemetry.mer_archive import SAMPLE_INTERVAL, MerTables, read_mer_tables

UNITS = ("backshell", "rover")
#: In place of a unit: the accelerations of TRANSFORMED, which are the backshell's, at the centre of mass.
ACCELERATIONS = "TRANSFORMED"
#: Faults of a stretch of the telemetry, and those that last to its end.
TRANSIENT = (
    "spike in force", "spike in rate", "burst in force", "burst in rate", "NaN rows", "zeros", "stuck force",
    "stuck rate", "saturated force", "repeated", "frozen packet", "bit flips", "noise of 10 sigmas",
    "noise of 300 sigmas",
)  # fmt: skip
LASTING = (
    "coarse, rounded", "sign of a force axis", "sign of a rate axis", "axes exchanged", "force scale of 1 %",
    "rate scale of 1 %", "force bias", "rate bias", "force ramp", "rate ramp",
)  # fmt: skip
#: Faults of a stretch of the forces alone.
OF_FORCES = tuple(name for name in TRANSIENT if "rate" not in name and name != "saturated force")
#: HIGHRATE begins at 90 s; the time before the parachute; times of faults in TRANSFORMED, s.
FIRST_S, BEFORE_DEPLOYMENT_S, BEFORE_HIGHRATE_S = 95.0, 15.0, (40.0, 85.0)


def with_fault(tables: MerTables, epoch: float, unit: str, name: str, at: float, seed: list[int]) -> MerTables:
    """Tables with a fault in the columns of one IMU from the time `at` on, s since the `epoch` (clock count)."""
    if unit == ACCELERATIONS:
        part, keys, interval = "transformed", {FORCE: "backshell_acceleration"}, 1.0
    else:
        part, interval = "highrate", SAMPLE_INTERVAL
        keys = {FORCE: f"{unit}_velocity_increment", RATE: f"{unit}_angle_increment"}
    table = getattr(tables, part)
    time = table.sclk - epoch
    data = {key: getattr(table, attribute) / interval for key, attribute in keys.items()}
    data |= {"time": time.copy()} | ({} if RATE in data else {RATE: np.zeros_like(data[FORCE])})
    changed = SAMPLE_FAULTS[name](data, int(np.searchsorted(time, at)), np.random.default_rng(seed)) or data
    columns = {attribute: changed[key] * interval for key, attribute in keys.items()}
    return replace(tables, **{part: replace(table, **columns)})


def flown(mission: Mission, unit: str, name: str, number: int, complete: np.ndarray, deployed: float) -> dict[str, Any]:
    """Outcome of one fault."""
    seed = [number, (*UNITS, ACCELERATIONS).index(unit)]
    times = BEFORE_HIGHRATE_S if unit == ACCELERATIONS else (FIRST_S, deployed - BEFORE_DEPLOYMENT_S)
    at = float(np.random.default_rng(seed).uniform(*times))
    epoch = load.mer_setup(mission).epoch_sclk

    def read(path: Path, spacecraft: int) -> MerTables:
        return with_fault(read_mer_tables(path, spacecraft), epoch, unit, name, at, seed)

    row: dict[str, Any] = {"flight": mission.name, "unit": unit, "fault": name, "time_s": at}
    try:
        with mock.patch.object(load, "read_mer_tables", read):
            result = reconstruct(mission, leave_one_out=False)
    except InputError as error:
        return row | {"refused": str(error)}
    state, covariance = at_deployment(result, deployed)
    difference, trust = state - complete, judge(result)
    return row | {
        "square": float(difference @ np.linalg.solve(covariance, difference)),
        "position_m": float(np.linalg.norm(difference[:3])),
        "velocity_m_s": float(np.linalg.norm(difference[3:])),
        "trustworthy": trust.trustworthy,
        "headline": trust.headline,
        "findings": sorted({f"{f.imu} {f.kind}: {f.repair}" for f in result.telemetry.findings}),
    }


def answer(row: dict[str, Any]) -> str:
    """``right``, ``flagged``, ``refused`` or ``lost``."""
    if "refused" in row:
        return "refused"
    if not row["trustworthy"]:
        return "flagged"
    return "right" if row["square"] <= THREE_SIGMAS else "lost"


def report(rows: list[dict[str, Any]]) -> None:
    """Print a table of the answers, and a line for each one that is not right."""
    print("| faults | tried | right | flagged | refused with a message | lost |\n|---|---|---|---|---|---|")
    increments, accelerations = (
        [row for row in rows if (row["unit"] == ACCELERATIONS) is chosen] for chosen in (False, True)
    )
    for label, group, names in (
        ("of a stretch of HIGHRATE", increments, TRANSIENT),
        ("of HIGHRATE that last to the end", increments, LASTING),
        ("of a stretch of TRANSFORMED", accelerations, OF_FORCES),
    ):
        answers = [answer(row) for row in group if row["fault"] in names]
        counts = " | ".join(str(answers.count(kind)) for kind in ("right", "flagged", "refused", "lost"))
        print(f"| {label} | {len(answers)} | {counts} |")
    for row in rows:
        if answer(row) != "right":
            detail = row.get("refused") or (
                f"{np.sqrt(row['square'] / 6.0):.2f} sigmas, {row['position_m']:.0f} m, {row['velocity_m_s']:.2f} m/s; "
                f"{row['headline']}"
            )
            print(f"{row['flight']} {row['unit']} {row['fault']} at {row['time_s']:.0f} s: {answer(row)}, {detail}")


@cache
def flawless(rover: str) -> tuple[Mission, np.ndarray, float]:
    """Mission of a rover, its state (6,) at the parachute's deployment without a fault, and the time of this, s."""
    mission = Mission.load(f"builtin:{rover}")
    deployed = load.event_times(mission, load.read_telemetry(mission))["parachute_deploy"]
    complete, _ = at_deployment(reconstruct(mission, leave_one_out=False), deployed)
    return mission, complete, deployed


def line_of(case: tuple[str, str, str]) -> dict[str, Any]:
    """Line of a rover, IMU and fault."""
    rover, unit, name = case
    mission, complete, deployed = flawless(rover)
    return flown(mission, unit, name, (*TRANSIENT, *LASTING).index(name), complete, deployed)


def case_of(row: dict[str, Any]) -> tuple[str, str, str]:
    """Rover, IMU and fault of a line."""
    return row["flight"], row["unit"], row["fault"]


def main() -> None:
    """Fly what is missing in the file, then report."""
    arguments = study_parser(__doc__, "study-results/rover-faults.jsonl").parse_args()
    cases = [*product(ROVERS, UNITS, (*TRANSIENT, *LASTING)), *product(ROVERS, [ACCELERATIONS], OF_FORCES)]
    append_missing(cases, line_of, case_of, arguments)
    report(read_lines(arguments.output))


if __name__ == "__main__":
    main()
