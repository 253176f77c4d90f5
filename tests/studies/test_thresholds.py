"""The study of thresholds: its variations, one flight with a short catalogue, and the report."""

import json
import sys

import pytest
import thresholds as study
from study_lines import read_lines

from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.mission.decision_settings import DecisionSettings

NAMES = list(DecisionSettings.model_fields)


@pytest.fixture(scope="module")
def one_candidate():
    """The catalogue with one effect."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "catalogue", lambda: {"gyro_bias": find_effect("gyro_bias")})
        yield


@pytest.fixture(scope="module")
def lines(builtin_flight, one_candidate, tmp_path_factory):
    """Lines of the shipped flight with one candidate: defaults, what comparisons decide, and the last that differ."""
    path = tmp_path_factory.mktemp("thresholds") / "lines.jsonl"
    study.decide_by_comparisons(builtin_flight, path)
    keys = study.remaining_keys(builtin_flight.stem, read_lines(path), 0.5)
    study.compute_remaining(builtin_flight, keys, path)
    return {(line["setting"], line["factor"]): line for line in read_lines(path)}


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


@pytest.mark.slow
def test_the_shipped_flight_is_clean_with_the_defaults(lines):
    assert study.answer(lines[None, 1.0]) == "clean"


@pytest.mark.slow
def test_variations_decided_by_comparisons_or_continued_are_those_of_their_own_diagnoses(
    lines, builtin_flight, one_candidate
):
    decided = [key for key, line in lines.items() if "decided" in line]
    continued = [key for key, line in lines.items() if "seconds" in line and key[0] is not None]
    assert len(decided) > 40 and ("approximation_error", 2.0) in continued
    for key in (("holds_share", 2.0), ("state_limit_sigmas", 2.0), ("approximation_error", 2.0)):
        own = study.diagnosis_line(builtin_flight, *key)
        assert {k: lines[key][k] for k in own if k != "seconds"} == {k: v for k, v in own.items() if k != "seconds"}
    assert lines["approximation_error", 2.0]["none"] != lines[None, 1.0]["none"]


def test_settings_that_are_not_tracked_are_refused(builtin_flight, monkeypatch):
    monkeypatch.setattr(study, "outcome", lambda mission: DecisionSettings().holds_share)
    with pytest.raises(RuntimeError, match="holds_share was read from settings that are not tracked"):
        study.tracked_run(builtin_flight, study.variations(), lambda key: False)


def test_refused_settings_are_read_as_plain_numbers(builtin_flight, monkeypatch, capsys):
    def outcome(mission):
        value = mission.diagnosis.holds_share
        if not isinstance(value, float):
            raise TypeError("no float")
        return {"value": value}

    monkeypatch.setattr(study, "outcome", outcome)
    tracked, result = study.tracked_run(builtin_flight, study.variations(), lambda key: False)
    assert result == {"value": 0.02}
    assert study.variations().keys() - tracked.pending == {("holds_share", 0.5), ("holds_share", 2.0)}
    assert "read as plain numbers: holds_share" in capsys.readouterr().out


def test_every_flight_is_computed_twice_by_a_process_of_its_own(builtin_flight, in_this_process, tmp_path, monkeypatch):
    """First with the variations that comparisons decide, for all flights, then with the others."""
    commands = []
    monkeypatch.setattr(study, "computed", lambda function, cases, *_: in_this_process(function, cases))
    monkeypatch.setattr(study.subprocess, "run", lambda command, check: commands.append(command))
    folder, path = tmp_path / "flights", tmp_path / "lines.jsonl"
    folder.mkdir()
    (folder / "practice_02.h5").touch()
    monkeypatch.setattr(sys, "argv", ["thresholds.py", "--flights", str(folder), "-o", str(path)])
    study.main()
    fixed = [sys.executable, study.__file__, "--flights", str(folder), "-o", str(path), "--longest"]
    assert [list(command) for command in commands] == [
        [*fixed, longest, "--flight", flight] for longest in ("0.0", "inf") for flight in ("practice_06", "practice_02")
    ]


def test_study_has_a_line_of_each_variation_and_resumes(builtin_flight, tmp_path, monkeypatch):
    """With a function of three settings in place of the diagnosis."""

    def outcome(mission):
        settings = mission.diagnosis
        verdict = "clean" if settings.decided_probability < 0.9 else "unknown"
        if settings.fit_iterations < 10:
            raise InputError("too few")
        if float(settings.named_gain_nats) == 3.0:
            raise ZeroDivisionError
        return {"verdict": verdict, "first": None, "none": 0.9, "something_else": 0.1, "ranking": []}

    monkeypatch.setattr(study, "outcome", outcome)
    monkeypatch.setattr(study, "place", lambda: "here")
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "lines.jsonl"
    arguments = ["thresholds.py", "--flights", str(builtin_flight.parent), "-o", str(path), "--flight", "practice_06"]
    monkeypatch.setattr(sys, "argv", [*arguments, "--longest", "0"])
    study.main()
    count = len(read_lines(path))
    monkeypatch.setattr(sys, "argv", arguments)
    study.main()
    lines = read_lines(path)
    assert len(lines) == count + 4 == len(study.variations()) + 1
    study.main()
    assert read_lines(path) == lines
    (tmp_path / "docs").mkdir()
    page = tmp_path / "docs/thresholds.md"
    page.write_text("before\n<!-- numbers: begin -->\nold\n<!-- numbers: end -->\nafter\n")
    path.write_text("".join(json.dumps(line) + "\n" for line in lines if line["setting"] != "max_effects"))
    monkeypatch.setattr(sys, "argv", ["thresholds.py", "--report", str(path)])
    study.main()
    text = page.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "\nold\n" not in text
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in text.splitlines() if row.startswith("| `")]
    rows = {(row[0].strip("`"), float(row[2])): row for row in rows}
    assert rows.keys() == study.variations().keys()
    assert rows["decided_probability", 2.0][4:] == ["06: unknown", "0", "1", ""]
    assert rows["fit_iterations", 0.5][4:] == ["06: refused", "0", "1", ""]
    assert rows["named_gain_nats", 0.5][4:] == ["06: crash", "0", "1", ""]
    assert rows["named_gain_nats", 2.0][4:] == ["none", "0", "1", ""]
    assert rows["onset_nats", 2.0][4:] == ["none", "1", "0", ""]
    assert rows["max_effects", 2.0][4:] == ["none", "0", "0", "06"]
    total = len(study.variations())
    assert f"{total - 6} are decided by comparisons, 4 were computed, 2 are missing. 3 of the {total - 2} have" in text
