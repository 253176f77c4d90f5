"""Tables of a trajectory, read back."""

import csv

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.export import export


def test_csv_has_the_trajectory_with_units(result, spirit):
    (path,) = export(result, "csv")
    assert path == result.parent / "trajectory.csv"
    with path.open(encoding="ascii") as file:
        rows = list(csv.DictReader(file))
    t = spirit.trajectory
    assert len(rows) == len(t.time)
    for name in ("time [s]", "sclk [s]", "utc", "altitude [m]", "alpha_total [deg]", "density [kg/m^3]"):
        assert name in rows[0]
    k = len(rows) // 2
    assert float(rows[k]["time [s]"]) == pytest.approx(t.time[k], abs=1e-6)
    assert float(rows[k]["sclk [s]"]) == pytest.approx(126462085.4 + t.time[k], abs=1e-6)
    assert float(rows[k]["position_y [m]"]) == pytest.approx(t.position[k, 1], abs=1e-4)
    assert float(rows[k]["angular_rate_x [deg/s]"]) == pytest.approx(np.rad2deg(t.angular_rate[k, 0]))
    since_epoch = np.datetime64(rows[k]["utc"]) - np.datetime64(spirit.telemetry.epoch_utc)
    assert since_epoch / np.timedelta64(1, "us") * 1e-6 == pytest.approx(t.time[k], abs=1e-6)
    assert all(None not in row and None not in row.values() for row in rows)


def test_csv_of_a_flight_without_a_clock_has_utc(practice_result, tmp_path):
    (path,) = export(practice_result.parent, "csv", tmp_path / "t.csv")
    header = path.read_text().splitlines()[0]
    assert "utc" in header and "sclk" not in header


def test_unknown_format_raises(practice_result):
    with pytest.raises(InputError, match="'xls'; accepted are csv, spk, ck"):
        export(practice_result, "xls")
