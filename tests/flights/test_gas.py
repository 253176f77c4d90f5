"""Temperatures and Mach numbers of the rovers at the constants of the table in docs/explanation/gas.md."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from edl_filter.planet.gas import NAMED_GASES, Gas, gas_of_constants
from edl_filter.postflight.airdata import air_data
from edl_filter.postflight.flight import derive_flight

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "gas.md"
GASES = {"mars": NAMED_GASES["mars"], "thesis": Gas(), "1.4": gas_of_constants(188.92, 1.4, None, None)}


def profile(flight, gas):
    """The flight's atmosphere in another gas: altitude (m), temperature (K), its sigma, Mach number, R T, density."""
    flight = replace(flight, atmosphere=replace(flight.atmosphere, gas=gas))
    a = derive_flight(flight, air_data(flight.trajectory, flight.planet, flight.atmosphere)).flight.atmosphere
    rows = np.stack((a.altitude, a.temperature, a.temperature_sigma, a.mach, gas.constant * a.temperature, a.density))
    return rows[:, a.valid][:, ::-1]


def at(rows, altitude):
    return [float(np.interp(altitude, rows[0], row)) for row in rows[1:]]


@pytest.fixture(scope="module")
def profiles(spirit, opportunity):
    return [[profile(flight, gas) for gas in GASES.values()] for flight in (spirit, opportunity)]


def test_the_table_of_the_documentation(profiles):
    """The tolerances are a third of the temperature's sigma or less; the columns are one flight in three gases."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if " km | " in line]
    assert len(lines) == 9
    for line in lines:
        altitude, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        for cell, rows in zip(cells, [r for flight in profiles for r in flight], strict=True):
            numbers = [float(x) for x in cell.replace("±", ",").split(",")]
            temperature, sigma, mach, _, _ = at(rows, 1e3 * float(altitude.removesuffix(" km")))
            assert numbers[0] == pytest.approx(temperature, abs=0.3), (line, temperature)
            assert numbers[-1] == pytest.approx(mach, abs=0.03), (line, mach)
            if len(numbers) == 3:
                assert numbers[1] == pytest.approx(sigma, abs=0.1), (line, sigma)


@pytest.mark.parametrize("altitude", [8e4, 5e4, 3e4])
def test_density_and_the_product_of_gas_constant_and_temperature_do_not_depend_on_the_gas(profiles, altitude):
    for flight in profiles:
        mars, thesis, diatomic = (at(rows, altitude) for rows in flight)
        for gas in (thesis, diatomic):
            assert gas[3] == pytest.approx(mars[3], rel=3e-4)
            assert gas[4] == pytest.approx(mars[4], rel=3e-4)
        assert diatomic[2] / thesis[2] == pytest.approx(np.sqrt(1.3 / 1.4), rel=1e-4)
        ratio = GASES["mars"].heat_capacity_ratio(mars[0])
        assert mars[2] / thesis[2] == pytest.approx(np.sqrt(1.3 / ratio), rel=3e-4)
