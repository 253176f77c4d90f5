"""Cases in a process of their own, whose parent can end it: `python -m edl_filter.workflow.campaign_process`.

A case may hang in compiled code that no exception interrupts, or end its process. The process reads a job and then
numbers of cases from standard input, one JSON line each, and answers each number with one line on standard output. The
operating system's timer ends it at a case's limit, also where its parent is gone; without a parent its input ends, and
so does it. BLAS and numba have one thread (`environment`).

`run_block` is the task of a dask worker: a block of cases. Each thread of the worker has one process for cases.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.estimation.parallel import WORKERS_VARIABLE
from edl_filter.simulation.campaign_config import Campaign
from edl_filter.workflow.campaign_files import CASES, FAILURES, CampaignJob, case_path, write_failure, write_record

#: Time after the limit at which the parent ends a process that the timer did not end, s.
_GRACE_S = 5.0
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", WORKERS_VARIABLE)


def environment() -> dict[str, str]:
    """Environment of a process for cases: that of this one, one thread for this package and each numerical library."""
    return os.environ | dict.fromkeys(_THREADS, "1")


class CaseProcess:
    """A process that runs cases of one job; started again after it has ended.

    Parameters
    ----------
    job : CampaignJob
        The job.
    """

    def __init__(self, job: CampaignJob) -> None:
        self.job = job
        self._campaign = job.load()
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: Any = None
        self._fresh = True

    def run(self, number: int) -> dict[str, Any]:
        """Run a case, which writes its record or its failure.

        Parameters
        ----------
        number : int
            Of the case.

        Returns
        -------
        dict
            ``outcome``: ``done``, ``failed`` or ``not written``; ``reason`` of the last two.
        """
        outcome = self._attempt(number)
        if outcome["outcome"] == "ended":  # once more: an operator or the system may have ended it
            outcome = self._attempt(number)
        if outcome["outcome"] not in ("ended", "time limit"):
            return outcome
        kind = "time limit" if outcome["outcome"] == "time limit" else "process ended"
        try:
            write_failure(Path(self.job.folder), self._campaign, number, kind, outcome["reason"])
        except InputError as error:
            return {"outcome": "not written", "reason": str(error)}
        return {"outcome": "failed", "reason": outcome["reason"]}

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for stream in (self._process.stdin, self._process.stdout, self._errors):
                if stream is not None:
                    stream.close()
        self._process = None

    def _attempt(self, number: int) -> dict[str, Any]:
        if self._process is None or self._process.poll() is not None:
            self._start()
        limit = self._campaign.time_limit_s + (self._campaign.start_limit_s if self._fresh else 0.0)
        answer = self._ask({"case": number, "limit": limit}, limit + _GRACE_S)
        self._fresh = False
        if answer is not None:
            return answer
        assert self._process is not None
        code = self._process.poll()
        if code is None or code == -signal.SIGALRM:
            self.close()
            return {"outcome": "time limit", "reason": f"the case took longer than {limit:g} s"}
        ending = f"signal {-code}" if code < 0 else f"exit code {code}"
        last = self._last_errors()
        self.close()
        return {"outcome": "ended", "reason": f"the process ended with {ending}{last}"}

    def _start(self) -> None:
        self.close()
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 -- open as long as the process runs
        self._process = subprocess.Popen(
            [sys.executable, "-m", self.job.program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env=environment(),
        )
        self._fresh = True
        self._send(asdict(self.job))

    def _send(self, content: dict[str, Any]) -> None:
        assert self._process is not None and self._process.stdin is not None
        with suppress(BrokenPipeError):  # the process has ended, as `_ask` sees
            self._process.stdin.write(json.dumps(content).encode() + b"\n")
            self._process.stdin.flush()

    def _ask(self, question: dict[str, Any], timeout: float) -> dict[str, Any] | None:
        """The answer to a question; None if the process ended or the time is over."""
        assert self._process is not None and self._process.stdout is not None
        self._send(question)
        stream = self._process.stdout
        ready, _, _ = select.select([stream], [], [], timeout)
        line = stream.readline() if ready else b""
        if not line:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(10.0 if ready else 0.0)
            return None
        return dict(json.loads(line))

    def _last_errors(self) -> str:
        """The end of what the process wrote to standard error."""
        self._errors.seek(0)
        text = self._errors.read()[-2000:].decode(errors="replace").strip()
        return f": {text.splitlines()[-1]}" if text else ""


#: Process of each thread of this one; `_lock` guards the mapping.
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


def serve(runner_of: Callable[[Campaign], Any] | None = None) -> None:
    """Answer the questions of the parent until the input ends.

    Parameters
    ----------
    runner_of : callable, optional
        Returns an object with ``run(number)`` for a campaign; by default a `campaign_case.CaseRunner`.
    """
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what a case prints is no answer
    job = CampaignJob(**json.loads(sys.stdin.readline()))
    campaign = job.load()
    if runner_of is None:
        from edl_filter.workflow.campaign_case import CaseRunner

        runner_of = CaseRunner
    runner = runner_of(campaign)
    for line in sys.stdin:
        question = json.loads(line)
        _set_timer(question["limit"])
        answer = _answer(runner, campaign, Path(job.folder), int(question["case"]))
        _set_timer(0.0)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _answer(runner: Any, campaign: Campaign, folder: Path, number: int) -> dict[str, Any]:
    """Run a case and write its record, or its failure."""
    try:
        record = runner.run(number)
    except Exception as error:
        kind, reason = ("input", str(error)) if isinstance(error, InputError) else ("error", _name(error))
        try:
            write_failure(folder, campaign, number, kind, reason, traceback.format_exc())
        except InputError as failure:
            return {"outcome": "not written", "reason": str(failure)}
        return {"outcome": "failed", "reason": reason}
    try:
        write_record(folder, record)
    except InputError as error:
        return {"outcome": "not written", "reason": str(error)}
    return {"outcome": "done"}


def _name(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _set_timer(seconds: float) -> None:
    """Let the system end this process after some time; 0: not."""
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, seconds)


if __name__ == "__main__":
    serve()
