"""Readings of a checking IMU against those that the driving IMU implies, and the correction of lever arms."""

from dataclasses import fields, replace

import numpy as np
import pytest

from edl_filter.diagnosis.prediction.residuals import Residuals, _checking_residuals, correct_lever_arms
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.increments import effective_samples
from edl_filter.telemetry.record import ImuRecord


def bins_of(edges):
    edges = np.asarray(edges, float)
    return TimeBins(edges, np.ones(len(edges) - 1, bool))


def test_a_checking_imu_is_predicted_at_the_place_of_each_sample():
    """A body that turns at a constant rate: centripetal acceleration alone; the record begins with a place at zero."""
    rng = np.random.default_rng(4)
    n, dt, rate = 40, 0.125, np.array([0.3, -0.2, 0.5])
    time, force = dt * np.arange(1, n + 1), rng.normal(size=(n, 3))
    place = np.where((time <= 2.0)[:, None], 0.0, [0.4, -0.3, 0.2])
    rates, zeros = np.tile(rate, (n, 1)), np.zeros(n)
    record = ImuRecord(
        "second", time, np.full(n, dt), force + np.cross(rate, np.cross(rate, place)), rates, place, zeros, zeros,
        zeros, zeros.astype(bool), zeros.astype(bool), (time > 2.0).astype(int), ("register", "second"),
        zeros.astype(int), ("test",), (SensorErrors(), SensorErrors()),
    )  # fmt: skip
    driving = replace(record, specific_force=force, position=np.zeros((n, 3)), unit=zeros.astype(int))
    bins = bins_of(np.append(0.0, time))
    residuals = _checking_residuals(record, bins, effective_samples(driving), rates, force, rates)
    np.testing.assert_allclose(residuals, 0.0, atol=1e-12)


def test_an_error_that_both_imus_have_is_no_difference_between_them():
    """The driving IMU's force is corrected by its own error; a checking one by its own less that of the driving IMU."""
    force, checking = np.arange(12.0).reshape(4, 3), 10.0 + np.arange(12.0).reshape(4, 3)
    error, further = np.full((4, 3), 0.25), np.full((4, 3), 0.5)
    residuals = Residuals(
        **{f.name: None for f in fields(Residuals)} | {"force": force, "checking_force": (checking, checking)}
    )
    corrected = correct_lever_arms(residuals, (error, error, error + further))
    np.testing.assert_array_equal(corrected.force, force - 0.25)
    np.testing.assert_array_equal(corrected.checking_force[0], checking)
    np.testing.assert_array_equal(corrected.checking_force[1], checking - 0.5)
    assert correct_lever_arms(residuals, ()) is residuals
    with pytest.raises(ValueError, match="shorter"):
        correct_lever_arms(residuals, (error, error))  # an IMU without its error
