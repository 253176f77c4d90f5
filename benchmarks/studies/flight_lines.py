"""Lines of a study, one JSON object a flight, written by several workers; a study that was interrupted goes on."""

import json
from itertools import islice


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
    """
    done = {flight_key(line) for line in read_lines(output.parent.glob(f"{output.stem}*.jsonl"))}
    output.parent.mkdir(parents=True, exist_ok=True)
    for i, case in enumerate(cases):
        if i % workers == worker and case not in done:
            text = json.dumps(result_of(case), default=float)
            with output.with_stem(f"{output.stem}_{worker}").open("a", encoding="utf-8") as file:
                file.write(text + "\n")


def append_missing_on_cluster(cases, result_of, output, workers, scheduler=None):
    """Append the lines of the flights that no file of the study contains, computed by dask workers.

    Parameters
    ----------
    cases, result_of
        As in `append_missing`; a worker must be able to import the module of `result_of`.
    output : Path
        File of the study, which this process writes.
    workers : int
        Processes of this machine.
    scheduler : str, optional
        Address of a scheduler whose workers are used instead.
    """
    from distributed import Client, LocalCluster, as_completed

    done = {flight_key(line) for line in read_lines(output.parent.glob(f"{output.stem}*.jsonl"))}
    output.parent.mkdir(parents=True, exist_ok=True)
    missing = iter([case for case in cases if case not in done])
    cluster = None if scheduler else LocalCluster(n_workers=workers, threads_per_worker=1, host="127.0.0.1")
    with Client(scheduler or cluster) as client:
        threads = sum(client.nthreads().values())
        running = as_completed([client.submit(result_of, case, pure=False) for case in islice(missing, 2 * threads)])
        for future in running:
            text = json.dumps(future.result(), default=float)
            with output.open("a", encoding="utf-8") as file:
                file.write(text + "\n")
            for case in islice(missing, 1):
                running.add(client.submit(result_of, case, pure=False))
    if cluster is not None:
        cluster.close()
