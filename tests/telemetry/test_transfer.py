"""Readings of one IMU from those of another one: constant errors of a simulated rigid body, and a simulated flight."""

from dataclasses import replace

import numpy as np
import pytest
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


def test_the_sigma_in_a_shock_contains_the_error_of_the_interpolation(builtin_flight):
    """The parachute turns the vehicle within a sample; each sample in turn is lost, the others are known."""
    telemetry = read_flight_file(builtin_flight)
    driving, checking = telemetry.driving, telemetry.checking[0]
    deployed = telemetry.events["parachute_deploy"]
    ratios, errors = [], []
    for row in np.flatnonzero((driving.time > deployed) & (driving.time < deployed + 2.5)):
        force = driving.specific_force.copy()
        force[row] = np.nan
        source = transferred(replace(driving, specific_force=force), checking, deployed - 1.0)
        errors.append(source.force[row] - driving.specific_force[row])
        ratios.append(errors[-1] / source.force_scatter[row])
    assert np.max(np.abs(errors)) > 100.0 * driving.force_noise[0]
    assert np.abs(ratios).max() < 3.5
    assert np.sqrt(np.mean(np.square(ratios))) > 0.2


@pytest.mark.parametrize("side", ["before", "after", "start"])
def test_the_sigma_beside_a_shock_is_that_of_the_difference(side, builtin_flight):
    """Ten times the stated noise in both IMUs: the interpolation's error in the shock hides none of it."""
    telemetry, rng = read_flight_file(builtin_flight), np.random.default_rng(8)
    deployed = telemetry.events["parachute_deploy"]
    driving, checking = (
        replace(r, specific_force=r.specific_force + 0.03 * rng.standard_normal(r.specific_force.shape))
        for r in (telemetry.driving, telemetry.checking[0])
    )
    source = transferred(driving, checking, deployed - 1.0)
    first, last = {"before": (deployed - 5.0, deployed - 0.5), "after": (deployed + 4.0, deployed + 9.0),
                   "start": (0.3, 6.0)}[side]  # fmt: skip
    rows = source.valid & (driving.time > first) & (driving.time < last)
    ratio = (source.force - driving.specific_force)[rows] / source.force_scatter[rows]
    assert 0.6 < np.sqrt(np.mean(ratio**2)) < 1.25
    assert source.force_scatter[rows].min() > 0.03


def test_a_sample_that_would_falsify_the_calibration_is_left_out_of_it(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    driving, checking = telemetry.driving, telemetry.checking[0]
    force = driving.specific_force.copy()
    force[552] += 1000.0
    spiked = replace(driving, specific_force=force)
    force = force.copy()
    force[552] = np.nan
    sound = replace(driving, specific_force=force)
    expected = transferred(sound, checking, 250.0)
    moved = transferred(spiked, checking, 250.0, (sound, checking))
    np.testing.assert_array_equal(moved.force, expected.force)
    np.testing.assert_array_equal(moved.force_error, expected.force_error)
    assert np.nanmax(np.abs(transferred(spiked, checking, 250.0).force - expected.force)) > 0.1
