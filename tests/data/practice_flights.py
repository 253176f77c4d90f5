"""Write the practice flights with hidden effects that the package ships.

Run: ``python tests/data/practice_flights.py [FOLDER]``, by default the package's folder of data. The commands that
simulate the flights stand in docs/how-to/practice-flights-solutions.md and nowhere else. A shipped flight is what the
command writes, without the group ``/truth``, compressed without loss.
"""

import re
import shlex
import sys
import tempfile
from pathlib import Path

from compress_flights import copy_compressed
from typer.testing import CliRunner

ROOT = Path(__file__).parents[2]
SOLUTIONS = ROOT / "docs" / "how-to" / "practice-flights-solutions.md"


def commands():
    """Name of each flight → arguments of the command that simulates it."""
    lines = re.findall(r"^edl-filter (simulate .*)$", SOLUTIONS.read_text(), re.MULTILINE)
    by_name = {}
    for line in lines:
        arguments = shlex.split(line)
        by_name[Path(arguments[arguments.index("-o") + 1]).stem] = arguments
    return by_name


def simulate(name, folder):
    """Run the command of a flight in a folder; returns the file with the truth."""
    from edl_filter.cli import app

    arguments = commands()[name]
    path = folder / f"{name}.h5"
    arguments[arguments.index("-o") + 1] = str(path)
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return path


def main(folder):
    for name in commands():
        with tempfile.TemporaryDirectory() as temporary:
            target = folder / f"{name}.h5"
            copy_compressed(simulate(name, Path(temporary)), target, without=("truth",))
        print(f"{target}: {target.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "src" / "edl_filter" / "data")
