"""One piece of work at a time: `edl-filter` commands one after the other, each a process that can be interrupted.

A process, because a command that is interrupted or crashes leaves nothing half-written, and takes no server with it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from edl_filter.command_line import PROGRESS, PROGRESS_MARK
from edl_filter.errors import InputError
from edl_filter.serve.plans import Plan

#: Commands that print nothing but JSON if asked to, which is faster than tables that nobody sees.
_WITH_JSON = ("run", "diagnose")
#: Seconds that an interrupted process has to clear away what it had begun.
_PATIENCE = 5.0


class BusyError(InputError):
    """Another piece of work is not done yet."""


@dataclass
class Job:
    """A piece of work.

    Attributes
    ----------
    number : int
    plan : Plan
    state : str
        ``running``, ``done``, ``failed`` or ``cancelled``.
    at : int
        Which command is being run.
    said : str
        What that one does.
    error : str
        One sentence.
    """

    number: int
    plan: Plan
    state: str = "running"
    at: int = 0
    said: str = ""
    error: str = ""
    began: float = field(default_factory=time.monotonic)
    ended: float | None = None

    def told(self) -> dict[str, Any]:
        """The job as the page hears of it."""
        return {
            "number": self.number, "title": self.plan.title, "state": self.state, "at": self.at, "said": self.said,
            "error": self.error, "commands": self.plan.lines(), "result": self.plan.result,
            "seconds": (self.ended or time.monotonic()) - self.began,
        }  # fmt: skip


def own_command(arguments: Sequence[str]) -> list[str]:
    """Command line of this installation's `edl-filter`; modules in the served folder are not imported (-P)."""
    asked = ("--json",) if arguments[0] in _WITH_JSON else ()
    return [sys.executable, "-P", "-m", "edl_filter.cli", *arguments, *asked]


class Worker:
    """Does one job at a time in a thread.

    Parameters
    ----------
    root : Path
        Folder in which commands are run.
    command : callable
        From arguments of `edl-filter` to a command line.
    """

    def __init__(self, root: Path, command: Callable[[Sequence[str]], list[str]] = own_command) -> None:
        self._root, self._command = root, command
        self._lock, self._numbers = threading.Lock(), count(1)
        self._job: Job | None = None
        self._process: subprocess.Popen[str] | None = None
        self._thread: threading.Thread | None = None

    @property
    def job(self) -> Job | None:
        """What is being done, or was done last."""
        return self._job

    def start(self, plan: Plan) -> Job:
        """Begin a job.

        Raises
        ------
        BusyError
            Another one is running.
        """
        before = self._thread
        if before is not None and self._job is not None and self._job.state != "running":
            before.join(_PATIENCE)  # one that was cancelled is still clearing away
        with self._lock:
            if self._job is not None and (self._job.state == "running" or (before is not None and before.is_alive())):
                raise BusyError(f"“{self._job.plan.title}” is still at work; wait for it or cancel it.")
            job = self._job = Job(next(self._numbers), plan)
            self._thread = threading.Thread(target=self._work, args=(job,), name=f"job {job.number}", daemon=True)
            self._thread.start()
        return job

    def cancel(self) -> None:
        """Stop what is being done, wait until it has stopped; nothing to do is no error."""
        with self._lock:
            job, process, thread = self._job, self._process, self._thread
            if job is None or job.state != "running" or thread is None:
                return
            job.state = "cancelled"
        if process is not None:
            _interrupt(process)
        thread.join(_PATIENCE)

    def _work(self, job: Job) -> None:
        error = ""
        try:
            for k, arguments in enumerate(job.plan.commands):
                job.at, job.said = k, ""
                error = self._run(job, arguments)
                if error or job.state == "cancelled":
                    break
        except OSError as failure:
            error = f"The command could not be started: {failure}."
        with self._lock:
            job.ended = time.monotonic()
            if job.state != "cancelled":
                job.state, job.error = ("failed", error) if error else ("done", "")

    def _run(self, job: Job, arguments: Sequence[str]) -> str:
        """Run one command; gives what was wrong, in a sentence, or nothing."""
        with self._lock:
            if job.state == "cancelled":
                return ""
            process = self._process = subprocess.Popen(
                self._command(arguments), cwd=self._root, env=os.environ | {PROGRESS: "lines"}, text=True,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, encoding="utf-8",
                errors="replace", start_new_session=True,  # Ctrl-C at the terminal is the server's to pass on
                preexec_fn=_listening if os.name == "posix" else None,
            )  # fmt: skip
        lines: list[str] = []
        with process:
            assert process.stderr is not None
            for line in process.stderr:
                if line.startswith(PROGRESS_MARK):
                    job.said = line.removeprefix(PROGRESS_MARK).strip()
                else:
                    lines.append(line.rstrip())
        with self._lock:
            self._process = None
        return "" if process.returncode == 0 else sentence(lines, process.returncode)


def _listening() -> None:
    """Let a command hear the interrupt that cancels it: a shell that runs the server with ``&`` has it ignored.

    Between fork and exec of a process with threads, so it takes no lock that another thread could hold.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def sentence(lines: Sequence[str], code: int) -> str:
    """What a command that ended with `code` said on standard error, as one message."""
    starts = [k for k, line in enumerate(lines) if line.startswith("edl-filter: ")]
    said = [line for line in lines[starts[-1] :] if line] if starts else [line for line in lines if line][-1:]
    text = " ".join(said).removeprefix("edl-filter: ")
    if code < 0:
        return f"The command was ended by signal {-code}. {text}".strip()
    return text or f"The command ended with code {code} and said nothing."


def _interrupt(process: subprocess.Popen[str]) -> None:
    """Ask a process to stop as Ctrl-C does, which lets it clear away; then insist."""
    if os.name == "posix":
        for _ in range(2):  # one that falls into compiled code's callback may be swallowed there
            process.send_signal(signal.SIGINT)
            try:
                process.wait(0.5 * _PATIENCE)
                return
            except subprocess.TimeoutExpired:
                continue
    process.kill()
