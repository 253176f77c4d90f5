"""Change points of variance, and the onsets of channels."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis.residual_analysis.change_point import abrupt_changes, onsets, variance_change_point
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()


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
    module = "edl_filter.diagnosis.residual_analysis.change_point.normalised_innovations"
    monkeypatch.setattr(module, lambda _: by_channel.ravel())
    first, second = onsets(model)
    assert (first.channel, second.channel) == ("moment_y", "force_x") and first.gain > second.gain
    assert first.time == pytest.approx(70.0, abs=1.2) and second.time == pytest.approx(80.0, abs=1.2)


def model_of(white, excess=True, **settings):
    """Two channels of forces and moments in ten bins of 0.5 s from 100 s on, and a row of a checking IMU."""
    rows = np.full((10, 12), -1)
    rows[1:, 0], rows[:, 4] = np.arange(9), 9 + np.arange(10)
    rows[:, 7] = 19 + np.arange(10)
    return SimpleNamespace(
        excess_variance=SimpleNamespace(is_zero=not excess),
        settings=DecisionSettings(**settings),
        bins=SimpleNamespace(edges=100.0 + 0.5 * np.arange(11)),
        index=SimpleNamespace(bin_rows=rows),
        stated_noise_filter="stated",
        white_residuals=lambda whiten: {"stated": white}[whiten],
    )


def test_abrupt_changes_are_the_bins_of_the_largest_innovations_apart_from_each_other():
    """Bin 3 by two rows together, bin 4 next to it, bin 8 by one; the rows of a checking IMU do not count."""
    white = np.zeros(29)
    white[2], white[9 + 3] = 6.0, -8.0  # bin 3: 100
    white[9 + 4] = 9.0  # bin 4
    white[7] = 7.0  # bin 8
    white[9] = 0.1  # bin 0
    white[19 + 6] = 50.0
    assert abrupt_changes(model_of(white, abrupt_change_spacing_s=1.0)) == [101.5, 104.0, 100.0]
    assert abrupt_changes(model_of(white, abrupt_change_spacing_s=0.5)) == [101.5, 102.0, 104.0, 100.0]
    assert abrupt_changes(model_of(white, abrupt_changes=1)) == [101.5]
    assert abrupt_changes(model_of(white, abrupt_changes=0)) == []


def test_a_model_without_excess_variance_has_no_abrupt_change():
    assert abrupt_changes(model_of(np.full(29, 9.0), excess=False)) == []
