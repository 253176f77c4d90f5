"""Faults of one IMU, with a complete second one or alone: is the answer right, and is the fault named?

Each fault is put into a simulated flight at a random time, or over the whole flight, and the flight is reconstructed.
The answer is right where position and velocity at the parachute's deployment are within the ellipsoid that holds
99.73 % (three sigmas), against the simulator's truth. An outcome that is wrong is silent if the result counts as
trustworthy and nothing names the fault. ``python faults.py -o faults.jsonl`` goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.stats import chi2

from edl_filter import Mission
from edl_filter.errors import InputError
from edl_filter.pipeline.reconstruct import Reconstruction, reconstruct
from edl_filter.pipeline.trust import contradicting
from edl_filter.simulation import Scenario, simulate

FORCE, RATE = "specific_force", "angular_rate"
#: Limit of the squared error in units of its covariance, six degrees of freedom: three sigmas.
THREE_SIGMAS = float(chi2.ppf(0.9973, 6))

Samples = dict[str, np.ndarray]
Fault = Callable[[Samples, int, np.random.Generator], Samples | None]


def removed(count: int) -> Fault:
    """Samples that are missing."""
    return lambda data, i, _: {key: np.delete(v, slice(i, i + count), axis=0) for key, v in data.items()}


def spike(key: str, size: float, count: int = 1) -> Fault:
    """Added values of random sign in one axis."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        data[key][i : i + count, rng.integers(3)] += size * rng.choice([-1.0, 1.0], count) * rng.uniform(0.5, 1, count)

    return change


def constant(count: int, value: float) -> Fault:
    """Packets whose values are all the same."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        for key in (FORCE, RATE):
            data[key][i : i + count] = value

    return change


def stuck(key: str, count: int) -> Fault:
    """An axis repeats its last value."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        axis = rng.integers(3)
        data[key][i : i + count, axis] = data[key][i, axis]

    return change


def saturated(data: Samples, i: int, rng: np.random.Generator) -> None:
    """The accelerometers' largest axis is limited to 60 % of its peak before the parachute."""
    axis = int(np.argmax(np.abs(data[FORCE][: len(data["time"]) * 2 // 3]).max(axis=0)))
    limit = 0.6 * np.abs(data[FORCE][: len(data["time"]) * 2 // 3, axis]).max()
    data[FORCE][:, axis] = np.clip(data[FORCE][:, axis], -limit, limit)


def ended(data: Samples, i: int, _: np.random.Generator) -> Samples:
    """The IMU is dead from then on."""
    return {key: values[:i] for key, values in data.items()}


def exchanged(data: Samples, i: int, _: np.random.Generator) -> Samples:
    """Packets out of order."""
    order = np.arange(len(data["time"]))
    order[i : i + 4] = [i + 2, i + 3, i, i + 1]
    return {key: values[order] for key, values in data.items()}


def sent_twice(data: Samples, i: int, _: np.random.Generator) -> Samples:
    """Packets twice with their times."""
    return {key: np.insert(v, i + 4, v[i : i + 4], axis=0) for key, v in data.items()}


def repeated(data: Samples, i: int, _: np.random.Generator) -> None:
    """Packets twice with new times."""
    for key in (FORCE, RATE):
        data[key][i + 4 : i + 8] = data[key][i : i + 4]


def jump(step: float, count: int | None = None) -> Fault:
    """The clock jumps, for `count` packets or for ever."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        data["time"][i : None if count is None else i + count] += step

    return change


def drift(rate: float) -> Fault:
    """The clock runs fast by a constant ratio from the first sample on."""

    def change(data: Samples, _i: int, _: np.random.Generator) -> None:
        data["time"] += rate * (data["time"] - data["time"][0])

    return change


def coarse(force: float, rate: float, carried: bool) -> Fault:
    """Increments of velocity (m/s) and angle (rad) in coarse steps, with or without carrying the remainder."""

    def change(data: Samples, _i: int, _: np.random.Generator) -> None:
        interval = float(np.median(np.diff(data["time"])))
        for key, quantum in ((FORCE, force), (RATE, rate)):
            increments = data[key] * interval
            if carried:
                counts = np.diff(np.round(np.cumsum(increments, axis=0) / quantum), axis=0, prepend=0.0)
            else:
                counts = np.round(increments / quantum)
            data[key][:] = counts * quantum / interval

    return change


FAULTS: dict[str, Fault] = {
    "none": lambda data, i, rng: None,
    "spike in force": spike(FORCE, 1000.0),
    "spike in rate": spike(RATE, 3.0),
    "burst in force": spike(FORCE, 300.0, 6),
    "burst in rate": spike(RATE, 2.0, 6),
    "gap of 1 s": lambda data, i, rng: removed(round(1.0 / np.median(np.diff(data["time"]))))(data, i, rng),
    "gap of 10 s": lambda data, i, rng: removed(round(10.0 / np.median(np.diff(data["time"]))))(data, i, rng),
    "NaN rows": constant(4, np.nan),
    "zeros": constant(16, 0.0),
    "stuck force": stuck(FORCE, 40),
    "stuck rate": stuck(RATE, 40),
    "saturated force": saturated,
    "dead": ended,
    "reordered": exchanged,
    "sent twice": sent_twice,
    "repeated": repeated,
    "clock ahead": jump(0.5),
    "clock back": jump(-0.5),
    "late times": jump(7.0, 3),
    "drift of 100 ppm": drift(1e-4),
    "drift of 1000 ppm": drift(1e-3),
    "drift of -1 %": drift(-1e-2),
    "coarse, carried": coarse(6.25e-3, 1e-4, True),
    "coarse, rounded": coarse(6.25e-3, 1e-4, False),
}


def outcome(reconstruction: Reconstruction, truth: Any) -> dict[str, Any]:
    """Squared error at the parachute, trust, and the findings."""
    time = truth.deployed
    nodes = np.array([node.time for node in reconstruction.filter_pass.nodes])
    node = int(np.argmin(np.abs(nodes - time)))
    error = reconstruction.smoothed.states[node].nav[:6] - truth.at(nodes[node : node + 1])[0][:6]
    covariance = reconstruction.smoothed.covariance[node][:6, :6]
    recovery = reconstruction.recovery
    wrong = contradicting(reconstruction.filter_pass)
    return {
        "square": float(error @ np.linalg.solve(covariance, error)),
        "position_m": float(np.linalg.norm(error[:3])),
        "velocity_m_s": float(np.linalg.norm(error[3:])),
        "sigma_m": float(np.sqrt(np.trace(covariance[:3, :3]))),
        "sigma_m_s": float(np.sqrt(np.trace(covariance[3:, 3:]))),
        "trustworthy": not wrong and (recovery is None or recovery.cause == "gap"),
        "recovery": None if recovery is None else recovery.cause,
        "rejected": sorted(wrong),
        "findings": sorted({f"{f.imu} {f.kind}" for f in reconstruction.telemetry.findings}),
    }


def flown(scenario: Scenario, seed: int, name: str, imus: int) -> dict[str, Any]:
    """Simulate a flight, put a fault into it and reconstruct it."""
    flight = simulate(scenario, seed=seed)
    rng = np.random.default_rng([seed, list(FAULTS).index(name)])
    with tempfile.TemporaryDirectory() as folder:
        path = flight.write(Path(folder) / "flight.h5")
        with h5py.File(path, "a") as file:
            group = file["imu/primary"]
            data = {key: group[key][()] for key in ("time", FORCE, RATE)}
            at = rng.uniform(60.0, flight.motion.deployed - 15.0)
            data = FAULTS[name](data, int(np.searchsorted(data["time"], at)), rng) or data
            for key, values in data.items():
                del group[key]
                group[key] = values
            if imus == 1:
                del file["imu/secondary"]
        try:
            mission = Mission.load(scenario.mission, [f"telemetry.path={path}"])
            return outcome(reconstruct(mission, leave_one_out=False), flight.motion)
        except InputError as error:
            return {"refused": str(error).replace(str(path), "FLIGHT")}


def verdict(row: dict[str, Any]) -> str:
    """``right``, ``flagged``, ``refused``, ``named`` (wrong, with a finding) or ``silent`` (wrong, without one)."""
    if "refused" in row:
        return "refused"
    if not row["trustworthy"]:
        return "flagged"
    if row["square"] <= THREE_SIGMAS:
        return "right"
    return "named" if row["findings"] else "silent"


def report(rows: list[dict[str, Any]]) -> None:
    """Print one line for each fault and number of IMUs."""
    groups: dict[tuple[int, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["imus"], row["fault"]].append(row)
    for (imus, fault), members in sorted(groups.items(), reverse=True):
        counts = {kind: sum(verdict(r) == kind for r in members)
                  for kind in ("right", "flagged", "refused", "named", "silent")}  # fmt: skip
        named = sum(bool(r.get("findings")) or "refused" in r for r in members)
        ratio = np.median([np.sqrt(r["square"] / 6.0) for r in members if "square" in r] or [np.nan])
        listed = ", ".join(f"{k} {v}" for k, v in counts.items() if v)
        print(f"{imus} IMU {fault:<20} {len(members):3d}: {listed}; named {named}; median error {ratio:.2f} sigmas")


def main() -> None:
    """Fly what is missing in the file, then report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("study-results/faults.jsonl"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--faults", nargs="*", default=list(FAULTS))
    parser.add_argument("--imus", type=int, nargs="*", default=[2])
    parser.add_argument("--scenarios", nargs="*", default=["mer", "phoenix"])
    arguments = parser.parse_args()
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    lines = arguments.output.read_text().splitlines() if arguments.output.is_file() else []
    rows = [json.loads(line) for line in lines]
    flown_before = {(r["scenario"], r["seed"], r["fault"], r["imus"]) for r in rows}
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        for name in arguments.scenarios:
            scenario = Scenario.load(f"builtin:{name}")
            for fault in arguments.faults:
                for imus in arguments.imus:
                    if (name, seed, fault, imus) in flown_before:
                        continue
                    row = {"scenario": name, "seed": seed, "fault": fault, "imus": imus}
                    row |= flown(scenario, seed, fault, imus)
                    rows.append(row)
                    with arguments.output.open("a") as file:
                        file.write(json.dumps(row) + "\n")
    report(rows)


if __name__ == "__main__":
    main()
