"""Noise of the rows: a lever-arm acceleration where a torque begins, and bins in which either table may apply."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis.jacobians.bin_rows import bins_of_either_regime, discontinuity_sigma
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_sigma
from edl_filter.effects.perturbation import CoefficientUnits, Perturbation
from edl_filter.imu_model.lever_arm import edge_values

DT, N, ARM = 0.125, 80, np.array([-0.8, 0.5, -0.6])
EDGES = DT * np.arange(N + 1)
BINS = TimeBins(EDGES, np.ones(N, bool))
AXIS = np.array([0.0, 0.3, 0.2])


def smooth_rate(t):
    """A slow oscillation of the rate, and its integral."""
    return 0.1 * np.sin(1.5 * t), -0.1 / 1.5 * np.cos(1.5 * t)


def true_and_stated_error(onset):
    """Errors of the tangential part with a torque from `onset` on, and the stated error, ``(N,)``, m/s²."""
    since = np.maximum(EDGES - onset, 0.0)
    smooth, torque = smooth_rate(EDGES), (0.5 * since, 0.25 * since**2)
    rate, angle = (a + b for a, b in zip(smooth, torque, strict=True))
    mean = np.outer(np.diff(angle) / DT, AXIS)
    edge_error = edge_values(np.full(N, DT), mean) - np.outer(rate, AXIS)
    true = np.cross(np.diff(edge_error, axis=0), ARM) / DT
    stated = discontinuity_sigma(BINS, mean, ARM)
    return np.linalg.norm(true, axis=1)[8:-8], np.linalg.norm(stated, axis=1)[8:-8]


@pytest.mark.parametrize("phase", np.linspace(0.0, 1.0, 9))
def test_a_discontinuity_of_the_rates_slope_is_covered(phase):
    true, stated = true_and_stated_error(DT * (40 + phase))
    large = true > 0.1 * true.max()
    assert large.any() and np.all(true[large] < 1.5 * stated[large])  # stated as one sigma
    assert np.count_nonzero(stated) < 12  # near the discontinuity alone


def test_a_smooth_rate_has_no_stated_error():
    true, stated = true_and_stated_error(1e3)
    assert true.max() < 1e-6 and not stated.any()


@pytest.mark.parametrize("per_bin", [1, 4])
def test_sigma_of_a_mean_over_bins(per_bin):
    """Against sampled noise that is independent from sample to sample, of uneven lengths and sigmas."""
    rng = np.random.default_rng(3)
    interval, noise = rng.uniform(0.05, 0.2, 12), rng.uniform(0.5, 2.0, 12)
    time = np.cumsum(interval)
    edges = np.concatenate(([0.0], time))[::per_bin]
    bins = TimeBins(edges, np.ones(len(edges) - 1, bool))
    samples = noise * rng.normal(size=(20_000, 12))
    means = np.add.reduceat(samples * interval, np.arange(0, 12, per_bin), axis=1) / bins.interval
    np.testing.assert_allclose(bin_sigma(bins, time, interval, noise), means.std(axis=0), rtol=0.03)


def either_regime(log_knudsen, join="switch", density=None):
    """Bins of either regime: the Knudsen number over its limit at the nodes, with a perturbation of the density."""
    time = np.arange(len(log_knudsen), dtype=float)
    perturbation = None
    if density is not None:
        units = CoefficientUnits(time, time, time, time)
        perturbation = replace(Perturbation.zero(units), time=time, density=density, wind=np.zeros((len(time), 2)))
    database = SimpleNamespace(join=join, continuum_limit=1e-3)
    flow = SimpleNamespace(time=time, knudsen=1e-3 * np.exp(log_knudsen))
    model = SimpleNamespace(database=database, perturbation=perturbation)
    return bins_of_either_regime(model, SimpleNamespace(flow=flow), 0.1)


def test_bins_near_the_limit_and_the_one_before_are_of_either_regime():
    """Three sigmas of the density of 10 %; the step of the rate at a bin's end spans the next bin."""
    log_knudsen = np.linspace(1.0, -1.0, 10 * NODES_PER_BIN + 1)
    near = np.flatnonzero(either_regime(log_knudsen))
    np.testing.assert_array_equal(near, [2, 3, 4, 5, 6])  # within 0.3 of the limit: 3 to 6
    assert not either_regime(log_knudsen, join="blend").any()


@pytest.mark.parametrize("shift", [-0.25, 0.25])
def test_bins_of_either_regime_do_not_depend_on_the_point(shift):
    """A point with another density has another Knudsen number; the rows' noise stays the same."""
    log_knudsen = np.linspace(1.0, -1.0, 10 * NODES_PER_BIN + 1)
    density = np.full(len(log_knudsen), shift)
    about_point = either_regime(log_knudsen - shift, density=density)
    np.testing.assert_array_equal(about_point, either_regime(log_knudsen))
    assert np.any(either_regime(log_knudsen - shift) != about_point)
