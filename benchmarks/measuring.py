"""How the benchmarks measure: functions in turn, the least processor time of each, and ratios of these.

Processor time is that of all threads of the process, so that other programs on the machine change it little. Functions
that are compared are called in turn, several times; a ratio is that of the least times, its spread the central half
of the ratios of the single rounds. Every benchmark returns `Section`s; `performance.py` writes them as one page.
"""

from __future__ import annotations

import argparse
import gc
import importlib.util
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

SHORTEST = 0.02  # s: a function that takes less is called several times in a measurement


@dataclass(frozen=True)
class Goal:
    """Bound of a ratio."""

    sense: Literal["at most", "at least"]
    value: float

    def is_met(self, ratio: float) -> bool:
        """Whether the ratio keeps the bound."""
        return ratio <= self.value if self.sense == "at most" else ratio >= self.value


def at_most(value: float) -> Goal:
    """Upper bound."""
    return Goal("at most", value)


def at_least(value: float) -> Goal:
    """Lower bound."""
    return Goal("at least", value)


@dataclass(frozen=True)
class Row:
    """One ratio.

    Attributes
    ----------
    what, reference : str
        Numerator and denominator.
    ratio : float or None
        None: not measured.
    spread : tuple of float or None
        Quartiles of the ratio over the rounds.
    goal : Goal or None
    agreement : str
        How far the answers of both agree, or why there is no ratio.
    """

    what: str
    reference: str
    ratio: float | None
    spread: tuple[float, float] | None = None
    goal: Goal | None = None
    agreement: str = ""


@dataclass(frozen=True)
class Grid:
    """Ratios over two variables.

    Attributes
    ----------
    corner : str
        Name of the first column.
    columns : sequence of str
    lines : mapping
        First cell → ratios.
    """

    corner: str
    columns: Sequence[str]
    lines: Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class Section:
    """Part of the page: heading, Markdown text, rows and a grid."""

    title: str
    text: str
    rows: Sequence[Row] = ()
    grid: Grid | None = None


@dataclass
class Times:
    """Times of functions that were called in turn, s, by name."""

    seconds: dict[str, list[float]] = field(default_factory=dict)

    def least(self, name: str) -> float:
        """Least time."""
        return min(self.seconds[name])

    def ratio(self, name: str, reference: str, factor: float = 1.0) -> tuple[float, tuple[float, float] | None]:
        """Ratio of least times times `factor`, and the quartiles of the rounds' ratios."""
        pairs = zip(self.seconds[name], self.seconds[reference], strict=True)
        rounds = factor * np.array([a / b for a, b in pairs])
        low, high = np.quantile(rounds, [0.25, 0.75])
        spread = (float(low), float(high)) if len(rounds) > 2 else None
        return factor * self.least(name) / self.least(reference), spread

    def row(
        self,
        what: str,
        reference: str,
        name: str,
        to: str,
        goal: Goal | None = None,
        agreement: str = "",
        factor: float = 1.0,
    ) -> Row:
        """Row of the ratio of `name` and `to`, times `factor`."""
        ratio, spread = self.ratio(name, to, factor)
        return Row(what, reference, ratio, spread, goal, agreement)


def interleaved(
    functions: Mapping[str, Callable[[], Any]], rounds: int = 7, warm: bool = True, shortest: float = SHORTEST
) -> Times:
    """Processor times of one call of each function.

    Parameters
    ----------
    functions : mapping of str to callable
        Called in this order in every round.
    rounds : int
        Measurements of each.
    warm : bool
        Whether each is called once before, so that it is compiled and its data are in the cache.
    shortest : float
        Processor time of a measurement, s: short functions are called repeatedly.
    """
    calls = dict.fromkeys(functions, 1)
    if warm:
        for name, function in functions.items():
            function()
            begin = time.process_time()
            function()
            calls[name] = max(1, int(np.ceil(shortest / max(time.process_time() - begin, 1e-7))))
    seconds: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            gc.collect()
            count = calls[name]
            begin = time.process_time()
            for _ in range(count):
                function()
            seconds[name].append((time.process_time() - begin) / count)
    return Times(seconds)


def command(words: Sequence[str], environment: Mapping[str, str] | None = None) -> tuple[float, float, float]:
    """Processor time and elapsed time of a command with its children, s, and its largest resident size, MB."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, env=dict(environment or os.environ))
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    elapsed, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, elapsed, usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


def installed(*modules: str) -> bool:
    """Whether all of these can be imported."""
    return all(importlib.util.find_spec(name) is not None for name in modules)


def missing(what: str, reference: str, distribution: str, goal: Goal | None = None) -> Row:
    """Row of a comparison whose peer is not installed."""
    return Row(what, reference, None, None, goal, f"{distribution} is not installed")


def as_json(sections: Sequence[Section]) -> str:
    """JSON text of the sections."""
    return json.dumps([asdict(s) for s in sections], indent=1)


def from_json(text: str) -> list[Section]:
    """Sections of a JSON text."""

    def row(r: dict[str, Any]) -> Row:
        goal, spread = r.pop("goal"), r.pop("spread")
        return Row(**r, goal=Goal(**goal) if goal else None, spread=tuple(spread) if spread else None)

    return [
        Section(s["title"], s["text"], [row(r) for r in s["rows"]], Grid(**s["grid"]) if s["grid"] else None)
        for s in json.loads(text)
    ]


def run(measure: Callable[[], list[Section]]) -> None:
    """Command line of one benchmark: print its sections, and write them as JSON with ``--rows FILE``."""
    from performance import section_text

    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("--rows", type=Path, help="JSON file to write")
    arguments = parser.parse_args()
    sections = measure()
    print("\n\n".join(section_text(s) for s in sections))
    if arguments.rows:
        arguments.rows.write_text(as_json(sections))
