"""The page of the benchmarks from their rows, and that each benchmark can be imported; times are not tested."""

import importlib
from importlib.metadata import PackageNotFoundError, distribution, requires
from pathlib import Path

import measuring
import performance
import pytest
from measuring import Grid, Row, Section, Times, at_least, at_most
from packaging.requirements import Requirement

#: Peers, of the extra `bench`, that a file imports at its beginning.
NEEDS = {"peer_dynamax": "dynamax", "peer_pyins": "python-ins", "peer_stonesoup": "stonesoup"}
FOLDER = Path(performance.__file__).parent
SECTION = Section(
    "Filter",
    "What was compared.",
    [
        Row("filter", "kernel", 20.76, (19.94, 24.21), at_most(10.0), "equal"),
        Row("peer | other", "ours", 1234.5, None, at_least(1000.0)),
        measuring.missing("third", "ours", "third-party", at_least(10.0)),
    ],
    Grid("states", ["1 sample", "8 samples"], {"15": [1.0, 2.344]}),
)


def test_table_of_rows():
    text = performance.section_text(SECTION)
    assert "| filter | 20.8 (19.9 to 24.2) | kernel | at most 10: **missed** | equal |" in text
    assert "| peer \\| other | 1230 | ours | at least 1000: met |  |" in text
    assert "| third | not measured | ours | at least 10 | third-party is not installed |" in text


def test_table_of_a_grid():
    assert performance.grid_text(SECTION.grid).splitlines() == [
        "| states | 1 sample | 8 samples |",
        "|---|---|---|",
        "| 15 | 1.00 | 2.34 |",
    ]


def test_page_lists_all_goals_and_has_no_time():
    text = performance.page([SECTION], performance.machine_text({"numba": "1.2"}, "two cores, x86-64"))
    goals = text.split("## Goals")[1].split("## Filter")[0]
    assert goals.count("| filter |") == 1
    assert "| third | ours | at least 10 | not measured |" in goals
    assert "Machine: two cores, x86-64. Versions: numba 1.2." in text


def test_page_names_benchmarks_without_results():
    assert "Not measured: `bench_a`, `bench_b`." in performance.page([SECTION], "", ["a", "b"])
    assert "Not measured" not in performance.page([SECTION], "")


def test_rows_survive_their_file():
    assert measuring.from_json(measuring.as_json([SECTION])) == [SECTION]


def test_ratio_is_that_of_the_least_times():
    times = Times({"a": [4.0, 2.0, 3.0], "b": [1.0, 2.0, 1.0]})
    ratio, spread = times.ratio("a", "b")
    assert ratio == 2.0
    assert spread == (2.0, 3.5)
    assert times.ratio("a", "b", 3.0)[0] == 6.0


def test_interleaved_measures_every_function():
    calls = []
    times = measuring.interleaved({n: (lambda n=n: calls.append(n)) for n in "ab"}, rounds=3, warm=False)
    assert calls == ["a", "b"] * 3
    assert all(len(seconds) == 3 for seconds in times.seconds.values())


@pytest.mark.parametrize("name", sorted(p.stem for p in FOLDER.glob("*.py")))
def test_every_file_can_be_imported(name):
    if name in NEEDS:
        try:
            distribution(NEEDS[name])
        except PackageNotFoundError:
            pytest.skip(f"{NEEDS[name]} is not installed (extra bench)")
    importlib.import_module(name)


def test_packages_that_may_be_missing_are_those_of_the_extra():
    needed = [Requirement(r) for r in requires("edl-filter")]
    extra = {r.name for r in needed if r.marker is not None and r.marker.evaluate({"extra": "bench"})}
    assert set(NEEDS.values()) <= extra


def test_every_benchmark_is_on_the_page():
    assert {f"bench_{n}" for n in performance.BENCHMARKS} == {p.stem for p in FOLDER.glob("bench_*.py")}


def test_operations_of_a_step_are_counted():
    """The step and its quaternion product run on numbers that count: one square root and one division, of r²."""
    counts = importlib.import_module("bench_propagation").operations()
    assert counts["sqrt"] == counts["division"] == 1
    assert 100 < counts["add"] + counts["multiply"] < 300
