import pytest

from edl_filter.aero.catalogue import CATALOGUE, find
from edl_filter.errors import InputError


def test_every_table_of_appendices_b_to_g():
    numbers = [f"12.{k}" for k in range(1, 9)] + ["13.1", "13.2", "13.3", "14.1", "14.2", "15.1", "16.1"]
    numbers += [f"17.{k}" for k in range(1, 7)]
    assert [entry.table for entry in CATALOGUE] == numbers
    assert len({entry.name for entry in CATALOGUE}) == len(CATALOGUE)
    assert all(entry.remark.endswith(".") for entry in CATALOGUE)


def test_find():
    assert find("phoenix_program_2.3").status == "shipped"
    assert find("17.6").name == "mer_dacfree"
    with pytest.raises(InputError, match="no table 'viking_windtunnel'; did you mean 'viking_wind_tunnel'"):
        find("viking_windtunnel")
    with pytest.raises(InputError, match="known are viking_wind_tunnel, "):
        find("12345")
