"""A scheduler and workers in processes of their own, over TCP on the loopback interface, which are killed."""

import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from edl_filter.workflow.campaign_files import read_progress

pytestmark = pytest.mark.slow

CASES = 60


class Cluster:
    """A scheduler on one port, and workers of one thread, each a process."""

    def __init__(self):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.processes = []

    def start(self, *words):
        command = [sys.executable, "-m", "dask", *words]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.processes.append(process)
        return process

    def scheduler(self):
        process = self.start("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    return process
            time.sleep(0.1)
        raise AssertionError("the scheduler does not listen")

    def worker(self):
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        return self.start("worker", self.address, *options)

    def stop(self):
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()


@pytest.fixture
def cluster():
    cluster = Cluster()
    yield cluster
    cluster.stop()


def kill(process):
    process.send_signal(signal.SIGKILL)
    process.wait()


def run_in_thread(faults, **options):
    """A campaign that runs in a thread; its list has the outcome when it has ended."""
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(faults.run(CASES, **options)))
    thread.start()
    return thread, outcomes


def wait_for_cases(faults, count):
    """Wait until so many cases have begun."""
    deadline = time.monotonic() + 120.0
    while len(faults.numbers("begun")) < count:
        assert time.monotonic() < deadline, "no case begins"
        time.sleep(0.02)


def assert_complete_once(faults, interrupted=0):
    """All cases have a record, and none was run again after it was complete."""
    progress = read_progress(faults.results, CASES)
    assert progress.done.all() and not progress.failed.any()
    assert set(faults.numbers("ended")) == set(range(CASES))
    # a case is begun a second time only where the first time was interrupted
    assert len(faults.numbers("begun")) <= CASES + interrupted


def test_a_worker_that_is_killed_in_a_case_loses_nothing(faults, cluster):
    cluster.scheduler()
    first = cluster.worker()
    thread, outcomes = run_in_thread(faults, scheduler=cluster.address)
    wait_for_cases(faults, 8)
    kill(first)
    cluster.worker()
    thread.join(180.0)
    assert outcomes and outcomes[0].stopped == "", outcomes
    assert_complete_once(faults, interrupted=2)


def test_a_scheduler_that_is_killed_and_restarted_loses_nothing(faults, cluster):
    scheduler, worker = cluster.scheduler(), cluster.worker()
    thread, outcomes = run_in_thread(faults, scheduler=cluster.address, patience_s=90.0)
    wait_for_cases(faults, 8)
    kill(scheduler)
    kill(worker)
    cluster.scheduler()
    cluster.worker()
    thread.join(240.0)
    assert outcomes and outcomes[0].stopped == "", outcomes
    assert_complete_once(faults, interrupted=2)


def test_a_scheduler_that_does_not_return_is_named_and_the_rest_runs_elsewhere(faults, cluster):
    scheduler, worker = cluster.scheduler(), cluster.worker()
    thread, outcomes = run_in_thread(faults, scheduler=cluster.address, patience_s=4.0)
    wait_for_cases(faults, 8)
    kill(scheduler)
    kill(worker)
    thread.join(180.0)
    (outcome,) = outcomes
    missing = outcome.progress.missing
    assert "scheduler" in outcome.stopped and 0 < len(missing) < CASES
    assert f"{len(missing)} are missing" in outcome.sentence
    assert faults.run(CASES).stopped == ""  # on this machine
    assert_complete_once(faults, interrupted=2)


PROGRAM = """
import sys
from pathlib import Path

sys.path.insert(0, {folder!r})
from conftest import Faults

if __name__ == "__main__":
    faults = Faults.__new__(Faults)
    faults.results, faults.notes = Path({results!r}), Path({notes!r})
    print(faults.run({cases}).sentence)
"""


def test_a_campaign_whose_own_process_is_killed_resumes(faults, tmp_path):
    script = tmp_path / "campaign.py"
    folder = str(Path(__file__).parent)
    script.write_text(PROGRAM.format(folder=folder, results=str(faults.results), notes=str(faults.notes), cases=CASES))
    process = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for_cases(faults, 8)
    kill(process)
    time.sleep(3.0)  # its workers notice, and end
    assert 0 < len(read_progress(faults.results, CASES).missing) < CASES
    assert faults.run(CASES).stopped == ""
    assert_complete_once(faults, interrupted=4)
