"""What is left: a line in noise, a burst in quiet, what it follows. A real one stands with the flights."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.diagnosis.remainder import _correlation, _line, _span, _words

DT = 0.125
TIME = 60.0 + DT * np.arange(800)


@settings(max_examples=12)
@given(st.floats(0.1, 3.5), st.floats(0.0, 6.0), st.integers(0, 100))
def test_a_sine_in_noise_has_its_frequency(frequency, phase, seed):
    """Found to a fifth of 1/span, with noise of half its power."""
    noise = np.random.default_rng(seed).normal(size=len(TIME))
    found = _line(TIME, 5.0 + np.sqrt(2.0) * np.sin(2.0 * np.pi * frequency * TIME + phase) + 0.7 * noise)
    assert found == pytest.approx(frequency, abs=0.2 / (TIME[-1] - TIME[0]))


def test_gaps_do_not_hide_a_line():
    keep = (np.arange(800) % 40 > 12) | (np.arange(800) < 100)
    found = _line(TIME[keep], np.sin(2.0 * np.pi * 0.7 * TIME[keep]))
    assert found == pytest.approx(0.7, abs=2e-3)


@pytest.mark.parametrize(("turns", "line"), [(0.5, False), (1.0, False), (2.0, False), (4.0, True)])
def test_a_trend_does_not_oscillate(turns, line):
    """One or two turns within the span are its course."""
    found = _line(TIME, np.sin(2.0 * np.pi * turns * (TIME - TIME[0]) / (TIME[-1] - TIME[0])))
    assert (found is not None) == line


def test_noise_has_no_line():
    rng = np.random.default_rng(2)
    assert not any(_line(TIME, rng.normal(size=len(TIME))) for _ in range(15))


def test_a_few_numbers_have_no_line():
    assert _line(TIME[:15], np.sin(TIME[:15])) is None


def spanned(scaled, use=None):
    edges = np.append(TIME, TIME[-1] + DT)
    rows = np.arange(len(TIME)) if use is None else np.where(use, np.cumsum(use) - 1, -1)
    return _span(rows, scaled if use is None else scaled[use], TIME + 0.5 * DT, edges)


@pytest.mark.parametrize("use", [None, np.arange(800) % 7 > 0])
def test_a_burst_is_found(use):
    """Within a piece of 2.5 s."""
    burst = (TIME > 90.0) & (TIME < 125.0)
    scaled = np.random.default_rng(3).normal(size=800) * np.where(burst, 6.0, 1.0)
    t0, t1, rms = spanned(scaled, use)
    assert (t0, t1) == (pytest.approx(90.0, abs=2.6), pytest.approx(125.0, abs=2.6))
    assert rms == pytest.approx(6.0, rel=0.15)


def test_of_two_bursts_the_one_with_more_in_it():
    scaled = np.random.default_rng(4).normal(size=800)
    scaled[(TIME > 70.0) & (TIME < 80.0)] *= 20.0
    scaled[(TIME > 100.0) & (TIME < 130.0)] *= 4.0
    t0, t1, rms = spanned(scaled)
    assert t0 == pytest.approx(70.0, abs=2.6) and t1 == pytest.approx(80.0, abs=2.6) and rms > 15.0


def test_a_quiet_piece_does_not_part_a_burst():
    scaled = np.full(800, 5.0)
    scaled[160:180] = 0.1  # one piece of 2.5 s of its own
    assert spanned(scaled)[:2] == (pytest.approx(60.0), pytest.approx(160.0))


def test_noise_has_no_span():
    rng = np.random.default_rng(5)
    none = [spanned(rng.normal(size=800)) is None for _ in range(100)]
    assert np.mean(none) > 0.95


def test_a_channel_that_is_not_compared_has_no_span():
    assert _span(np.full(800, -1), np.zeros(0), TIME, np.append(TIME, 160.0)) is None


def test_correlation():
    x = np.linspace(-1.0, 1.0, 101)
    assert _correlation(3.0 * x + 2.0, x) == pytest.approx(1.0)
    assert _correlation(x**2, x) == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(_correlation(np.ones(101), x))


def test_the_words_name_what_is_followed_and_what_acts_as_well():
    told = _words("moment_y", 63.0, 164.0, 116.4, 4.9, "N m", 0.6794, {"q": 0.6, "Mach": -0.9}, ("force_z",))
    assert told == (
        "moment_y from 63 to 164 s: 4.9 N m RMS, 116 times its sigma; it oscillates at 0.679 Hz; "
        "it follows Mach (correlation -0.90); force_z acts at the same time."
    )
    told = _words("force_x", 1.0, 2.0, 3.0, 4.0, "N", None, {"q": 0.2}, ())
    assert "Hz" not in told and told.endswith("it follows none of q, angle of attack and Mach number.")
