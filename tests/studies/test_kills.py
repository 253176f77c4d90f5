"""A command that is killed leaves the earlier or the new result."""

import subprocess
import sys

import kills
import pytest


@pytest.mark.slow
def test_a_killed_run_leaves_the_earlier_or_the_new_result(tmp_path):
    old = tmp_path / "old"
    command = [sys.executable, "-m", "edl_filter", "run", kills.MISSION, "--no-figures", "-o", str(old)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    states = [kills.killed("run", old, tmp_path / "work", after) for after in (0.5, 2.0, 4.0, 6.0, 8.0, 12.0, 300.0)]
    assert {state for state, _ in states} <= {"practice_mer", "new"}
    assert states[-1] == ("new", True)
