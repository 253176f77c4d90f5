"""Time stamps that scatter about a steady clock, packets out of step with it, and clocks of another kind."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.telemetry.time_stamps import evened, ordered_packets

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
    np.testing.assert_allclose(finding.clock_sigma, np.std(stamps - TIME), rtol=1e-3)


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


READINGS = np.arange(12000.0).reshape(-1, 6)


def ordered(time, readings=READINGS):
    return ordered_packets(time, readings, INTERVAL, "a")


@pytest.mark.parametrize("jump", [-0.72, -0.4, -0.1, 0.1, 0.4, 0.48])
def test_a_clock_that_leaves_its_steps_by_a_fraction_has_jumped(jump):
    """The sensor averages over one interval in each sample: a step of 1.4 intervals is none of it."""
    time, readings, (finding,) = ordered(TIME + np.where(np.arange(2000) >= 700, jump * INTERVAL, 0.0))
    np.testing.assert_allclose(time, TIME, atol=1e-9)
    np.testing.assert_array_equal(readings, READINGS)
    assert (finding.kind, finding.samples) == ("clock_jump", 1)
    assert finding.end == pytest.approx(TIME[700] + jump * INTERVAL)
    assert f"{jump * INTERVAL:+.3f} s" in finding.repair


@pytest.mark.parametrize("count", [1, 8])
@pytest.mark.parametrize("error", [-0.6, -0.3, 0.2, 0.45])
def test_packets_with_wrong_times_between_others_in_step_are_counted(error, count):
    stamps = TIME.copy()
    stamps[900 : 900 + count] += error * INTERVAL
    time, _, (finding,) = ordered(stamps)
    np.testing.assert_allclose(time, TIME, atol=1e-9)
    assert (finding.kind, finding.samples) == ("clock_jump", count) and "counting" in finding.repair


@pytest.mark.parametrize("place", [0.1, 0.3, 0.5, 0.9])
def test_a_packet_between_two_that_are_in_step_is_not_used(place):
    """Whatever it reads: no sensor has it."""
    stamps = np.insert(TIME, 1200, TIME[1199] + place * INTERVAL)
    time, readings, (finding,) = ordered(stamps, np.insert(READINGS, 1200, READINGS[1199] + 0.1, axis=0))
    np.testing.assert_array_equal(time, TIME)
    np.testing.assert_array_equal(readings, READINGS)
    assert (finding.kind, finding.samples) == ("duplicated", 1)


def test_missing_samples_may_change_the_phase_of_the_sensor():
    stamps = np.delete(TIME, slice(800, 810))
    stamps[800:] += 0.3 * INTERVAL
    time, _, findings = ordered(stamps, np.delete(READINGS, slice(800, 810), axis=0))
    np.testing.assert_array_equal(time, stamps)
    assert findings == []


def test_packets_with_wrong_times_between_missing_samples_stay_at_their_place():
    kept = np.r_[0:800, 810:815, 825:2000]
    stamps = TIME[kept].copy()
    stamps[800:805] += 0.3 * INTERVAL
    time, readings, (finding,) = ordered(stamps, READINGS[kept])
    np.testing.assert_allclose(time, TIME[kept], atol=1e-9)
    np.testing.assert_array_equal(readings, READINGS[kept])
    assert (finding.kind, finding.samples) == ("clock_jump", 5)


def test_a_clock_that_is_not_steady_has_no_steps():
    """Stamps that scatter by more than `evened` takes for errors of a steady clock."""
    stamps = np.cumsum(INTERVAL * np.random.default_rng(1).uniform(0.6, 1.4, 2000))
    time, _, findings = ordered(stamps)
    np.testing.assert_array_equal(time, stamps)
    assert findings == []


@pytest.mark.parametrize(("rate", "ratio"), [(100.0, 1e-3), (200.0, 1e-3), (62.0, 0.0), (59.0, 0.0), (128.0, 0.0)])
def test_stamps_that_are_rounded_are_no_jumps(rate, ratio):
    """To a millisecond, which is up to a fifth of an interval: a jump for each unit would add up to seconds."""
    exact = (1.0 + ratio) / rate * np.arange(1, int(200.0 * rate))
    stamps, _ = evened(np.round(exact, 3), 1.0 / rate, "a")
    time, _, findings = ordered_packets(stamps, np.zeros((len(exact), 6)), 1.0 / rate, "a")
    assert np.abs(time - exact).max() < 1.1e-3 and findings == []


@pytest.mark.parametrize("share", [0.012, 0.015, 0.019])
def test_a_small_scatter_of_the_stamps_is_no_sequence_of_jumps(share):
    stamps = TIME + share * INTERVAL * np.random.default_rng(4).standard_normal(len(TIME))
    time, _, findings = ordered(evened(stamps, INTERVAL, "a")[0])
    assert np.abs(time - TIME).max() < 5.0 * share * INTERVAL and findings == []


def test_a_jump_is_found_beside_packets_out_of_order():
    stamps = TIME + np.where(np.arange(2000) >= 700, 0.4 * INTERVAL, 0.0)
    order = np.arange(2000)
    order[[1500, 1501]] = 1501, 1500
    time, readings, findings = ordered(stamps[order], READINGS[order])
    np.testing.assert_allclose(time, TIME, atol=1e-9)
    np.testing.assert_array_equal(readings, READINGS)
    assert {f.kind for f in findings} == {"clock_jump", "reordered"}


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.tuples(st.sampled_from(["jump", "stamp", "extra"]), st.floats(0.06, 0.44), st.booleans()),
        min_size=1,
        max_size=20,
    ),
    st.integers(0, 2**32 - 1),
)
def test_any_mixture_of_fractions_far_apart_is_removed(faults, seed):
    rows = np.sort(np.random.default_rng(seed).choice(np.arange(1, 98), len(faults), replace=False) * 20)
    stamps, readings = list(TIME), list(READINGS)
    for row, (kind, size, negative) in reversed(list(zip(rows, faults, strict=True))):
        offset = INTERVAL * (-size if negative and kind != "extra" else size)
        if kind == "jump":
            stamps[row:] = [t + offset for t in stamps[row:]]
        elif kind == "stamp":
            stamps[row] += offset
        else:
            stamps.insert(row, stamps[row - 1] + offset)
            readings.insert(row, readings[row - 1] + 1.0)
    time, kept, findings = ordered(np.array(stamps), np.array(readings))
    np.testing.assert_allclose(time, TIME, atol=1e-9)
    np.testing.assert_array_equal(kept, READINGS)
    assert len(findings) == len(faults)
