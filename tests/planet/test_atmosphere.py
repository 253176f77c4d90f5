"""The atmosphere table: interpolation, extrapolation, hydrostatic balance of the shipped one, bad files."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.io.csv_table import package_data
from edl_filter.planet.atmosphere import COLUMNS, Atmosphere
from edl_filter.planet.gas import NAMED_GASES, Gas

HEADER = ",".join(COLUMNS)
ROWS = ["0,1e-2,220,1,2", "1000,9e-3,218,3,4", "2000,8e-3,216,5,6"]


def write_table(tmp_path, *rows, header=HEADER):
    path = tmp_path / "table.csv"
    path.write_text("\n".join(("# a comment", header, *rows)) + "\n", encoding="utf-8")
    return path


def test_interpolation_is_log_linear_in_density_and_linear_otherwise(tmp_path):
    atmosphere = Atmosphere.read(write_table(tmp_path, *ROWS), Gas())
    assert atmosphere.density(500.0) == pytest.approx(np.sqrt(1e-2 * 9e-3))
    assert atmosphere.temperature_at(500.0) == pytest.approx(219.0)
    np.testing.assert_allclose(atmosphere.wind_at(1500.0), [4.0, 5.0])
    assert atmosphere.speed_of_sound(0.0) == pytest.approx(np.sqrt(1.3 * 188.92 * 220.0))


def test_density_above_the_table_has_the_last_scale_height(tmp_path):
    atmosphere = Atmosphere.read(write_table(tmp_path, *ROWS), Gas())
    assert atmosphere.density(3000.0) == pytest.approx(8e-3 * (8.0 / 9.0))
    assert atmosphere.density(-500.0) == pytest.approx(1e-2)
    assert atmosphere.density(np.array([[0.0, 1000.0]])).shape == (1, 2)


def test_a_table_of_another_gas_keeps_its_pressure(tmp_path):
    """Hydrostatic equilibrium gives the pressure from the density alone: the temperature depends on the gas."""
    path, air = write_table(tmp_path, *ROWS), NAMED_GASES["mars"]
    table, converted = Atmosphere.read(path, Gas()), Atmosphere.read(path, air, 188.92)
    assert converted.temperature_at(700.0) * air.constant == pytest.approx(table.temperature_at(700.0) * 188.92)
    assert converted.density(700.0) == table.density(700.0)
    assert Atmosphere.read(path, air).temperature_at(700.0) == table.temperature_at(700.0)


def test_shipped_table_is_hydrostatic():
    """Pressure from the gas law falls with altitude at the rate g/(R T), to 0.5 percent."""
    atmosphere = Atmosphere.read(package_data("mars_reference.csv"), Gas())
    altitude, temperature = atmosphere.altitude[:120], atmosphere.temperature[:120]
    pressure = np.exp(atmosphere.log_density[:120]) * atmosphere.gas.constant * temperature
    gravity = 4.282837e13 / (3396190.0 + altitude) ** 2
    decay_rate = -np.diff(np.log(pressure)) / np.diff(altitude)
    expected = gravity / (atmosphere.gas.constant * temperature)
    np.testing.assert_allclose(decay_rate, 0.5 * (expected[1:] + expected[:-1]), rtol=0.005)


@pytest.mark.parametrize(
    ("rows", "header", "message"),
    [
        (ROWS, "altitude,density", "the header must be altitude_m,density"),
        ([ROWS[0], "1000,nine,218,3,4"], HEADER, r"line 4: expected 5 finite numbers, found '1000,nine"),
        ([ROWS[0], "1000,nan,218,3,4"], HEADER, "line 4: expected 5 finite numbers"),
        ([ROWS[1], ROWS[0]], HEADER, "line 4: altitude_m must increase, but 0 follows 1000"),
        ([ROWS[0], "1000,2e-2,218,3,4"], HEADER, "line 4: density must decrease, but 0.02 follows 0.01"),
        ([ROWS[0], "1000,-9e-3,218,3,4"], HEADER, "line 4: density must be positive"),
        ([ROWS[0]], HEADER, "1 rows of values; at least 2"),
    ],
)
def test_bad_table_raises_with_line_number(tmp_path, rows, header, message):
    with pytest.raises(InputError, match=message):
        Atmosphere.read(write_table(tmp_path, *rows, header=header), Gas())


def test_missing_file_raises(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        Atmosphere.read(tmp_path / "none.csv", Gas())
