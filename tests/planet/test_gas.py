"""The gas: heat capacities against published ones, mixtures against closed forms, the thesis's constants."""

import numpy as np
import pytest

from edl_filter.planet.gas import (
    MARS,
    MOLAR_GAS_CONSTANT,
    NAMED_GASES,
    SPECIES,
    Gas,
    gas_of_constants,
    heat_capacity_ratio,
    mixture,
)

#: Coefficients of cp/R from 200 to 1000 K: a1/T² + a2/T + a3 + a4 T + a5 T² + a6 T³ + a7 T⁴ (NASA/TP-2002-211556).
NASA = {
    "CO2": (
        4.943650540e4, -6.264116010e2, 5.301725240, 2.503813816e-3, -2.127308728e-7, -7.689988780e-10, 2.849677801e-13,
    ),
    "N2": (
        2.210371497e4, -3.818461820e2, 6.082738360, -8.530914410e-3, 1.384646189e-5, -9.625793620e-9, 2.519705809e-12,
    ),
    "O2": (
        -3.425563420e4, 4.847000970e2, 1.119010961, 4.293889240e-3, -6.836300520e-7, -2.023372700e-9, 1.039040018e-12,
    ),
    "CO": (
        1.489045326e4, -2.922285939e2, 5.724527170, -8.176235030e-3, 1.456903469e-5, -1.087746302e-8, 3.027941827e-12,
    ),
    "Ar": (0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 0.0),
}  # fmt: skip
#: Heat capacities at 298.15 K, J/(mol K), of the same report.
ROOM = {"CO2": 37.135, "N2": 29.124, "O2": 29.378, "CO": 29.141, "Ar": 20.786}


def nasa_heat_capacity(species, temperature):
    return sum(a * temperature ** (k - 2.0) for k, a in enumerate(NASA[species]))


@pytest.mark.parametrize("species", SPECIES)
def test_the_typed_coefficients_are_those_of_the_report(species):
    assert MOLAR_GAS_CONSTANT * nasa_heat_capacity(species, 298.15) == pytest.approx(ROOM[species], abs=6e-4)


@pytest.mark.parametrize("species", SPECIES)
def test_heat_capacity_agrees_with_the_polynomials_where_they_begin(species):
    """The formula's neglect of anharmonicity grows with the temperature."""
    capacity = SPECIES[species].heat_capacity
    for low, high, tolerance in ((200.0, 300.0, 1e-3), (300.0, 700.0, 3.5e-3)):
        temperature = np.linspace(low, high, 41)
        np.testing.assert_allclose(capacity(temperature), nasa_heat_capacity(species, temperature), rtol=tolerance)


def test_heat_capacity_between_its_limits():
    """Vibrations rest in the cold and have R each in the heat (equipartition)."""
    assert SPECIES["CO2"].heat_capacity(30.0) == pytest.approx(3.5, abs=1e-9)
    assert SPECIES["CO2"].heat_capacity(1e6) == pytest.approx(3.5 + 4.0, rel=1e-5)
    assert SPECIES["Ar"].heat_capacity(200.0) == 2.5
    # measured down to 195 K: NIST-JANAF has 32.36 J/(mol K) at 200 K and 29.21 at 100 K
    np.testing.assert_allclose(MOLAR_GAS_CONSTANT * SPECIES["CO2"].heat_capacity([100.0, 200.0]), [29.21, 32.36], 5e-4)


def test_martian_air():
    """A gas constant of 191.2, and γ that falls with the temperature: a constant 1.3 is right at 285 K only."""
    air = NAMED_GASES["mars"]
    assert air.constant == pytest.approx(191.2, abs=0.03)
    np.testing.assert_allclose(air.heat_capacity_ratio([300.0, 200.0, 140.0]), [1.293, 1.350, 1.388], atol=5e-4)
    assert air.molecule_mass * air.constant == pytest.approx(1.380649e-23, rel=1e-12)
    # CO2, N2, Ar, O2, CO of Viking (Owen et al. 1977) differ in argon and nitrogen and have the same gas constant
    viking = mixture({"CO2": 0.9532, "N2": 0.027, "Ar": 0.016, "O2": 0.0013, "CO": 0.0008})
    assert viking.constant == pytest.approx(air.constant, rel=2e-4)
    assert sum(x for _, x in air.composition) == pytest.approx(1.0, abs=1e-15)
    assert sum(MARS.values()) == pytest.approx(1.0, abs=2e-3)


def test_the_table_of_the_ratio_is_the_formula():
    air, temperature = NAMED_GASES["mars"], np.linspace(20.0, 2900.0, 9973)
    np.testing.assert_allclose(
        air.heat_capacity_ratio(temperature), heat_capacity_ratio(air.composition, temperature), rtol=2e-6
    )
    assert air.heat_capacity_ratio(np.full((2, 3), 200.0)).shape == (2, 3)
    ends = heat_capacity_ratio(air.composition, np.array([20.0, 3000.0]))
    np.testing.assert_allclose(air.heat_capacity_ratio([1.0, 20.0, 3000.0, 1e4]), ends[[0, 0, 1, 1]], rtol=1e-12)


def test_speed_of_sound_and_mach():
    assert Gas().speed_of_sound(200.0) == pytest.approx(np.sqrt(1.3 * 188.92 * 200.0))
    air = NAMED_GASES["mars"]
    expected = np.sqrt(heat_capacity_ratio(air.composition, 200.0) * air.constant * 200.0)
    assert air.speed_of_sound(200.0) == pytest.approx(expected, rel=1e-6)
    assert air.mach(expected, 200.0) == pytest.approx(1.0, rel=1e-6)
    # at 200 K a Mach number is 2.5 % lower than with the thesis's constants
    assert air.mach(1.0, 200.0) / Gas().mach(1.0, 200.0) == pytest.approx(0.9755, abs=5e-4)


def test_hard_spheres():
    """The thesis's diameter is that of carbon dioxide from its viscosity; a pure mixture is its species."""
    carbon_dioxide = mixture({"CO2": 1.0})
    assert carbon_dioxide.molecule_diameter == pytest.approx(4.64e-10, rel=1e-3)
    assert carbon_dioxide.molecule_diameter == pytest.approx(SPECIES["CO2"].diameter, rel=1e-12)
    assert carbon_dioxide.constant == pytest.approx(188.92, rel=1e-4)
    assert NAMED_GASES["mars"].molecule_diameter < carbon_dioxide.molecule_diameter
    # two species: written out
    d, m, x = (np.array([getattr(SPECIES[s], k) for s in ("CO2", "Ar")]) for k in ("diameter", "mass", "diameter"))
    x = np.array([0.7, 0.3])
    path = 0.0
    for i in range(2):
        rate = sum(x[j] * np.pi * (d[i] + d[j]) ** 2 / 4 * np.sqrt(1 + m[i] / m[j]) for j in range(2))
        path += x[i] / rate
    blend = mixture({"CO2": 7.0, "Ar": 3.0})
    assert blend.mean_free_path(blend.molecule_mass) == pytest.approx(path, rel=1e-12)


def test_stated_constants():
    gas = gas_of_constants(287.0, 1.4, None, None)
    assert gas.molecule_mass == pytest.approx(4.8106e-26, rel=1e-4)
    assert gas.molecule_diameter == 4.64e-10
    assert gas.speed_of_sound(288.15) == pytest.approx(340.3, abs=0.1)


def test_descriptions_name_gas_constant_and_ratio():
    assert Gas().description == "carbon dioxide as in Thomas (2011): R 188.92 J/(kg K), γ 1.3 constant"
    assert "CO2 95.2 %" in NAMED_GASES["mars"].description
    assert "R 191.20 J/(kg K), γ 1.350 at 200 K and 1.293 at 300 K" in NAMED_GASES["mars"].description
