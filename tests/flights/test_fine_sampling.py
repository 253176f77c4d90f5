"""A flight of 200 Hz: its page stays small and quick, and keeps what happens in a single sample."""

import base64
import json
import re
import time

import numpy as np
import pytest

from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.report.html import write_report
from edl_filter.results import Result
from edl_filter.simulation import Scenario, simulate
from edl_filter.workflow.run import write_outputs


def seconds(function):
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


@pytest.mark.slow
def test_the_page_of_a_flight_of_200_hz(tmp_path):
    fine = ["sampling.interval_s=0.005", "sampling.substeps=1", "altimeter.interval_s=0.125"]
    path = simulate(Scenario.load("builtin:mer", fine), [], 1).write(tmp_path / "flight.h5")
    reconstruction = reconstruct(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]), leave_one_out=False)
    written = write_outputs(Result(reconstruction), tmp_path / "results", figures=False)
    text = written["report"].read_text(encoding="utf-8")
    assert len(text.encode()) < 6e6
    page = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S).group(1))
    (curve,) = (t for t in page["figures"]["flight"]["data"] if t["name"] == "q")
    y = np.frombuffer(base64.b64decode(curve["y"]["bdata"]), "<f4")
    dynamic_pressure = Result(reconstruction).to_xarray()["trajectory"]["dynamic_pressure"].values
    assert len(dynamic_pressure) > 60_000 > 10 * len(y)
    assert y.max() == pytest.approx(1e-3 * dynamic_pressure.max(), rel=1e-6)
    # the filter itself takes a second for such a flight, so five for the page would be more than this
    again = [seconds(lambda: write_report(tmp_path / "results")) for _ in range(3)]
    assert min(again) < 4.0 * seconds(lambda: reconstruct(reconstruction.mission, leave_one_out=False))
