"""Values of effects: their check against the declaration; instances: keys, labels, and phases modulo whole turns."""

import numpy as np
import pytest

from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError


def test_values_are_checked_and_completed():
    effect = find_effect("density_wave")
    assert effect.checked({"A": 0.2}) == {"A": 0.2, "L": 14e3, "phase": 0.0}
    for values, message in (
        ({"B": 0.2}, "B: found an unknown key; expected a parameter of density_wave; accepted: A, L, phase"),
        (
            {"phasse": 0.2},
            "phasse: found an unknown key; .* of density_wave; nearest accepted: phase",
        ),
        ({"A": 2.0}, "A: found 2; expected between -0.9 and 0.9"),
        ({"L": 1e3}, "L: found 1000; expected m between 8000 and 25000"),
        ({"L": np.nan}, "L: found nan; expected m between 8000 and 25000"),
    ):
        with pytest.raises(InputError, match=message):
            effect.checked(values)
    assert find_effect("remnant_torque").checked({"t1": np.inf})["t1"] == np.inf


def test_name_and_imu_identify_an_instance():
    bias = find_effect("gyro_bias")
    driving, checking = EffectInstance(bias, {}), EffectInstance(bias, {"bx": 1e-4}, "secondary")
    assert (driving.key, driving.label) == (("gyro_bias", None), "gyro_bias")
    assert (checking.key, checking.label) == (("gyro_bias", "secondary"), "gyro_bias in secondary")


@pytest.mark.parametrize(
    ("name", "values", "zero"),
    [("gyro_bias", {}, True), ("gyro_bias", {"bz": 1e-9}, False), ("density_wave", {"phase": 2.0}, True)],
)
def test_an_effect_is_zero_where_all_its_sizes_are(name, values, zero):
    assert EffectInstance(find_effect(name), values).is_zero is zero


def test_an_effect_without_sizes_is_never_zero():
    class Delay(Effect):
        name = "delay"
        parameters = (Parameter("tau", "s", "of the samples", 1.0, kind="time"),)

    assert not EffectInstance(Delay(), {}).is_zero


def wave(phase):
    return EffectInstance(find_effect("density_wave"), {"A": 0.1, "L": 1e4, "phase": phase})


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
def test_phases_are_brought_into_one_turn(turns):
    instance = wave(0.3 + turns * 2.0 * np.pi).canonical_phase()
    assert instance.values == pytest.approx({"A": 0.1, "L": 1e4, "phase": 0.3})
    assert 0.0 <= wave(-1e-17).canonical_phase().values["phase"] <= 2.0 * np.pi
    wind = EffectInstance(find_effect("wind"), {"east": 700.0})
    assert wind.canonical_phase().values == wind.values


@pytest.mark.parametrize("phase", [0.0, 0.3, 4.0])
def test_the_canonical_amplitude_is_not_negative(phase):
    """An amplitude of the other sign is a phase half a turn further."""
    instance = EffectInstance(find_effect("density_wave"), {"A": -0.1, "L": 1e4, "phase": phase})
    canonical, altitude = instance.canonical_phase(), np.linspace(0.0, 1e5, 50)
    assert canonical.values["A"] == 0.1 and 0.0 <= canonical.values["phase"] < 2.0 * np.pi
    density = instance.effect.density
    np.testing.assert_allclose(density(canonical.values, altitude), density(instance.values, altitude), atol=1e-12)


def test_values_are_limited_to_their_bounds_and_a_phase_is_not():
    values = {"A": 1.16, "L": 4e3, "phase": -9.0}
    limited = EffectInstance(find_effect("density_wave"), values).within_bounds()
    assert limited.values == {"A": 0.9, "L": 8e3, "phase": -9.0}
    assert limited.within_bounds() == limited
    remnant = EffectInstance(find_effect("remnant_torque"), {"t0": 1e4})  # bounds of a time are the flight's own
    assert remnant.within_bounds().values["t0"] == 1e4


def test_a_change_does_not_count_whole_turns():
    assert wave(6.2).change_from(wave(0.1).values, "phase") == pytest.approx(0.1 - 6.2 + 2.0 * np.pi)
    assert wave(0.1).change_from(wave(6.2).values, "phase") == pytest.approx(0.1 - 6.2 + 2.0 * np.pi)
    assert wave(0.1).change_from(wave(0.4).values, "phase") == pytest.approx(0.3)
    assert wave(0.1).change_from(wave(0.4).values | {"L": 2e4}, "L") == pytest.approx(1e4)
