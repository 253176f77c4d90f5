"""Are the sigmas true? Simulated flights, reconstructed and compared with their truth: `make calibrate` (resumable).

A flight is given by its number alone: vehicle, seed, noise of the IMUs and sigma of the entry state (half to double the
scenario's), every second flight in an inexact world (`inexact_world`), two of three with lost samples of the first IMU
(0.125 to 20 s at a random time), half of these without a second IMU. Its line in the JSONL file is appended in one
write, so that a study that was interrupted continues (`study_lines`). `calibration_report.py` makes
``docs/calibration.md`` of them.

    python benchmarks/studies/calibration.py -o study-results/calibration.jsonl [--flights 300]
"""

import os
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from inexact_world import draw_world
from study_lines import append_missing, study_parser

from edl_filter import Mission, rotations
from edl_filter.errors import InputError
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.postflight.flight import derived_quantities
from edl_filter.results.result import Result
from edl_filter.simulation import Scenario, simulate
from simulation import PHASES

VEHICLES = ("mer", "phoenix")
GAPS_S = (0.125, 0.5, 1.0, 3.0, 10.0, 20.0)
#: Altitudes at which the post-flight quantities are compared, m.
ALTITUDES = (60e3, 40e3, 25e3, 12e3)
COEFFICIENTS = ("CN", "CY", "Cl", "Cm", "Cn")
COMPONENTS = ("x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az")
#: Temperature of the table at the top of the atmosphere, K.
TOP_TEMPERATURE = 139.0
_SEED = 19


@dataclass(frozen=True)
class Case:
    """One flight of the study.

    Attributes
    ----------
    number, seed : int
    vehicle : str
    inexact : bool
        Whether tables, air, mass and inertia differ from the nominal model.
    noise, entry : float
        Factors of the noise of the IMUs and of the sigmas of the entry state.
    gap : float
        Length of the lost stretch of the primary IMU, s; 0: none.
    gap_place : float
        Its place as a fraction of the time between 20 s and 20 s before the landing.
    imus : int
    """

    number: int
    seed: int
    vehicle: str
    inexact: bool
    noise: float
    entry: float
    gap: float
    gap_place: float
    imus: int


def case_of(number):
    """The flight with a number."""
    random = np.random.default_rng([_SEED, number])
    noise, entry = 2.0 ** random.uniform(-1.0, 1.0, 2)
    gap = float(random.choice(GAPS_S)) if number % 3 else 0.0
    imus = 1 if gap and random.random() < 0.5 else 2
    return Case(
        number, 10_000 + number, VEHICLES[number % 2], bool(number // 2 % 2), noise, entry, gap, random.random(), imus
    )


def flown(case, folder):
    """Simulate a case: the flight, with lost samples, and the mission of a user who has its file."""
    if case.inexact:
        world = draw_world(case.vehicle, np.random.default_rng([_SEED, case.number, 1]))
        scenario = world.scenario(folder)
    else:
        scenario = Scenario.load(f"builtin:{case.vehicle}")
    flight = simulate(_with(scenario, case), seed=case.seed)
    path = Path(folder) / "flight.h5"
    replace(flight, contents=_with_gap(flight, case)).write(path)
    if case.inexact:
        return flight, world.mission(path)
    return flight, Mission.load(f"builtin:practice_{case.vehicle}", [f"telemetry.path={path}"])


def _with(scenario, case):
    """The scenario with the noise and the entry state of a case."""
    imus = {
        name: imu.model_copy(
            update={key: case.noise * getattr(imu, key) for key in ("accelerometer_noise", "gyro_noise")}
        )
        for name, imu in scenario.imus.items()
    }
    keys = ("position_sigma", "velocity_sigma", "attitude_sigma_deg")
    stated = scenario.stated_state.model_copy(
        update={key: case.entry * getattr(scenario.stated_state, key) for key in keys}
    )
    return scenario.model_copy(update={"imus": imus, "stated_state": stated})


def _with_gap(flight, case):
    """Contents of the flight file, with samples lost and without the second IMU where the case has none."""
    contents = flight.contents
    imus = dict(contents.imus)
    if case.imus == 1:
        imus = {"primary": imus["primary"]}
    if case.gap:
        imu = imus["primary"]
        start = 20.0 + case.gap_place * (flight.motion.landed - 40.0 - case.gap)
        lost = (imu.time > start) & (imu.time <= start + case.gap + 1e-6)
        imus["primary"] = replace(
            imu, **{key: getattr(imu, key)[~lost] for key in ("time", "specific_force", "angular_rate")}
        )
    return replace(contents, imus=imus)


def navigation_errors(reconstruction, motion):
    """Errors over sigmas of position, velocity and attitude, and NEES over 3, by phase of the flight."""
    times = np.array([node.time for node in reconstruction.filter_pass.nodes])
    force = np.linalg.norm(motion.before[:, 13:16], axis=1) * (motion.time[:-1] < motion.deployed)
    at = (0.0, motion.time[np.argmax(force)], motion.deployed - 1.0, motion.deployed + 20.0, motion.stopped + 10.0)
    out = {}
    for phase, time_s in zip(PHASES, at, strict=True):
        i = int(np.argmin(np.abs(times - time_s)))
        nav, covariance = reconstruction.smoothed.states[i].nav, reconstruction.smoothed.covariance[i][:9, :9]
        true = motion.at(times[i : i + 1])[0]
        turn = rotations.multiply(rotations.conjugate(nav[6:10]), true[6:10])
        error = np.concatenate((true[:6] - nav[:6], rotations.to_rotation_vector(turn)))
        nees = [float(error[p] @ np.linalg.solve(covariance[p, p], error[p])) for p in map(slice, (0, 3, 6), (3, 6, 9))]
        z = error / np.sqrt(np.diag(covariance))
        out[phase] = {
            "nees": nees,
            "z": z.tolist(),
            "error": [float(np.linalg.norm(error[k : k + 3])) for k in (0, 3, 6)],
        }
    return out


def true_air(forward_model, motion):
    """Altitude, density, pressure and temperature along a flight: the pressure is the weight of the flown air."""
    time_s, state = motion.time[::10], motion.state[::10]
    flow = forward_model.flow(time_s, state[:, :3], state[:, 3:6], state[:, 6:10], state[:, 10:13])
    potential = forward_model.planet.geopotential(state[:, :3])
    layers = 0.5 * (flow.density[1:] + flow.density[:-1]) * -np.diff(potential)
    top = flow.density[0] * forward_model.gas.constant * TOP_TEMPERATURE
    pressure = top + np.concatenate(([0.0], np.cumsum(layers)))
    return time_s, flow.density, pressure, pressure / (flow.density * forward_model.gas.constant)


def postflight_errors(reconstruction, flight):
    """Errors over sigmas of density, pressure, temperature, coefficients and CA with the preflight air, by altitude."""
    post = derived_quantities(reconstruction).postflight
    forward_model, motion, case = flight.forward_model, flight.motion, post.flight
    time_s, *air = true_air(forward_model, motion)
    true = dict(
        zip(("density", "pressure", "temperature"), (np.interp(post.time, time_s, x) for x in air), strict=True)
    )
    state = motion.at(post.time)
    flow = forward_model.flow(post.time, state[:, :3], state[:, 3:6], state[:, 6:10], state[:, 10:13])
    force, moment = forward_model.loads(flow)
    push = flow.dynamic_pressure * forward_model.area
    smoother, rate = post.motion.smoother, flow.rate
    inertia = forward_model.rigid_body.inertia
    turning = np.linalg.solve(inertia, (moment - rotations.cross(rate, rate @ inertia.T)).T).T
    # through the same sampling and smoothing as the readings, and Euler's equations again
    rate = smoother.as_smoothed(rate)
    moment = smoother.as_derived(turning) @ inertia.T + rotations.cross(rate, rate @ inertia.T)
    force = smoother.as_smoothed(force)
    coefficients = np.hstack((-force[:, 2:], force[:, 1:2], moment / forward_model.diameter)) / push[:, None]
    true |= dict(zip(COEFFICIENTS, coefficients.T, strict=True))
    true["CA preflight"] = -force[:, 0] / push
    out = {}
    for altitude in ALTITUDES:
        profile = case.atmosphere
        height = np.where(profile.valid, profile.altitude, np.inf)
        i = int(np.argmin(np.abs(height - altitude)))
        if not np.isfinite(height[i]) or abs(height[i] - altitude) > 3e3:
            continue
        z = {}
        for name in ("density", "pressure", "temperature"):
            z[name] = (getattr(profile, name)[i] - true[name][i]) / getattr(profile, f"{name}_sigma")[i]
        for name in COEFFICIENTS:
            z[name] = (case.coefficients.value[name][i] - true[name][i]) / case.coefficients.sigma(name)[i]
        preflight = post.preflight.coefficients
        z["CA preflight"] = (preflight.value["CA"][i] - true["CA preflight"][i]) / preflight.sigma("CA")[i]
        out[f"{altitude / 1e3:.0f} km"] = {k: float(v) for k, v in z.items() if np.isfinite(v)}
    return out


def result_of(case):
    """Line of one flight."""
    begin = time.perf_counter()
    line = {"case": vars(case)}
    with tempfile.TemporaryDirectory() as folder:
        try:
            flight, mission = flown(case, folder)
            r = reconstruct(mission)
            line["navigation"] = navigation_errors(r, flight.motion)
            line["postflight"] = postflight_errors(r, flight)
            nis = {}
            for fused in r.filter_pass.fused:
                total = nis.setdefault(fused.constraint.name, [0.0, 0, 0])
                total[0] += fused.innovation.nis
                total[1] += len(fused.innovation.residual)
                total[2] += not fused.accepted
            line["nis"] = nis
            line["trustworthy"] = Result(r).trust.trustworthy
        except InputError as error:
            line["refused"] = str(error)
    line["seconds"] = round(time.perf_counter() - begin, 2)
    return line


def line_of(number):
    """Line of a case by its number."""
    return result_of(case_of(number))


def case_number(line):
    """Number of a line's case."""
    return line["case"]["number"]


def main():
    """Run the study."""
    parser = study_parser(__doc__, "study-results/calibration.jsonl")
    parser.add_argument("--flights", type=int, default=300)
    a = parser.parse_args()
    append_missing(range(a.flights), line_of, case_number, a)


if __name__ == "__main__":
    main()
