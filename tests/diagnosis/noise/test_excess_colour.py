"""Colour of the excess variance: its covariance, the search on the grid, and its price."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from linear_problems import from_dense, joint_measurements
from scipy.optimize import brentq
from scipy.stats import multivariate_normal

from edl_filter.diagnosis.noise import excess_colour as module
from edl_filter.diagnosis.noise.excess_colour import (
    ExcessColour,
    colour_excess,
    filter_at_excess,
    most_likely_colour,
)
from edl_filter.diagnosis.noise.variance_components import ExcessVariance, add_variance
from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.estimation import kalman
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()

#: Axes of force and moment, and of one checking IMU, whose excess stays white.
AXES, WIDTH = 6, 9


def six_axes(count=200, interval=0.1, size=2):
    """Six axes and three rows of a checking IMU in every bin, with a few walking states in common."""
    rng = np.random.default_rng(8)
    rows = count * WIDTH
    model = LinearStateSpace(
        increment=from_dense(np.zeros((count, size, size))),
        process_noise=from_dense(np.tile(0.01 * np.eye(size), (count, 1, 1))),
        row_start=np.arange(0, rows + 1, WIDTH),
        design=0.3 * rng.normal(size=(rows, size)),
        row_noise=np.tile(np.eye(WIDTH), (count, 1)),
        initial_covariance=np.eye(size),
    )
    bin_rows = np.arange(rows).reshape(count, WIDTH)
    index = RowIndex(
        bin_rows=bin_rows,
        constraint_rows=(),
        count=rows,
        step_interval=np.concatenate(([0.0], np.full(count - 1, interval))),
        time=np.repeat(interval * np.arange(count), WIDTH),
        column=np.tile(np.arange(WIDTH), count),
    )
    return model, index


def gauss_markov(rng, count, interval, memory):
    """Processes of unit variance ``(count, AXES)``, with correlation times of forces and of moments."""
    decay = np.exp(-interval / np.repeat(memory, AXES // 2))
    out = np.empty((count, AXES))
    out[0] = rng.normal(size=AXES)
    for k in range(1, count):
        out[k] = decay * out[k - 1] + np.sqrt(1.0 - decay**2) * rng.normal(size=AXES)
    return out


def residuals_with(seed, model, index, process):
    """Residuals of the model with a process ``(count, AXES)`` in the rows of force and moment."""
    rng = np.random.default_rng(seed)
    count, size = len(index.bin_rows), model.size
    states = rng.normal(size=size) + np.cumsum(0.1 * rng.normal(size=(count, size)), axis=0)
    out = np.einsum("rn,rn->r", model.design, np.repeat(states, WIDTH, axis=0)) + rng.normal(size=index.count)
    out[index.bin_rows[:, :AXES]] += process
    return out


def excess_of(index, variance, checking=0.0):
    by_row = np.zeros(index.count)
    by_row[index.bin_rows[:, :AXES]] = variance
    by_row[index.bin_rows[:, AXES:]] = checking
    return ExcessVariance(by_row, by_row > 0.0)


@pytest.mark.parametrize("memory", [(0.05, 1.0), (1.0, 0.2), (40.0, 40.0)])
def test_coloured_excess_is_a_dense_covariance(memory):
    """f σ_i σ_j exp(-|t_i - t_j| / memory) of each axis, its size different from row to row; of checking rows σ²."""
    model, index = six_axes(count=25, interval=0.15)
    rng = np.random.default_rng(6)
    variance = rng.uniform(0.1, 9.0, index.count)
    variance[index.bin_rows[5:9, 2]] = 0.0  # none in an interval
    excess = ExcessVariance(variance, variance > 0.0)
    factor = np.array([0.5, 3.0])
    coloured = colour_excess(model, index, excess, np.array(memory), factor)
    mean, covariance = joint_measurements(model, np.array([0.3, -0.1]))
    for i in range(index.count):
        for j in range(index.count):
            if index.column[i] != index.column[j]:
                continue
            if index.column[i] < AXES:
                kind = int(index.column[i] >= AXES // 2)
                correlation = factor[kind] * np.exp(-abs(index.time[i] - index.time[j]) / memory[kind])
                covariance[i, j] += np.sqrt(variance[i] * variance[j]) * correlation
            elif i == j:
                covariance[i, j] += variance[i]
    np.testing.assert_allclose(
        joint_measurements(coloured, np.concatenate(([0.3, -0.1], np.zeros(AXES))))[1], covariance, atol=1e-10
    )
    whiten, residuals = whitening_filter(coloured), rng.normal(size=index.count)
    white = whiten(residuals[:, None], np.array([[0.3], [-0.1]]))[:, 0]
    expected = multivariate_normal.logpdf(residuals, mean, covariance) + 0.5 * index.count * np.log(2.0 * np.pi)
    assert whiten.log_likelihood(white) == pytest.approx(expected, rel=1e-10)


def test_colour_leaves_the_model_and_rows_without_excess():
    """A row that is not used has no place; the model's own arrays are not changed."""
    model, index = six_axes(count=10)
    design, noise = model.design.copy(), model.row_noise.copy()
    partly = index.bin_rows.copy()
    partly[3, 1] = -1
    excess = excess_of(index, 4.0, checking=9.0)
    coloured = colour_excess(model, replace(index, bin_rows=partly), excess, np.ones(2), np.ones(2))
    np.testing.assert_array_equal(model.design, design)
    np.testing.assert_array_equal(model.row_noise, noise)
    states = coloured.design[:, model.size :]
    assert np.count_nonzero(states) == 6 * 10 - 1 and set(np.unique(states)) == {0.0, 2.0}
    added = (coloured.row_noise - noise)[np.arange(index.count), index.column].reshape(10, WIDTH)
    np.testing.assert_array_equal(added[:, AXES:], 9.0)
    assert added[3, 1] == 4.0 and np.count_nonzero(added[:, :AXES]) == 1


def chosen(index, model, residuals, excess, **changes):
    """Places of memory and factor that are chosen, of forces and of moments, or None if the excess stays white."""
    choice, mean = SETTINGS.model_copy(update=changes), np.zeros(model.size)
    at_white = kalman.log_likelihood(add_variance(model, index, excess), residuals, mean)
    colour = most_likely_colour(at_white, model, index, excess, residuals, mean, choice)
    return colour.places if colour.is_correlated else None


@pytest.mark.parametrize("factor", [0.25, 1.0, 6.0])
def test_a_factor_of_the_coloured_excess_is_one_of_the_variance_of_its_axes(factor):
    """The filter that a colour gives is that of the scaled excess; without one, that of white excess."""
    model, index = six_axes(count=40)
    excess = excess_of(index, 4.0, checking=9.0)
    variance = excess.variance.copy()
    variance[index.bin_rows[:, :3]] *= factor
    scaled = replace(excess, variance=variance)
    choice = SETTINGS.model_copy(update={"excess_memories_s": (0.3, 2.0), "excess_colour_factors": (factor, 1.0)})
    white = whitening_filter(add_variance(model, index, excess))
    coloured = colour_excess(model, index, scaled, np.array([2.0, 0.3]), np.ones(2))
    residuals, mean = np.random.default_rng(2).normal(size=index.count), np.zeros(model.size)
    whiten = filter_at_excess(model, index, excess, ExcessColour(((1, 0), (0, 1)), True), choice)
    expected = whitening_filter(coloured)
    assert whiten.log_determinant == pytest.approx(expected.log_determinant, rel=1e-12)
    assert log_likelihood_of(whiten, residuals, mean) == pytest.approx(
        log_likelihood_of(expected, residuals, mean), rel=1e-12
    )
    for colour in (None, ExcessColour(((1, 0), (0, 1)), False)):
        assert filter_at_excess(model, index, excess, colour, choice).log_determinant == white.log_determinant


@pytest.mark.parametrize("memory", [(0.4, 3.2), (0.8, 0.8), (3.2, 0.4)])
def test_the_correlation_times_of_simulated_noise_are_estimated_within_a_step_of_the_grid(memory):
    """And its variance, of which the white estimate is a factor of the grid.

    Along a ridge of the likelihood the ratio of variance and correlation time is constant.
    """
    model, index = six_axes(count=300)
    for seed in range(4):
        process = 3.0 * gauss_markov(np.random.default_rng(100 + seed), 300, 0.1, memory)
        residuals = residuals_with(seed, model, index, process)
        for reduction in (1.0, 4.0):  # of the white estimate
            places = chosen(index, model, residuals, excess_of(index, 9.0 / reduction))
            for (i, j), true in zip(places, memory, strict=True):
                assert abs(i - SETTINGS.excess_memories_s.index(true)) <= 1
                assert abs(j - SETTINGS.excess_colour_factors.index(reduction)) <= 1


def test_white_noise_stays_white():
    model, index = six_axes(count=300)
    for seed in range(5):
        process = 3.0 * np.random.default_rng(200 + seed).normal(size=(300, AXES))
        assert chosen(index, model, residuals_with(seed, model, index, process), excess_of(index, 9.0)) is None


def test_without_excess_there_is_no_colour():
    model, index = six_axes(count=20)
    zero = ExcessVariance.zero(index.count)
    assert most_likely_colour(0.0, model, index, zero, np.zeros(index.count), np.zeros(2), SETTINGS) is None


@pytest.mark.slow
def test_a_search_from_any_place_ends_at_the_same_colour(monkeypatch):
    """From the most likely places of a similar model it costs their neighbours only."""
    model, index = six_axes(count=120)
    process = 3.0 * gauss_markov(np.random.default_rng(11), 120, 0.1, (0.4, 0.8))
    residuals, excess, mean = residuals_with(1, model, index, process), excess_of(index, 9.0), np.zeros(model.size)
    at_white = kalman.log_likelihood(add_variance(model, index, excess), residuals, mean)
    computed = {}

    def remembered(coloured, *rest):
        key = coloured.process_noise.values.tobytes()
        if key not in computed:
            computed[key] = kalman.log_likelihood(coloured, *rest)
        calls.append(1)
        return computed[key]

    monkeypatch.setattr(module, "log_likelihood", remembered)
    calls = []

    def search(initial):
        calls.clear()
        colour = most_likely_colour(at_white, model, index, excess, residuals, mean, SETTINGS, initial)
        return colour, len(calls)

    colour, count = search(None)
    assert colour.is_correlated
    grid = list(product(range(len(SETTINGS.excess_memories_s)), range(len(SETTINGS.excess_colour_factors))))
    for force, moment in product(grid[::4], grid[::3]):
        assert search((force, moment))[0] == colour
    assert search(colour.places)[1] <= 9 < count


@pytest.mark.parametrize("variance", [2.25, 9.0, 36.0])
def test_with_one_correlation_time_the_factor_is_searched(variance):
    """Noise of variance 9 over an excess that is too small, right or too large by a factor of four."""
    settings = DecisionSettings(excess_memories_s=(0.4,))
    model, index = six_axes(count=120)
    process = 3.0 * gauss_markov(np.random.default_rng(11), 120, 0.1, (0.4, 0.4))
    residuals, excess, mean = residuals_with(1, model, index, process), excess_of(index, variance), np.zeros(model.size)
    colour = most_likely_colour(-np.inf, model, index, excess, residuals, mean, settings)
    factors = settings.excess_colour_factors
    likelihoods = {
        (j, k): kalman.log_likelihood(
            colour_excess(model, index, excess, np.full(2, 0.4), np.array([factors[j], factors[k]])), residuals, mean
        )
        for j, k in product(range(len(factors)), repeat=2)
    }
    best = max(likelihoods, key=likelihoods.get)
    assert colour.places == ((0, best[0]), (0, best[1]))


@pytest.mark.parametrize(("margin", "chosen_colour"), [(0.5, True), (-0.5, False)])
def test_colour_costs_the_logarithm_of_the_number_of_candidates(margin, chosen_colour):
    """A candidate that gains less than the price leaves the noise white; the price is of all, tried or not."""
    model, index = six_axes(count=60)
    mean, excess = np.zeros(model.size), excess_of(index, 2.25)
    noise = gauss_markov(np.random.default_rng(3), 60, 0.1, (0.3, 0.3))

    def gain(part):
        """Of the colour over white noise, nats, with a part of the noise correlated."""
        rest = np.sqrt(1.0 - part**2) * np.random.default_rng(5).normal(size=noise.shape)
        residuals = residuals_with(1, model, index, 1.5 * (part * noise + rest))
        return log_likelihood_of(coloured, residuals, mean) - log_likelihood_of(white, residuals, mean), residuals

    white = whitening_filter(add_variance(model, index, excess))
    coloured = whitening_filter(colour_excess(model, index, excess, np.full(2, 0.3), np.ones(2)))
    count = 20  # equal candidates, of forces and of moments
    few = SETTINGS.model_copy(update={"excess_memories_s": (0.3,) * count, "excess_colour_factors": (1.0,)})
    part = brentq(lambda x: gain(x)[0] - 2.0 * np.log(count) - margin, 0.0, 1.0)
    residuals = gain(part)[1]
    at_white = log_likelihood_of(white, residuals, mean)
    assert most_likely_colour(at_white, model, index, excess, residuals, mean, few).is_correlated == chosen_colour


def log_likelihood_of(whiten, residuals, mean):
    return whiten.log_likelihood(whiten(residuals[:, None], mean[:, None])[:, 0])
