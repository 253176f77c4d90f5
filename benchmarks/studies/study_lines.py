"""Cases of a study on dask.distributed, and its file of JSON lines: a study that was interrupted continues.

Input: cases and the function that computes the line of a case. Method: the cases are tasks of a dask cluster, of this
machine by default or of any scheduler by its address; a line is appended in one write when its case is complete, so
that an interruption loses the cases that were running and nothing else. Output: one file, in the order of completion.
"""

import argparse
import importlib
import json
import sys
from pathlib import Path

from edl_filter.workflow.campaign import connections

#: How long a scheduler is waited for, s.
PATIENCE_S = 60.0


def study_parser(description, output):
    """Parser with the options that each study has: output, scheduler and number of workers.

    Parameters
    ----------
    description : str
        Text above the options.
    output : str
        Default of ``--output``.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path(output), help="file of JSON lines")
    parser.add_argument("--scheduler", help="address of a dask scheduler whose workers have this folder")
    parser.add_argument("--workers", type=int, help="processes of this machine; by default one for each processor")
    return parser


def computed(function, cases, scheduler=None, workers=None):
    """Yield the value of a function for each case, in the order of completion.

    Parameters
    ----------
    function : callable
        Of one case; of a module's top level, which the workers import.
    cases : sequence
        Picklable.
    scheduler : str, optional
        Address of a dask scheduler; otherwise processes of this machine.
    workers : int, optional
        Number of these.

    Yields
    ------
    object

    Raises
    ------
    Exception
        That of the first case that raised one; the values before it are yielded.
    """
    if not cases:
        return
    from distributed import as_completed

    with connections(scheduler, workers, PATIENCE_S) as connect:
        client = connect()
        futures = client.map(_importable(function), list(cases), pure=False)
        for future in as_completed(futures):
            yield future.result()
            future.release()


def _importable(function):
    """A function of the running script as one of the module of that name: a worker runs another script."""
    if function.__module__ != "__main__":
        return function
    return getattr(importlib.import_module(Path(sys.modules["__main__"].__file__).stem), function.__qualname__)


def flight_key(line):
    """What identifies a flight of a study: vehicle, seed, hidden effects, part of the plausible size."""
    return line["vehicle"], line["seed"], tuple(line["hidden"]), line["part"]


def read_lines(path):
    """Lines of a file that are complete; one that an interruption tore is left out."""
    lines = []
    for text in path.read_text(encoding="utf-8").splitlines():
        try:
            lines.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return lines


def lines_so_far(path):
    """Lines of a study's file; none before the study has begun."""
    return read_lines(path) if path.exists() else []


def append_line(path, line):
    """Append one line in one write, behind a torn line on a line of its own; the folder is created."""
    text = json.dumps(line, default=float) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and path.stat().st_size and not path.read_bytes().endswith(b"\n"):
        text = "\n" + text
    with path.open("ab", buffering=0) as file:
        file.write(text.encode())


def append_missing(cases, line_of, key, options):
    """Append the lines of all cases that the file of a study does not contain.

    Parameters
    ----------
    cases : sequence of tuple
        All cases, as `key` returns them.
    line_of : callable
        Line of a case.
    key : callable
        Case of a line.
    options : argparse.Namespace
        ``output``, ``scheduler`` and ``workers`` (`study_parser`).
    """
    done = {key(line) for line in lines_so_far(options.output)}
    missing = [case for case in cases if case not in done]
    for line in computed(line_of, missing, options.scheduler, options.workers):
        append_line(options.output, line)
