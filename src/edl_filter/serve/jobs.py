"""One job at a time: a sequence of `edl-filter` commands, each in a process that can be interrupted.

Each command is a process, because a process that is interrupted or crashes leaves no partial output and does not stop
the server.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import IO, Any

from edl_filter.errors import UNTRUSTWORTHY, InputError
from edl_filter.io.output_folder import remove_if_empty
from edl_filter.io.progress import PROGRESS, PROGRESS_MARK
from edl_filter.serve.plans import Plan

#: Commands that run with --json, which is faster to print than tables.
_WITH_JSON = ("run", "diagnose", "identifiability")
#: Seconds that an interrupted process has to remove its temporary files.
_SHUTDOWN_TIMEOUT = 5.0


class BusyError(InputError):
    """Another job is still running."""


@dataclass
class Job:
    """A sequence of commands, and its progress.

    Attributes
    ----------
    number : int
        Number of the job, from 1.
    plan : Plan
        The commands.
    state : str
        ``running``, ``done``, ``failed`` or ``cancelled``.
    command_index : int
        Index of the current command.
    step : str
        Description of the current command's current step.
    error : str
        One sentence; empty if there is no error.
    study : dict or None
        Output of `edl-filter identifiability`, the only one that is not in a file.
    began, ended : float
        Times of the monotonic clock, s.
    """

    number: int
    plan: Plan
    state: str = "running"
    command_index: int = 0
    step: str = ""
    error: str = ""
    study: dict[str, Any] | None = None
    began: float = field(default_factory=time.monotonic)
    ended: float | None = None

    def as_json(self) -> dict[str, Any]:
        """The job as data for the page."""
        return {
            "number": self.number, "title": self.plan.title, "state": self.state, "at": self.command_index,
            "said": self.step, "error": self.error, "commands": self.plan.lines(), "result": self.plan.result,
            "study": self.study,
            "seconds": (self.ended or time.monotonic()) - self.began,
        }  # fmt: skip


def installed_command(arguments: Sequence[str]) -> list[str]:
    """Command line of this installation's `edl-filter`; modules in the served folder are not imported (-P)."""
    json_option = ("--json",) if arguments[0] in _WITH_JSON else ()
    return [sys.executable, "-P", "-m", "edl_filter", *arguments, *json_option]


class Worker:
    """Runs one job at a time in a thread.

    Parameters
    ----------
    root : Path
        Folder in which the commands run.
    command : callable
        Returns a command line from the arguments of `edl-filter`.
    """

    def __init__(self, root: Path, command: Callable[[Sequence[str]], list[str]] = installed_command) -> None:
        self._root, self._command = root, command
        self._lock, self._numbers = threading.Lock(), count(1)
        self._job: Job | None = None
        self._process: subprocess.Popen[str] | None = None
        self._thread: threading.Thread | None = None

    @property
    def job(self) -> Job | None:
        """The current job, or the last one."""
        return self._job

    def start(self, plan: Plan) -> Job:
        """Start a job.

        Raises
        ------
        BusyError
            Another job is running.
        """
        last = self._thread
        if last is not None and self._job is not None and self._job.state != "running":
            last.join(_SHUTDOWN_TIMEOUT)  # a job that was cancelled may still be stopping
        with self._lock:
            if self._job is not None and (self._job.state == "running" or (last is not None and last.is_alive())):
                raise BusyError(f"“{self._job.plan.title}” is still at work; wait for it or cancel it.")
            job = self._job = Job(next(self._numbers), plan)
            self._thread = threading.Thread(target=self._work, args=(job,), name=f"job {job.number}", daemon=True)
            self._thread.start()
        return job

    def cancel(self) -> None:
        """Cancel the current job and wait until it has stopped; without a job nothing happens."""
        with self._lock:
            job, process, thread = self._job, self._process, self._thread
            if job is None or job.state != "running" or thread is None:
                return
            job.state = "cancelled"
        if process is not None:
            _interrupt(process)
        thread.join(_SHUTDOWN_TIMEOUT)

    def _work(self, job: Job) -> None:
        error = ""
        result = self._root / job.plan.result if job.plan.result else None
        try:
            for k, arguments in enumerate(job.plan.commands):
                job.command_index, job.step = k, ""
                error = self._run(job, arguments)
                if error or job.state == "cancelled":
                    break
        except OSError as failure:
            error = f"The command could not be started: {failure}."
        if result is not None and (error or job.state == "cancelled"):
            remove_if_empty(result, self._root)  # left by a command that was killed
        with self._lock:
            job.ended = time.monotonic()
            if job.state != "cancelled":
                job.state, job.error = ("failed", error) if error else ("done", "")

    def _run(self, job: Job, arguments: Sequence[str]) -> str:
        """Run one command; returns its error in one sentence, or an empty string."""
        with tempfile.TemporaryFile() as output:
            error = self._run_into(job, arguments, output)
            if not error and arguments[0] == "identifiability" and job.state != "cancelled":
                output.seek(0)
                job.study = json.loads(output.read())
        return error

    def _run_into(self, job: Job, arguments: Sequence[str], output: IO[bytes]) -> str:
        """As `_run`, with the file of the command's standard output."""
        with self._lock:
            if job.state == "cancelled":
                return ""
            process = self._process = subprocess.Popen(
                self._command(arguments), cwd=self._root, env=os.environ | {PROGRESS: "lines"}, text=True,
                stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.PIPE, encoding="utf-8",
                errors="replace", start_new_session=True,  # Ctrl-C reaches the server only, which cancels the job
                preexec_fn=_restore_interrupt if os.name == "posix" else None,
            )  # fmt: skip
        lines: list[str] = []
        with process:
            assert process.stderr is not None
            for line in process.stderr:
                if line.startswith(PROGRESS_MARK):
                    job.step = line.removeprefix(PROGRESS_MARK).strip()
                else:
                    lines.append(line.rstrip())
        with self._lock:
            self._process = None
        done = (0, UNTRUSTWORTHY)  # the page of an untrustworthy result says so
        return "" if process.returncode in done else failure_message(lines, process.returncode)


def _restore_interrupt() -> None:
    """Restore the default action of the interrupt, which a shell that runs the server with ``&`` disables.

    Runs between fork and exec of a process with threads, so it must not acquire a lock that another thread may hold.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def failure_message(lines: Sequence[str], code: int) -> str:
    """Error message of a command.

    Parameters
    ----------
    lines : sequence of str
        Lines of its standard error.
    code : int
        Exit code; a negative code is the number of the signal that ended the process.
    """
    starts = [k for k, line in enumerate(lines) if line.startswith("edl-filter: ")]
    message = [line for line in lines[starts[-1] :] if line] if starts else [line for line in lines if line][-1:]
    text = " ".join(message).removeprefix("edl-filter: ")
    if code < 0:
        return f"The command was ended by signal {-code}. {text}".strip()
    return text or f"The command ended with code {code} and said nothing."


def _interrupt(process: subprocess.Popen[str]) -> None:
    """Interrupt a process as Ctrl-C does, so that it removes its temporary files; kill it if it continues to run."""
    if os.name == "posix":
        for _ in range(2):  # an interrupt during a callback from compiled code may be lost
            process.send_signal(signal.SIGINT)
            try:
                process.wait(0.5 * _SHUTDOWN_TIMEOUT)
                return
            except subprocess.TimeoutExpired:
                continue
    process.kill()
