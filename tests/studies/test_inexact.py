"""The study of an inexact world: the statistics of its errors, its flights, and the report on lines made by hand."""

import itertools
import json
import sys

import inexact as study
import inexact_report
import numpy as np
import pytest
from inexact_world import (
    DENSITY_SIGMA,
    INERTIA_SIGMA,
    MASS_SIGMA,
    WIND_SIGMA,
    draw_world,
)

from edl_filter.effects.registry import catalogue
from edl_filter.io.csv_table import package_data
from edl_filter.planet.atmosphere import COLUMNS
from edl_filter.simulation.simulate import flown_world, simulate


@pytest.fixture(scope="module")
def phoenix_world():
    return draw_world("phoenix", np.random.default_rng(3))


def test_factors_and_air_have_their_sigmas():
    reference = np.loadtxt(package_data("mars_reference.csv"), delimiter=",", skiprows=2)
    worlds = [draw_world("mer", np.random.default_rng(seed)) for seed in range(60)]
    tolerance = 5.0 / np.sqrt(120.0)
    assert np.std([w.mass_factor for w in worlds]) == pytest.approx(MASS_SIGMA, rel=tolerance)
    assert np.std([w.inertia_factor for w in worlds]) == pytest.approx(INERTIA_SIGMA, rel=tolerance)
    density = np.array([w.air[:, 1] / reference[:, 1] - 1.0 for w in worlds])
    assert np.sqrt(np.mean(density**2)) == pytest.approx(DENSITY_SIGMA, rel=0.15)
    winds = np.array([w.air[:, 3:] for w in worlds])
    assert np.sqrt(np.mean(winds**2, axis=(0, 1))) == pytest.approx([WIND_SIGMA, WIND_SIGMA], rel=0.15)
    assert all(np.array_equal(w.air[:, [0, 2]], reference[:, [0, 2]]) for w in worlds)


def test_a_world_is_reproducible_by_its_seed(phoenix_world):
    again, another = (draw_world("phoenix", np.random.default_rng(seed)) for seed in (3, 4))
    assert np.array_equal(again.continuum.Cm, phoenix_world.continuum.Cm)
    assert np.array_equal(again.air, phoenix_world.air) and again.mass_factor == phoenix_world.mass_factor
    assert not np.array_equal(another.continuum.Cm, phoenix_world.continuum.Cm)


def test_the_scenario_flies_the_world_and_nothing_else(phoenix_world, tmp_path):
    """Tables, air and vehicle are those of the world, and the scenario draws no weather beside them."""
    scenario = phoenix_world.scenario(tmp_path)
    flown = flown_world(scenario, (), np.random.default_rng(0))
    for regime in ("continuum", "rarefied"):
        for name in ("nodes", "alpha", "CA", "CN", "Cm"):
            values = [getattr(getattr(w, regime), name) for w in (flown.database, phoenix_world)]
            np.testing.assert_allclose(values[0], values[1], rtol=1e-7, atol=1e-12)
    density, wind = flown.air_at(phoenix_world.air[:, 0])
    np.testing.assert_allclose(density, phoenix_world.air[:, COLUMNS.index("density")], rtol=1e-7)
    np.testing.assert_allclose(wind, phoenix_world.air[:, 3:], atol=1e-6)
    assert flown.body.mass == pytest.approx(573.0 * phoenix_world.mass_factor, rel=1e-12)
    assert flown.body.inertia[0, 1] == pytest.approx(-0.9 * phoenix_world.inertia_factor, rel=1e-12)


def test_the_mission_states_the_nominal_model_and_its_sigmas(phoenix_world, tmp_path):
    path = simulate(phoenix_world.scenario(tmp_path), (), 1).write(tmp_path / "flight.h5")
    mission = phoenix_world.mission(path)
    assert mission.aerodynamics.continuum == "builtin:continuum_grid" and mission.vehicle.mass == 573.0
    assert mission.atmosphere.table == "builtin:mars_reference"
    stated = (mission.aerodynamics.coefficient_sigma, mission.atmosphere.density_sigma, mission.atmosphere.wind_sigma)
    assert stated == (1.0, 0.10, 10.0)
    assert (mission.vehicle.mass_sigma, mission.vehicle.inertia_sigma) == (4.0, 0.03)


def test_the_flights_are_those_of_the_study_in_one_random_order():
    flights = study.cases()
    assert flights == study.cases() and len(flights) == len(set(flights))
    assert sum(not names for _, _, names, _ in flights) == 60
    for name in catalogue():
        for part in (1.0, 0.5):
            assert {v for v, _, names, p in flights if names == (name,) and p == part} == {"mer", "phoenix"}
    assert sum(len(names) == 2 for _, _, names, _ in flights) == 10
    assert sum(names[0] in study.OUTSIDE_EFFECTS for _, _, names, _ in flights if names) == 18
    first = [names for _, _, names, _ in flights[: len(flights) // 4]]
    assert 8 <= sum(not names for names in first) <= 25  # a third of them, by chance
    assert not set(study.cases(first_seed=7)) & set(flights)


@pytest.mark.parametrize("name", study.OUTSIDE_EFFECTS)
def test_effects_outside_the_catalogue_are_drawn_within_their_range(name):
    assert name not in catalogue()
    effect, typical = study.OUTSIDE_EFFECTS[name]
    sizes = []
    for seed in range(20):
        (instance,) = study.hidden_effects((name,), 1.0, np.random.default_rng(seed))
        sizes += [instance.values[q.name] / typical[q.name] for q in effect.sizes]
    assert min(sizes) < 0.0 < max(sizes) and 0.7 <= np.abs(sizes).min() < np.abs(sizes).max() <= 1.4


def test_a_sensor_that_drifts_is_corrected_by_what_it_reads():
    (drift,) = study.hidden_effects(("thermal_drift",), 1.0, np.random.default_rng(0))
    time, rate = np.linspace(50.0, 250.0, 9), np.zeros((9, 3))
    force = np.random.default_rng(1).standard_normal((9, 3))
    reading = drift.effect.imu(drift.values, time, force, rate)
    np.testing.assert_allclose(drift.effect.corrected(drift.values, time, *reading)[0], force, atol=1e-15)
    assert np.array_equal(reading[0][time < 100.0], force[time < 100.0])
    assert reading[0][-1, 0] - force[-1, 0] == pytest.approx(drift.values["a"], rel=0.05)


def name(effect, probability, same_as=()):
    return {"effect": effect, "imu": None, "label": effect, "same_as": list(same_as), "probability": probability}


def flight_line(hidden, verdict, named=(), gain=50.0, parameters=None, share=1.0, **more):
    """Line of a flight as `inexact.result_of` gives it."""
    first = {"parameters": parameters or {}, "explained_share": share, "at_noise_floor": share == 1.0}
    ranking = [n | first | {"gain": 40.0} for n in named[-1:]] or [name("wind", 0.3) | first | {"gain": 2.0}]
    return {
        "vehicle": "mer", "seed": 0, "hidden": list(hidden), "part": 1.0 if hidden else 0.0, "verdict": verdict,
        "expected_gains": dict.fromkeys(hidden, gain), "named": list(named), "ranking": ranking, "seconds": 36.0,
    } | more  # fmt: skip


def lines_by_hand():
    mass = {"k": {"estimate": 0.07, "sigma": 0.01}}
    return [
        flight_line((), "clean", increments={"CA": [90, 100]}),
        flight_line((), "clean", increments={"CA": [30, 30]}, key_of_a_later_version={"a": 1}),
        flight_line((), "undecided", increments={"CA": [20, 20]}),
        flight_line((), "missing", [name("static_instability", 0.97)], increments={"CA": [50, 50]}),
        flight_line(("mass",), "missing", [name("mass", 0.9)], truth={"mass": {"k": 0.05}}, parameters=mass),
        flight_line(
            ("mass",), "missing", [name("density_scale", 0.9, ["mass"])], truth={"mass": {"k": 0.05}}, share=0.95
        ),
        flight_line(("wind",), "missing", [name("com_offset", 0.7)], part=0.5),
        flight_line(("wind",), "clean", gain=2.0),
        flight_line(("leak",), "unknown"),
        flight_line(("leak",), "missing", [name("remnant_torque", 1.0)], share=0.4),
        flight_line(("wind", "mass"), "clean", [name("wind", 1.0), name("mass", 0.85)]),
        {"vehicle": "phoenix", "seed": 3, "hidden": ["slosh"], "part": 1.0, "refused": "it tumbles", "seconds": 9.0},
    ]


def test_the_report_counts_what_was_right(tmp_path, monkeypatch, capsys):
    path, page = tmp_path / "lines.jsonl", tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    path.write_text("".join(json.dumps(line) + "\n" for line in lines_by_hand()))
    figure = page.parent / "figures" / "reliability.png"
    monkeypatch.setattr(sys, "argv", ["inexact_report.py", str(path), "--page", str(page), "--figure", str(figure)])
    inexact_report.main()
    text = page.read_text()
    assert text.strip() == capsys.readouterr().out.strip() and figure.is_file()
    for row in (
        "| clean: not called clean | 2 of 4, 50.0% (6.8% to 93.2%) | at most 5 % |",
        "| clean: named something | 1 of 4,",
        "| clean: undecided | 1 of 4,",
        "| detectable effect, plausible size: named first | 2 of 2,",
        "| detectable effect, half of it: named first | 0 of 1,",
        "| detectable effect, both: named first | 2 of 3,",
        "| not detectable: called clean | 1 of 1,",
        "| outside the catalogue: name with 0.95 or more | 1 of 2,",
        "| outside, detectable: unknown | 1 of 2,",
        "| pairs: both named | 1 of 1,",
        "| parameters of right names: within 3 sigma | 1 of 1,",
        "| parameters of right names: rms of error over sigma | 2.00 |",
        "| 0.5 to 0.8 | 1 | 0.700 | 0 of 1,",
        "| 0.8 to 0.95 | 3 | 0.883 | 3 of 3,",
        "| 0.99 to 1 | 2 | 1.000 | 1 of 2,",
        "| 0 to 0.5 | 5 | 0.300 | 1 of 5,",
        "| mer | 0 | nothing | 0 |  | undecided |",
        "| mer | 0 | leak | 1 | 50 | missing: remnant_torque (1.000) |",
        "| phoenix | 3 | slosh | it tumbles |",
        "(figures/reliability.png)",
        "| 0.5 to 1 | 1 | 0 of 1, 0.0% (0.0% to 97.5%) | 0 of 1, 0.0% (0.0% to 97.5%) |",
        "| clean: increments of CA within 2 sigma, flown cells (correlated) | 190 of 200, 95.0% (90.9% to 100.0%) |",
        "| 0 to 0.2 | 0 (0) | 0 (0) |",
        "| 0.4 to 0.9 | 0 (0) | 1 (0) |",
        "| 0.9 to 1 | 2 (1) | 1 (1) |",
        "| 2 to 3 | 3 | 2 of 3, 66.7% (9.4% to 99.2%) | 3 of 3, 100.0% (29.2% to 100.0%) |",
    ):
        assert row in text, row
    assert "| mer | 0 | mass |" not in text and "11 flights were diagnosed" in text


def test_intervals_of_a_share_are_exact():
    """Clopper and Pearson: of 60 flights without an alarm, 6 % is excluded and 5.9 % is not (1 − 0.025^(1/60))."""
    low, high = inexact_report.binomial_interval(0, 60)
    assert low == 0.0 and high == pytest.approx(1.0 - 0.025 ** (1 / 60), rel=1e-12)
    assert inexact_report.binomial_interval(60, 60) == pytest.approx((0.025 ** (1 / 60), 1.0), rel=1e-12)


def test_the_bootstrap_interval_is_that_of_independent_flights():
    """Of 50 flights all of whose cells are within, or none, it is about that of 50 trials, however many cells."""
    counts = np.array([[7, 7]] * 40 + [[0, 7]] * 10)
    low, high = inexact_report.bootstrap_interval(counts)
    assert (low, high) == pytest.approx(
        (0.8 - 1.96 * np.sqrt(0.8 * 0.2 / 50), 0.8 + 1.96 * np.sqrt(0.8 * 0.2 / 50)), abs=0.02
    )
    assert inexact_report.bootstrap_interval(np.array([[3, 4]] * 9)).tolist() == [0.75, 0.75]
    counts = np.array([[90, 100], [30, 30], [20, 20], [50, 50]])
    samples = [counts[list(i)].sum(axis=0) for i in itertools.product(range(4), repeat=4)]  # all that there are
    exact = np.percentile([within / units for within, units in samples], (2.5, 97.5))
    np.testing.assert_allclose(inexact_report.bootstrap_interval(counts), exact, rtol=1e-12)


@pytest.mark.usefixtures("in_this_process")
def test_flights_in_the_file_are_not_repeated(tmp_path, monkeypatch):
    flights = study.cases()[:6]
    calls = []

    def line_of(case):
        calls.append(case)
        return {"vehicle": case[0], "seed": case[1], "hidden": list(case[2]), "part": case[3]}

    monkeypatch.setattr(study, "result_of", line_of)
    output = tmp_path / "new" / "inexact.jsonl"
    monkeypatch.setattr(sys, "argv", ["inexact.py", "-o", str(output)])
    for total in (4, 6, 6):
        monkeypatch.setattr(study, "cases", lambda *_, total=total: flights[:total])
        study.main()
    assert calls == flights


@pytest.mark.slow
@pytest.mark.parametrize("names", [(), ("thermal_drift",)])
def test_a_flight_is_diagnosed_with_a_short_catalogue(names, monkeypatch):
    """The hidden drift is detectable beside everything that the mission states as uncertain."""
    monkeypatch.setattr(study, "catalogue", lambda: {"gyro_bias": catalogue()["gyro_bias"]})
    line = study.result_of(("mer", 1, names, 1.0 if names else 0.0))
    assert "fault" not in line and "refused" not in line
    assert line["verdict"] and all(gain > inexact_report.DETECTABLE for gain in line["expected_gains"].values())
    assert set(line["expected_gains"]) == set(names) and 0.0 <= line["something_else"] <= 1.0
    inexact_report.report([line], "figure.png")
