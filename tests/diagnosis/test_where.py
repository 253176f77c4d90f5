"""Cells: what is normal does not fail, what is too loud does, and the numbers are those of the noise."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from edl_filter.diagnosis.path import PER_BIN
from edl_filter.diagnosis.where import CHANCE, _cell, failures, louder_from, regimes


def cell_of(scaled, sigma=0.02, limit=None, channel="force_x"):
    sigma = np.full(len(scaled), sigma)
    return _cell(channel, "Mach 25 to 15", 10.0, 20.0, np.asarray(scaled), sigma, "m/s^2", limit)


def test_of_normal_numbers_nothing_fails():
    rng = np.random.default_rng(0)
    cells = [cell_of(rng.normal(size=n)) for n in (5, 20, 200, 2000) for _ in range(500)]
    # five sigmas of a mean square; of five numbers its distribution has a long tail
    assert np.mean([c.fails for c in cells[:500]]) < 0.02
    assert not any(c.fails for c in cells[1000:])


def test_the_numbers_of_a_cell():
    c = cell_of([1.0, 2.0, 3.0, -2.0])
    assert c.rms == pytest.approx(np.sqrt(18.0 / 4.0)) and c.bias == pytest.approx(1.0) and c.count == 4
    assert c.autocorrelation == pytest.approx((2.0 + 6.0 - 6.0) / 3.0 / 4.5)
    assert c.physical == pytest.approx(0.02 * np.sqrt(18.0 / 4.0 - 1.0))
    assert np.isnan(c.matters) and "database" not in c.sentence
    c = cell_of([1.0, 2.0, 3.0, -2.0], limit=np.array([0.03, 0.04, 0.05, 0.0]))
    assert c.matters == pytest.approx(0.02 * np.sqrt(3.5) / np.sqrt(0.0050 / 4.0))
    assert c.sentence.startswith("force_x in Mach 25 to 15 (10 to 20 s): 2.12 times its sigma, 0.037 m/s^2 beyond")


def test_noise_below_what_is_stated_leaves_nothing_beyond():
    c = cell_of([0.5, -0.5, 0.5, -0.5])
    assert c.physical == 0.0 and not c.fails
    assert c.autocorrelation == pytest.approx(-1.0)


@pytest.mark.parametrize("n", [50, 400])
def test_it_fails_beyond_chance_only(n):
    """A mean square of n numbers has the sigma √(2/n)."""
    limit = np.sqrt(chi2.isf(norm.sf(CHANCE), n) / n)
    even = np.where(np.arange(n) % 2, 1.0, -1.0)
    assert not cell_of(0.99 * limit * even).fails
    assert cell_of(1.01 * limit * even).fails


def test_what_nobody_would_care_for_does_not_fail():
    """Of a million numbers 5 % more are far beyond chance."""
    even = np.where(np.arange(1_000_000) % 2, 1.0, -1.0)
    assert not cell_of(1.05 * even).fails and cell_of(1.15 * even).fails


def test_failures_are_sorted():
    base = cell_of(np.ones(10))
    cells = [replace(base, channel=str(r), rms=r, fails=f) for r, f in ((2.0, True), (9.0, False), (5.0, True))]
    assert [c.rms for c in failures(cells)] == [5.0, 2.0]
    assert failures([]) == []


def test_every_bin_is_in_one_regime():
    """From free flow to Mach 4: regimes do not overlap and leave nothing out, and empty ones are not told."""
    count = 400
    knudsen = np.repeat(np.geomspace(100.0, 1e-9, count), PER_BIN)
    mach = np.repeat(np.linspace(30.0, 4.0, count), PER_BIN)
    nodes = SimpleNamespace(mach=np.append(mach, 4.0), knudsen=np.append(knudsen, 1e-9))
    found = regimes(SimpleNamespace(ground=SimpleNamespace(found=SimpleNamespace(flow=nodes))))
    np.testing.assert_array_equal(np.sum([inside for _, inside in found], axis=0), np.ones(count))
    names = [name for name, _ in found]
    assert names == ["free-molecular flow", "transitional flow", "Mach 25 to 15", "Mach 15 to 5", "Mach 5 to 3.5"]
    for (_, before), (_, after) in pairwise(found):
        assert np.flatnonzero(before).max() < np.flatnonzero(after).min()
    for name, inside in found[2:]:
        high, low = (float(x) for x in name.removeprefix("Mach ").split(" to "))
        assert np.all((mach[::PER_BIN][inside] < high) & (mach[::PER_BIN][inside] >= low))


@pytest.mark.parametrize(("at", "factor"), [(100, 3.0), (700, 1.6), (30, 30.0)])
def test_an_onset_is_found_where_it_is(at, factor):
    rng = np.random.default_rng(7)
    scaled = rng.normal(size=1000)
    scaled[at:] *= factor
    found, gain = louder_from(scaled)
    assert abs(found - at) <= 12 and gain > 12.0


def test_noise_and_what_always_fails_have_no_onset():
    rng = np.random.default_rng(8)
    gains = [louder_from(f * rng.normal(size=400))[1] for f in (0.5, 1.0, 5.0) for _ in range(100)]
    assert np.mean(np.array(gains) > 12.0) < 0.01
    quieter = rng.normal(size=400)
    quieter[:200] *= 5.0  # what ends does not begin
    assert louder_from(quieter)[1] < 12.0
