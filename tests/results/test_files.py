"""Readers of the JSON files: what they return, and that errors name file, line and key."""

import json

import numpy as np
import pytest
from contents import diagnosis, hypothesis, ledger_end, ledger_step

from edl_filter.errors import InputError
from edl_filter.results import Result
from edl_filter.results.files import finite, read_diagnosis, read_ledger, read_summary, write_json


@pytest.fixture(scope="module")
def summary(practice_06):
    return Result(practice_06).summary()


def written(folder, content, name="diagnosis.json"):
    return write_json(content, folder / name)


def test_a_summary_from_its_folder_and_from_its_file(tmp_path, summary):
    path = written(tmp_path, summary, "summary.json")
    assert read_summary(path) == read_summary(tmp_path)
    content = read_summary(tmp_path)
    assert content.mission == "practice_mer" and content.landing.miss_m == pytest.approx(summary["landing"]["miss_m"])
    assert content.constraints["landing"].accepted


def test_a_summary_with_a_wrong_number(tmp_path, summary):
    landing = summary["landing"] | {"miss_m": "far"}
    written(tmp_path, summary | {"landing": landing}, "summary.json")
    with pytest.raises(InputError) as caught:
        read_summary(tmp_path)
    assert str(caught.value) == (
        f"{tmp_path}/summary.json: landing.miss_m: found 'far' (text); expected a number (horizontal distance from the "
        "site, m; null without a site or a landing); run 'edl-filter run' again."
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (diagnosis(verdict="maybe"), "diagnosis.json: verdict: found 'maybe'; expected 'clean', 'missing'"),
        (diagnosis(more=1), "diagnosis.json: more: found an unknown key"),
        ({}, "diagnosis.json: verdict: found nothing; expected a required key (verdict) (and 23 more problems)"),
        (
            diagnosis(ranking=[hypothesis(probability="high")]),
            "diagnosis.json: ranking.0.probability: found 'high' (text); expected a number (posterior probability)",
        ),
        (
            diagnosis(ranking=[hypothesis(parameters={"Cm": 3})]),
            "diagnosis.json: ranking.0.parameters.Cm: found 3; expected",
        ),
    ],
)
def test_a_diagnosis_that_violates_the_schema(tmp_path, content, message):
    written(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_diagnosis(tmp_path)
    assert message in str(caught.value) and str(caught.value).endswith("; run 'edl-filter diagnose' again.")


@pytest.mark.parametrize("text", ["", "{", "{'verdict': 1}"])
def test_a_file_that_is_not_json(tmp_path, text):
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(InputError, match=r"diagnosis\.json: found no JSON \(Expecting .*expected the diagnosis\.json"):
        read_diagnosis(tmp_path)


@pytest.mark.parametrize("text", ["[]", "3", "null"])
def test_a_file_without_keys(tmp_path, text):
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(InputError, match=r"diagnosis\.json: found no object with keys; expected the diagnosis\.json"):
        read_diagnosis(tmp_path)


def test_a_file_that_is_not_there_or_not_text(tmp_path):
    with pytest.raises(InputError, match=r"nowhere: found no diagnosis; expected a folder in which 'edl-filter diag"):
        read_diagnosis(tmp_path / "nowhere")
    (tmp_path / "summary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"summary\.json: found no summary; expected a folder in which 'edl-filter r"):
        read_summary(tmp_path)


def lines(*contents):
    return "".join(json.dumps(c) + "\n" for c in contents)


def test_a_ledger(tmp_path):
    assert read_ledger(tmp_path) == []
    (tmp_path / "ledger.jsonl").write_text(lines(ledger_step(), ledger_end()))
    step, end = read_ledger(tmp_path)
    assert (step.added, step.errors["moment_y"].after, end.added, end.why) == ("remnant_torque", 1.0, None, "Stopped.")


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (
            "{",
            "ledger.jsonl, line 2: found no JSON (Expecting property name enclosed in double quotes); remove the line.",
        ),
        (lines(ledger_step(gain="much")), "ledger.jsonl, line 2: gain: found 'much' (text); expected a number"),
        (lines(ledger_end(same_as=[])), "ledger.jsonl, line 2: same_as: found an unknown key"),
        ("3", "ledger.jsonl, line 2: found no object with keys; remove the line."),
    ],
)
def test_a_ledger_with_a_wrong_line(tmp_path, second, message):
    (tmp_path / "ledger.jsonl").write_text(lines(ledger_step()) + second)
    with pytest.raises(InputError) as caught:
        read_ledger(tmp_path)
    assert message in str(caught.value)


def test_a_failure_keeps_the_old_file(tmp_path):
    path = tmp_path / "summary.json"
    path.write_text("old")
    with pytest.raises(TypeError):
        write_json({"a": object()}, path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_not_finite_becomes_null():
    plain_data = finite(
        {
            "a": [np.inf, 1.0, float("nan")],
            "b": np.array([1.0, -np.inf]),
            "c": None,
            "d": True,
            "e": np.longdouble(2.0),
            "f": np.int64(3),
        }
    )
    assert plain_data == {"a": [None, 1.0, None], "b": [1.0, None], "c": None, "d": True, "e": 2.0, "f": 3}
