"""An effect switched on: phases, of which whole turns mean nothing."""

import numpy as np
import pytest

from edl_filter.effects.catalogue import effect_named
from edl_filter.effects.effect import Active


def wave(phase):
    return Active(effect_named("density_wave"), {"A": 0.1, "L": 1e4, "phase": phase})


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
def test_phases_are_brought_into_one_turn(turns):
    found = wave(0.3 + turns * 2.0 * np.pi).in_one_turn()
    assert found.values == pytest.approx({"A": 0.1, "L": 1e4, "phase": 0.3})
    assert 0.0 <= wave(-1e-17).in_one_turn().values["phase"] <= 2.0 * np.pi
    other = Active(effect_named("wind"), {"east": 700.0})
    assert other.in_one_turn().values == other.values


@pytest.mark.parametrize("phase", [0.0, 0.3, 4.0])
def test_an_amplitude_is_told_without_a_sign(phase):
    """Half a turn further on it is the same wave."""
    found = Active(effect_named("density_wave"), {"A": -0.1, "L": 1e4, "phase": phase})
    told, altitude = found.in_one_turn(), np.linspace(0.0, 1e5, 50)
    assert told.values["A"] == 0.1 and 0.0 <= told.values["phase"] < 2.0 * np.pi
    density = found.effect.density
    np.testing.assert_allclose(density(told.values, altitude), density(found.values, altitude), atol=1e-12)


def test_a_change_does_not_count_whole_turns():
    assert wave(6.2).change_from(wave(0.1).values, "phase") == pytest.approx(0.1 - 6.2 + 2.0 * np.pi)
    assert wave(0.1).change_from(wave(6.2).values, "phase") == pytest.approx(0.1 - 6.2 + 2.0 * np.pi)
    assert wave(0.1).change_from(wave(0.4).values, "phase") == pytest.approx(0.3)
    assert wave(0.1).change_from(wave(0.4).values | {"L": 2e4}, "L") == pytest.approx(1e4)
