"""Time of commands from the shell, as ratios to the import of the libraries they need, measured side by side.

Prints processor and wall time of `--help`, of a run of Spirit without and with figures, and of the import of numba,
scipy.linalg and matplotlib.pyplot: the least of several repetitions, in turn. The ratio of wall times has a meaning
only on a machine without other load.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

REPETITIONS = 4
IMPORTS = [sys.executable, "-c", "import numba, scipy.linalg, matplotlib.pyplot"]


def measured(command: list[str]) -> tuple[float, float]:
    """Processor and wall time of a command with its children, s."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def main() -> None:
    program = [sys.executable, "-m", "edl_filter"]
    with tempfile.TemporaryDirectory() as folder:
        run = [*program, "run", "builtin:mer_a", "-o", str(Path(folder) / "result")]
        commands = {
            "imports": IMPORTS,
            "--help": [*program, "--help"],
            "run, no figures": [*run, "--no-figures"],
            "run": run,
        }
        measured(commands["run"])  # compiles the kernels
        times = {name: [measured(c) for _ in range(1)] for name, c in commands.items()}
        for _ in range(REPETITIONS - 1):
            for name, command in commands.items():
                times[name].append(measured(command))
    least = {name: tuple(min(values) for values in zip(*pairs, strict=True)) for name, pairs in times.items()}
    print(f"{'':18}{'processor s':>12}{'wall s':>8}{'ratio':>8}{'of wall':>9}")
    for name, (processor, wall) in least.items():
        ratios = processor / least["imports"][0], wall / least["imports"][1]
        print(f"{name:18}{processor:12.2f}{wall:8.2f}{ratios[0]:8.2f}{ratios[1]:9.2f}")


if __name__ == "__main__":
    main()
