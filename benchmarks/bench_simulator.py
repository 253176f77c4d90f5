"""The simulator against scipy's integrator on the same forward model, and against the reconstruction of its flight.

Run: ``python benchmarks/bench_simulator.py``
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from measuring import Row, Section, interleaved, run
from scipy.integrate import solve_ivp

from edl_filter import rotations
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.simulation import Scenario, dynamics, simulate
from edl_filter.simulation.increments import NOTHING
from edl_filter.simulation.parachute import Parachute
from edl_filter.simulation.simulate import flown_world, true_start
from edl_filter.simulation.tables import tabulate
from edl_filter.types import Array

DURATION, STEP = 20.0, 0.0125  # s: of the comparison, in the denser air, with the scenario's step
LATER = 70.0  # s: begin of the comparison


def derivative(forward_model: ForwardModel, time: float, state: Array) -> Array:
    """Derivative of position, velocity, attitude and rates ``(13,)``, as one writes it with the forward model."""
    position, velocity, attitude, rate = state[:3], state[3:6], state[6:10], state[10:13]
    flow = forward_model.flow(np.array([time]), position[None], velocity[None], attitude[None], rate[None])
    force, moment = (x[0] for x in forward_model.loads(flow))
    body = forward_model.rigid_body
    return np.concatenate(
        (
            velocity,
            forward_model.gravity_planet.gravity(position) + rotations.rotate(attitude, force / body.mass),
            0.5 * rotations.multiply(attitude, np.append(rate, 0.0)),
            np.linalg.solve(body.inertia, moment - np.cross(rate, body.inertia @ rate)),
        )
    )


def marched(forward_model: ForwardModel, start: Array, duration: float) -> Array:
    """State after `duration` by the simulator's kernel."""
    steps = round(duration / STEP)
    tables = tabulate(forward_model, Parachute(15.0))
    state, slope = np.zeros((steps + 1, dynamics.SIZE)), np.zeros((steps + 1, dynamics.SIZE))
    state[0, :13] = start
    dynamics.march(0.0, STEP, state, slope, dynamics.ENTRY, tables, np.zeros(7), NOTHING, 1, 1e9, False)
    return state[-1, :13]


def against_scipy(scenario: Scenario) -> list[Row]:
    """Rows of the integration alone."""
    forward_model = flown_world(scenario, (), np.random.default_rng(0))
    start = marched(forward_model, true_start(scenario, forward_model, np.random.default_rng(1)), LATER)

    def scipy() -> Array:
        tolerance = {"rtol": 1e-9, "atol": 1e-7}
        return solve_ivp(lambda t, y: derivative(forward_model, t, y), (0.0, DURATION), start, "DOP853", **tolerance).y[
            :, -1
        ]

    ours, theirs = marched(forward_model, start, DURATION), scipy()
    distance, turn = np.linalg.norm(ours[:3] - theirs[:3]), np.max(np.abs(ours[6:10] - theirs[6:10]))
    assert distance < 0.1 and turn < 1e-4, (distance, turn)
    times = interleaved({"scipy": scipy, "ours": lambda: marched(forward_model, start, DURATION)}, rounds=3)
    return [
        times.row(
            f"scipy DOP853 (relative 1e-9) on `ForwardModel.loads`, {DURATION:g} s of entry",
            "the simulator's kernel and its tables",
            "scipy",
            "ours",
            agreement=f"{distance:.0e} m and {turn:.0e} rad apart (asserted: 0.1 m, 1e-4)",
        )
    ]


def measure() -> list[Section]:
    """All sections."""
    scenario = Scenario.load("builtin:mer")
    rows = against_scipy(scenario)
    with tempfile.TemporaryDirectory() as folder:
        path = simulate(scenario, seed=1).write(Path(folder) / "flight.h5")
        mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
        substeps = {n: Scenario.load("builtin:mer", [f"sampling.substeps={n}"]) for n in (5, 20)}
        times = interleaved(
            {
                "simulate": lambda: simulate(scenario, seed=1),
                "reconstruct": lambda: reconstruct(mission),
                "5": lambda: simulate(substeps[5], seed=1),
                "20": lambda: simulate(substeps[20], seed=1),
            },
            rounds=5,
        )
    rows += [
        times.row(
            "a flight of 8 Hz with its telemetry, ten steps a sample", "its reconstruction", "simulate", "reconstruct"
        ),
        times.row("the same with five steps a sample", "ten steps", "5", "simulate"),
        times.row("the same with twenty steps a sample", "ten steps", "20", "simulate"),
    ]
    return [Section("Simulator", "", rows)]


if __name__ == "__main__":
    run(measure)
