"""One second of the primary IMU lost at a random time: is the error of the reconstruction still that of its sigmas?

Of each vehicle ``--flights`` seeds are flown, and one second is removed from each flight at ``--times`` random times
between 20 s and 15 s before the parachute, by turns with the second IMU and without it. The error is that of position
and velocity at the parachute's deployment against the simulator's truth (`faults.outcome`). On the rovers the truth is
unknown: a result with a second removed is compared with that of all samples, in the sigmas of the former; both have the
errors of all other samples in common. ``python lost_seconds.py -o FILE.jsonl`` goes on where it stopped, and reports.
"""

from __future__ import annotations

import shutil
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from calibration import VEHICLES
from faults import THREE_SIGMAS, imu, outcome, removed
from gaps import with_gap
from scipy.stats import chi2
from study_lines import append_line, computed, lines_so_far, read_lines, study_parser

from edl_filter import Mission
from edl_filter.errors import InputError
from edl_filter.pipeline.load import check_settings, event_times, read_telemetry
from edl_filter.pipeline.reconstruct import FlightInputs, Reconstruction, reconstruct
from edl_filter.pipeline.trust import judge
from edl_filter.simulation import Scenario, simulate
from edl_filter.telemetry.sample_repair import repaired

ROVERS = ("mer_a", "mer_b")
#: Seconds lost on each rover, with the second IMU and without it.
PLACES = 20
#: First time of a lost second, and its last one before the parachute's deployment, s.
FIRST_S, BEFORE_DEPLOYMENT_S = 20.0, 15.0
#: Degrees of freedom: position and velocity.
FREEDOM = 6


def simulated(vehicle: str, seed: int, times: int, done: set[int]) -> Iterator[dict[str, Any]]:
    """Outcomes of one simulated flight with a second lost, at the times that are not done."""
    if len(done) == times:
        return
    scenario = Scenario.load(f"builtin:{vehicle}")
    flight = simulate(scenario, seed=seed)
    places = np.random.default_rng([seed, 1]).uniform(FIRST_S, flight.motion.deployed - BEFORE_DEPLOYMENT_S, times)
    with tempfile.TemporaryDirectory() as folder:
        complete = flight.write(Path(folder) / "complete.h5")
        interval = float(np.median(np.diff(flight.contents.imus["primary"].time)))
        for number in sorted(set(range(times)) - done):
            imus = 1 + (number + seed) % 2
            path = Path(shutil.copy(complete, Path(folder) / "flight.h5"))
            with h5py.File(path, "a") as file:
                if imus == 1:
                    del file["imu/secondary"]
                imu(removed(round(1.0 / interval)), "primary")(file, float(places[number]), np.random.default_rng(0))
            try:
                mission = Mission.load(scenario.mission, [f"telemetry.path={path}"])
                row = outcome(reconstruct(mission, leave_one_out=False), flight.motion)
            except InputError as error:
                row = {"refused": str(error).replace(str(path), "FLIGHT")}
            yield {"flight": vehicle, "seed": seed, "number": number, "imus": imus, "time_s": places[number]} | row


def of_rover(name: str, done: set[int]) -> Iterator[dict[str, Any]]:
    """Outcomes of a rover's flight with a second lost, against the result of all samples, at the times not done."""
    count = 2 * PLACES
    if len(done) == count:
        return
    mission = Mission.load(f"builtin:{name}")
    telemetry = read_telemetry(mission)
    deployed = event_times(mission, telemetry)["parachute_deploy"]
    interval = float(np.median(telemetry.driving.interval))
    places = np.repeat(np.random.default_rng(1).uniform(FIRST_S, deployed - BEFORE_DEPLOYMENT_S, PLACES), 2)
    complete = {}
    for number in sorted(set(range(count)) - done):
        imus = 1 + number % 2
        used = telemetry if imus == 2 else replace(telemetry, checking=())
        if imus not in complete:
            complete[imus] = at_deployment(
                reconstruct(mission, leave_one_out=False, inputs=FlightInputs(used)), deployed
            )
        lost = with_gap(used, int(telemetry.driving.index_at(places[number])), round(1.0 / interval), imus == 2)
        filled = repaired(lost, check_settings(mission), deployed)
        result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(filled))
        (state, covariance), (expected, _) = at_deployment(result, deployed), complete[imus]
        difference = state - expected
        yield {
            "flight": name, "seed": 0, "number": number, "imus": imus, "time_s": places[number],
            "square": float(difference @ np.linalg.solve(covariance, difference)),
            "position_m": float(np.linalg.norm(difference[:3])),
            "velocity_m_s": float(np.linalg.norm(difference[3:])),
            "trustworthy": judge(result).trustworthy,
        }  # fmt: skip


def at_deployment(reconstruction: Reconstruction, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity ``(6,)`` at the node nearest to a time, and their covariance ``(6, 6)``."""
    node = int(np.argmin([abs(n.time - time) for n in reconstruction.filter_pass.nodes]))
    return reconstruction.smoothed.states[node].nav[:6], reconstruction.smoothed.covariance[node][:6, :6]


def report(rows: list[dict[str, Any]]) -> None:
    """Print a line for each flight and number of IMUs."""
    groups: dict[tuple[str, int], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["flight"], row["imus"]].append(row)
    for (flight, imus), members in groups.items():
        square = np.array([r["square"] for r in members if "square" in r])
        flights = len({r["seed"] for r in members})
        # the seconds of one flight have its other errors in common: as many independent values as flights
        low, high = chi2.ppf([0.025, 0.975], FREEDOM * flights) / (FREEDOM * flights)
        untrusted = sum(not r.get("trustworthy", True) for r in members)
        position = max(r.get("position_m", 0.0) for r in members)
        velocity = max(r.get("velocity_m_s", 0.0) for r in members)
        print(
            f"{flight:>8} {imus} IMU: {len(members)} seconds of {flights} flights, "
            f"refused {len(members) - len(square)}, not trusted {untrusted}; "
            f"NEES/6 {square.mean() / FREEDOM:.3f} (95 %: {low:.2f} to {high:.2f}), "
            f"within three sigmas {np.mean(square <= THREE_SIGMAS):.4f}, "
            f"largest {np.sqrt(square.max() / FREEDOM):.2f} sigmas, {position:.0f} m, {velocity:.2f} m/s"
        )


def rows_of(case: tuple[str, int, int, tuple[int, ...]]) -> list[dict[str, Any]]:
    """Outcomes of a flight, its seed, its number of times, and the times that are done."""
    flight, seed, times, done = case
    return list(of_rover(flight, set(done)) if flight in ROVERS else simulated(flight, seed, times, set(done)))


def main() -> None:
    """Fly what is missing in the file, then report."""
    parser = study_parser(__doc__, "study-results/lost-seconds.jsonl")
    parser.add_argument("--flights", type=int, default=20, help="seeds of each vehicle")
    parser.add_argument("--times", type=int, default=50, help="lost seconds of each flight")
    arguments = parser.parse_args()
    done: dict[tuple[str, int], list[int]] = defaultdict(list)
    for row in lines_so_far(arguments.output):
        done[row["flight"], row["seed"]].append(row["number"])
    flights = [(rover, 0) for rover in ROVERS]
    flights += [(vehicle, seed) for seed in range(200, 200 + arguments.flights) for vehicle in VEHICLES]
    cases = [(*flight, arguments.times, tuple(done[flight])) for flight in flights]
    for rows in computed(rows_of, cases, arguments.scheduler, arguments.workers):
        for row in rows:
            append_line(arguments.output, row)
    report(read_lines(arguments.output))


if __name__ == "__main__":
    main()
