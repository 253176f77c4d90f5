"""The unscented against the extended Kalman filter: ``make study-filters`` (minutes; it resumes where it stopped).

1. Simulated flights of the MER-like scenario, 100 for each quality of the stated entry state (`CASES`). Each is
   reconstructed with both filters from the same problem, and with the unscented one linearised again about its smoothed
   path as the program does (`navigation.recovery.first_pass`): normalised estimation error squared (NEES) of the
   smoothed states against the truth, normalised innovations squared (NIS), rejected constraints and times. One line a
   flight in ``study-results/filter_comparison.jsonl``; flights that are in the file already are not repeated.
2. Spirit, Opportunity (where their telemetry is at hand) and the shipped practice flight with both filters: estimates
   at the parachute, at landing and of the entry state with their differences in sigmas, and times.

Both are divided by their degrees of freedom: one is consistent, above one overconfident, below one cautious.
"""

import argparse
import json
import os
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SENSOR_STATES
from edl_filter.mission import Mission
from edl_filter.navigation.filter import run_filter
from edl_filter.navigation.leave_one_out import check_constraints
from edl_filter.navigation.recovery import first_pass
from edl_filter.navigation.smoother import smooth
from edl_filter.pipeline.load import read_atmosphere
from edl_filter.pipeline.reconstruct import assemble, reconstruct
from edl_filter.planet import ellipsoid
from edl_filter.simulation import Scenario, simulate

METHODS = ("ukf", "ekf")
#: Columns of the report on simulated flights.
RUNS = (*METHODS, "iterated")
#: Sigmas of the stated entry state: position (m), velocity (m/s), attitude (deg). The first is the scenario's.
CASES = {
    f"{position:g} m, {velocity:g} m/s, {attitude:g} deg": [
        f"stated_state.position_sigma={position}",
        f"stated_state.velocity_sigma={velocity}",
        f"stated_state.attitude_sigma_deg={attitude}",
    ]
    for position, velocity, attitude in ((300.0, 0.3, 0.01719), (1e3, 1.0, 0.2), (1e3, 1.0, 0.5), (1e3, 1.0, 1.0))
}
PHASES = ("entry", "peak", "before parachute", "under parachute", "rest")
MISSIONS = ("mer_a", "mer_b", "practice_mer")


def with_method(problem, method):
    """The same problem for one of the filters."""
    return replace(problem, settings=replace(problem.settings, method=method))


def shortest(function, repeats):
    """Shortest processor time of `function` with each of the filters, s; the calls alternate."""
    times = {method: [] for method in METHODS}
    for _ in range(repeats):
        for method in METHODS:
            begin = time.process_time()
            function(method)
            times[method].append(time.process_time() - begin)
    return {method: min(values) for method, values in times.items()}


# Simulated flights


def compare_flight(case, seed):
    """NEES, NIS and times of one simulated flight, by filter."""
    scenario = Scenario.load("builtin:mer", CASES[case])
    flight = simulate(scenario, seed=seed)
    mission = Mission.load(scenario.mission)
    telemetry = flight.telemetry()
    planet = mission.planet_model(telemetry.prime_meridian_at_epoch)
    problem = assemble(mission, telemetry, planet, read_atmosphere(mission))
    problems = {method: with_method(problem, method) for method in METHODS}
    seconds = shortest(lambda m: smooth(run_filter(problems[m])), 3)
    judged = {m: judge_filter(run_filter(problems[m]), flight) | {"seconds": seconds[m]} for m in METHODS}
    begin = time.process_time()
    filter_pass = first_pass(problems["ukf"])
    smooth(filter_pass)
    return judged | {"iterated": judge_filter(filter_pass, flight) | {"seconds": time.process_time() - begin}}


def judge_filter(filter_pass, flight):
    """NEES by phase (navigation, all states), NIS and rejected constraints of one filter on one flight."""
    smoothed = smooth(filter_pass)
    motion = flight.motion
    force = np.linalg.norm(motion.before[:, 13:16], axis=1)
    peak = motion.time[np.argmax(force * (motion.time[:-1] < motion.deployed))]
    times = (0.0, peak, motion.deployed - 1.0, motion.deployed + 20.0, motion.stopped + 10.0)
    nees = {}
    for phase, at in zip(PHASES, times, strict=True):
        k = int(np.argmin(np.abs(smoothed.time - at)))
        covariance = smoothed.covariance[k]
        error = state_error(filter_pass.layout, smoothed.states[k], smoothed.time[k], flight)
        nees[phase] = [float(error[:n] @ np.linalg.solve(covariance[:n, :n], error[:n])) / n for n in (9, len(error))]
    return {
        "nees": nees,
        "nis": float(sum(f.innovation.nis for f in filter_pass.fused)),
        "dof": sum(len(f.innovation.residual) for f in filter_pass.fused),
        "rejected": sum(not f.accepted for f in filter_pass.fused),
    }


def state_error(layout, state, at, flight):
    """True minus estimated state in the filter's vector."""
    true = flight.motion.at(np.array([at]))[0]
    error = np.zeros(layout.size)
    error[:6] = true[:6] - state.nav[:6]
    error[6:9] = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(state.nav[6:10]), true[6:10]))
    true_errors = flight.contents.truth["sensor_errors"]["primary"]
    for name in SENSOR_STATES:
        if name in layout:
            error[layout[name]] = true_errors[name] - state.errors[layout[name]]
    return error


def report_flights(rows):
    """Print the averages over the flights of each case."""
    for case in CASES:
        flights = [row["filters"] for row in rows if row["case"] == case]
        if not flights:
            continue
        low, high = (chi2.ppf([0.025, 0.975], dof * len(flights)) / (dof * len(flights)) for dof in (9, 24))
        print(f"\n{len(flights)} flights, {case}")
        print(f"  95 % of chi-square: {low[0]:.2f} to {low[1]:.2f} (9 dof), {high[0]:.2f} to {high[1]:.2f} (24 dof)")
        print(f"  {'NEES/dof, smoothed':<20}" + "".join(f"{m + ' nav':>14}{m + ' all':>14}" for m in RUNS))
        for phase in PHASES:
            means = [np.mean([f[m]["nees"][phase] for f in flights], axis=0) for m in RUNS]
            print(f"  {phase:<20}" + "".join(f"{x:>14.2f}" for x in np.concatenate(means)))
        limit = chi2.ppf(0.999, 9) / 9
        rows_by_name = {
            "NIS/dof": [sum(f[m]["nis"] for f in flights) / sum(f[m]["dof"] for f in flights) for m in RUNS],
            "constraints rejected": [sum(f[m]["rejected"] for f in flights) for m in RUNS],
            "NEES > 99.9 %, rest": [sum(f[m]["nees"]["rest"][0] > limit for f in flights) for m in RUNS],
            "ms, median": [1e3 * np.median([f[m]["seconds"] for f in flights]) for m in RUNS],
        }
        for name, values in rows_by_name.items():
            print(f"  {name:<20}" + "".join(f"{x:>28.4g}" for x in values))
        ratio = np.median([f["ukf"]["seconds"] / f["ekf"]["seconds"] for f in flights])
        print(f"  filter and smoother: the UKF takes {ratio:.2f} times the EKF's time (median)")


# Missions


def estimates(reconstruction):
    """Estimates with their sigmas, by name: parachute, landing, entry corrections."""
    trajectory, planet, entry = reconstruction.trajectory, reconstruction.planet, reconstruction.entry
    out = {}
    k = int(np.searchsorted(trajectory.time, reconstruction.event_times["parachute_deploy"] - 1e-6))
    position, velocity = (
        trajectory.position[k],
        planet.velocity_relative(trajectory.position[k], trajectory.velocity[k]),
    )
    covariance, along = trajectory.covariance[k], velocity / np.linalg.norm(velocity)
    up = planet.enu_from_inertial(trajectory.time[k], position)[2]
    altitude = float(planet.geodetic(trajectory.time[k], position)[2])
    out["parachute: altitude (m)"] = altitude, float(np.sqrt(up @ covariance[:3, :3] @ up))
    out["parachute: speed (m/s)"] = (
        float(np.linalg.norm(velocity)),
        float(np.sqrt(along @ covariance[3:6, 3:6] @ along)),
    )
    k = int(np.searchsorted(trajectory.time, reconstruction.event_times["landing"] - 1e-6))
    fixed = planet.rotation.to_fixed(trajectory.time[k], trajectory.position[k])
    latitude, longitude, _ = ellipsoid.areocentric_from_fixed(reconstruction.site)
    enu = ellipsoid.enu_from_fixed(latitude, longitude)
    turn = planet.rotation.to_inertial(trajectory.time[k], enu)
    sigma = np.sqrt(np.diag(turn @ trajectory.covariance[k, :3, :3] @ turn.T))
    for axis, value, s in zip(("east", "north", "up"), enu @ (fixed - reconstruction.site), sigma, strict=True):
        out[f"landing: {axis} of the site (m)"] = float(value), float(s)
    names = [f"{n} {a} ({u})" for n, u in (("position", "m"), ("velocity", "m/s"), ("attitude", "deg")) for a in "xyz"]
    scale = np.repeat([1.0, 1.0, np.degrees(1.0)], 3)
    for name, value, s in zip(names, scale * entry.change, scale * entry.change_sigma, strict=True):
        out[f"entry: {name}"] = float(value), float(s)
    for name, (value, s) in entry.states.items():
        factor, unit = (1.0, "s") if name == "entry_epoch" else (np.degrees(1.0), "deg")
        for i, (v, one_sigma) in enumerate(zip(value, s, strict=True)):
            label = name if len(value) == 1 else f"{name} {'xyz'[i]}"
            out[f"entry: {label} ({unit})"] = float(factor * v), float(factor * one_sigma)
    return out


def compare_mission(name):
    """Print estimates, differences and times of one mission with both filters."""
    runs = {m: reconstruct(Mission.load(f"builtin:{name}", [f"filter.method={m}"])) for m in METHODS}
    ukf, ekf = (estimates(runs[m]) for m in METHODS)
    print(f"\n{name}\n  {'estimate':<32}{'ukf':>14}{'sigma':>12}{'ekf':>14}{'sigma':>12}{'difference, sigmas':>20}")
    for key, (value, sigma) in ukf.items():
        twin, twin_sigma = ekf[key]
        print(f"  {key:<32}{value:>14.4g}{sigma:>12.4g}{twin:>14.4g}{twin_sigma:>12.4g}{(twin - value) / sigma:>20.3f}")
    states = [runs[m].smoothed for m in METHODS]
    sigma = np.sqrt(np.diagonal(states[0].covariance, axis1=1, axis2=2))
    change = np.array([b.minus(a) for a, b in zip(states[0].states, states[1].states, strict=True)]) / sigma
    ratio = np.sqrt(np.diagonal(states[1].covariance, axis1=1, axis2=2)) / sigma
    for label, columns in (("position", slice(0, 3)), ("velocity", slice(3, 6)), ("attitude", slice(6, 9))):
        k = int(np.argmax(np.max(np.abs(change[:, columns]), axis=1)))
        largest, part = np.max(np.abs(change[k, columns])), ratio[:, columns]
        print(
            f"  largest difference of {label}: {largest:.3f} sigma at {states[0].time[k]:.0f} s; "
            f"sigmas ekf / ukf {part.min():.3f} to {part.max():.3f}"
        )
    problems = {m: runs[m].problem for m in METHODS}
    stages = {
        "filter": lambda m: run_filter(problems[m]),
        "smoother": lambda m: smooth(runs[m].filter_pass),
        "leave-one-out": lambda m: check_constraints(problems[m], runs[m].filter_pass),
    }
    for stage, function in stages.items():
        seconds = shortest(function, 10)
        text = "   ".join(f"{m} {1e3 * t:8.1f} ms" for m, t in seconds.items())
        print(f"  {stage:<14} {text}   ratio {seconds['ukf'] / seconds['ekf']:.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=100, help="of each case")
    parser.add_argument("-o", "--output", type=Path, default=Path("study-results/filter_comparison.jsonl"))
    arguments = parser.parse_args()
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    lines = arguments.output.read_text().splitlines() if arguments.output.exists() else []
    rows = [json.loads(line) for line in lines]
    done = {(row["case"], row["seed"]) for row in rows}
    with arguments.output.open("a") as file:
        for case in CASES:
            for seed in (s for s in range(arguments.flights) if (case, s) not in done):
                rows.append({"case": case, "seed": seed, "filters": compare_flight(case, seed)})
                file.write(json.dumps(rows[-1]) + "\n")
                file.flush()
    report_flights(rows)
    for name in MISSIONS:
        try:
            compare_mission(name)
        except InputError as error:
            print(f"\n{name}: left out. {error}")


if __name__ == "__main__":
    main()
