"""The study of identification: its flights, one of them diagnosed with a short catalogue, and the report of both."""

import json
import sys

import identification as study
import identification_report
import numpy as np
import pytest

from edl_filter.effects.registry import catalogue, find_effect

pytestmark = pytest.mark.slow

SHORT = {name: find_effect(name) for name in ("gravity_oblateness", "gyro_bias")}


@pytest.fixture(scope="module")
def line():
    """Line of one flight with a short catalogue."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "catalogue", lambda: SHORT)
        return study.result_of(("mer", 0, ("gravity_oblateness",), 1.0))


def test_every_effect_is_flown_on_both_vehicles_at_both_sizes():
    flights = study.cases(range(2), 3)
    assert len(flights) == len(set(flights)) == 2 * (4 * len(catalogue()) + 2 * len(study.OUTSIDE) + 3 + 5)
    for name in catalogue():
        for vehicle in study.VEHICLES:
            assert {(vehicle, 0, (name,), 1.0), (vehicle, 1, (name,), 0.5)} <= set(flights)


@pytest.mark.parametrize("name", catalogue())
def test_the_size_of_an_instance_is_the_part_of_the_plausible_one(name):
    """As the root mean square over its sizes, in sigmas; the same for the same seed."""
    effect = catalogue()[name]
    for part in (1.0, 0.5):
        a, b = (study.random_instance(name, part, np.random.default_rng(4)) for _ in range(2))
        assert a.values == b.values
        sizes = [a.values[q.name] / q.sigma for q in effect.sizes]
        assert np.sqrt(np.mean(np.square(sizes))) == pytest.approx(part, rel=1e-12)


def test_a_flight_is_diagnosed(line):
    assert "fault" not in line and "refused" not in line
    assert line["expected_gain"] > identification_report.DETECTABLE
    assert line["verdict"] == "missing" and line["ranking"][0]["effect"] == "gravity_oblateness"
    assert identification_report.estimates_agree(line)


def test_a_flight_that_tumbles_is_refused():
    line = study.result_of(("phoenix", 1, ("normal_force_scale",), 1.0))
    assert "tumbles" in line["refused"] and "verdict" not in line


@pytest.mark.usefixtures("in_this_process")
def test_flights_in_the_file_are_not_repeated_and_are_reported(line, tmp_path, monkeypatch, capsys):
    path = tmp_path / "study.jsonl"
    calls = []
    clean = ("mer", 1000, (), 0.0)
    monkeypatch.setattr(study, "cases", lambda *_: [("mer", 0, ("gravity_oblateness",), 1.0), clean])
    monkeypatch.setattr(
        study,
        "result_of",
        lambda case: (
            calls.append(case)
            or {"vehicle": case[0], "seed": case[1], "hidden": [], "part": 0.0, "verdict": "clean", "ranking": []}
        ),
    )
    path.write_text(json.dumps(line) + "\n")
    monkeypatch.setattr(sys, "argv", ["identification.py", "-o", str(path)])
    study.main()
    study.main()
    assert calls == [clean]
    figure = tmp_path / "confusion.png"
    monkeypatch.setattr(sys, "argv", ["identification_report.py", str(path), "--figure", str(figure)])
    identification_report.main()
    printed = capsys.readouterr().out
    assert "| detectable effect | 1 | right name first: 1 |" in printed
    assert "| clean | 1 | false alarms: 0 |" in printed
    assert figure.is_file()
