"""The compiled process noise and on-board rotation against readable twins."""

from dataclasses import replace

import numpy as np
import pytest
import twins
from compiled_cases import filled, uneven_samples

from edl_filter import rotations
from edl_filter.navigation.compiled_noise import in_body_axes, noise_of_samples, onboard_rotation_jacobians
from edl_filter.navigation.noise import IDENTITY, increment_variances, sample_attitudes


@pytest.mark.parametrize(("force", "rate"), [(0.0, 0.0), (0.3, 0.0), (0.0, 0.02), (0.3, 0.02)])
def test_noise_of_samples_is_that_of_the_reference(force, rate):
    """All blocks, by the whole rate noise and by the part that an on-board attitude does not share."""
    random = np.random.default_rng(6)
    s, attitude = filled(uneven_samples(random), random, force, rate), rotations.normalise(random.standard_normal(4))
    middle, end = sample_attitudes(s.interval, s.rate, attitude)
    own = np.sqrt(s.rate_noise**2 - s.shared_rate_noise**2)
    force_noise = np.hypot(s.force_noise, s.force_fill_sigma)
    covariances = noise_of_samples(s.interval, middle, s.force, *increment_variances(s))
    for covariance, rate_noise in zip(covariances, (s.rate_noise, own), strict=True):
        rate_sigma = np.hypot(rate_noise, s.rate_fill_sigma)
        expected = twins.process_noise(replace(s, force_noise=force_noise, rate_noise=rate_sigma), attitude)
        scale = np.sqrt(np.diag(expected))
        before = covariance.copy()
        turned = in_body_axes(covariance, end)
        np.testing.assert_allclose(turned / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-13)
        np.testing.assert_array_equal(covariance, before)


@pytest.mark.parametrize("axis", range(3))
def test_noise_along_one_axis_is_in_the_part_that_an_on_board_attitude_does_not_share(axis):
    """Without noise of the forces and with no shared noise both covariances are equal."""
    random = np.random.default_rng(8)
    s = uneven_samples(random)
    middle, _ = sample_attitudes(s.interval, s.rate, rotations.normalise(random.standard_normal(4)))
    variance = np.zeros_like(s.force)
    variance[:, axis] = 1e-8
    covariance, unshared = noise_of_samples(s.interval, middle, s.force, 0.0 * variance, variance, variance)
    assert np.all(np.diag(covariance)[6:] > 0.0)
    np.testing.assert_array_equal(unshared, covariance)


def onboard_rotation(samples):
    """Derivatives by rate and by mounting, as sums of matrices."""
    middle, end = sample_attitudes(samples.interval, samples.rate, IDENTITY)
    weight = np.where(samples.coning_corrected, 0.0, samples.interval)
    to_end = rotations.to_matrix(rotations.multiply(rotations.conjugate(end), middle)) * weight[:, None, None]
    return -to_end.sum(axis=0), np.einsum("nij,njk->ik", to_end, rotations.cross_matrix(samples.rate))


def test_derivatives_of_the_onboard_rotation_are_those_of_the_reference():
    """They do not depend on the attitude at the beginning."""
    random = np.random.default_rng(7)
    s = uneven_samples(random)
    assert s.coning_corrected.any() and not s.coning_corrected.all()
    middle, end = sample_attitudes(s.interval, s.rate, rotations.normalise(random.standard_normal(4)))
    jacobians = onboard_rotation_jacobians(s.interval, s.rate, s.coning_corrected, middle, end)
    for jacobian, expected in zip(jacobians, onboard_rotation(s), strict=True):
        np.testing.assert_allclose(jacobian, expected, rtol=1e-13, atol=1e-14)
