"""Calibration of the IMUs in words and rows, for the terminal and the page.

Input: the content of ``summary.json``. Output: one table for each IMU, as rows of text: quantity, estimate along x, y
and z with one sigma, and what the mission or the telemetry states.
"""

from __future__ import annotations

from collections.abc import Sequence

from edl_filter.report.text import with_sigma, words
from edl_filter.results.schema import Summary
from edl_filter.results.schema.summary import ImuCalibration

#: Heads of the columns.
HEADS = ("", "x", "y", "z", "stated")

_DEG_H = 3600.0 * 57.29577951308232


def instrument_tables(summary: Summary) -> dict[str, list[tuple[str, ...]]]:
    """Rows by title of the table.

    Parameters
    ----------
    summary : Summary
        Content of ``summary.json``.

    Returns
    -------
    dict
        Title → rows of `HEADS`; empty where nothing is estimated.
    """
    tables: dict[str, list[tuple[str, ...]]] = {}
    bias = summary.pre_entry_bias_m_s2
    if bias is not None:
        rows = [_row("slope of velocity (as Thomas 2011, table 3.5), m/s²", bias.slope, bias.slope_sigma)]
        if bias.filter is not None and bias.filter_sigma is not None:
            rows.append(_row("estimate of the filter, m/s²", bias.filter, bias.filter_sigma))
        tables["Accelerometer bias before entry, body axes"] = rows
    for name, calibration in summary.imu_calibration.items():
        title = f"IMU {words(name)} against the driving one, {calibration.start_s:.0f} to {calibration.end_s:.0f} s"
        tables[title] = _calibration_rows(calibration)
        if comparison := summary.imu_comparison.get(name):
            fit = comparison.all
            slope = ("–", *map(with_sigma, fit.misalignment_deg, fit.misalignment_sigma_deg))
            tables[title].append(("rotation by the axial force alone (as Thomas 2011, table 3.6), deg", *slope, ""))
    return tables


def _calibration_rows(c: ImuCalibration) -> list[tuple[str, ...]]:
    stated = ", ".join("–" if value is None else f"{value:.4f}" for value in c.stated_lever_arm_m)
    if c.stated_lever_arm_sigma_m:
        stated += f" ± {c.stated_lever_arm_sigma_m:.2g}"
    aligned = f"0 ± {c.stated_alignment_sigma_deg:.2g}" if c.stated_alignment_sigma_deg else "0"
    return [
        _row("position relative to the driving IMU, m", c.lever_arm_m, c.lever_arm_sigma_m, stated),
        _row("rotation of gyros, deg", c.rate_alignment_deg, c.rate_alignment_sigma_deg, aligned),
        _row("rotation of accelerometers, deg", c.force_alignment_deg, c.force_alignment_sigma_deg, aligned),
        _row("bias of accelerometers, m/s²", c.force_bias_m_s2, c.force_bias_sigma_m_s2, "0"),
        _row("bias of gyros, deg/h", c.rate_bias_rad_s, c.rate_bias_sigma_rad_s, "0", _DEG_H),
        ("scale of accelerometer, ppm", with_sigma(1e6 * c.axial_scale, 1e6 * c.axial_scale_sigma), "", "", "0"),
        ("delay of readings, ms", with_sigma(1e3 * c.delay_s, 1e3 * c.delay_sigma_s), "", "", "0"),
    ]


def _row(
    name: str,
    values: Sequence[float | None],
    sigmas: Sequence[float | None],
    stated: str = "",
    factor: float = 1.0,
) -> tuple[str, ...]:
    scaled = ([None if v is None else factor * v for v in numbers] for numbers in (values, sigmas))
    x, y, z = map(with_sigma, *scaled)
    return (name, x, y, z, stated)
