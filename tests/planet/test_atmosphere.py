from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.planet.atmosphere import COLUMNS, Atmosphere

HEADER = ",".join(COLUMNS)
GOOD = ["0,1e-2,220,1,2", "1000,9e-3,218,3,4", "2000,8e-3,216,5,6"]


def table(tmp_path, *rows, header=HEADER):
    path = tmp_path / "table.csv"
    path.write_text("\n".join(("# a comment", header, *rows)) + "\n", encoding="utf-8")
    return path


def test_between_nodes_density_is_log_linear_and_the_rest_linear(tmp_path):
    a = Atmosphere.read(table(tmp_path, *GOOD), 188.92, 1.3)
    assert a.density(500.0) == pytest.approx(np.sqrt(1e-2 * 9e-3))
    assert a.temperature_at(500.0) == pytest.approx(219.0)
    np.testing.assert_allclose(a.wind_at(1500.0), [4.0, 5.0])
    assert a.speed_of_sound(0.0) == pytest.approx(np.sqrt(1.3 * 188.92 * 220.0))


def test_above_the_top_density_keeps_its_last_scale_height(tmp_path):
    a = Atmosphere.read(table(tmp_path, *GOOD), 188.92, 1.3)
    assert a.density(3000.0) == pytest.approx(8e-3 * (8.0 / 9.0))
    assert a.density(-500.0) == pytest.approx(1e-2)
    assert a.density(np.array([[0.0, 1000.0]])).shape == (1, 2)


def test_shipped_table_is_hydrostatic():
    """Its pressure from the gas law falls as its weight says, to a few per mille between nodes."""
    a = Atmosphere.read(Path(str(files("edl_filter") / "data" / "mars_reference.csv")), 188.92, 1.3)
    h = a.altitude[:120]
    pressure = np.exp(a.log_density[:120]) * a.gas_constant * a.temperature[:120]
    gravity = 4.282837e13 / (3396190.0 + h) ** 2
    slope = -np.diff(np.log(pressure)) / np.diff(h)
    weight = gravity / (a.gas_constant * a.temperature[:120])
    np.testing.assert_allclose(slope, 0.5 * (weight[1:] + weight[:-1]), rtol=0.02)


@pytest.mark.parametrize(
    ("rows", "header", "message"),
    [
        (GOOD, "altitude,density", "the header must be altitude_m,density"),
        ([GOOD[0], "1000,nine,218,3,4"], HEADER, r"line 4: expected 5 finite numbers, found '1000,nine"),
        ([GOOD[0], "1000,nan,218,3,4"], HEADER, "line 4: expected 5 finite numbers"),
        ([GOOD[1], GOOD[0]], HEADER, "line 4: altitude_m must increase, but 0 follows 1000"),
        ([GOOD[0], "1000,2e-2,218,3,4"], HEADER, "line 4: density must decrease, but 0.02 follows 0.01"),
        ([GOOD[0], "1000,-9e-3,218,3,4"], HEADER, "line 4: density must be positive"),
        ([GOOD[0]], HEADER, "1 rows of values; at least 2"),
    ],
)
def test_bad_tables(tmp_path, rows, header, message):
    with pytest.raises(InputError, match=message):
        Atmosphere.read(table(tmp_path, *rows, header=header), 188.92, 1.3)


def test_a_table_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        Atmosphere.read(tmp_path / "none.csv", 188.92, 1.3)
