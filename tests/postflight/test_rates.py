"""Smoothing of rates, and angular acceleration."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.postflight.rates import batch_smoother, box_mean


def test_batches_keep_their_length_in_time():
    slow, fast = np.arange(0, 20, 0.25), np.arange(20, 60, 0.125)
    filters = batch_smoother(np.concatenate((slow, fast)))
    assert set(filters.points[:70]) == {5} and set(filters.points[90:]) == {7}
    assert batch_smoother(np.arange(0, 10, 0.005)).points[0] == 175
    assert filters.bandwidth[7] == pytest.approx(1.28, abs=0.01)
    assert filters.acceleration_bandwidth[7] < filters.bandwidth[7]


def test_quadratics_pass_unchanged():
    t = np.sort(np.concatenate((np.arange(0, 10, 0.25), np.arange(10, 20, 0.125))))
    filters = batch_smoother(t)
    x = np.stack((1 + t - 0.1 * t**2, 3 * t, t**2), axis=1)
    np.testing.assert_allclose(filters.smooth(x), x, atol=1e-9)
    want = np.stack((1 - 0.2 * t, 3 + 0 * t, 2 * t), axis=1)
    np.testing.assert_allclose(filters.differentiate(x), want, atol=1e-8)


def test_gains_are_the_scatter_of_white_noise_ends_included():
    t, rng = np.arange(120) * 0.125, np.random.default_rng(3)
    filters = batch_smoother(t)
    noise = rng.normal(size=(120, 4000))
    np.testing.assert_allclose(filters.smooth(noise).std(axis=1), filters.gain, rtol=0.06)
    np.testing.assert_allclose(filters.differentiate(noise).std(axis=1), filters.acceleration_gain, rtol=0.06)


def test_a_low_pass_before_the_batches():
    """Gains are the scatter of white noise, bandwidths those of sines; the predictions go the same way."""
    t, rng = np.arange(900) * 0.005, np.random.default_rng(3)
    plain, filters = batch_smoother(t, 0.025), batch_smoother(t, 0.025, 17.0)
    assert filters.points[0] == plain.points[0] == 5
    noise, middle = rng.normal(size=(900, 600)), slice(300, 600)
    for values, gain in (
        (filters.smooth(noise), filters.gain),
        (filters.differentiate(noise), filters.acceleration_gain),
    ):
        np.testing.assert_allclose(np.sqrt(np.mean(values[middle] ** 2)), gain[450], rtol=0.02)
    assert filters.gain[450] < 0.7 * plain.gain[450]
    assert filters.bandwidth[5] < plain.bandwidth[5]
    for bandwidth, response in (
        (filters.bandwidth[5], lambda w: filters.smooth(np.cos(w * t)[:, None])),
        (filters.acceleration_bandwidth[5], lambda w: filters.differentiate(np.sin(w * t)[:, None]) / w),
    ):
        w = 2 * np.pi * bandwidth
        got, wave = response(w)[middle, 0], np.cos(w * t)[middle]
        assert got @ wave / (wave @ wave) == pytest.approx(np.sqrt(0.5), rel=5e-3)
    smooth = np.sin(2 * np.pi * 2.0 * t)[:, None]
    np.testing.assert_array_equal(filters.as_smoothed(smooth), filters.smooth(box_mean(smooth)))


def test_a_low_pass_needs_even_samples_and_a_frequency_below_nyquist():
    uneven = np.concatenate((np.arange(0, 20, 0.25), np.arange(20, 60, 0.125)))
    with pytest.raises(InputError, match=r"low_pass_hz: found sampling intervals from 0.125 to 0.25 s"):
        batch_smoother(uneven, 0.875, 1.0)
    with pytest.raises(InputError, match="Nyquist"):
        batch_smoother(np.arange(0, 60, 0.125), 0.875, 4.5)


def test_bandwidth_of_the_angular_acceleration():
    t = np.arange(0, 60, 0.125)
    filters = batch_smoother(t)
    w = 2 * np.pi * filters.acceleration_bandwidth[7]
    got = filters.differentiate(np.sin(w * t)[:, None])[40:-40, 0] / w
    reference = np.cos(w * t)[40:-40]
    assert got @ reference / (reference @ reference) == pytest.approx(np.sqrt(0.5), rel=2e-3)


def test_a_model_is_filtered_as_the_sensor_is():
    """Means over the intervals of a true rate, differenced, against the true derivative filtered likewise."""
    dt, w = 0.125, 2 * np.pi * 0.7
    t = np.arange(0, 40, dt)
    filters = batch_smoother(t)
    mean_rate = (np.sin(w * t) * np.sinc(w * dt / 2 / np.pi))[:, None]
    got = filters.as_derived((w * np.cos(w * t))[:, None])[20:-20]
    want = filters.differentiate(mean_rate)[20:-20]
    assert np.abs(got - want).max() < 0.002 * np.abs(want).max()
    np.testing.assert_allclose(
        filters.as_smoothed(np.sin(w * t)[:, None])[20:-20], filters.smooth(mean_rate)[20:-20], atol=5e-4
    )


def test_too_few_samples():
    with pytest.raises(InputError, match="more than 5 samples"):
        batch_smoother(np.arange(4.0))


def test_one_noisy_sample_is_noisy_for_all_that_its_batch_reaches():
    """Its variance is spread evenly over its reach, and the sum of variances there is that of the weights."""
    n, bad = 121, 60
    filters = batch_smoother(0.125 * np.arange(float(n)))
    sample = np.full(n, 1e-3)
    sample[bad] = 0.1
    distance, impulses = np.abs(np.arange(n) - bad), np.eye(n)
    for weights, stated, reach in (
        (filters.smooth(impulses), filters.smoothed_sigma(sample), 3),
        (filters.differentiate(impulses), filters.acceleration_sigma(sample), 7),
    ):
        exact = np.sqrt(weights**2 @ sample**2)
        far, near = distance > reach, distance <= reach
        np.testing.assert_allclose(stated[far][10:-10], exact[far][10:-10], rtol=1e-9)
        np.testing.assert_allclose(stated[near], stated[bad], rtol=1e-9)
        assert stated[bad] > 5.0 * np.median(stated)
        # 1e-3: share of the other samples, which the mean counts alike
        assert np.mean(stated[near] ** 2) == pytest.approx(np.mean(exact[near] ** 2), rel=1e-3)
