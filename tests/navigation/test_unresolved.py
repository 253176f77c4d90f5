"""Noise of unresolved motion: constants against simulated processes, and NEES of noisy integration."""

import numpy as np
import pytest
from scipy.stats import chi2

from edl_filter.estimation.interpolating_spline import integral_spline
from edl_filter.navigation.rotation_corrections import rotation_corrections
from edl_filter.navigation.unresolved import (
    covariance_root,
    intensity_sigma,
    moment_covariance,
    moment_weights,
    second_difference,
    unresolved_motion,
)

FINE = 64  # steps of a simulated process in one sample


def process(rng, order, count, runs):
    """Values ``(count * FINE, runs)`` of unit white noise, integrated `order` times, for samples of length 1."""
    x = rng.standard_normal((count * FINE, runs)) * np.sqrt(FINE)
    for _ in range(order):
        x = np.cumsum(x, axis=0) / FINE - 0.5 * x / FINE
    return x


def means_and_moment(x, middle):
    """Means over the samples, ``(N, runs)``, and the first moment inside one of them, ``(runs,)``."""
    cells = x.reshape(-1, FINE, x.shape[1])
    time = (np.arange(FINE) + 0.5) / FINE - 0.5
    return cells.mean(axis=1), time @ cells[middle] / FINE


@pytest.mark.parametrize("order", [pytest.param(0, marks=pytest.mark.slow), 1, pytest.param(2, marks=pytest.mark.slow)])
def test_moment_covariance_is_that_of_a_simulated_process(order):
    """Variance, and covariances of two samples at distances of 1 and 2."""
    x = process(np.random.default_rng(order), order, 45, 20000)
    errors = []
    for middle in (20, 21, 22):
        means, moment = means_and_moment(x, middle)
        errors.append(moment - moment_weights(5) @ means[middle - 20 : middle + 21])
    expected = moment_covariance(order)
    for distance in (0, 1, 2):
        covariance = np.mean(errors[0] * errors[distance])
        assert covariance == pytest.approx(expected[distance], abs=0.03 * expected[0])


def test_the_wiener_constant_is_near_its_lower_limit():
    """The cubic spline is the optimum for a Wiener rate; the quintic one loses 1 %. With the rate known at the edges
    the bridge between them has the variance 1/720."""
    cubic, quintic = moment_covariance(1, 3)[0], moment_covariance(1, 5)[0]
    assert 1.0 / 720.0 < cubic < quintic < 1.04 * cubic


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_root_of_the_covariance_has_it_as_its_convolution(order):
    root, covariance = covariance_root(order), moment_covariance(order)
    square = np.convolve(root, root)[len(root) - 1 :]
    np.testing.assert_allclose(square[:10], covariance[:10], atol=2e-3 * covariance[0])


@pytest.mark.parametrize("order", [1, 2])
def test_the_intensity_of_a_process_is_recovered_from_its_means(order):
    """On average over the samples, with any length of them."""
    rng = np.random.default_rng(5)
    h, s = 0.125, 3.0
    means, _ = means_and_moment(process(rng, order, 60, 400), 30)
    means = s * h ** (order - 0.5) * means  # a process of intensity s² over samples of length h
    interval = np.full(60, h)
    edges = np.concatenate(([0.0], np.cumsum(interval)))
    estimate = intensity_sigma(edges, interval, means, order)[10:-10]
    assert np.sqrt(np.mean(estimate**2)) == pytest.approx(s, rel=0.03)


def test_steady_change_is_resolved():
    t = np.arange(20.0)[:, None]
    rate = 0.5 + t * [0.01, 0.02, 0.0]
    for sigma in unresolved_motion(0.125 * (t[:, 0] + 1.0), np.full(20, 0.125), np.zeros((20, 3)), rate):
        np.testing.assert_allclose(sigma, 0.0, atol=1e-9)


def test_an_oscillation_that_is_sampled_well_has_no_noise_to_speak_of():
    """0.55 Hz at 8 Hz: below a twentieth of the coning that a sample has, and of the noise of a gyro (2e-5 rad/s).

    The errors of a coning about x are about x.
    """
    time = 0.125 * np.arange(1, 81)
    rate = 0.2 * np.column_stack((0.0 * time, np.cos(3.4 * time), np.sin(3.4 * time)))
    _, sigma, in_sample = unresolved_motion(time, np.full(80, 0.125), np.zeros((80, 3)), rate)
    coning = 0.125 / 12.0 * 0.2**2 * 3.4 * 0.125
    sigma, in_sample = sigma[10:-10], in_sample[10:-10]
    assert np.all(np.sqrt(np.mean(sigma**2, axis=1)) < 0.05 * coning) and np.all(in_sample < 0.05 * coning)
    assert np.all(sigma[:, 0] > 0.0) and not sigma[:, 1:].any()


def rotation_errors(order, impacts_from, steady_force=None, runs=120, count=230, h=0.125):
    """Errors of the summed rotation and of the summed velocity over their sigmas, ``(runs, 3)`` each.

    And errors of the rotation over single samples over their sigma, ``(runs * samples, 3)``.
    """
    rng = np.random.default_rng(20 + order)
    time, interval = h * np.arange(1, count + 1), np.full(count, h)
    inner = slice(15, count - 15)
    turns, gains, single = [], [], []
    for _ in range(runs):
        steady = rng.standard_normal((2, 3)) * [[0.3], [5.0]]
        rate = steady[0] + 0.03 * h ** (order - 0.5) * process(rng, order, count, 3)
        jumps = 3.0 * h ** (order - 1.5) * process(rng, order - 1, count, 3)
        force = steady[1] + jumps if steady_force is None else np.zeros_like(jumps) + steady_force
        cells = [x.reshape(count, FINE, 3) for x in (rate, force)]
        mean_rate, mean_force = (x.mean(axis=1) for x in cells)
        step = h / FINE
        angle, velocity = (np.cumsum(x, axis=1) * step - 0.5 * step * x for x in cells)
        exact_turn = 0.5 * step * np.cross(angle, cells[0]).sum(axis=1)
        exact_gain = 0.5 * step * (np.cross(angle, cells[1]) + np.cross(velocity, cells[0])).sum(axis=1)
        to_force, to_rate = rotation_corrections(time, interval, mean_force, mean_rate)
        to_force -= np.cross(mean_rate, np.cross(mean_rate, mean_force)) * h**2 / 24.0
        force_sigma, rate_sigma, in_sample = unresolved_motion(time, interval, mean_force, mean_rate, impacts_from)
        single.append(((exact_turn - to_rate * h) / (in_sample * h)[:, None])[inner])
        for out, error, sigma in (
            (turns, exact_turn - to_rate * h, rate_sigma), (gains, exact_gain - to_force * h, force_sigma)
        ):  # fmt: skip
            out.append(error[inner].sum(axis=0) / np.sqrt(np.sum((sigma[inner] * h) ** 2, axis=0)))
    return np.array(turns), np.array(gains), np.concatenate(single)


@pytest.mark.parametrize(("order", "impacts_from"), [(2, np.inf), (1, -np.inf)], ids=["flight", "impacts"])
def test_nees_of_integrated_rotation_and_velocity(order, impacts_from):
    """Rates and forces drawn from the stated processes: errors of sums over 200 samples have the stated variance.

    The ends of a stretch, where errors do not cancel, add 3 % in flight.
    """
    turns, gains, single = rotation_errors(order, impacts_from)
    low, high = chi2.ppf([0.001, 0.999], turns.size) / turns.size
    assert low < np.mean(turns**2) < high
    assert low < np.mean(gains**2) < high
    assert np.mean(single**2) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("order", "impacts_from"), [(2, np.inf), (1, -np.inf)], ids=["flight", "impacts"])
def test_nees_of_the_velocity_that_a_steady_force_gives_to_an_unresolved_rotation(order, impacts_from):
    """The force is along x, so that the errors are along y and z alone, whatever the direction of the moment."""
    _, gains, _ = rotation_errors(order, impacts_from, steady_force=[-50.0, 0.0, 0.0])
    transverse = gains[:, 1:]
    low, high = chi2.ppf([0.001, 0.999], transverse.size) / transverse.size
    assert low < np.mean(transverse**2) < high


def test_second_difference_is_the_deviation_from_both_neighbours():
    x = np.array([[0.0], [1.0], [5.0], [3.0]])
    np.testing.assert_allclose(second_difference(x)[:, 0], [0.0, -1.5, 3.0, 0.0])


def test_short_records_have_no_noise_from_splines():
    interval = np.full(3, 0.1)
    edges = 0.1 * np.arange(4)
    assert not intensity_sigma(edges, interval, np.random.default_rng(0).standard_normal((3, 3)), 2).any()
    assert integral_spline(edges, interval, np.ones((3, 1))).degree == 3
