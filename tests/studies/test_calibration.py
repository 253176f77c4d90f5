"""The calibration study: its cases, resumption, statistics, and twenty flights whose sigmas must be true."""

import json
import sys
from pathlib import Path

import calibration as study
import calibration_report as page
import numpy as np
import pytest
from scipy.stats import chi2
from study_lines import read_lines

FLIGHTS = 20


def case(number):
    """A flight of the nominal world without lost samples."""
    return study.Case(number, 500 + number, study.VEHICLES[number % 2], False, 1.0, 1.0, 0.0, 0.5, 2)


@pytest.fixture(scope="module")
def lines():
    return [json.loads(json.dumps({**study.result_of(case(n)), "case": vars(case(n))})) for n in range(FLIGHTS)]


def test_average_nees_is_not_above_its_interval(lines):
    """At every phase, of position, velocity and attitude of twenty flights; a tenth of the sigmas fails it."""
    dof = 3 * FLIGHTS
    high = chi2.isf(1e-5, dof) / dof
    for phase in study.PHASES:
        for k, part in enumerate(page.PARTS):
            nees = np.mean([line["navigation"][phase]["nees"][k] for line in lines]) / 3.0
            assert 0.2 < nees < high, (phase, part)


def test_nees_of_the_well_sampled_vehicle_is_in_its_interval(lines):
    """20 Hz: neither the sampling nor a cautious default determines the sigmas of velocity and attitude."""
    chosen = [line for line in lines if line["case"]["vehicle"] == "phoenix"]
    dof = 3 * len(chosen)
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], dof) / dof
    for k in (1, 2):
        for phase in ("peak", "before parachute", "under parachute", "rest"):
            assert low < np.mean([x["navigation"][phase]["nees"][k] for x in chosen]) / 3.0 < high


def test_velocity_before_the_parachute_is_known_to_decimetres_a_second(lines):
    """At 8 Hz by interpolation with the samples on both sides: 0.4 m/s by the two neighbours alone."""
    errors = [x["navigation"]["before parachute"]["error"][1] for x in lines if x["case"]["vehicle"] == "mer"]
    assert np.sqrt(np.mean(np.square(errors))) < 0.2


def test_postflight_errors_are_within_their_sigmas(lines):
    for name, values, square, *_ in page.postflight_table(lines):
        assert values >= 3 * FLIGHTS, name
        assert square < chi2.isf(1e-5, FLIGHTS) / FLIGHTS, name


def test_innovations_are_in_their_intervals(lines):
    for name, dof, nis, *_ in page.nis_table(lines):
        low, high = chi2.ppf([1e-5, 1.0 - 1e-5], dof) / dof
        assert low < nis < high, name


def test_cases_are_given_by_their_numbers():
    cases = [study.case_of(n) for n in range(60)]
    assert cases == [study.case_of(n) for n in range(60)]
    assert {c.vehicle for c in cases} == set(study.VEHICLES) and {c.inexact for c in cases} == {True, False}
    assert {c.gap for c in cases} == {0.0, *study.GAPS_S} and {c.imus for c in cases} == {1, 2}
    assert all(0.5 <= c.noise <= 2.0 and 0.5 <= c.entry <= 2.0 for c in cases)
    assert all(c.imus == 2 for c in cases if not c.gap)


@pytest.mark.usefixtures("in_this_process")
def test_the_study_computes_the_cases_that_its_file_lacks(tmp_path, monkeypatch):
    run = []
    monkeypatch.setattr(study, "result_of", lambda c: run.append(c.number) or {"case": {"number": c.number}})
    path = tmp_path / "lines.jsonl"
    for flights in ("3", "5"):
        monkeypatch.setattr(sys, "argv", ["calibration.py", "-o", str(path), "--flights", flights])
        study.main()
    assert run == [0, 1, 2, 3, 4]
    assert [line["case"]["number"] for line in read_lines(path)] == run


def test_lost_samples_and_a_missing_imu_are_in_the_file(tmp_path):
    import h5py

    lost = study.Case(4, 504, "mer", False, 1.0, 1.0, 3.0, 0.5, 1)
    study.flown(lost, tmp_path)
    with h5py.File(tmp_path / "flight.h5") as file:
        time = file["imu/primary/time"][:]
        assert list(file["imu"]) == ["primary"]
    assert np.max(np.diff(time)) == pytest.approx(3.125, abs=1e-6)


def test_the_page_has_the_numbers_between_its_marks(lines, tmp_path):
    path = tmp_path / "calibration.md"
    path.write_text(f"before\n{page.START}\nold\n{page.END}\nafter\n")
    text = page.insert(path.read_text(), page.report(lines))
    assert text.startswith("before") and text.endswith("after\n") and "old" not in text
    assert "MER-like, 8 Hz, no lost samples** (10 flights)" in text and "| altimeter |" in text
    paths = page.draw(lines, tmp_path)
    assert all(Path(p).stat().st_size > 5000 for p in paths)


def test_statistics_of_gaussian_errors():
    z = np.random.default_rng(0).standard_normal(200_000)
    np.testing.assert_allclose(page.coverage(z), page.GAUSSIAN, atol=3e-3)
    assert page.robust_nees(z**2, 1) == pytest.approx(1.0, abs=0.02)
    low, high = page.nees_interval(3, 100)
    assert low < 1.0 < high and high - low == pytest.approx(4 * np.sqrt(2 / 300), rel=0.05)


def test_the_diagnoses_of_the_inexact_world_have_a_section():
    def line(hidden, verdict, named, gain, probability):
        name = {"effect": named, "label": named, "same_as": [], "probability": probability}
        return {"hidden": hidden, "part": 1.0, "verdict": verdict, "named": [name] if named else [],
                "ranking": [name | {"parameters": {"k": {"estimate": 0.07, "sigma": 0.01}}}],
                "truth": {"mass": {"k": 0.05}}, "expected_gains": dict.fromkeys(hidden, gain)}  # fmt: skip

    text = page.report([], [
        line([], "clean", "", 0.0, 0.1), line([], "missing", "wind", 0.0, 0.93),
        line(["mass"], "missing", "mass", 30.0, 0.995), line(["mass"], "missing", "wind", 30.0, 0.999),
        line(["mass"], "undecided", "", 30.0, 0.5), {"hidden": ["slosh"], "refused": "it tumbles"},
    ])  # fmt: skip
    assert "**Diagnosis** (5 flights of" in text and "is named: 1 of 2, 50.0%" in text
    assert "within 3 sigma: 1 of 1, 100.0% (2.5% to 100.0%); rms of error over sigma: 2.00." in text
    assert "| 0.8 to 0.95 | 1 | 0.930 | 0 of 1," in text and "| 0.99 to 1 | 2 | 0.997 | 1 of 2," in text
    assert "| 2 to 3 | 3 | 1 of 3, 33.3% (0.8% to 90.6%) | 3 of 3," in text  # sqrt(30 / 6) smallest detectable sizes


def test_marked_results_have_no_part_in_the_tables(lines):
    spoilt = [line | {"trustworthy": number != 3} for number, line in enumerate(lines)]
    assert len(page.flights(spoilt)) == len(lines) - 1
    (text,) = page.marked(spoilt)
    assert f"number {lines[3]['case']['number']} (" in text and "sigmas)" in text
    assert f"The tables are over the {len(lines) - 1} trustworthy ones. Marked: {text}." in page.report(spoilt)
    assert page.marked(lines) == [] and "Marked" not in page.report(lines)
