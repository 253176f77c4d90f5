"""Rows of the instruments' tables: numbers with sigmas and units, and what is not estimated."""

from folders import summary

from edl_filter.report.instruments import HEADS, instrument_tables
from edl_filter.results.files import read_summary

VECTOR, SIGMA = [0.5748, -0.27, 0.001], [0.0005, 0.0008, 0.0009]
QUANTITIES = ("lever_arm{}_m", "rate_alignment{}_deg", "force_alignment{}_deg", "force_bias{}_m_s2")
CALIBRATION = {
    "start_s": 89.6, "end_s": 250.8, "samples": 1287, "stated_lever_arm_m": [0.5753, -0.2705, 0.0],
    "stated_lever_arm_sigma_m": 0.0102, "stated_alignment_sigma_deg": None,
    "axial_scale": 1.38e-3, "axial_scale_sigma": 7e-5, "delay_s": 1.8e-5, "delay_sigma_s": 9e-6,
    "rate_bias_rad_s": [9.696e-6, 0.0, 0.0], "rate_bias_sigma_rad_s": [9.696e-7] * 3,
    "force_rms_m_s2": SIGMA, "rate_rms_rad_s": SIGMA,
    **{name.format(""): VECTOR for name in QUANTITIES}, **{name.format("_sigma"): SIGMA for name in QUANTITIES},
}  # fmt: skip


def tables(tmp_path, **changes):
    summary(tmp_path, **changes)
    return instrument_tables(read_summary(tmp_path))


def test_a_calibration_has_units_and_sigmas(tmp_path):
    (rows,) = tables(tmp_path, imu_calibration={"rover": CALIBRATION}).values()
    texts = {row[0]: row[1:] for row in rows}
    assert all(len(row) == len(HEADS) for row in rows)
    assert texts["position relative to the driving IMU, m"][0] == "0.57480 ± 0.00050"
    assert texts["position relative to the driving IMU, m"][3] == "0.5753, -0.2705, 0.0000 ± 0.01"
    assert texts["rotation of gyros, deg"][3] == "0"
    assert texts["bias of gyros, deg/h"][0] == "2.00 ± 0.20"
    assert texts["delay of readings, ms"][0] == "0.0180 ± 0.0090"
    assert texts["scale of accelerometer, ppm"][0] == "1380 ± 70"


def test_the_bias_before_entry_stands_with_and_without_the_filters(tmp_path):
    bias = {"slope": [0.0037, -0.0014, 0.0007], "slope_sigma": [1e-4] * 3}
    (rows,) = tables(tmp_path, pre_entry_bias_m_s2=bias).values()
    assert [row[1] for row in rows] == ["0.00370 ± 0.00010"]
    bias |= {"filter": [0.0037, -0.0014, 0.0007], "filter_sigma": [3e-4] * 3}
    (rows,) = tables(tmp_path, pre_entry_bias_m_s2=bias).values()
    assert [row[1] for row in rows] == ["0.00370 ± 0.00010", "0.00370 ± 0.00030"]


def test_a_flight_with_one_imu_has_no_tables(tmp_path):
    assert tables(tmp_path) == {}
