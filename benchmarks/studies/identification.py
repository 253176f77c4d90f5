"""How often the right effect is named: `make study` (hours of one core; an interrupted study is continued).

Flights of the package's simulator with one hidden effect each (every name of the catalogue, at its plausible size and
at half of it, on both vehicles), clean ones, pairs, and effects outside the catalogue, are diagnosed with the whole
catalogue. Whether an effect is *detectable* is computed with the truth and fixed before the diagnosis: the gain that a
linear fit of its noise-free columns would have, at its true places, exceeds `named_gain_nats`. Results go to
``identification.jsonl``, one line a flight; ``identification_report.py`` makes of them the table and the figure of
``docs/identification.md``.
"""

import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from outside_effects import OUTSIDE_EFFECTS
from study_lines import append_missing, flight_key, study_parser

from edl_filter import Mission
from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.stepwise import improve
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import catalogue
from edl_filter.errors import InputError
from edl_filter.estimation.regression import regress
from edl_filter.simulation import Scenario, simulate

VEHICLES = ("mer", "phoenix")
#: J2 of the simulated planet.
TRUE_J2 = 1.960454e-3
RANKING_KEYS = ("effect", "same_as", "probability", "gain", "score_gain", "at_noise_floor", "parameters")
PAIRS = (
    ("density_wave", "rolling_moment"), ("wind", "remnant_torque"), ("com_offset", "accelerometer_misalignment"),
    ("base_pressure", "gyro_bias"), ("mass", "products_of_inertia"),
)  # fmt: skip


OUTSIDE = {name: OUTSIDE_EFFECTS[name] for name in ("oscillating_jet", "leak", "slosh")}


def cases(seeds, clean):
    """All flights: (vehicle, seed, names, part of the plausible size)."""
    flights = []
    for seed in seeds:
        for name in catalogue():
            flights += [(vehicle, seed, (name,), 1.0) for vehicle in VEHICLES]
        flights += [(vehicle, seed, (name,), 1.0) for vehicle in VEHICLES for name in OUTSIDE]
        flights += [(VEHICLES[i % 2], 1000 * (1 + seed) + i, (), 0.0) for i in range(clean)]
        flights += [(VEHICLES[i % 2], seed, pair, 1.0) for i, pair in enumerate(PAIRS)]
        for name in catalogue():
            flights += [(vehicle, seed, (name,), 0.5) for vehicle in VEHICLES]
    return flights


def random_instance(name, part, random):
    """An effect with sizes drawn in a random direction, of the given part of the plausible size, and random places."""
    if name in OUTSIDE:
        effect, values = OUTSIDE[name]
        return EffectInstance(effect, values)
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
    return EffectInstance(effect, {n: v for n, v in values.items() if n in names})


def hidden_by_mission(effects):
    """Effects that are simulated, and the changes of the mission that hide those that are not."""
    changes, in_flight = [], []
    for instance in effects:
        if instance.name == "gravity_oblateness":  # hidden by leaving J2 out of the mission
            changes.append("planet.gravity.j2=" + repr(TRUE_J2 * (1.0 - abs(instance.values["J2"]) / 2e-3)))
        else:
            in_flight.append(instance)
    return in_flight, changes


def simulated_mission(vehicle, seed, effects, folder):
    """Simulate a flight; the mission that a user would have of it."""
    in_flight, changes = hidden_by_mission(effects)
    path = simulate(Scenario.load(f"builtin:{vehicle}"), in_flight, seed).write(folder / "flight.h5")
    return Mission.load(f"builtin:practice_{vehicle}", [f"telemetry.path={path}", *changes])


def expected_gains(case, effects):
    """Log Bayes factor of each effect for the noise-free residuals of the truth, given the others, nats, by name.

    Sizes and places have their priors, as in the diagnosis: what an unknown place costs is part of the factor.

    Parameters
    ----------
    case : FlightCase
        The flight with the mission that a user would have; its nuisance parameters are those of the diagnosis.
    effects : sequence of EffectInstance
        The truth.
    """
    model = linearize(case)
    columns, sigmas, signal = [], [], 0.0
    for instance in effects:
        truth = instance
        if instance.name == "gravity_oblateness":
            truth = EffectInstance(instance.effect, {"J2": TRUE_J2 - case.mission.planet.gravity.j2})
        by_size = effect_jacobian(model, truth.at_zero())
        size = model.stated_noise_filter(by_size.rows, by_size.initial_mean)
        signal = signal + size @ np.array([truth.values[n] for n in by_size.names])
        columns.append(size)
        sigmas.append(by_size.sigma)
        if places := [q.name for q in truth.fitted if q.kind != "size"]:
            by_place = effect_jacobian(model, truth, places)
            place = model.stated_noise_filter(by_place.rows, by_place.initial_mean)
            columns[-1], sigmas[-1] = np.hstack((size, place)), np.concatenate((by_size.sigma, by_place.sigma))

    def joint_gain(chosen):
        if not chosen:
            return 0.0
        return regress(
            signal, np.hstack([columns[i] for i in chosen]), np.concatenate([sigmas[i] for i in chosen])
        ).gain

    every = list(range(len(effects)))
    return {a.name: float(joint_gain(every) - joint_gain([k for k in every if k != i])) for i, a in enumerate(effects)}


def ranking_rows(content, count, keys):
    """First rows of a diagnosis's ranking, with those of the keys that it has."""
    return [{k: e[k] for k in keys if k in e} for e in content["ranking"][:count]]


def result_of(case):
    """Diagnose one flight; its line of the results."""
    vehicle, seed, names, part = case
    random = np.random.default_rng([seed, sum(map(ord, "".join(names))), int(10 * part)])
    begin = time.perf_counter()
    line = {"vehicle": vehicle, "seed": seed, "hidden": list(names), "part": part}
    with tempfile.TemporaryDirectory() as folder:
        try:
            effects = [random_instance(name, part, random) for name in names]
            line["truth"] = {a.name: a.values for a in effects}
            mission = simulated_mission(vehicle, seed, effects, Path(folder))
            if len(names) == 1 and names[0] not in OUTSIDE:
                line["expected_gain"] = expected_gains(load_case(mission, ()), effects)[names[0]]
            if len(names) == 2:
                steps = list(improve(mission, list(catalogue().values())))
                line["named"] = [s.added.name for s in steps if s.added is not None]
                content = steps[-1].diagnosis.content()
            else:
                content = diagnose(load_case(mission, ()), catalogue().values()).content()
            line["verdict"] = content["verdict"]
            line["ranking"] = ranking_rows(content, 4, RANKING_KEYS)
        except InputError as error:
            line["refused"] = str(error)
        except Exception as error:
            line["fault"] = f"{type(error).__name__}: {error}"
    line["seconds"] = time.perf_counter() - begin
    return line


def main():
    parser = study_parser(__doc__, "study-results/identification.jsonl")
    parser.add_argument("--seeds", type=int, default=1, help="how many draws of sizes, places, weather and noise")
    parser.add_argument("--first-seed", type=int, default=0, help="the first draw")
    parser.add_argument("--clean", type=int, default=20, help="clean flights for each seed")
    a = parser.parse_args()
    flights = cases(range(a.first_seed, a.first_seed + a.seeds), a.clean)
    append_missing(flights, result_of, flight_key, a)


if __name__ == "__main__":
    main()
