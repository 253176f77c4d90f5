"""Cases of a study on a cluster, and its file of lines."""

import argparse
import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest
import study_lines
from study_lines import append_line, append_missing, computed, lines_so_far, read_lines, study_parser

from edl_filter.errors import InputError

SCRIPT = """
import os
from functools import cache

from study_lines import append_missing, read_lines, study_parser

@cache
def squared(number):
    return number**2

def line_of(number):
    return {"number": number, "square": squared(number), "process": os.getpid()}

def number_of(line):
    return line["number"]

if __name__ == "__main__":
    options = study_parser("A study.", "lines.jsonl").parse_args()
    append_missing(range(6), line_of, number_of, options)
    print(len(read_lines(options.output)), os.getpid())
"""


def test_a_study_runs_on_a_cluster_and_continues(tmp_path):
    """With functions of the script itself, one of them with a cache, which only its module can name."""
    script, output = tmp_path / "squares.py", tmp_path / "new" / "lines.jsonl"
    script.write_text(SCRIPT)
    append_line(output, {"number": 3, "square": -9, "process": 0})
    with output.open("a") as file:
        file.write('{"number": 4, "sq')  # torn by a kill
    path = os.pathsep.join((str(Path(study_lines.__file__).parent), os.environ.get("PYTHONPATH", "")))
    command = [sys.executable, script, "-o", output, "--workers", "2"]
    first, second = (
        subprocess.run(command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=True)
        for _ in range(2)
    )
    count, parent = first.stdout.split()
    assert count == second.stdout.split()[0] == "6"
    lines = {line["number"]: line for line in read_lines(output)}
    assert {n: line["square"] for n, line in lines.items()} == {0: 0, 1: 1, 2: 4, 3: -9, 4: 16, 5: 25}
    assert int(parent) not in {line["process"] for line in lines.values()}


def test_values_are_those_of_the_cases_and_an_exception_is_raised():
    assert sorted(computed(Fraction, ["1/2", "1/3"], workers=1)) == [Fraction(1, 3), Fraction(1, 2)]
    with pytest.raises(ValueError, match="Invalid literal for Fraction"):
        list(computed(Fraction, ["one"], workers=1))
    assert list(computed(Fraction, [])) == []


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr(study_lines, "PATIENCE_S", 1.0)
    with pytest.raises(InputError, match=r"--scheduler tcp://127\.0\.0\.1:9: no dask scheduler answers there"):
        list(computed(Fraction, ["1/2"], scheduler="tcp://127.0.0.1:9"))


@pytest.mark.usefixtures("in_this_process")
def test_lines_that_are_there_are_not_computed_again(tmp_path):
    options = argparse.Namespace(output=tmp_path / "a" / "lines.jsonl", scheduler=None, workers=None)
    run = []

    def line_of(number):
        run.append(number)
        return {"number": number}

    assert lines_so_far(options.output) == []
    for cases in (range(3), range(5), range(5)):
        append_missing(cases, line_of, lambda line: line["number"], options)
    assert run == [0, 1, 2, 3, 4]
    assert [json.loads(text)["number"] for text in options.output.read_text().splitlines()] == run
    with pytest.raises(FileNotFoundError):
        read_lines(tmp_path / "lines.jsonl")


def test_every_study_has_the_same_options():
    options = study_parser("A study.", "study-results/lines.jsonl").parse_args(["--scheduler", "tcp://192.0.2.7:8786"])
    assert vars(options) == {
        "output": Path("study-results/lines.jsonl"), "scheduler": "tcp://192.0.2.7:8786", "workers": None
    }  # fmt: skip
