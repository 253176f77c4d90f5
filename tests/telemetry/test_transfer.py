"""Readings of one IMU from those of another one: constant errors of a simulated rigid body, and a simulated flight."""

from dataclasses import replace

import numpy as np
from test_relative_calibration import two_records

from edl_filter.imu_model.sensor_errors import apply_errors
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.transfer import transferred


def test_constant_errors_of_the_source_are_removed():
    """Errors of `imu_model.sensor_errors`, no noise: to half the square of the rotation, estimated linearly."""
    reference, source = two_records(noise=0.0)
    turn = np.array([-8e-3, 6e-3, 5e-3])
    force = apply_errors(source.specific_force, turn, np.array([2e-3, 0.0, 0.0]), np.array([0.01, 0.02, -0.01]))
    rate = apply_errors(source.angular_rate, turn, bias=np.array([1e-4, -5e-5, 1e-4]))
    moved = transferred(reference, replace(source, specific_force=force, angular_rate=rate), np.inf)
    assert moved.valid.sum() == 999
    for values, expected in ((moved.force, reference.specific_force), (moved.rate, reference.angular_rate)):
        inside = slice(2, -2)  # the spline of the readings knows less at its ends
        largest = np.linalg.norm(expected[inside], axis=1).max()
        assert np.abs(values - expected)[inside].max() < 0.4 * turn @ turn * largest


def test_transferred_readings_are_those_of_the_reference(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    source = transferred(telemetry.driving, telemetry.checking[0], 251.75)
    rows = source.valid & (telemetry.driving.time < 251.0)
    assert rows.sum() > 1900
    for key, values, scatter in (
        ("specific_force", source.force, source.force_scatter), ("angular_rate", source.rate, source.rate_scatter)
    ):  # fmt: skip
        ratio = (values - getattr(telemetry.driving, key))[rows] / scatter[rows]
        assert 0.8 < np.sqrt(np.mean(ratio**2)) < 1.2
