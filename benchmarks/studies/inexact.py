"""How often the right effect is named where nothing is known exactly: `make study-inexact` (hours; resumable).

Each flight has a world of its own (`inexact_world`): tables, air, mass and inertia differ from the nominal model of its
mission, which states their sigmas. At least 60 flights are clean; every effect of the catalogue is hidden at its
plausible size and at half of it, once on each vehicle; ten flights hide pairs, 18 something outside the catalogue.
All are diagnosed with the whole catalogue. The expected gain is computed with the truth and with the same nuisance
parameters, before the diagnosis. The flights are in random order, so that a part of the study is a fair sample. Results
go to ``inexact.jsonl``, one line a flight; ``inexact_report.py`` makes of them ``docs/identification-inexact.md``.

    python benchmarks/studies/inexact.py -o study-results/inexact.jsonl [--workers N | --scheduler ADDRESS]
    python benchmarks/studies/inexact.py --list
    python benchmarks/studies/inexact.py --write FOLDER --flight NUMBER
"""

import os
import tempfile
import time
import zlib
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from identification import PAIRS, VEHICLES, expected_gains, hidden_by_mission, random_instance, ranking_rows
from inexact_world import STATED_UNCERTAINTY, draw_world
from outside_effects import OUTSIDE_EFFECTS, random_outside_instance
from study_lines import append_missing, flight_key, study_parser

from edl_filter.aero.increments import SYMBOLS
from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.stepwise import improve
from edl_filter.effects.registry import catalogue
from edl_filter.errors import InputError
from edl_filter.simulation import simulate

TEN_PAIRS = (
    *PAIRS,
    ("pitch_damping", "accelerometer_bias"), ("atmosphere_rotation", "com_offset"), ("wind", "imu_lever_arm"),
    ("remnant_torque", "gyro_scale"), ("products_of_inertia", "attitude_frame"),
)  # fmt: skip
#: Effects at which the improvement of a flight with two of them ends: more names are wrong, and each takes a minute.
PAIR_LIMIT = 4
RANKING_KEYS = (
    "effect", "imu", "label", "same_as", "alternatives", "probability", "gain", "score_gain", "at_noise_floor",
    "explained_share",
    "parameters",
)  # fmt: skip
#: Seed of the order of the flights.
ORDER = 18


def cases(clean=60, draws=2, first_seed=0):
    """All flights in random order: (vehicle, seed, names, part of the plausible size).

    Parameters
    ----------
    clean : int
        Number of clean flights.
    draws : int
        Flights of each effect and size; the vehicle alternates.
    first_seed : int
        Another number gives flights that no other study has.
    """
    flights = [(VEHICLES[i % 2], 1000 * first_seed + i, (), 0.0) for i in range(clean)]
    for i, name in enumerate(catalogue()):
        for part in (1.0, 0.5):
            flights += [(VEHICLES[(i + k) % 2], first_seed + k, (name,), part) for k in range(draws)]
    flights += [(VEHICLES[i % 2], first_seed, pair, 1.0) for i, pair in enumerate(TEN_PAIRS)]
    flights += [(vehicle, first_seed, (name,), 1.0) for name in OUTSIDE_EFFECTS for vehicle in VEHICLES]
    flights += [(vehicle, first_seed + 1, ("oscillating_jet",), 1.0) for vehicle in VEHICLES]
    return [flights[i] for i in np.random.default_rng(ORDER).permutation(len(flights))]


def hidden_effects(names, part, random):
    """Effects with random sizes and places."""
    return [
        random_outside_instance(name, random) if name in OUTSIDE_EFFECTS else random_instance(name, part, random)
        for name in names
    ]


def flight_generators(case):
    """Generators of the world and of the effects, and the seed of the simulation, for a flight."""
    vehicle, seed, names, part = case
    sequence = np.random.SeedSequence([ORDER, seed, zlib.crc32(f"{vehicle} {' '.join(names)} {part}".encode())])
    world, effects, noise = sequence.spawn(3)
    return np.random.default_rng(world), np.random.default_rng(effects), int(noise.generate_state(1)[0])


def simulated_flight(case, folder):
    """Simulate a flight and write it with its world to a folder: the world, its effects, and the user's mission."""
    vehicle, _, names, part = case
    world_random, effect_random, noise_seed = flight_generators(case)
    world = draw_world(vehicle, world_random)
    effects = hidden_effects(names, part, effect_random)
    in_flight, changes = hidden_by_mission(effects)
    if len(names) == 2:
        changes.append(f"diagnosis.max_effects={PAIR_LIMIT}")
    path = simulate(world.scenario(folder), in_flight, noise_seed).write(Path(folder) / "flight.h5")
    return world, effects, world.mission(path, changes)


def stated_values(effect, world):
    """Values of an effect as a mission states them: its inertia factor scales products of inertia too."""
    if effect.name != "products_of_inertia":
        return effect.values
    return {name: value / world.inertia_factor for name, value in effect.values.items()}


def something_else_probability(content):
    """Probability of something outside the catalogue."""
    value = content.get("something_else")
    return value.get("probability") if isinstance(value, dict) else value


def increments_within_two_sigma(world, diagnosis):
    """Coefficient → number of flown cells in which the database's error is within 2 sigma of its increment, and of all.

    Parameters
    ----------
    world : World
        Whose tables were flown.
    diagnosis : Diagnosis
        With the increments of the nominal tables.
    """
    database = diagnosis.ranking.model.inputs.forward_model.database
    tables = {"mach": (world.continuum, database.continuum), "knudsen": (world.rarefied, database.rarefied)}
    counts = dict.fromkeys(SYMBOLS.values(), (0, 0))
    for regime in diagnosis.update.regimes:
        flown, nominal = (
            np.stack(
                [table.at(regime.nodes).evaluate(np.full(len(regime.nodes), a))[:3] for a in regime.alpha], axis=-1
            )
            for table in tables[regime.regime]
        )
        for k, symbol in enumerate(SYMBOLS.values()):
            cells = (regime.bins > 0) & (regime.sigma[k] > 0.0)
            inside = np.abs(regime.increment[k] - (flown - nominal)[k]) < 2.0 * regime.sigma[k]
            within, total = counts[symbol]
            counts[symbol] = within + int(np.sum(inside[cells])), total + int(np.sum(cells))
    return counts


def name_given(content):
    """The leading row of a ranking, as a name that was given."""
    return ranking_rows(content, 1, ("effect", "imu", "label", "same_as", "probability"))[0]


def result_of(case):
    """Diagnose one flight; its line of the results."""
    vehicle, seed, names, part = case
    begin = time.perf_counter()
    line = {"vehicle": vehicle, "seed": seed, "hidden": list(names), "part": part}
    with tempfile.TemporaryDirectory() as folder:
        try:
            world, effects, mission = simulated_flight(case, folder)
            line["world"] = {"mass_factor": world.mass_factor, "inertia_factor": world.inertia_factor}
            line["truth"] = {a.name: stated_values(a, world) for a in effects}
            flight = load_case(mission, ())
            line["expected_gains"] = expected_gains(flight, effects)
            line["diagnosis_begins"] = time.perf_counter() - begin
            if len(names) == 2:
                line["named"] = []
                for step in improve(mission, list(catalogue().values())):  # a step takes much memory
                    content = step.diagnosis.content()
                    if step.added is not None:
                        line["named"].append(name_given(content))
            else:
                diagnosis = diagnose(flight, catalogue().values())
                content = diagnosis.content()
                if not names:
                    line["increments"] = increments_within_two_sigma(world, diagnosis)
                line["named"] = [name_given(content)] if content["verdict"] == "missing" else []
            line["verdict"] = content["verdict"]
            line["none"] = content.get("none")
            line["something_else"] = something_else_probability(content)
            line["ranking"] = ranking_rows(content, 5, RANKING_KEYS)
        except InputError as error:
            line["refused"] = str(error)
        except Exception as error:
            line["fault"] = f"{type(error).__name__}: {error}"
    line["seconds"] = time.perf_counter() - begin
    return line


def main():
    parser = study_parser(__doc__, "study-results/inexact.jsonl")
    parser.add_argument("--clean", type=int, default=60, help="clean flights")
    parser.add_argument("--draws", type=int, default=2, help="flights of each effect and size")
    parser.add_argument("--first-seed", type=int, default=0, help="another number gives new flights")
    parser.add_argument("--list", action="store_true", help="print the flights with their numbers, and end")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write one flight and its world, and end")
    parser.add_argument("--flight", type=int, default=0, help="number of that flight")
    a = parser.parse_args()
    flights = cases(a.clean, a.draws, a.first_seed)
    if a.list:
        for i, (vehicle, seed, names, part) in enumerate(flights):
            print(i, vehicle, seed, " and ".join(names) or "nothing", part)
    elif a.write:
        a.write.mkdir(parents=True, exist_ok=True)
        _, effects, mission = simulated_flight(flights[a.flight], a.write)
        _, changes = hidden_by_mission(effects)
        print("\n".join(f"hidden: {e.name} {e.values}" for e in effects) or "hidden: nothing")
        sets = (f"telemetry.path={mission.telemetry.path}", *STATED_UNCERTAINTY, *changes)
        print(f"edl-filter run builtin:{mission.name} " + " ".join(f"--set {s}" for s in sets))
    else:
        append_missing(flights, result_of, flight_key, a)


if __name__ == "__main__":
    main()
