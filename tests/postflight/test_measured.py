"""The database's coefficients through the sampling and smoothing of a flight's."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.postflight.comparison import DatabaseCoefficients
from edl_filter.postflight.measured import as_measured
from edl_filter.postflight.rates import batch_smoother

TIME = np.arange(0.0, 40.0, 0.125)
INNER = slice(40, -40)
NAMES = ("CA", "CN", "CY", "Cl", "Cm", "Cn")
MASS, DIAMETER = 832.0, 2.65
INERTIA = np.array([[270.0, 5.0, -3.0], [5.0, 205.0, 2.0], [-3.0, 2.0, 210.0]])
SMOOTHER = batch_smoother(TIME)


def measured(values, rate=(0.2, 0.03, -0.01), density=1e-3):
    """Of coefficients by name; the density may vary over the flight."""
    database = DatabaseCoefficients(values, {"CN": TIME}, {"CN": 3.0 * TIME}, np.zeros(len(TIME), bool))
    atmosphere = SimpleNamespace(density=np.broadcast_to(density, TIME.shape))
    rates = np.tile(np.asarray(rate, float), (len(TIME), 1))
    return as_measured(
        database, atmosphere, SMOOTHER, rates, np.full(len(TIME), 3000.0), MASS, DIAMETER, INERTIA
    )  # fmt: skip


def constant():
    return {name: np.full(len(TIME), 0.01 * (k + 1)) for k, name in enumerate(NAMES)}


def test_constant_coefficients_at_a_constant_rate_are_not_changed():
    """The gyroscopic moment of the rate is no part of them."""
    result = measured(constant())
    for name, value in constant().items():
        np.testing.assert_allclose(result.value[name], value, rtol=1e-9, atol=1e-12)


def test_an_oscillation_is_attenuated_as_that_of_forces_and_moments_is():
    """Forces by the means and the smoothing, moments by the derivative of smoothed means; about a principal axis."""
    wave = np.sin(2.0 * np.pi * 0.7 * TIME)
    result = measured(
        constant() | {"CA": 3.0 * wave, "CN": wave, "CY": 2.0 * wave, "Cl": 0.0 * wave, "Cm": wave, "Cn": wave},
        (0, 0, 0),
    )
    force = SMOOTHER.as_smoothed(wave[:, None])[:, 0]
    moment = SMOOTHER.as_derived(wave[:, None])[:, 0]
    np.testing.assert_allclose(result.value["CA"][INNER], 3.0 * force[INNER], atol=1e-12)
    np.testing.assert_allclose(result.value["CN"][INNER], force[INNER], atol=1e-12)
    np.testing.assert_allclose(result.value["CY"][INNER], 2.0 * force[INNER], atol=1e-12)
    np.testing.assert_allclose(result.value["Cm"][INNER], moment[INNER], atol=1e-12)
    assert 0.5 < np.ptp(moment[INNER]) / np.ptp(wave) < np.ptp(force[INNER]) / np.ptp(wave) < 0.99


def test_it_is_the_force_that_is_smoothed_and_not_the_coefficient():
    """Where the density grows linearly, a coefficient that falls as its inverse is that of a constant force."""
    density = 1e-3 * (1.0 + TIME / 40.0)
    values = dict.fromkeys(NAMES, 0.01 * 0.001 / density)
    result = measured(values, (0, 0, 0), density)
    for name in NAMES:
        np.testing.assert_allclose(result.value[name], values[name], rtol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_a_sample_without_a_look_up_leaves_a_gap_of_its_batches_and_nothing_else(name):
    values = constant()
    for lost in values.values():
        lost[150] = np.nan
    result = measured(values)
    missing = np.flatnonzero(np.isnan(result.value[name]))
    reach = int(SMOOTHER.points.max())
    np.testing.assert_array_equal(missing, np.arange(150 - reach, 150 + reach + 1))
    kept = np.setdiff1d(np.arange(len(TIME)), missing)
    # the integral of the derivative reaches two samples farther, with a weight of 6e-5
    np.testing.assert_allclose(result.value[name][kept], constant()[name][kept], rtol=1e-4)


def test_sigmas_are_those_of_the_database():
    result = measured(constant())
    np.testing.assert_array_equal(result.three_sigma["CN"], 3.0 * TIME)
    np.testing.assert_array_equal(result.angle_sigma["CN"], TIME)
