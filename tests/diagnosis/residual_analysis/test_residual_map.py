"""Cells of the residual map: which fail, and their numbers; regimes; change points."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.residual_analysis.residual_map import (
    CONSTRAINTS,
    _cell,
    failing_cells,
    flow_regimes,
    onsets,
    variance_change_point,
)
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()


def cell_of(normalised, sigma=0.02, database_sigma=None, settings=SETTINGS):
    sigma = np.full(len(normalised), sigma)
    span = (10.0, 20.0)
    return _cell("force_x", "Mach 25 to 15", span, np.asarray(normalised), sigma, "m/s^2", database_sigma, settings)


def test_cells_of_normal_numbers_do_not_fail():
    rng = np.random.default_rng(0)
    cells = [cell_of(rng.normal(size=n)) for n in (5, 20, 200, 2000) for _ in range(500)]
    # five sigmas of a mean square; of five numbers its distribution has a long tail
    assert np.mean([c.fails for c in cells[:500]]) < 0.02
    assert not any(c.fails for c in cells[1000:])


def test_numbers_of_a_cell():
    c = cell_of([1.0, 2.0, 3.0, -2.0])
    assert c.rms == pytest.approx(np.sqrt(18.0 / 4.0)) and c.bias == pytest.approx(1.0) and c.count == 4
    assert c.autocorrelation == pytest.approx((2.0 + 6.0 - 6.0) / 3.0 / 4.5)
    assert c.physical == pytest.approx(0.02 * np.sqrt(18.0 / 4.0 - 1.0))
    assert np.isnan(c.over_database_sigma) and "database" not in c.sentence
    c = cell_of([1.0, 2.0, 3.0, -2.0], database_sigma=np.array([0.03, 0.04, 0.05, 0.0]))
    assert c.over_database_sigma == pytest.approx(0.02 * np.sqrt(3.5) / np.sqrt(0.0050 / 4.0))
    assert c.sentence.startswith("force_x in Mach 25 to 15 (10 to 20 s): 2.12 times its sigma, 0.037 m/s^2 beyond")


def test_a_constraint_and_an_excess_of_small_sigmas_only_in_words():
    """Samples with a large sigma may be so small that nothing is beyond the noise in the unit of the channel."""
    values, sigma = np.array([3.0, 3.0, 0.1, 0.1]), np.array([0.01, 0.01, 1.0, 1.0])
    c = _cell("rest_gravity", CONSTRAINTS, (344.0, 344.0), values, sigma, "m/s^2", np.ones(4), SETTINGS)
    assert c.physical == 0.0 and c.sentence == "rest_gravity (344 s): 2.12 times its sigma."


def test_noise_below_the_stated_noise_has_nothing_beyond_it():
    c = cell_of([0.5, -0.5, 0.5, -0.5])
    assert c.physical == 0.0 and not c.fails
    assert c.autocorrelation == pytest.approx(-1.0)


@pytest.mark.parametrize("n", [50, 400])
def test_a_cell_fails_beyond_chance_only(n):
    """The limit is the quantile of the chi-square distribution of n degrees of freedom."""
    limit = np.sqrt(chi2.isf(norm.sf(SETTINGS.cell_fails_sigmas), n) / n)
    alternating = np.where(np.arange(n) % 2, 1.0, -1.0)
    assert not cell_of(0.99 * limit * alternating).fails
    assert cell_of(1.01 * limit * alternating).fails


def test_a_negligible_excess_does_not_fail():
    """Of a million numbers 5 % more are far beyond chance."""
    alternating = np.where(np.arange(1_000_000) % 2, 1.0, -1.0)
    assert not cell_of(1.05 * alternating).fails and cell_of(1.15 * alternating).fails
    assert cell_of(1.05 * alternating, settings=DecisionSettings(cell_minimum_rms=1.0)).fails


def test_failing_cells_are_sorted():
    base = cell_of(np.ones(10))
    cells = [replace(base, channel=str(r), rms=r, fails=f) for r, f in ((2.0, True), (9.0, False), (5.0, True))]
    assert [c.rms for c in failing_cells(cells)] == [5.0, 2.0]
    assert failing_cells([]) == []


def test_every_bin_is_in_one_regime():
    """From free-molecular flow to Mach 4: regimes do not overlap and cover all bins; empty ones are left out."""
    count = 400
    knudsen = np.repeat(np.geomspace(100.0, 1e-9, count), NODES_PER_BIN)
    mach = np.repeat(np.linspace(30.0, 4.0, count), NODES_PER_BIN)
    flow = SimpleNamespace(mach=np.append(mach, 4.0), knudsen=np.append(knudsen, 1e-9))
    regimes = flow_regimes(SimpleNamespace(residuals=SimpleNamespace(flow=flow)))
    np.testing.assert_array_equal(np.sum([inside for _, inside in regimes], axis=0), np.ones(count))
    names = [name for name, _ in regimes]
    assert names == ["free-molecular flow", "transitional flow", "Mach 25 to 15", "Mach 15 to 5", "Mach 5 to 3.5"]
    for (_, before), (_, after) in pairwise(regimes):
        assert np.flatnonzero(before).max() < np.flatnonzero(after).min()
    for name, inside in regimes[2:]:
        high, low = (float(x) for x in name.removeprefix("Mach ").split(" to "))
        middle = mach[NODES_PER_BIN // 2 :: NODES_PER_BIN]
        assert np.all((middle[inside] < high) & (middle[inside] >= low))


def change_point(normalised):
    return variance_change_point(normalised, SETTINGS.onset_samples)


@pytest.mark.parametrize(("change", "factor"), [(100, 3.0), (700, 1.6), (30, 30.0)])
def test_a_change_point_is_located(change, factor):
    rng = np.random.default_rng(7)
    normalised = rng.normal(size=1000)
    normalised[change:] *= factor
    first, gain = change_point(normalised)
    assert abs(first - change) <= 12 and gain > SETTINGS.onset_nats


def test_the_change_point_is_that_of_a_slow_scan():
    """Every division into two variances, each at least one and the second the larger."""

    def log_likelihood(values):
        variance = max(np.mean(values**2), 1.0)
        return -0.5 * len(values) * np.log(variance) - 0.5 * np.sum(values**2) / variance

    rng = np.random.default_rng(9)
    for _ in range(20):
        normalised = rng.normal(size=60) * np.where(np.arange(60) < rng.integers(10, 50), 1.0, rng.uniform(0.5, 3.0))
        gains = {}
        for k in range(10, 51):
            a, b = normalised[:k], normalised[k:]
            larger = max(np.mean(b**2), 1.0) > max(np.mean(a**2), 1.0)
            gains[k] = log_likelihood(a) + log_likelihood(b) - log_likelihood(normalised) if larger else 0.0
        first, gain = change_point(normalised)
        assert gain == pytest.approx(max(max(gains.values()), 0.0), abs=1e-9)
        if gain > 0.0:
            assert gains[first] == pytest.approx(gain, abs=1e-9)


def test_constant_and_decreasing_variances_have_no_change_point():
    rng = np.random.default_rng(8)
    gains = [change_point(f * rng.normal(size=400))[1] for f in (0.5, 1.0, 5.0) for _ in range(100)]
    assert np.mean(np.array(gains) > SETTINGS.onset_nats) < 0.01
    decreasing = rng.normal(size=400)
    decreasing[:200] *= 5.0
    assert change_point(decreasing)[1] < SETTINGS.onset_nats


def test_onsets_are_those_of_the_channels_that_begin_to_fail(monkeypatch):
    """Force x begins to fail at bin 300 and moment y, more clearly, at bin 200; force z is not compared enough."""
    rng, count = np.random.default_rng(3), 400
    by_channel = rng.normal(size=(count, 6))
    by_channel[300:, 0] *= 3.0
    by_channel[200:, 4] *= 6.0
    rows = np.arange(6 * count).reshape(count, 6)
    rows[19:, 2] = -1
    model = SimpleNamespace(
        index=SimpleNamespace(bin_rows=rows),
        inputs=SimpleNamespace(checking=()),
        bins=SimpleNamespace(edges=50.0 + 0.1 * np.arange(count + 1)),
        settings=SETTINGS,
    )
    module = "edl_filter.diagnosis.residual_analysis.residual_map.normalised_innovations"
    monkeypatch.setattr(module, lambda _: by_channel.ravel())
    first, second = onsets(model)
    assert (first.channel, second.channel) == ("moment_y", "force_x") and first.gain > second.gain
    assert first.time == pytest.approx(70.0, abs=1.2) and second.time == pytest.approx(80.0, abs=1.2)
