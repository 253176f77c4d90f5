"""Random errors of the air: of a table, and as an effect."""

import numpy as np
import pytest

from edl_filter.simulation.air_errors import AirError, air_with_errors


def test_a_table_has_the_stated_sigmas_and_keeps_altitude_and_temperature():
    air = np.column_stack((np.arange(0.0, 100e3, 5e3), np.ones(20), np.full(20, 200.0), np.zeros((20, 2))))
    random = np.random.default_rng(1)
    drawn = np.array([air_with_errors(random, air, 0.1, 10.0, 10e3) for _ in range(500)])
    assert np.sqrt(np.mean((drawn[:, :, 1] - 1.0) ** 2)) == pytest.approx(0.1, rel=0.1)
    assert np.sqrt(np.mean(drawn[:, :, 3:] ** 2, axis=(0, 1))) == pytest.approx([10.0, 10.0], rel=0.1)
    assert np.array_equal(drawn[0][:, [0, 2]], air[:, [0, 2]]) and np.all(air[:, 1] == 1.0)


def test_the_effect_has_the_stated_sigmas_and_is_constant_outside():
    altitude = np.array([-20e3, -10e3, 40e3, 41e3, 200e3, 300e3])
    errors = [AirError(np.random.default_rng(seed), 0.05, 8.0, 10e3) for seed in range(400)]
    factor = np.array([e.density({}, altitude) for e in errors])
    wind = np.array([e.wind({}, altitude) for e in errors])
    assert factor[:, 2].std() == pytest.approx(0.05, rel=0.18) and wind[:, 2].std() == pytest.approx(8.0, rel=0.18)
    assert np.array_equal(factor[:, 0], factor[:, 1]) and np.array_equal(wind[:, 4], wind[:, 5])
    assert np.corrcoef(factor[:, 2], factor[:, 3])[0, 1] > 0.98
    assert wind.shape == (400, 6, 2)


def test_a_density_of_many_sigmas_stays_positive():
    assert AirError(np.random.default_rng(0), 5.0, 0.0, 10e3).density({}, np.linspace(0.0, 1e5, 50)).min() > 0.0
