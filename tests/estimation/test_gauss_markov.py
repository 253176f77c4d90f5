"""A Gauss-Markov process in white noise: dense Gaussians, drawn processes, and few observations."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from edl_filter.estimation import gauss_markov
from edl_filter.estimation.gauss_markov import estimate_in_stretch


def dense(time, values, wanted, amplitudes):
    """One process, each set of parameters with the whole covariance."""
    span = max(time[-1], wanted[-1]) - min(time[0], wanted[0])
    options = []
    for own, missing in ((np.ones(len(time)), np.ones(len(wanted))), *amplitudes):
        own, missing = own / np.sqrt(np.mean(own**2)), missing / np.sqrt(np.mean(own**2))
        for fraction in gauss_markov._TIMES:

            def covariance(a, b, tau=fraction * span):
                return np.exp(-np.abs(a[:, None] - b) / tau)

            prior_of_mean = missing @ covariance(wanted, wanted) @ missing / len(wanted) ** 2
            for ratio in gauss_markov._RATIOS:
                total = np.eye(len(time)) + ratio * covariance(time, time) * np.outer(own, own)
                inverse = np.linalg.inv(total)
                noise = values @ inverse @ values / len(time)
                log = -0.5 * np.linalg.slogdet(noise * total)[1]
                gain = ratio * covariance(wanted, time) * np.outer(missing, own)
                average = gain.mean(axis=0)
                variance = noise * (ratio * prior_of_mean - average @ inverse @ average)
                options.append((log, gain @ inverse @ values, max(variance, 0.0)))
    weight = np.exp(np.array([o[0] for o in options]) - max(o[0] for o in options))
    weight /= weight.sum()
    mean = sum(w * o[1] for w, o in zip(weight, options, strict=True))
    variance = sum(w * (o[2] + (o[1].mean() - mean.mean()) ** 2) for w, o in zip(weight, options, strict=True))
    return mean, variance


def drawn(rng, time, tau, sigma, noise):
    """A process at the times, and observations of it."""
    covariance = sigma**2 * np.exp(-np.abs(np.subtract.outer(time, time)) / tau)
    process = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(time))) @ rng.standard_normal(len(time))
    return process, process + noise * rng.standard_normal(len(time))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 40), st.integers(1, 30))
@example(1, 0, 20)
@example(2, 70, 20)
def test_the_estimate_is_that_of_the_dense_gaussians(seed, first, length):
    rng = np.random.default_rng(seed)
    time = 0.25 * np.arange(90)
    lost = (np.arange(90) >= first) & (np.arange(90) < first + length)
    _, read = drawn(rng, time, 5.0, rng.uniform(0.0, 3.0), 1.0)
    amplitude = 0.5 + 0.1 * time
    amplitudes = [(amplitude[~lost], amplitude[lost])] if seed % 2 else []
    pair = np.stack((read[~lost], -2.0 * read[~lost]), axis=1)
    mean, variance = estimate_in_stretch(time[~lost], pair, time[lost], amplitudes)
    expected, expected_variance = dense(time[~lost], read[~lost], time[lost], amplitudes)
    scale = np.abs(read).max()
    np.testing.assert_allclose(mean[:, 0], expected, atol=1e-6 * scale)
    np.testing.assert_allclose(mean[:, 1], -2.0 * expected, atol=1e-6 * scale)
    np.testing.assert_allclose(variance, expected_variance * np.array([1.0, 4.0]), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("sigma", "tau"),
    [
        pytest.param(0.2, 8.0, marks=pytest.mark.slow),
        (0.5, 8.0),
        pytest.param(3.0, 8.0, marks=pytest.mark.slow),
        (3.0, 60.0),
    ],
)
def test_errors_of_the_mean_over_the_stretch_are_those_of_its_variance(sigma, tau):
    """Of the process in the mean over many draws; of readings, with the noise of their mean, in each draw too.

    A process of less than the noise is seen in some draws only.
    """
    rng = np.random.default_rng(4)
    time = 0.125 * np.arange(300)
    lost = (np.arange(300) >= 120) & (np.arange(300) < 160)
    outcomes = []
    for _ in range(200):
        process, read = drawn(rng, time, tau, sigma, 1.0)
        mean, variance = estimate_in_stretch(time[~lost], read[~lost, None], time[lost])
        outcomes.append((mean.mean() - process[lost].mean(), mean.mean() - read[lost].mean(), variance[0]))
    error, difference, variance = np.array(outcomes).T
    assert 0.85 < np.sqrt(np.mean(error**2) / np.mean(variance)) < 1.15
    sigmas = difference / np.sqrt(variance + 1.0 / lost.sum())
    assert 0.85 < np.sqrt(np.mean(sigmas**2)) < 1.15 and np.abs(sigmas).max() < 4.0


def test_without_a_process_the_variance_is_small():
    rng = np.random.default_rng(5)
    time = 0.125 * np.arange(300)
    lost = (np.arange(300) >= 120) & (np.arange(300) < 160)
    estimates = [estimate_in_stretch(time[~lost], rng.standard_normal((260, 1)), time[lost]) for _ in range(50)]
    errors = np.array([mean.mean() / np.sqrt(variance[0]) for mean, variance in estimates])
    assert np.abs(errors).max() < 3.0
    assert np.sqrt(np.mean([variance[0] for _, variance in estimates])) < 0.7 / np.sqrt(lost.sum())


def test_a_trend_between_both_sides_is_interpolated():
    time = np.r_[np.arange(0.0, 10.0, 0.125), np.arange(14.0, 24.0, 0.125)]
    values = 0.03 * (time - 12.0)[:, None] + 1e-4 * np.random.default_rng(1).standard_normal((len(time), 1))
    wanted = np.arange(10.0, 14.0, 0.125)
    mean, variance = estimate_in_stretch(time, values, wanted)
    np.testing.assert_allclose(mean[:, 0], 0.03 * (wanted - 12.0), atol=0.01)
    assert 0.0 < np.sqrt(variance[0]) < 0.02


def test_many_observations_are_used_by_blocks():
    """2000 observations of white noise about a constant."""
    rng = np.random.default_rng(2)
    time = np.r_[np.arange(1000), np.arange(1020, 2020)] * 0.125
    values = 5.0 + rng.standard_normal((2000, 3))
    mean, variance = estimate_in_stretch(time, values, np.arange(1000, 1020) * 0.125)
    assert np.all(np.abs(mean.mean(axis=0) - 5.0) < 3.0 * np.sqrt(variance)) and np.all(np.sqrt(variance) < 0.15)


def test_the_origin_of_time_has_no_effect():
    time = 0.125 * np.arange(80)
    lost = (np.arange(80) >= 30) & (np.arange(80) < 50)
    _, read = drawn(np.random.default_rng(3), time, 2.0, 3.0, 1.0)
    estimates = [
        estimate_in_stretch(start + time[~lost], read[~lost, None], start + time[lost]) for start in (0.0, 64.0)
    ]
    np.testing.assert_allclose(estimates[1][0], estimates[0][0], rtol=1e-9)
    np.testing.assert_allclose(estimates[1][1], estimates[0][1], rtol=1e-9)


def test_three_observations_are_the_fewest_from_which_a_process_is_estimated():
    mean, variance = estimate_in_stretch(np.arange(3.0), np.array([[1.0], [1.1], [0.9]]), np.array([3.0, 4.0]))
    assert np.all(mean > 0.05) and 0.0 < variance[0] < 1.0


def test_few_observations_give_their_size_as_the_sigma():
    wanted = np.array([1.0, 2.0])
    mean, variance = estimate_in_stretch(np.array([0.0, 3.0]), np.array([[3.0, 0.0], [4.0, 2.0]]), wanted)
    np.testing.assert_array_equal(mean, np.zeros((2, 2)))
    np.testing.assert_allclose(variance, [12.5, 2.0])
    np.testing.assert_allclose(estimate_in_stretch(np.zeros(1), np.array([[3.0]]), wanted)[1], [9.0])
    mean, variance = estimate_in_stretch(np.zeros(0), np.zeros((0, 2)), wanted)
    np.testing.assert_array_equal(mean, np.zeros((2, 2)))
    np.testing.assert_array_equal(variance, [0.0, 0.0])
    mean, variance = estimate_in_stretch(np.arange(5.0), np.zeros((5, 1)), wanted + 5.0)
    assert np.all(mean == 0.0) and np.all(variance >= 0.0) and np.isfinite(variance).all()
