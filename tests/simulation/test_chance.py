"""Random errors of the preflight atmosphere: their statistics over many seeds.

The tolerances are four standard deviations of the sampling distribution of normal deviates. Altitudes four correlation
lengths apart have a correlation of 0.008, so that they count as independent samples: ``SEEDS`` times the number of
altitudes is the size n of each sample. A standard deviation about a known mean of zero then has the relative standard
deviation ``1/√(2n)``, a correlation r that of ``(1 - r²)/√n``.
"""

import numpy as np
import pytest

from edl_filter.simulation.chance import HIGH, LOW, weather

SEEDS = 200
DENSITY_SIGMA, WIND_SIGMA, LENGTH = 0.02, 8.0, 10e3
ALTITUDES = np.arange(0.0, 190e3, 4.0 * LENGTH)
COUNT = SEEDS * len(ALTITUDES)
#: Of a process of Matérn of order 3/2 at one correlation length: ``(1 + √3) exp(-√3)``.
AT_ONE_LENGTH = 0.4833577


def errors(altitude):
    """Errors of density, wind towards east and towards north over their sigmas, ``(3, SEEDS · altitudes)``."""
    samples = []
    for seed in range(SEEDS):
        density, wind = weather(np.random.default_rng(seed), DENSITY_SIGMA, WIND_SIGMA, LENGTH)
        relative = density.effect.density({}, altitude) - 1.0
        samples.append(np.vstack((relative / DENSITY_SIGMA, wind.effect.wind({}, altitude).T / WIND_SIGMA)))
    return np.concatenate(samples, axis=1)


@pytest.fixture(scope="module")
def drawn():
    return errors(ALTITUDES)


def test_weather_is_the_same_for_the_same_stream():
    h = np.linspace(-5e3, 150e3, 50)
    (density, wind), (repeated, again) = (weather(np.random.default_rng(3), 0.01, 0.5, 1e4) for _ in range(2))
    np.testing.assert_array_equal(density.effect.density({}, h), repeated.effect.density({}, h))
    np.testing.assert_array_equal(wind.effect.wind({}, h), again.effect.wind({}, h))
    assert wind.effect.wind({}, h).shape == (50, 2)


def test_errors_have_the_stated_sigmas_and_no_mean(drawn):
    """At the nodes; tolerances 9 % of a standard deviation, and 0.13 sigma of a mean."""
    np.testing.assert_allclose(np.sqrt(np.mean(drawn**2, axis=1)), 1.0, atol=4.0 / np.sqrt(2.0 * COUNT))
    np.testing.assert_allclose(drawn.mean(axis=1), 0.0, atol=4.0 / np.sqrt(COUNT))


def test_errors_have_the_stated_sigmas_between_the_nodes():
    between = errors(ALTITUDES + 500.0)
    np.testing.assert_allclose(np.sqrt(np.mean(between**2, axis=1)), 1.0, atol=4.0 / np.sqrt(2.0 * COUNT))


def test_the_correlation_at_one_length_is_that_of_a_matern_process(drawn):
    """Tolerance 0.097 for each of the three, 0.056 for their mean: an exponential has 0.368, a Gaussian 0.607."""
    shifted = errors(ALTITUDES + LENGTH)
    correlation = np.mean(drawn * shifted, axis=1) / np.sqrt(np.mean(drawn**2, axis=1) * np.mean(shifted**2, axis=1))
    tolerance = 4.0 * (1.0 - AT_ONE_LENGTH**2) / np.sqrt(COUNT)
    np.testing.assert_allclose(correlation, AT_ONE_LENGTH, atol=tolerance)
    assert correlation.mean() == pytest.approx(AT_ONE_LENGTH, abs=tolerance / np.sqrt(3.0))


def test_density_and_both_components_of_the_wind_are_independent(drawn):
    """Tolerance 0.13."""
    np.testing.assert_allclose(np.corrcoef(drawn) - np.eye(3), 0.0, atol=4.0 / np.sqrt(COUNT))


def test_beyond_the_drawn_altitudes_the_last_value_holds():
    density, wind = weather(np.random.default_rng(3), 0.01, 0.5, 1e4)
    for end, beyond, within in ((LOW, LOW - 5e3, LOW + 5e3), (HIGH, HIGH + 50e3, HIGH - 5e3)):
        inside, outside = np.array([end]), np.array([beyond])
        assert density.effect.density({}, np.array([within])) != density.effect.density({}, inside)
        np.testing.assert_array_equal(density.effect.density({}, outside), density.effect.density({}, inside))
        np.testing.assert_array_equal(wind.effect.wind({}, outside), wind.effect.wind({}, inside))
