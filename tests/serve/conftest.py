"""A served folder with a mission and a result, and a client of its server."""

import json
import shutil
import sys

import numpy as np
import pytest
from contents import cell, diagnosis, hypothesis
from starlette.testclient import TestClient

from edl_filter.mission import Mission, shipped_mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.results import Result
from edl_filter.results.groups import Group
from edl_filter.results.hdf5 import write_groups
from edl_filter.serve.app import make_app
from edl_filter.serve.jobs import Worker
from edl_filter.workflow.run import write_outputs

PORT = 8765
ORIGIN = f"http://127.0.0.1:{PORT}"

MAP = [
    cell(channel=channel, regime=regime, normalised_rms=rms, fails=rms == 12.0, sentence=f"{channel} in {regime}.")
    for channel, regime, rms in (
        ("force_x", "hypersonic", 12.0), ("force_y", "hypersonic", None), ("landing", "constraints", 0.9),
    )
]  # fmt: skip
DIAGNOSIS = diagnosis(
    sentence="Missing: wind (gain 100 nats).", where=[], map=MAP, errors={"force_x": 9.0},
    ranking=[hypothesis(
        effect="wind", label="wind",
        same_as=["com_offset"], probability=1.0, gain=100.0, score_gain=90.0, channel="force_x",
        alternatives={"com_offset": {"parameters": {"dy": {"estimate": 4e-3, "sigma": 1e-4, "unit": "m"}}}},
        parameters={"east": {"estimate": 30.0, "sigma": 1.0, "unit": "m/s"}},
    )],
)  # fmt: skip


@pytest.fixture(scope="session")
def served_folder(tmp_path_factory):
    """A folder with one mission, its result and an invented diagnosis; tests must not change it."""
    root = tmp_path_factory.mktemp("served")
    (root / "flight.yaml").write_text(shipped_mission("practice_mer").read_text())
    result = root / "results" / "flight"
    write_outputs(Result(reconstruct(Mission.load(root / "flight.yaml"))), result, figures=False)
    (result / "diagnosis.json").write_text(json.dumps(DIAGNOSIS))
    group = Group()
    group.add("time", ("time",), np.arange(4.0), "s", "time")
    group.label("channel", ["force_x", "force_y"], "channel")
    group.text("unit", "channel", ["m/s^2", "m/s^2"], "unit")
    values = np.array([[1.0, np.nan, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])
    for name, factor in (("residual", 1.0), ("sigma", 0.5), ("normalised", 2.0)):
        group.add(name, ("channel", "time"), factor * values, "1", name)
    write_groups({"/": group}, result / "residuals.nc")
    return root


@pytest.fixture
def root(served_folder, tmp_path):
    """A copy of `served_folder`, whose result names the mission file of the original."""
    copied = (tmp_path / "served").resolve()
    shutil.copytree(served_folder, copied)
    return copied


@pytest.fixture
def worker(root):
    """Worker that runs jobs in the copy."""
    folder_worker = Worker(root)
    yield folder_worker
    folder_worker.cancel()


def client_of(root, worker):
    """Client with the host and origin of the page."""
    return TestClient(make_app(root, PORT, worker), base_url=ORIGIN, headers={"Origin": ORIGIN})


@pytest.fixture
def client(root, worker):
    """Client of a server whose jobs run in the copy."""
    return client_of(root, worker)


#: The program with a function replaced by one that waits: the command is held there, however fast the machine is.
HELD = """
import sys, time
import edl_filter.report.html, edl_filter.workflow.run
from edl_filter.cli import main
def wait_while_writing(result, folder):
    (folder / "result.nc").write_text("a part of the result")
    time.sleep(60.0)
if sys.argv.pop(1) == "while writing":
    edl_filter.workflow.run._write_all = wait_while_writing
else:
    edl_filter.report.html.write_report = lambda folder: time.sleep(60.0)
main()
"""


@pytest.fixture
def held_client(root, request):
    """Client of a server whose run waits while it writes the result, or after it."""
    held = Worker(root, lambda arguments: [sys.executable, "-P", "-c", HELD, request.param, *arguments])
    yield client_of(root, held)
    held.cancel()
