"""Lines of a study, one JSON object a flight, written by several workers; a study that was interrupted goes on."""

import json


def flight_key(line):
    """What identifies a flight of a study: vehicle, seed, hidden effects, part of the plausible size."""
    return line["vehicle"], line["seed"], tuple(line["hidden"]), line["part"]


def read_lines(paths):
    """All lines of some files."""
    return [json.loads(text) for path in paths for text in path.read_text(encoding="utf-8").splitlines()]


def append_missing(cases, result_of, output, worker, workers):
    """Append the lines of this worker's flights that no file of the study contains.

    Parameters
    ----------
    cases : sequence of tuple
        All flights, as `flight_key` gives them.
    result_of : callable
        Line of a case.
    output : Path
        File of the study; worker K writes to one with ``_K`` at the end of its stem.
    worker, workers : int
        Number of this process, and how many there are.

    Raises
    ------
    ValueError
        The file's name does not end in ``.jsonl``: the study would not find its own lines when it goes on.
    """
    if output.suffix != ".jsonl":
        raise ValueError(f"{output}: state a file whose name ends in .jsonl")
    done = {flight_key(line) for line in read_lines(output.parent.glob(f"{output.stem}*.jsonl"))}
    output.parent.mkdir(parents=True, exist_ok=True)
    for i, case in enumerate(cases):
        if i % workers == worker and case not in done:
            text = json.dumps(result_of(case), default=float)
            with output.with_stem(f"{output.stem}_{worker}").open("a", encoding="utf-8") as file:
                file.write(text + "\n")
