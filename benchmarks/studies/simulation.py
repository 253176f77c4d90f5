"""How well the reconstruction does on flights of the own simulator: `make study-simulation`.

For each shipped scenario and many seeds: are the innovations (NIS) and the errors against the truth (NEES) what their
covariances say? Both are divided by their degrees of freedom: one is right, below one is cautious.
"""

import argparse
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.stats import chi2
from study_lines import computed

from edl_filter import Mission, rotations
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.simulation import Scenario, simulate

PARTS = {"all": slice(0, 9), "position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9)}
PHASES = ("entry", "peak", "before parachute", "under parachute", "rest")


def flown(job):
    """NIS by statement, and NEES and errors by phase, of one flight; and the time that its simulation took."""
    name, seed = job
    scenario = Scenario.load(f"builtin:{name}")
    simulate(scenario, seed=seed)  # compiled and warm
    begin = time.perf_counter()
    flight = simulate(scenario, seed=seed)
    took = time.perf_counter() - begin
    with tempfile.TemporaryDirectory() as folder:
        path = flight.write(Path(folder) / "flight.h5")
        reconstruction = reconstruct(Mission.load(scenario.mission, [f"telemetry.path={path}"]))
    nis = [(f.constraint.name, f.innovation.nis, len(f.innovation.residual)) for f in reconstruction.filter_pass.fused]
    times = np.array([node.time for node in reconstruction.filter_pass.nodes])
    motion, rows = flight.motion, {}
    peak = motion.time[
        np.argmax(np.linalg.norm(motion.before[:, 13:16], axis=1) * (motion.time[:-1] < motion.deployed))
    ]
    wanted = (0.0, peak, motion.deployed - 1.0, motion.deployed + 20.0, motion.stopped + 10.0)
    for phase, at in zip(PHASES, wanted, strict=True):
        i = int(np.argmin(np.abs(times - at)))
        nav, covariance = reconstruction.smoothed.states[i].nav, reconstruction.smoothed.covariance[i]
        true = motion.at(times[i : i + 1])[0]
        turn = rotations.multiply(rotations.conjugate(nav[6:10]), true[6:10])
        error = np.concatenate((true[:6] - nav[:6], rotations.to_rotation_vector(turn)))
        nees = [error[p] @ np.linalg.solve(covariance[p, p], error[p]) / len(error[p]) for p in PARTS.values()]
        rows[phase] = (*nees, *(np.linalg.norm(error[p]) for p in list(PARTS.values())[1:]))
    return nis, rows, took


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=50, help="of each scenario")
    parser.add_argument("--scheduler", help="address of a dask scheduler")
    parser.add_argument("--workers", type=int, help="processes of this machine; by default one for each processor")
    arguments = parser.parse_args()
    for name in ("mer", "phoenix"):
        jobs = [(name, seed) for seed in range(arguments.flights)]
        flights = list(computed(flown, jobs, arguments.scheduler, arguments.workers))
        print(f"\n{name}: {len(flights)} clean flights, {np.median([f[2] for f in flights]):.2f} s each to simulate")
        groups = defaultdict(list)
        for nis, _, _ in flights:
            for statement, square, dof in nis:
                groups[statement].append((square, dof))
        print(f"  {'statement':<16}{'NIS/dof':>8}  95 % of chi-square")
        for statement, pairs in sorted(groups.items()):
            total, dof = np.sum(pairs, axis=0)
            low, high = chi2.ppf([0.025, 0.975], dof) / dof
            print(f"  {statement:<16}{total / dof:>8.3f}  {low:.3f} to {high:.3f}")
        print(f"  {'NEES/dof at':<18}" + "".join(f"{p:>10}" for p in PARTS) + "   mean error: m, m/s, mrad")
        for phase in PHASES:
            mean = np.mean([rows[phase] for _, rows, _ in flights], axis=0)
            print(f"  {phase:<18}" + "".join(f"{x:>10.2f}" for x in mean[:4])
                  + f"   {mean[4]:8.1f} {mean[5]:7.3f} {1e3 * mean[6]:6.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
