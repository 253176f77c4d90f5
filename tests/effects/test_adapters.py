"""Atmosphere and database with effects, as their users look them up: the effects applied by hand, and the inverse."""

from dataclasses import replace

import numpy as np
import pytest
from standins import PLANET

from edl_filter.aero.database import load_database
from edl_filter.aero.inverse import angle_from_cm, angle_from_cn
from edl_filter.effects import Effect, EffectInstance
from edl_filter.effects.adapters import atmosphere_with_effects, database_with_effects
from edl_filter.effects.forward_model import compose_air_rotation
from edl_filter.effects.registry import find_effect
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import Gas
from edl_filter.postflight.airdata import wind_shear

H = np.linspace(0.0, 80e3, 41)
TABLE = Atmosphere(H, np.log(1e-2) - H / 11e3, np.full(41, 200.0), np.stack((H / 1e4, -H / 2e4), axis=1), Gas())
WIND = EffectInstance(find_effect("wind"), {"east": 30.0, "north": -20.0, "h_lo": 10e3, "h_hi": 30e3})
WAVE = EffectInstance(find_effect("density_wave"), {"A": 0.2, "L": 12e3})

DATABASE = load_database("builtin:continuum_grid", "builtin:rarefied_grid", family="MER")
MACH, KNUDSEN = np.array([25.0, 18.0, 8.0, 2.5]), np.array([2e-3, 1e-5, 1e-5, 1e-6])
ALPHA = np.radians([1.0, 3.0, 5.0, 7.0])
EFFECTS = [
    EffectInstance(find_effect("axial_force_scale"), {"k": 0.05}),
    EffectInstance(find_effect("normal_force_scale"), {"k": -0.3}),
    EffectInstance(find_effect("base_pressure"), {"a": 0.1}),
    EffectInstance(find_effect("pitching_moment_scale"), {"k": 0.2}),
    EffectInstance(find_effect("static_instability"), {"a": 2e-3}),
]
CHANGED = database_with_effects(DATABASE, EFFECTS)


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


def test_a_look_up_has_the_effects():
    bare, entry = DATABASE.lookup(MACH, KNUDSEN, ALPHA), CHANGED.lookup(MACH, KNUDSEN, ALPHA)
    base = 0.1 * np.maximum(1 - MACH / 10, 0) ** 2
    np.testing.assert_allclose(entry.ca, 1.05 * bare.ca + base)
    np.testing.assert_allclose(entry.cn, 0.7 * bare.cn)
    unstable = 2e-3 * np.exp(-(((MACH - 18) / 4) ** 2)) * np.sin(np.pi * ALPHA / np.radians(8))
    np.testing.assert_allclose(entry.cm_nose, 1.2 * bare.cm_nose + unstable)
    np.testing.assert_array_equal(entry.outside, bare.outside)
    np.testing.assert_array_equal(entry.rarefied, bare.rarefied)


def test_an_effect_that_is_there_once_more_acts_as_well():
    values = {"a": 2e-3, "M0": 8.0}
    first, second = (
        database_with_effects(DATABASE, [EffectInstance(find_effect(name), values)])
        .lookup(MACH, KNUDSEN, ALPHA)
        .cm_nose
        for name in ("static_instability", "static_instability_2")
    )
    assert np.any(first != DATABASE.lookup(MACH, KNUDSEN, ALPHA).cm_nose)
    np.testing.assert_array_equal(second, first)


def test_rows_are_evaluations():
    cut, angles = CHANGED.at(MACH, KNUDSEN), np.radians([0.5, 2.0, 6.0])
    weights = (0.1, 0.27, 1.0)
    rows = cut.rows(angles, weights)
    for k, angle in enumerate(angles):
        np.testing.assert_allclose(rows[:, k], np.asarray(weights) @ cut.evaluate(np.full(4, angle)), rtol=1e-12)
    index = np.array([2, 0])
    np.testing.assert_allclose(cut.take(index).evaluate(ALPHA[index]), cut.evaluate(ALPHA)[:, index])
    np.testing.assert_array_equal(cut.alpha_nodes, DATABASE.at(MACH, KNUDSEN).alpha_nodes)


def test_the_inverse_returns_the_angle():
    entry = CHANGED.lookup(MACH, KNUDSEN, ALPHA)
    back = angle_from_cn(CHANGED, entry.cn, MACH, KNUDSEN, hint=ALPHA)
    np.testing.assert_allclose(back.alpha, ALPHA, atol=1e-6)
    back = angle_from_cm(CHANGED, entry.cm_at(0.27), MACH, KNUDSEN, x_over_d=0.27, hint=ALPHA)
    np.testing.assert_allclose(back.alpha, ALPHA, atol=1e-6)


@pytest.mark.parametrize("name", ["mass", "wind", "remnant_torque"])
def test_without_effects_in_coefficients_it_is_the_same(name):
    assert database_with_effects(DATABASE, [EffectInstance(find_effect(name), {})]) is DATABASE


def test_a_users_coefficients_are_left_to_predictions():
    class PredictedOnly(Effect):
        name = "normal_force_scale"

        def coefficients(self, p, flow, totals):
            raise AssertionError

    assert database_with_effects(DATABASE, [EffectInstance(PredictedOnly(), {})]) is DATABASE
