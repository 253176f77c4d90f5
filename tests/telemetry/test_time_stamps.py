"""Time stamps that scatter about a steady clock are replaced; a clock that drifts or jumps is not of that kind."""

import numpy as np
import pytest

from edl_filter.telemetry.time_stamps import evened

INTERVAL = 0.125
TIME = INTERVAL * np.arange(1, 2001)


def jittered(share):
    return TIME + share * INTERVAL * np.random.default_rng(0).uniform(-1.0, 1.0, len(TIME))


@pytest.mark.parametrize(
    "stamps", [jittered(0.1), jittered(0.4), 0.1 * np.round(TIME / 0.1)], ids=["10 %", "40 %", "0.1 s"]
)
def test_scattered_stamps_are_those_of_a_steady_clock(stamps):
    if np.any(np.diff(stamps) < 0.0):
        stamps = np.sort(stamps)
    time, (finding,) = evened(stamps, INTERVAL, "a")
    assert finding.kind == "jitter"
    np.testing.assert_allclose(time, TIME, atol=0.02 * INTERVAL)


@pytest.mark.parametrize(
    "stamps",
    [
        TIME,
        TIME * 1.001,
        TIME + np.where(TIME > 100.0, 0.05, 0.0),
        TIME + 0.05 * np.sin(TIME / 20.0),
        np.delete(TIME, slice(800, 808)),
    ],
    ids=["steady", "drift", "jump", "slow", "gap"],
)
def test_other_errors_of_a_clock_stay(stamps):
    time, findings = evened(stamps, INTERVAL, "a")
    assert time is stamps and findings == []
