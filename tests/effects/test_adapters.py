"""Atmosphere with effects, as the post-flight layer and the constraints use it."""

from dataclasses import replace

import numpy as np
from standins import PLANET

from edl_filter.effects import EffectInstance
from edl_filter.effects.adapters import atmosphere_with_effects
from edl_filter.effects.forward_model import compose_air_rotation
from edl_filter.effects.registry import find_effect
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import Gas
from edl_filter.postflight.airdata import wind_shear

H = np.linspace(0.0, 80e3, 41)
TABLE = Atmosphere(H, np.log(1e-2) - H / 11e3, np.full(41, 200.0), np.stack((H / 1e4, -H / 2e4), axis=1), Gas())
WIND = EffectInstance(find_effect("wind"), {"east": 30.0, "north": -20.0, "h_lo": 10e3, "h_hi": 30e3})
WAVE = EffectInstance(find_effect("density_wave"), {"A": 0.2, "L": 12e3})


def test_densities_and_winds_are_the_tables_with_the_effects():
    air = atmosphere_with_effects(TABLE, [WIND, WAVE])
    h = np.array([[2e3, 15e3], [31e3, 95e3]])
    np.testing.assert_allclose(air.density(h) / TABLE.density(h), 1 + 0.2 * np.sin(2 * np.pi * h / 12e3))
    added = air.wind_at(h) - TABLE.wind_at(h)
    np.testing.assert_allclose(added.reshape(4, 2), WIND.effect.wind(WIND.values, h.ravel()))
    np.testing.assert_array_equal(air.temperature_at(h), TABLE.temperature_at(h))
    assert air.density(20e3).shape == () and air.wind_at(20e3).shape == (2,)


def test_shear_has_the_effects_slope():
    air, h = atmosphere_with_effects(TABLE, [WIND]), np.linspace(1e3, 70e3, 300)
    slope = wind_shear(air, h) - wind_shear(TABLE, h)
    expected = np.gradient(WIND.effect.wind(WIND.values, np.linspace(1e3, 70e3, 29901)), axis=0)
    step = 69e3 / 29900
    np.testing.assert_allclose(slope, expected[::100] / step, atol=2e-6)


def test_what_does_not_act_on_the_air_leaves_it_what_it_is():
    mass = EffectInstance(find_effect("mass"), {"k": 0.1})
    assert atmosphere_with_effects(TABLE, [mass]) is TABLE
    assert compose_air_rotation(PLANET, [mass]) is PLANET
    turning = EffectInstance(find_effect("atmosphere_rotation"), {"k": 0.25})
    assert compose_air_rotation(PLANET, [turning]) == replace(PLANET, rotation_rate=0.75 * PLANET.rotation_rate)
