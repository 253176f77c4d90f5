"""Lost stretches of the only IMU, filled by an autoregression and by rotational dynamics: which is nearer to the truth?

Stretches at random times of a flight are taken out, filled by either method, and compared with the readings that were
taken out: rotation and velocity across the stretch, with their errors in sigmas, the largest angle in it, and position
and velocity at the parachute against the result of all samples. ``python dynamics_filling.py MISSION --set KEY=VALUE``
prints two lines for each length. With ``--rates`` the rates alone are lost.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from gaps import with_gap
from lost_seconds import at_deployment

from edl_filter.mission import Mission
from edl_filter.pipeline import dynamics_filling
from edl_filter.pipeline.load import check_settings, event_times, read_telemetry
from edl_filter.pipeline.reconstruct import FlightInputs, Reconstruction, reconstruct
from edl_filter.telemetry.record import ImuRecord
from edl_filter.telemetry.sample_repair import repaired

LENGTHS_S = (1.0, 3.0, 10.0)
#: First time of a stretch, s, and the end of the last one before the parachute.
FIRST_S, BEFORE_DEPLOYMENT_S = 50.0, 3.0
METHODS = {"autoregression": 0, "dynamics": dynamics_filling.PASSES}


def errors(record: ImuRecord, truth: ImuRecord, rows: slice) -> tuple[np.ndarray, np.ndarray]:
    """Errors of rotation (rad) and velocity (m/s) across filled samples (6,), and their sigmas."""
    step = truth.interval[rows, None]
    error, variance = [], []
    for values, fill, noise in (
        ("angular_rate", record.rate_fill_sigma, truth.rate_noise),
        ("specific_force", record.force_fill_sigma, truth.force_noise),
    ):
        error.append(np.sum((getattr(record, values)[rows] - getattr(truth, values)[rows]) * step, axis=0))
        variance.append(np.sum((fill[rows] ** 2 + noise[rows, None] ** 2) * step**2, axis=0))
    return np.concatenate(error), np.sqrt(np.concatenate(variance))


def outcome(result: Reconstruction, complete: Reconstruction, rows: slice, deployed: float) -> np.ndarray:
    """Errors (6,), the same in sigmas (6,); position (m), velocity (m/s), their square in sigmas / 6; angle (rad)."""
    filled, truth = result.telemetry.driving, complete.telemetry.driving
    error, sigma = errors(filled, truth, rows)
    angles = np.cumsum((filled.angular_rate - truth.angular_rate)[rows] * truth.interval[rows, None], axis=0)
    (state, covariance), (expected, _) = at_deployment(result, deployed), at_deployment(complete, deployed)
    d = state - expected
    last = [np.linalg.norm(d[:3]), np.linalg.norm(d[3:]), d @ np.linalg.solve(covariance, d) / 6.0]
    last.append(np.abs(angles).max())
    return np.concatenate((error, error / sigma, last))


def main() -> None:
    """Print a line for each length and method."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--rates", action="store_true", help="the rates alone are lost")
    parser.add_argument("--lengths", type=float, nargs="*", default=LENGTHS_S)
    args = parser.parse_args()
    mission = Mission.load(args.mission, args.set)
    telemetry = replace(read_telemetry(mission), checking=())
    deployed = event_times(mission, telemetry)["parachute_deploy"]
    complete = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(telemetry))
    record = telemetry.driving
    for length in args.lengths:
        count, random = round(length / float(np.median(record.interval))), np.random.default_rng(2)
        outcomes: dict[str, list[np.ndarray]] = {name: [] for name in METHODS}
        for _ in range(args.count):
            first = int(record.index_at(random.uniform(FIRST_S, deployed - BEFORE_DEPLOYMENT_S - length)))
            gap = with_gap(telemetry, first, count, two=False, rates_alone=args.rates)
            lost = repaired(gap, check_settings(mission), deployed)
            for name, passes in METHODS.items():
                dynamics_filling.PASSES = passes
                result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(lost))
                outcomes[name].append(outcome(result, complete, slice(first, first + count), deployed))
        for name, values in outcomes.items():
            rms = np.sqrt(np.mean(np.square(values), axis=0))
            sigmas, last = np.array(values)[:, 6:12], np.mean(np.array(values)[:, 14])
            print(
                f"{mission.name} {length:4.1f} s {name:>14}: "
                f"largest angle {np.degrees(rms[15]):.3f} deg, "
                f"lateral rotation {np.degrees(np.hypot(*rms[1:3])):.4f} deg, roll {np.degrees(rms[0]):.4f} deg, "
                f"axial velocity {rms[3]:.3f} m/s; in sigmas {rms[6:12].round(2)}, largest {np.abs(sigmas).max():.1f}; "
                f"at the parachute {rms[12]:.1f} m, {rms[13]:.3f} m/s, {last:.3f} of sigma^2",
                flush=True,
            )


if __name__ == "__main__":
    main()
