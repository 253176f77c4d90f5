"""A block of cases, as a task of a dask worker: each thread of it has one process for cases."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from edl_filter._version import __version__
from edl_filter.workflow.campaign_files import CASES, FAILURES, CampaignJob, case_path
from edl_filter.workflow.campaign_process import CaseProcess

_processes: dict[int, CaseProcess] = {}
_lock = threading.Lock()


def run_block(job: CampaignJob, numbers: Sequence[int]) -> dict[str, Any]:
    """Run cases one after the other, except those that are complete.

    Parameters
    ----------
    job : CampaignJob
        The job.
    numbers : sequence of int
        Of the cases.

    Returns
    -------
    dict
        ``done`` and ``failed``: numbers of cases; ``not_written``: why a case could not be written, after which no
        further one is run, or None.
    """
    outcome: dict[str, Any] = {"done": 0, "failed": 0, "not_written": None}
    if job.version != __version__:
        outcome["not_written"] = f"a worker has edl-filter {__version__}, the campaign {job.version}"
        return outcome
    folder = Path(job.folder)
    for number in numbers:
        if case_path(folder, CASES, number).is_file():
            outcome["done"] += 1
            continue
        if case_path(folder, FAILURES, number).is_file():
            outcome["failed"] += 1
            continue
        answer = _process(job).run(number)
        if answer["outcome"] == "not written":
            outcome["not_written"] = answer["reason"]
            break
        outcome[answer["outcome"]] += 1
    return outcome


def close_processes() -> None:
    """End the processes for cases of all threads."""
    with _lock:
        processes = list(_processes.values())
        _processes.clear()
    for process in processes:
        process.close()


def _process(job: CampaignJob) -> CaseProcess:
    """The process of this thread for a job; that of an earlier job is ended."""
    identity = threading.get_ident()
    with _lock:
        process = _processes.get(identity)
    if process is not None and process.job == job:
        return process
    if process is not None:
        process.close()
    process = CaseProcess(job)
    with _lock:
        _processes[identity] = process
    return process
