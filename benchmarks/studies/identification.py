"""How often the right effect is named: `make study` (hours of one core; results are kept and taken up again).

Flights of the own simulator with one hidden effect each (every name of the catalogue, at its plausible size and at half
of it, on both vehicles), clean ones, pairs, and effects outside the catalogue, are diagnosed without a hint. Whether an
effect is *detectable* is computed with the truth known and fixed before the diagnosis: the gain that a linear fit of
its noise-free signature would have, at its true places, exceeds 6 nats. Answers go to ``identification.jsonl``, one
line a flight; ``identification_report.py`` turns them into the table and the figure of ``docs/identification.md``.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from edl_filter import Mission
from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.diagnose import diagnose
from edl_filter.diagnosis.improve import improve
from edl_filter.diagnosis.regression import regress
from edl_filter.diagnosis.rounds import linearise
from edl_filter.diagnosis.signatures import signature
from edl_filter.effects.catalogue import catalogue
from edl_filter.effects.effect import Active, Effect, Parameter
from edl_filter.errors import InputError
from edl_filter.simulation import Scenario, simulate

DETECTABLE = 6.0
VEHICLES = ("mer", "phoenix")
PAIRS = (
    ("density_wave", "rolling_moment"), ("wind", "remnant_torque"), ("com_offset", "accelerometer_misalignment"),
    ("base_pressure", "gyro_bias"), ("mass", "products_of_inertia"),
)  # fmt: skip


class Jet(Effect):
    """An oscillating jet: torque about y and a force along z."""

    name = "oscillating_jet"
    parameters = (Parameter("A", "N m", "torque", 5.0), Parameter("f", "Hz", "frequency", kind="frequency"))

    def force_moment(self, p, flow):
        there = (flow.time > 70.0) & (flow.time < 160.0)
        wave = np.where(there, p["A"] * np.sin(2.0 * np.pi * p["f"] * flow.time), 0.0)
        nothing = np.zeros_like(wave)
        return np.column_stack((nothing, nothing, 2.0 * wave)), np.column_stack((nothing, wave, nothing))


class Leak(Effect):
    """A steady leak: force along y and torque about z, absolute, from one moment on."""

    name = "leak"
    parameters = (Parameter("F", "N", "force", 20.0),)

    def force_moment(self, p, flow):
        push = np.where(flow.time > 90.0, p["F"], 0.0)
        nothing = np.zeros_like(push)
        return np.column_stack((nothing, push, nothing)), np.column_stack((nothing, nothing, 0.5 * push))


class Slosh(Effect):
    """Torque that follows the rate with the square of the angle: no damping of the catalogue."""

    name = "slosh"
    parameters = (Parameter("k", "N m s", "size", 3e2),)

    def force_moment(self, p, flow):
        size = p["k"] * flow.alpha_total**2
        return np.zeros_like(flow.rate), size[:, None] * flow.rate * np.array([0.0, 1.0, 1.0])


OUTSIDE = {
    "oscillating_jet": (Jet(), {"A": 5.0, "f": 0.7}),
    "leak": (Leak(), {"F": 20.0}),
    "slosh": (Slosh(), {"k": 3e2}),
}


def cases(seeds, clean):
    """All flights: (vehicle, seed, names, part of the plausible size)."""
    found = []
    for seed in seeds:
        for name in catalogue():
            found += [(vehicle, seed, (name,), 1.0) for vehicle in VEHICLES]
        found += [(vehicle, seed, (name,), 1.0) for vehicle in VEHICLES for name in OUTSIDE]
        found += [(VEHICLES[i % 2], 1000 * (1 + seed) + i, (), 0.0) for i in range(clean)]
        found += [(VEHICLES[i % 2], seed, pair, 1.0) for i, pair in enumerate(PAIRS)]
        for name in catalogue():
            found += [(vehicle, seed, (name,), 0.5) for vehicle in VEHICLES]
    return found


def drawn(name, part, random):
    """An effect with sizes drawn in a random direction, of the given part of the plausible size, and random places."""
    if name in OUTSIDE:
        effect, values = OUTSIDE[name]
        return Active(effect, values)
    effect = catalogue()[name]
    direction = random.standard_normal(len(effect.sizes))
    direction *= np.sqrt(len(direction)) / np.linalg.norm(direction)
    values = {q.name: float(part * q.sigma * d) for q, d in zip(effect.sizes, direction, strict=True)}
    values |= {
        "L": random.uniform(8e3, 25e3), "phase": random.uniform(0.0, 6.28), "h_lo": random.uniform(5e3, 15e3),
        "M0": random.uniform(12.0, 24.0), "t0": random.uniform(80.0, 200.0),
    }  # fmt: skip
    values["h_hi"] = values["h_lo"] + random.uniform(8e3, 20e3)
    names = {q.name for q in effect.parameters}
    return Active(effect, {n: v for n, v in values.items() if n in names})


def flown(vehicle, seed, effects, folder):
    """The flight's file, and the mission that a user would have."""
    changes = []
    kept = []
    for active in effects:
        if active.name == "gravity_oblateness":  # hidden by leaving J2 out of the mission
            changes.append("planet.gravity.j2=" + repr(1.960454e-3 * (1.0 - abs(active.values["J2"]) / 2e-3)))
        else:
            kept.append(active)
    path = simulate(Scenario.load(f"builtin:{vehicle}"), kept, seed).write(folder / "flight.h5")
    return Mission.load(f"builtin:practice_{vehicle}", [f"telemetry.path={path}", *changes])


def expected_gain(mission, active):
    """Gain of the noise-free signature at the truth, nats."""
    truth = active
    if active.name == "gravity_oblateness":
        truth = Active(active.effect, {"J2": 1.960454e-3 - mission.planet.gravity.j2})
    linear = linearise(load_case(mission, ()))
    none = Active(active.effect, truth.values | {q.name: 0.0 for q in active.effect.sizes})
    s = signature(linear.ground, none)
    x = linear.plain(s.rows, s.start)
    return regress(x @ np.array([truth.values[n] for n in s.names]), x, s.sigma).gain


def answer(case):
    """Diagnose one flight."""
    vehicle, seed, names, part = case
    random = np.random.default_rng([seed, sum(map(ord, "".join(names))), int(10 * part)])
    begin = time.perf_counter()
    line = {"vehicle": vehicle, "seed": seed, "hidden": list(names), "part": part}
    with tempfile.TemporaryDirectory() as folder:
        try:
            effects = [drawn(name, part, random) for name in names]
            line["truth"] = {a.name: a.values for a in effects}
            mission = flown(vehicle, seed, effects, Path(folder))
            if len(names) == 1 and names[0] not in OUTSIDE:
                line["expected_gain"] = expected_gain(mission, effects[0])
            if len(names) == 2:
                steps = list(improve(mission, list(catalogue().values())))
                line["named"] = [s.added.name for s in steps if s.added is not None]
                content = steps[-1].diagnosis.content()
            else:
                content = diagnose(load_case(mission, ()), catalogue().values()).content()
            line["verdict"] = content["verdict"]
            line["ranking"] = [
                {
                    k: e[k]
                    for k in ("effect", "same_as", "probability", "gain", "score_gain", "at_noise_floor", "parameters")
                }
                for e in content["ranking"][:4]
            ]
        except InputError as error:
            line["refused"] = str(error)
        except Exception as error:
            line["fault"] = f"{type(error).__name__}: {error}"
    line["seconds"] = time.perf_counter() - begin
    return line


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1, help="how many draws of sizes, places, weather and noise")
    parser.add_argument("--first-seed", type=int, default=0, help="begin at this one: flights that nobody has seen")
    parser.add_argument("--clean", type=int, default=20, help="clean flights for each seed")
    parser.add_argument("--worker", type=int, default=0, help="this one of --workers")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=Path("identification.jsonl"))
    a = parser.parse_args()
    done = set()
    for path in a.output.parent.glob(f"{a.output.stem}*.jsonl"):
        for text in path.read_text().splitlines():
            line = json.loads(text)
            done.add((line["vehicle"], line["seed"], tuple(line["hidden"]), line["part"]))
    mine = a.output.with_stem(f"{a.output.stem}_{a.worker}")
    for i, case in enumerate(cases(range(a.first_seed, a.first_seed + a.seeds), a.clean)):
        if i % a.workers == a.worker and case not in done:
            with mine.open("a") as file:
                file.write(json.dumps(answer(case), default=float) + "\n")


if __name__ == "__main__":
    main()
