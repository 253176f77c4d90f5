"""One job at a time, each command in a process: progress, error messages, and cancelling."""

import signal
import sys
import time

import pytest

from edl_filter.serve.jobs import BusyError, Worker, failure_message, installed_command
from edl_filter.serve.plans import Plan


def python(code):
    """A worker's command line that runs `code` instead of `edl-filter`."""
    return lambda arguments: [sys.executable, "-c", code, *arguments]


def wait(worker, until=lambda job: job.state != "running"):
    for _ in range(1000):
        if until(worker.job):
            return worker.job
        time.sleep(0.02)
    raise AssertionError(worker.job)


def test_commands_run_in_sequence_in_the_folder(tmp_path):
    code = "import sys, pathlib; pathlib.Path('log').open('a').write(sys.argv[1] + ' ')"
    worker = Worker(tmp_path, python(code))
    worker.start(Plan("two", (("first",), ("second",)), "r"))
    assert wait(worker).state == "done"
    assert (tmp_path / "log").read_text() == "first second "
    assert worker.job.as_json()["commands"] == ["edl-filter first", "edl-filter second"]


def test_a_failed_command_ends_the_job_with_its_message(tmp_path):
    output = "noise\nprogress: half\nedl-filter: k: found 3; expected 4."
    code = f"import sys; print({output!r}, file=sys.stderr); sys.exit(2)"
    worker = Worker(tmp_path, python(code))
    worker.start(Plan("bad", (("first",), ("second",)), "r"))
    job = wait(worker)
    assert (job.state, job.command_index, job.step, job.error) == ("failed", 0, "half", "k: found 3; expected 4.")


def test_a_command_that_does_not_start_is_an_error(tmp_path):
    worker = Worker(tmp_path, lambda _: [str(tmp_path / "none")])
    worker.start(Plan("none", (("run",),), "r"))
    assert "could not be started" in wait(worker).error


@pytest.mark.parametrize(
    ("lines", "code", "message"),
    [
        (["Usage: x", "Error: No such option: -q"], 2, "Error: No such option: -q"),
        (["edl-filter: internal error: KeyError: 1", "Run 'edl-filter --debug'."], 1,
         "internal error: KeyError: 1 Run 'edl-filter --debug'."),
        ([], 1, "The command ended with code 1 and said nothing."),
        ([], -9, "The command was ended by signal 9."),
    ],
)  # fmt: skip
def test_failure_messages(lines, code, message):
    assert failure_message(lines, code) == message


SLOW = """
import pathlib, sys, time
pathlib.Path('half').write_text('')
try:
    print('progress: waiting', file=sys.stderr, flush=True)
    time.sleep(60)
finally:
    pathlib.Path('half').unlink()
"""


def test_cancel_lets_the_command_clean_up_and_starts_no_other(tmp_path):
    worker = Worker(tmp_path, python(SLOW))
    worker.start(Plan("slow", (("first",), ("second",)), "r"))
    wait(worker, lambda job: job.step == "waiting")
    with pytest.raises(BusyError, match="“slow” is still at work; wait for it or cancel it"):
        worker.start(Plan("other", (("run",),), "r"))
    began = time.monotonic()
    worker.cancel()
    assert time.monotonic() - began < 10.0
    assert (worker.job.state, worker.job.command_index, worker.job.error) == ("cancelled", 0, "")
    assert not (tmp_path / "half").exists()
    worker.cancel()  # without a running job
    worker.start(Plan("next", (("run",),), "r"))
    worker.cancel()


KILLED = """
import os, pathlib, signal, sys
pathlib.Path('results/r/.edl-filter.x').mkdir(parents=True)
pathlib.Path('results/r/.edl-filter.x/half').touch()
if len(sys.argv) > 2:
    pathlib.Path('results/r/complete').touch()
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("arguments", [("run",), ("run", "complete")])
def test_a_job_without_result_leaves_no_folder(tmp_path, arguments):
    worker = Worker(tmp_path, python(KILLED))
    worker.start(Plan("killed", (arguments,), "results/r"))
    assert wait(worker).state == "failed"
    assert (tmp_path / "results").exists() == (len(arguments) == 2)


def test_the_output_of_a_study_is_kept(tmp_path):
    worker = Worker(tmp_path, python("print('{\"effects\": []}' + 100_000 * ' ')"))
    worker.start(Plan("study", (("identifiability", "m.yaml"),), ""))
    job = wait(worker).as_json()
    assert (job["state"], job["study"]) == ("done", {"effects": []})


def test_a_server_in_the_background_of_a_shell_can_cancel(tmp_path):
    """Such a shell starts the server with the interrupt ignored, and child processes inherit this."""
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        worker = Worker(tmp_path, python(SLOW))
        worker.start(Plan("slow", (("first",),), "r"))
        wait(worker, lambda job: job.step == "waiting")
        worker.cancel()
    finally:
        signal.signal(signal.SIGINT, previous)
    assert not (tmp_path / "half").exists()


def test_a_command_that_ignores_the_interrupt_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr("edl_filter.serve.jobs._SHUTDOWN_TIMEOUT", 0.5)
    ignore = "import signal, sys, time; signal.signal(2, signal.SIG_IGN)"
    code = f"{ignore}; print('progress: running', file=sys.stderr, flush=True); time.sleep(60)"
    worker = Worker(tmp_path, python(code))
    worker.start(Plan("ignoring", (("run",),), "r"))
    wait(worker, lambda job: job.step == "running")
    worker.cancel()
    wait(worker, lambda job: job.ended is not None)
    assert worker.job.state == "cancelled"


def test_modules_in_the_folder_are_not_imported(tmp_path):
    (tmp_path / "yaml.py").write_text("raise SystemExit('taken from the folder')")
    worker = Worker(tmp_path, installed_command)
    worker.start(Plan("bad", (("run", "none.yaml"),), "r"))
    job = wait(worker)
    assert job.state == "failed"
    assert "none.yaml" in job.error
    assert "taken" not in job.error
