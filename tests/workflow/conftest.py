"""Campaigns whose cases do nothing, or fail as a test says."""

import json
import os
from pathlib import Path

import pytest

from edl_filter.io.output_folder import output_folder
from edl_filter.simulation.campaign_config import Campaign


class Faults:
    """A campaign of quick cases in a folder of its own, and what its cases did."""

    def __init__(self, folder):
        self.results, self.notes = folder / "results", folder / "notes"
        self.notes.mkdir()
        self.set()

    def set(self, **faults):
        """Let cases fail: ``n3="raise"``."""
        content = {number.removeprefix("n"): fault for number, fault in faults.items()}
        (self.notes / "faults.json").write_text(json.dumps(content))

    def campaign(self, cases, time_limit_s=5.0):
        """A campaign of so many cases of one flight."""
        flights = {"mer": {"scenario": "builtin:mer"}}
        return Campaign.from_dict(
            {"name": "t", "cases": cases, "time_limit_s": time_limit_s, "start_limit_s": 20.0, "flights": flights}
        )

    def run(self, cases, time_limit_s=5.0, **options):
        """Run it, on two processes of this machine unless the options say otherwise."""
        from edl_filter.workflow.campaign import run_campaign

        with output_folder(self.results):
            options = {"workers": None if "scheduler" in options else 2} | options
            return run_campaign(self.campaign(cases, time_limit_s), self.results, program="faulty_cases", **options)

    def numbers(self, name):
        """Numbers of the cases that have begun, or ended, in order of time."""
        path = self.notes / name
        return [int(line) for line in path.read_text().split()] if path.is_file() else []


@pytest.fixture
def faults(tmp_path, monkeypatch):
    folder = Path(__file__).parent
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("FAULTS", str(tmp_path / "notes"))
    return Faults(tmp_path)
