"""The study of both filters: one flight, and the file from which it resumes."""

import json
import sys

import filter_comparison as study
import numpy as np
import pytest


@pytest.fixture(scope="module")
def flight():
    return study.compare_flight(next(iter(study.CASES)), 0)


def test_both_filters_are_consistent_on_a_flight_with_a_well_known_start(flight):
    for phase in study.PHASES:
        ukf, ekf = (flight[method]["nees"][phase] for method in study.METHODS)
        assert np.all(np.array([ukf, ekf]) < 2.5), phase  # 9 degrees of freedom: beyond 99 % of chi-square
        assert ekf == pytest.approx(ukf, rel=0.1), phase
    assert all(flight[method]["rejected"] == 0 for method in study.METHODS)


def test_flights_in_the_file_are_not_repeated(flight, tmp_path, monkeypatch, capsys):
    path = tmp_path / "flights.jsonl"
    done = [{"case": case, "seed": 0, "filters": flight} for case in study.CASES]
    path.write_text("".join(json.dumps(row) + "\n" for row in done))
    calls = []
    monkeypatch.setattr(study, "compare_flight", lambda case, seed: calls.append((case, seed)) or flight)
    monkeypatch.setattr(study, "MISSIONS", ())
    monkeypatch.setattr(sys, "argv", ["filter_comparison.py", "--flights", "2", "-o", str(path)])
    study.main()
    assert calls == [(case, 1) for case in study.CASES]
    assert len(path.read_text().splitlines()) == 2 * len(study.CASES)
    assert "2 flights" in capsys.readouterr().out
