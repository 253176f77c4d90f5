"""The gas of a mission: by name, by composition, by constants; keys of earlier releases are refused with advice."""

import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.world import CompositionConfig
from edl_filter.pipeline.load import gas_of, read_atmosphere
from edl_filter.planet.gas import MARS, NAMED_GASES, SPECIES, Gas, mixture


def gas(*overrides, mission="practice_mer"):
    return gas_of(Mission.load(f"builtin:{mission}", overrides))


def test_names():
    assert gas() == Gas()
    assert gas("atmosphere.gas=mars") == NAMED_GASES["mars"]
    for mission in ("mer_a", "mer_b", "phoenix"):
        assert gas(mission=mission) == NAMED_GASES["mars"]


def test_a_composition_is_divided_by_its_sum():
    stated = gas("atmosphere.gas={composition: {CO2: 0.9532, N2: 0.027, Ar: 0.016, O2: 0.0013, CO: 0.0008}}")
    assert stated == mixture({"CO2": 0.9532, "N2": 0.027, "Ar": 0.016, "O2": 0.0013, "CO": 0.0008})
    assert set(CompositionConfig.model_fields) == set(SPECIES) >= set(MARS)


def test_constants():
    stated = gas("atmosphere.gas={constant: 191.0, heat_capacity_ratio: 1.4}")
    assert (stated.constant, stated.heat_capacity_ratio(150.0)) == (191.0, 1.4)
    constants = "{constant: 188.92, heat_capacity_ratio: 1.3, molecule_diameter: 4.64e-10, molecule_mass: 7.3079e-26}"
    stated = gas(f"atmosphere.gas={constants}")
    assert stated.mean_free_path(1e-5) == Gas().mean_free_path(1e-5)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("atmosphere.gas={composition: {CO2: 0.95}}", r"found fractions with the sum 0.95; expected mole fractions"),
        ("atmosphere.gas={composition: {CO2: 95.3, N2: 4.7}}", r"is it in %"),
        ("atmosphere.gas={composition: {CO2: 0.9, He: 0.1}}", r"composition.He: found an unknown key"),
        ("atmosphere.gas={constant: 191.0}", r"heat_capacity_ratio: found nothing; expected a required key"),
        ("atmosphere.gas={constant: 0.191, heat_capacity_ratio: 1.3}", r"is it in kJ/\(kg K\)"),
        (
            "atmosphere.gas_constant=188.92",
            r"gas_constant: found 188.92; expected no such key since 0.2: 'gas: thesis'",
        ),
        ("atmosphere.heat_capacity_ratio=1.33", r"heat_capacity_ratio: found 1.33; .*'gas: mars'"),
    ],
)
def test_wrong_values_say_what_is_accepted(override, message):
    with pytest.raises(InputError, match=message):
        gas(override)


def test_the_rovers_preflight_table_keeps_its_pressures():
    practice, rover = (read_atmosphere(Mission.load(f"builtin:{m}")) for m in ("practice_mer", "mer_a"))
    for h in (0.0, 4e4, 1e5):
        pressures = [a.density(h) * a.gas.constant * a.temperature_at(h) for a in (practice, rover)]
        assert pressures[1] == pytest.approx(pressures[0], rel=1e-12)
    assert rover.temperature_at(4e4) < practice.temperature_at(4e4)
