"""Commands from the shell, as ratios to the import of the libraries they need.

`--help`, a run of Spirit without and with figures, cold and warm, and the import of numba, scipy.linalg and
matplotlib.pyplot: the least of several repetitions, in turn. Cold: the cache of compiled kernels is empty. The ratio of
elapsed times has a meaning only on a machine without other load. Byte code is kept, as that of an installed package,
whatever ``PYTHONDONTWRITEBYTECODE`` says: without it every command would compile the package's modules again.

Run: ``python benchmarks/bench_commands.py``
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from measuring import Row, Section, Times, at_most, command, run

REPETITIONS = 5
IMPORTS = [sys.executable, "-c", "import numba, scipy.linalg, matplotlib.pyplot"]
GOALS = {"`--help`": 0.2, "`run builtin:mer_a --no-figures`": 1.5, "`run builtin:mer_a` with figures and report": 2.5}


def measure() -> list[Section]:
    """All sections."""
    program = [sys.executable, "-m", "edl_filter"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        run_spirit = [*program, "run", "builtin:mer_a", "-o", str(Path(folder) / "result")]
        words = [[*program, "--help"], [*run_spirit, "--no-figures"], run_spirit]
        commands = {"imports": IMPORTS} | dict(zip(GOALS, words, strict=True))
        for c in commands.values():
            command(c, environment)  # compiles the kernels and the byte code
        processor: dict[str, list[float]] = {name: [] for name in commands}
        elapsed: dict[str, list[float]] = {name: [] for name in commands}
        memory: dict[str, float] = {}
        for _ in range(REPETITIONS):
            for name, c in commands.items():
                spent, wall, memory[name] = command(c, environment)
                processor[name].append(spent)
                elapsed[name].append(wall)
        cold = {"NUMBA_CACHE_DIR": str(Path(folder) / "cache")}
        first, _, _ = command(words[1], environment | cold)
    times, walls, to = Times(processor), Times(elapsed), "import of numba, scipy.linalg, matplotlib.pyplot"
    rows = []
    for name, goal in GOALS.items():
        rows.append(times.row(f"{name}, processor time", to, name, "imports", at_most(goal)))
        rows.append(walls.row(f"{name}, elapsed time", to, name, "imports"))
    what = "`run builtin:mer_a --no-figures`"
    rows += [
        Row(f"{what}, first call with an empty cache of kernels", "warm", first / times.least(what)),
        Row("`run builtin:mer_a`, largest memory of one process", "1 MB", max(memory.values())),
    ]
    return [Section("Commands", "", rows)]


if __name__ == "__main__":
    run(measure)
