"""The study of reconstructions: one simulated flight, and the tables of a few."""

import sys

import numpy as np
import pytest
from scipy.stats import chi2

import simulation as study


@pytest.fixture(scope="module")
def flight():
    return study.flown(("mer", 0))


def test_errors_and_innovations_of_a_flight_are_consistent(flight):
    innovations, rows, seconds = flight
    assert {"landing", "altimeter", "parachute"} <= {name for name, _, _ in innovations} and seconds > 0.0
    square, dof = np.sum([(nis, size) for _, nis, size in innovations], axis=0)
    assert chi2.ppf(1e-5, dof) < square < chi2.isf(1e-5, dof)
    assert tuple(rows) == study.PHASES
    for phase, (nees, *_) in rows.items():
        assert nees < chi2.isf(1e-5, 9) / 9.0, phase


def test_both_vehicles_are_in_the_tables(flight, in_this_process, monkeypatch, capsys):
    jobs = []
    monkeypatch.setattr(study, "computed", in_this_process)
    monkeypatch.setattr(study, "flown", lambda job: jobs.append(job) or flight)
    monkeypatch.setattr(sys, "argv", ["simulation.py", "--flights", "2"])
    study.main()
    printed = capsys.readouterr().out
    assert jobs == [(name, seed) for name in ("mer", "phoenix") for seed in (0, 1)]
    assert printed.count("2 clean flights") == 2 and all(f"  {phase}" in printed for phase in study.PHASES)
