"""Excess variance: the right amount where there is some, and none elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_problems import from_dense

from edl_filter.diagnosis.noise.variance_components import (
    ExcessVariance,
    _Iteration,
    _next_variance,
    add_variance,
    estimate_variance_components,
    moment_estimate,
)
from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()
RATE, LENGTH = 8, 60
COUNT = RATE * LENGTH
PIECE_BINS = round(SETTINGS.noise_piece_s * RATE)
SIGMA = np.array([0.1, 2.0])
ZERO_MEAN = np.zeros(1)


def two_channels(walk=0.0):
    """Two channels at 8 Hz for a minute; both contain one common random walk with a step of `walk`."""
    rows = 2 * COUNT
    model = LinearStateSpace(
        increment=from_dense(np.zeros((COUNT, 1, 1))),
        process_noise=from_dense(np.full((COUNT, 1, 1), walk**2)),
        row_start=np.arange(0, rows + 1, 2),
        design=np.tile(SIGMA if walk else np.zeros(2), COUNT)[:, None],
        row_noise=np.tile(np.diag(SIGMA**2), (COUNT, 1)),
        initial_covariance=np.eye(1),
    )
    index = RowIndex(
        bin_rows=np.arange(rows).reshape(COUNT, 2),
        constraint_rows=(),
        count=rows,
        step_interval=np.full(COUNT, 1.0 / RATE),
        time=100.0 + np.repeat(np.arange(COUNT), 2) / RATE,
        column=np.tile([0, 1], COUNT),
    )
    return model, index


def sampled_every(index, interval):
    """The same rows with bins of another length, s."""
    time = 100.0 + interval * np.repeat(np.arange(COUNT), 2)
    return replace(index, step_interval=np.full(COUNT, interval), time=time)


def simulated(seed, walk=0.0, factor=1.0):
    """Residuals of the model, their noise times `factor` ``(COUNT, 2)``."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(COUNT, 2)) * factor
    common = rng.normal() + np.cumsum(walk * rng.normal(size=COUNT)) if walk else np.zeros(COUNT)
    return (SIGMA * (noise + common[:, None])).ravel()


def noisy_piece(piece, channel, factor=5.0):
    """Factors on the noise ``(COUNT, 2)``: one channel over one piece of time."""
    out = np.ones((COUNT, 2))
    out[piece * PIECE_BINS : (piece + 1) * PIECE_BINS, channel] = factor
    return out


def estimate(model, index, residuals, initial=None):
    whiten = whitening_filter(model)
    return estimate_variance_components(whiten, index, residuals, ZERO_MEAN, SETTINGS, initial)


def moments(model, index, residuals):
    return moment_estimate(whitening_filter(model), index, residuals, ZERO_MEAN, SETTINGS)


def log_likelihood(whiten, residuals):
    return whiten.log_likelihood(whiten(residuals[:, None], ZERO_MEAN[:, None])[:, 0])


@pytest.mark.parametrize("channel", [0, 1])
def test_of_independent_rows_it_is_the_excess_of_the_mean_square(channel):
    model, index = two_channels()
    factor = noisy_piece(2, channel)
    residuals = simulated(1, factor=factor)
    excess, whiten = estimate(model, index, residuals)
    rows = index.bin_rows[:, channel][factor[:, channel] > 1.0]
    expected = np.zeros(len(residuals))
    expected[rows] = np.mean(residuals[rows] ** 2) - SIGMA[channel] ** 2
    np.testing.assert_allclose(excess.variance, expected, rtol=1e-9)
    assert not excess.is_zero and excess.share == pytest.approx(len(rows) / len(residuals))
    # and the whitening filter that is returned has it
    np.testing.assert_allclose(whiten.innovation_sigma**2, np.tile(SIGMA**2, COUNT) + expected)


@pytest.mark.parametrize("channel", [0, 1])
def test_five_times_the_noise_is_estimated_where_it_is(channel):
    """With a state common to both channels, innovations contain more than noise and depend on other pieces."""
    model, index = two_channels(walk=0.1)
    factor = noisy_piece(3, channel)
    unaffected_channel_insignificant = []
    for seed in range(20):
        excess, _ = estimate(model, index, simulated(seed, 0.1, factor))
        relative = excess.variance[index.bin_rows] / SIGMA**2
        inside = factor[:, channel] > 1.0
        assert np.ptp(relative[inside, channel]) == 0.0
        assert np.sqrt(1.0 + relative[inside, channel][0]) == pytest.approx(5.0, rel=0.25)  # chance: one sigma is 8 %
        assert not relative[~inside].any()
        assert np.all(relative[:, 1 - channel] < 1.0)
        unaffected_channel_insignificant.append(not excess.significant[index.bin_rows][:, 1 - channel].any())
    # the common state may add a little to the other channel at the same time
    assert np.mean(unaffected_channel_insignificant) >= 0.9


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0, 8.0])
def test_significance_is_that_of_the_moment_estimate_however_few_rows_a_piece_has(rate):
    """Of independent rows both test whether the excess is more than chance in so many rows."""
    model, index = two_channels()
    index = sampled_every(index, 1.0 / rate)
    residuals = simulated(1, factor=noisy_piece(2, 0))
    by_moments = moments(model, index, residuals)
    assert not by_moments.is_zero
    excess, _ = estimate(model, index, residuals)
    np.testing.assert_array_equal(excess.significant, by_moments.significant)


@pytest.mark.parametrize(("variance", "sufficient"), [(3.0, False), (6.0, True)])
def test_the_gain_must_exceed_the_penalty(variance, sufficient):
    """Five rows a piece: three times the variance is more than chance in one piece, but there are 192 pieces."""
    model, index = two_channels()
    index = sampled_every(index, 2.0)
    residuals = np.tile(SIGMA, COUNT)  # one sigma in each row
    piece = index.bin_rows[20:25, 0]
    residuals[piece] *= np.sqrt(1.0 + variance)
    assert not moments(model, index, residuals).is_zero
    excess, _ = estimate(model, index, residuals)
    gain = 0.5 * len(piece) * (variance - np.log1p(variance))
    penalty = np.log(192.0) + 0.5 * np.log(5.0)
    assert (gain > penalty) == sufficient == (not excess.is_zero)
    assert excess.penalty == pytest.approx(penalty if sufficient else 0.0)
    np.testing.assert_array_equal(np.flatnonzero(excess.significant), piece if sufficient else [])


def test_a_clean_flight_has_no_excess_variance():
    model, index = two_channels(walk=0.1)
    zero = [estimate(model, index, simulated(seed, 0.1))[0].is_zero for seed in range(100)]
    assert np.mean(zero) >= 0.95


def test_the_moment_estimate_of_independent_rows_is_the_maximum():
    model, index = two_channels()
    residuals = simulated(1, factor=noisy_piece(2, 0))
    excess, _ = estimate(model, index, residuals)
    np.testing.assert_allclose(moments(model, index, residuals).variance, excess.variance, rtol=1e-9)


@given(st.integers(0, 1000), st.lists(st.floats(0.2, 30.0), min_size=12, max_size=12))
def test_the_likelihood_is_never_below_that_of_the_stated_noise(seed, factors):
    """With any noise in any of the twelve pieces."""
    model, index = two_channels(walk=0.1)
    factor = np.repeat(np.reshape(factors, (6, 2)), PIECE_BINS, axis=0)
    residuals = simulated(seed, 0.1, factor)
    _, whiten = estimate(model, index, residuals)
    assert log_likelihood(whiten, residuals) >= log_likelihood(whitening_filter(model), residuals)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(0, 5), st.integers(0, 1), st.floats(3.0, 30.0))
def test_no_piece_would_be_more_likely_with_another_variance(seed, piece, channel, factor):
    """With a state common to both channels, where the moment estimate is not the maximum."""
    model, index = two_channels(walk=0.5)
    noise = noisy_piece(piece, channel, factor) * noisy_piece((piece + 1) % 6, 1 - channel, factor)
    residuals = simulated(seed, 0.5, noise)
    excess, whiten = estimate(model, index, residuals)
    best = log_likelihood(whiten, residuals)
    for variance in np.unique(excess.variance[excess.significant]):
        for change in (0.7, 1.4):
            changed = replace(excess, variance=np.where(excess.variance == variance, change, 1.0) * excess.variance)
            candidate = whitening_filter(add_variance(model, index, changed))
            assert log_likelihood(candidate, residuals) < best + SETTINGS.variance_convergence_nats


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(2.0, 30.0), st.floats(2.0, 30.0))
def test_the_result_does_not_depend_on_the_start(seed, factor, start_factor):
    """Started from the estimate of other residuals, with more noise and elsewhere, it has the same likelihood."""
    model, index = two_channels(walk=0.2)
    start_residuals = simulated(seed + 1, 0.2, noisy_piece(1, 0, start_factor) * noisy_piece(4, 1, start_factor))
    initial, _ = estimate(model, index, start_residuals)
    residuals = simulated(seed, 0.2, noisy_piece(1, 0, factor) * noisy_piece(2, 1, factor))
    values = [log_likelihood(estimate(model, index, residuals, start)[1], residuals) for start in (None, initial)]
    assert values[0] == pytest.approx(values[1], abs=4.0)


@given(st.floats(1.1, 2.9), st.floats(0.01, 100.0), st.floats(1.5, 20.0), st.booleans())
def test_the_secant_gives_the_power_of_each_piece(power, best, distance, above):
    """Where a ratio is a power of the variance the third step is exact; another piece has a power of its own."""
    initial = np.array([best * (distance if above else 1.0 / distance), 2.0])

    def iteration_at(variance):
        ratio = (np.array([best, 5.0]) / variance) ** (1.0 / np.array([power, 1.5]))
        return _Iteration(variance, ratio, np.ones(2))

    pieces, iterations = [np.arange(4), np.arange(4, 9)], [iteration_at(initial)]
    for _ in range(3):
        variance = _next_variance(iterations, pieces, 9, SETTINGS)
        assert np.ptp(variance[:4]) == np.ptp(variance[4:]) == 0.0
        iterations.append(iteration_at(variance[[0, 4]]))
    np.testing.assert_allclose(iterations[-1].variance, [best, 5.0], rtol=1e-6)


@pytest.mark.parametrize("count", [0, 3, -3])
def test_an_estimate_with_another_number_of_rows_is_a_start_too(count):
    """A model may use a few rows more or fewer than the one whose estimate is the start."""
    model, index = two_channels()
    residuals = simulated(5, factor=noisy_piece(2, 1))
    excess, whiten = estimate(model, index, residuals)
    variance = np.resize(excess.variance, len(residuals) + count)
    _, restarted = estimate(model, index, residuals, ExcessVariance(variance, variance > 0.0))
    assert log_likelihood(whiten, residuals) == pytest.approx(log_likelihood(restarted, residuals), abs=2.0)


def test_the_excess_is_added_to_the_diagonal_alone():
    model, index = two_channels()
    assert add_variance(model, index, ExcessVariance.zero(index.count)) is model
    variance = np.arange(2.0 * COUNT)
    added = add_variance(model, index, ExcessVariance(variance, variance > 0.0)).row_noise - model.row_noise
    expected = np.zeros((2 * COUNT, 2))
    expected[0::2, 0], expected[1::2, 1] = variance[0::2], variance[1::2]
    np.testing.assert_allclose(added, expected, atol=1e-12)
    assert model.row_noise[0, 0] == SIGMA[0] ** 2  # the model itself is not changed


def test_no_excess_variance():
    zero = ExcessVariance.zero(5)
    assert zero.is_zero and zero.share == 0.0 and zero.penalty == 0.0 and len(zero.variance) == 5


def test_rows_that_are_not_used_have_none():
    """A channel that is nowhere compared, and rows of constraints, which belong to no channel."""
    model, index = two_channels()
    rows = np.stack((index.bin_rows[:, 0], np.full(COUNT, -1)), axis=1)
    excess, _ = estimate(model, replace(index, bin_rows=rows), simulated(1, factor=7.0))
    variance = excess.variance.reshape(COUNT, 2)
    assert variance[:, 0].all() and not variance[:, 1].any()
