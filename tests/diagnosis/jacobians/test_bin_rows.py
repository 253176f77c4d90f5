"""Noise of the rows: interpolated readings where a torque begins, and bins in which either table may apply."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter import Mission
from edl_filter.diagnosis.jacobians.bin_rows import discontinuity_sigma, weight_of_either_regime
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_sigma
from edl_filter.effects import EffectInstance
from edl_filter.effects.perturbation import CoefficientUnits, Perturbation
from edl_filter.effects.registry import find_effect
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


def either_regime(log_knudsen, join="switch", density_sigma=0.1, **model):
    """Weights by bin: the Knudsen number over its limit at the nodes, by a density that falls with altitude."""
    altitude = 10e3 * (log_knudsen - log_knudsen[0])
    air = SimpleNamespace(density=lambda h: np.exp(-h / 10e3))
    gas = SimpleNamespace(knudsen=lambda density, diameter: 1e-3 * np.exp(log_knudsen[0]) / (density * diameter))
    database = SimpleNamespace(join=join, continuum_limit=1e-3)
    stated = SimpleNamespace(database=database, atmosphere=air, gas=gas, diameter=1.0, **model)
    return weight_of_either_regime(stated, altitude, density_sigma)


def test_about_the_limit_either_table_may_apply():
    """One within three sigmas of 10 %, none from 4.5 on, without a step; the rate's step spans the next bin."""
    log_knudsen = np.linspace(1.0, -1.0, 200 * NODES_PER_BIN + 1)
    weight = either_regime(log_knudsen)
    distance = np.abs(log_knudsen) / 0.1
    near, far = (distance[:-1].reshape(200, NODES_PER_BIN).max(axis=1) < 3.0, distance[:-1:NODES_PER_BIN] > 4.6)
    assert near.sum() == 60 and np.all(weight[near] == 1.0) and weight[far].max() < 1e-6
    assert np.abs(np.diff(weight)).max() < 0.3
    nearest = np.array([distance[NODES_PER_BIN * b : NODES_PER_BIN * (b + 1)].min() for b in range(200)])
    by_bin = np.exp(-0.5 * (np.maximum(nearest - 3.0, 0.0) / 0.25) ** 2)
    np.testing.assert_allclose(weight, np.maximum(by_bin, np.append(by_bin[1:], 0.0)), rtol=1e-9)
    assert (
        not either_regime(log_knudsen, join="blend").any() and not either_regime(log_knudsen, density_sigma=0.0).any()
    )


def test_the_noise_about_the_limit_is_the_same_about_every_point_and_with_every_effect():
    """The log determinant of the noise is no evidence."""
    settings = ("aerodynamics.coefficient_sigma=1.0", "atmosphere.density_sigma=0.1")
    case = load_case(Mission.load("builtin:practice_mer", settings), ())
    inputs = case.model_inputs(())
    altitude = np.linspace(90e3, 40e3, 400 * NODES_PER_BIN + 1)
    stated = weight_of_either_regime(inputs.forward_model, altitude, 0.1)
    assert stated.max() > 0.4 and np.count_nonzero(stated > 1e-6) < 250
    effect = EffectInstance(find_effect("density_scale"), {"k": 0.2})
    time = np.zeros(1)
    shifted = replace(Perturbation.zero(CoefficientUnits(time, time, time, time)), density=np.full(1, -0.1))
    changed = replace(inputs.forward_model.with_effects((effect,)), perturbation=shifted)
    np.testing.assert_array_equal(weight_of_either_regime(changed, altitude, 0.1), stated)
