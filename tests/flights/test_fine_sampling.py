"""A flight of 200 Hz: its page stays small and quick, and keeps what happens in a single sample."""

import base64
import json
import re
import time

import numpy as np
import pytest

from edl_filter.mission import Mission
from edl_filter.reconstruction import reconstruct
from edl_filter.report.html import write_report
from edl_filter.results.outputs import write_outputs
from edl_filter.simulation import Scenario, simulate


def seconds(function):
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def test_the_page_of_a_flight_of_200_hz(tmp_path):
    fine = ["sampling.interval_s=0.005", "sampling.substeps=1", "altimeter.interval_s=0.125"]
    path = simulate(Scenario.load("builtin:mer", fine), [], 1).write(tmp_path / "flight.h5")
    found = reconstruct(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]), leave_one_out=False)
    written = write_outputs(found, tmp_path / "results", figures=False)
    text = written["report"].read_text(encoding="utf-8")
    assert len(text.encode()) < 6e6
    told = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S).group(1))
    (shown,) = (t for t in told["figures"]["flight"]["data"] if t["name"] == "q")
    y = np.frombuffer(base64.b64decode(shown["y"]["bdata"]), "<f4")
    whole = found.to_xarray()["trajectory"]["dynamic_pressure"].values
    assert len(whole) > 60_000 > 10 * len(y)
    assert y.max() == pytest.approx(1e-3 * whole.max(), rel=1e-6)
    # the filter itself takes a second for such a flight, so five for the page would be more than this
    again = [seconds(lambda: write_report(tmp_path / "results")) for _ in range(3)]
    assert min(again) < 4.0 * seconds(lambda: reconstruct(found.mission, leave_one_out=False))
