"""Figures in a process of their own: the same as here, whatever happens to the process."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from edl_filter.errors import InputError
from edl_filter.report.figure_process import FigureProcess
from edl_filter.report.figures import draw_all
from edl_filter.results import Result
from edl_filter.results.reader import ResultReader
from edl_filter.workflow.run import write_outputs


@pytest.fixture(scope="module")
def folder(practice_06, tmp_path_factory):
    place = tmp_path_factory.mktemp("run")
    write_outputs(Result(practice_06), place, figures=False)
    return place


@pytest.fixture(scope="module")
def expected(folder, tmp_path_factory):
    with ResultReader.open(folder) as reader:
        return draw_all(reader, tmp_path_factory.mktemp("here"))


@pytest.mark.slow
def test_it_draws_what_the_calling_process_draws(folder, expected, tmp_path):
    with FigureProcess() as process:
        process.start(folder, tmp_path / "figures", ["png"])
        written = process.wait()
    assert [p.name for p in written] == [p.name for p in expected]
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(written, expected, strict=True))


@pytest.mark.slow
def test_without_the_process_the_calling_process_draws(folder, expected, tmp_path):
    with FigureProcess() as process:
        process._process.kill()
        process._process.wait()
        process.start(folder, tmp_path / "figures", ["png"])
        written = process.wait()
    assert [p.name for p in written] == [p.name for p in expected]


def test_a_folder_that_cannot_be_written_is_an_input_error(folder, tmp_path):
    (tmp_path / "figures").write_text("a file")
    with FigureProcess() as process, pytest.raises(InputError, match="cannot be written"):
        process.start(folder, tmp_path / "figures", ["png"])
        process.wait()


def test_it_ends_with_its_parent():
    code = (
        "import time; from edl_filter.report.figure_process import FigureProcess\n"
        "with FigureProcess() as p: print(p._process.pid, flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        child = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    for _ in range(300):
        try:
            os.kill(child, 0)
            state = Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except OSError:
            return
        if state == "Z":  # ended, and nobody asked for its exit code
            return
        time.sleep(0.1)
    raise AssertionError("it is still there after 30 s")
