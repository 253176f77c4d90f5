"""Run every benchmark in a process of its own, and write the page of the ratios.

A benchmark that is complete is not repeated: its rows lie in ``bench-results``. ``--again NAME`` measures one anew,
``--again`` alone all, and ``--page`` only writes the page from the rows that are there.

    python benchmarks/performance.py [--only NAME ...] [--again [NAME ...]] [--page] [-o docs/performance.md]
"""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from measuring import Grid, Row, Section, from_json

FOLDER = Path(__file__).parent
#: In the order of the page.
BENCHMARKS = (
    "commands",
    "engines",
    "epochs",
    "propagation",
    "peers",
    "filter",
    "postflight",
    "lookup",
    "simulator",
    "diagnosis",
    "diagnosis_fine",
    "growth",
    "campaign",
)
PEERS = ("filterpy", "dynamax", "jax", "stonesoup", "python-ins", "pymap3d", "astropy")

INTRODUCTION = """# Performance

This page is written by `make bench`. It states ratios of processor times that were measured alternately, in one process
or, for commands, in one session. A ratio is that of the shortest times of several rounds; the range in brackets is the
central half of the ratios of all rounds. Absolute times depend on the machine and are not stated. If two programs solve
the same problem, their answers are compared in the same run, and a benchmark whose answers differ by more than the
stated tolerance fails.
"""


def number(value: float) -> str:
    """A ratio with two or three significant digits."""
    if value >= 1e5:
        digits = f"{float(f'{value:.2g}'):,.0f}"
        return digits.replace(",", " ")
    if value >= 100.0:
        return f"{float(f'{value:.3g}'):.0f}"
    return f"{value:.3g}" if value >= 10.0 else f"{value:.2f}"


def row_text(row: Row) -> str:
    """Line of the table of one row."""
    ratio = "not measured" if row.ratio is None else number(row.ratio)
    if row.spread is not None:
        ratio += f" ({number(row.spread[0])} to {number(row.spread[1])})"
    cells = (row.what, ratio, row.reference, goal_text(row), row.agreement)
    return line(cells)


def line(cells: Sequence[str]) -> str:
    """Line of a table."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def goal_text(row: Row) -> str:
    """The goal of a row, and whether it is met."""
    if row.goal is None:
        return ""
    bound = f"{row.goal.sense} {row.goal.value:g}"
    if row.ratio is None:
        return bound
    return f"{bound}: {'met' if row.goal.is_met(row.ratio) else '**missed**'}"


def grid_text(grid: Grid) -> str:
    """Table of a grid."""
    lines = [f"| {grid.corner} | " + " | ".join(grid.columns) + " |", "|---" * (len(grid.columns) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(number(v) for v in values) + " |" for name, values in grid.lines.items()]
    return "\n".join(lines)


def rows_text(rows: Sequence[Row]) -> str:
    """Table of rows."""
    head = ["| what | ratio | to | goal | answers |", "|---|---|---|---|---|"]
    return "\n".join(head + [row_text(r) for r in rows])


def section_text(section: Section) -> str:
    """Markdown of one section."""
    parts = [f"## {section.title}", section.text.strip()]
    parts += [rows_text(section.rows)] if section.rows else []
    parts += [grid_text(section.grid)] if section.grid is not None else []
    return "\n\n".join(p for p in parts if p)


def machine_text(versions: Mapping[str, str], cores: str) -> str:
    """Sentence on the machine and the versions."""
    listed = ", ".join(f"{name} {number}" for name, number in versions.items())
    return f"Machine: {cores}. Versions: {listed}."


def goals_text(sections: Sequence[Section]) -> str:
    """All rows that have a goal, at the top of the page."""
    rows = [r for s in sections for r in s.rows if r.goal is not None]
    lines = ["| what | to | goal | measured |", "|---|---|---|---|"]
    for r in rows:
        measured = "not measured" if r.ratio is None else number(r.ratio)
        lines.append(line((r.what, r.reference, goal_text(r), measured)))
    return "## Goals\n\n" + "\n".join(lines)


def page(sections: Sequence[Section], machine: str, absent: Sequence[str] = ()) -> str:
    """The whole page; `absent` are the names of benchmarks without results."""
    parts = [INTRODUCTION.strip(), machine]
    parts += [f"Not measured: {', '.join(f'`bench_{name}`' for name in absent)}."] if absent else []
    parts += [goals_text(sections), *(section_text(s) for s in sections)]
    return "\n\n".join(parts) + "\n"


def installed_versions() -> dict[str, str]:
    """Versions of Python, of what computes, and of the peers that are installed."""
    out = {"Python": platform.python_version()}
    for name in ("numba", "numpy", "scipy", *PEERS):
        try:
            out[name] = version(name)
        except PackageNotFoundError:
            out[name] = "not installed"
    return out


def cores_text() -> str:
    """Number of cores in words, and architecture."""
    import os

    count, names = os.cpu_count() or 1, {1: "one core", 2: "two cores", 4: "four cores"}
    return f"{names.get(count, f'{count} cores')}, {platform.machine().replace('_', '-')}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, default=BENCHMARKS)
    parser.add_argument("--again", nargs="*", choices=BENCHMARKS)
    parser.add_argument("--page", action="store_true", help="write the page from what was measured")
    parser.add_argument("--results", type=Path, default=FOLDER.parent / "bench-results")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER.parent / "docs" / "performance.md")
    arguments = parser.parse_args()
    arguments.results.mkdir(exist_ok=True)
    repeated = () if arguments.again is None else arguments.again or BENCHMARKS
    sections, failed, absent = [], [], []
    for name in BENCHMARKS:
        rows = arguments.results / f"{name}.json"
        wanted = name in arguments.only and not arguments.page and (name in repeated or not rows.exists())
        if wanted:
            print(f"== {name}", flush=True)
            rows.unlink(missing_ok=True)
            if subprocess.run([sys.executable, str(FOLDER / f"bench_{name}.py"), "--rows", str(rows)]).returncode:
                failed.append(name)
        if rows.exists():
            sections += from_json(rows.read_text())
        else:
            absent.append(name)
    arguments.output.write_text(page(sections, machine_text(installed_versions(), cores_text()), absent))
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
