"""Effects on density, wind and the rotation of the air, against numbers worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from standins import PLANET, H, on

from edl_filter.effects import EffectInstance
from edl_filter.effects.forward_model import compose_air_rotation
from edl_filter.effects.registry import find_effect

RADIUS = 3396190.0


def test_density_scale_is_one_factor():
    effect, p = on("density_scale", k=-0.15)
    np.testing.assert_allclose(effect.density(p, H), 0.85, rtol=1e-15)


def test_density_wave_at_parts_of_a_wavelength():
    """A twelfth of 12 km is 30 degrees, whose sine is one half."""
    effect, p = on("density_wave", A=0.2, L=12e3)
    heights = np.array([0.0, 1e3, 3e3, 6e3, 7e3, 9e3, 15e3])
    np.testing.assert_allclose(effect.density(p, heights), [1.0, 1.1, 1.2, 1.0, 0.9, 0.8, 1.2], rtol=1e-14)
    effect, p = on("density_wave", A=0.2, L=12e3, phase=np.pi / 2.0)
    np.testing.assert_allclose(effect.density(p, heights[:3]), [1.2, 1.0 + 0.1 * np.sqrt(3.0), 1.0], rtol=1e-14)


@given(st.floats(-0.9, 0.9), st.floats(8e3, 25e3), st.floats(0.0, 6.28))
def test_density_wave_has_its_period_and_no_mean(amplitude, length, phase):
    effect, p = on("density_wave", A=amplitude, L=length, phase=phase)
    density, half, one_wavelength = (effect.density(p, H + shift) for shift in (0.0, 0.5 * length, length))
    np.testing.assert_allclose(one_wavelength, density, atol=1e-12)
    np.testing.assert_allclose(half + density, 2.0, atol=1e-12)  # opposite half a wavelength above
    over_a_wavelength = effect.density(p, length * np.arange(64) / 64.0)
    assert np.mean(over_a_wavelength) == pytest.approx(1.0, abs=1e-12)
    assert np.ptp(over_a_wavelength) == pytest.approx(2.0 * abs(amplitude), abs=0.01)


def test_wind_is_half_at_the_edges_of_its_layer_and_full_within():
    """``(1 + tanh 1)/2 = 1/(1 + e⁻²) = 0.8807971`` one scale of 2 km inside an edge, and 1 minus that outside."""
    effect, p = on("wind", east=30.0, north=-20.0, h_lo=10e3, h_hi=50e3)
    heights = np.array([-10e3, 8e3, 10e3, 12e3, 30e3, 48e3, 50e3, 52e3, 70e3])
    inside = [0.0, 0.1192029, 0.5, 0.8807971, 1.0, 0.8807971, 0.5, 0.1192029, 0.0]
    wind = effect.wind(p, heights)
    np.testing.assert_allclose(wind[:, 0] / 30.0, inside, atol=1e-7)
    np.testing.assert_allclose(wind[:, 1] / -20.0, inside, atol=1e-7)


def test_wind_is_symmetric_about_the_middle_of_its_layer():
    effect, p = on("wind", east=30.0, north=-20.0, h_lo=10e3, h_hi=14e3)
    above = np.linspace(0.0, 20e3, 50)
    np.testing.assert_allclose(effect.wind(p, 12e3 + above), effect.wind(p, 12e3 - above), atol=1e-13)


@pytest.mark.parametrize(("k", "rate"), [(0.0, 1.0), (0.25, 0.75), (1.0, 0.0), (-1.0, 2.0)])
def test_air_rotation(k, rate):
    """At the equator the air moves at ``7.088e-5 rad/s · 3396190 m = 240.7219472 m/s`` towards the east (y)."""
    instance = EffectInstance(find_effect("atmosphere_rotation"), {"k": k})
    assert instance.effect.atmosphere_rate(instance.values) == rate
    planet = compose_air_rotation(PLANET, [instance])
    relative = planet.velocity_relative(np.array([RADIUS, 0.0, 0.0]), np.array([0.0, 1000.0, 0.0]))
    np.testing.assert_allclose(relative, [0.0, 1000.0 - 240.7219472 * rate, 0.0], atol=1e-6)
