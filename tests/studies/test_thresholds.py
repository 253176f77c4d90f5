"""The study of thresholds: its variations, one flight with a short catalogue, and the report."""

import json
import sys

import pytest
import thresholds as study

from edl_filter.effects.registry import find_effect
from edl_filter.mission.decision_settings import DecisionSettings

NAMES = list(DecisionSettings.model_fields)


@pytest.fixture(scope="module")
def line(builtin_flight):
    """Line of the shipped flight with the defaults and one candidate."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "catalogue", lambda: {"gyro_bias": find_effect("gyro_bias")})
        return study.diagnosis_line(builtin_flight, None, 1.0)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("factor", study.FACTORS)
def test_every_variation_is_a_mission(builtin_flight, name, factor):
    value = study.changed_value(name, factor)
    default = DecisionSettings.model_fields[name].default
    if value is None:
        return  # at its bound
    mission = study.mission_of(builtin_flight, name, factor)
    changed = getattr(mission.diagnosis, name)
    assert changed == (tuple(value) if isinstance(default, tuple) else value) and changed != default


def test_the_shipped_flight_is_clean_with_the_defaults(line):
    assert "error" not in line and study.answer(line) == "clean"


def test_diagnoses_in_the_file_are_not_repeated_and_are_reported(line, builtin_flight, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, calls = tmp_path / "lines.jsonl", []
    path.write_text(json.dumps(line) + "\n")

    def varied(flight, name, factor):
        calls.append((flight.stem, name, factor))
        return line | {"setting": name, "factor": factor, "verdict": "unknown"}

    monkeypatch.setattr(study, "diagnosis_line", varied)
    monkeypatch.setattr(sys, "argv", ["thresholds.py", "--flights", str(builtin_flight.parent), "-o", str(path)])
    study.main()
    count = len(calls)
    assert (builtin_flight.stem, None, 1.0) not in calls and count > len(NAMES)
    study.main()
    assert len(calls) == count
    (tmp_path / "docs").mkdir()
    monkeypatch.setattr(sys, "argv", ["thresholds.py", "--report", str(path)])
    study.main()
    text = (tmp_path / "docs/thresholds.md").read_text()
    assert all(f"| `{name}` |" in text for name in NAMES)
    assert text.count(f"{builtin_flight.stem}: unknown") == count
