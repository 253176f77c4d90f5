"""Errors in the model of a measured flight: entry state, sensors, database."""

import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.aero.uncertainty import three_sigma
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.simulation.model_errors import DatabaseError, EntryStateError, ImuErrors
from edl_filter.telemetry.record import InitialState


def test_the_entry_state_moves_by_the_difference_and_keeps_its_covariance():
    attitude = rotations.from_rotation_vector(np.array([0.3, -0.2, 0.1]))
    stated = InitialState(0.0, np.ones(3), np.zeros(3), attitude, np.diag(np.arange(1.0, 10.0)))
    difference = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.01])
    true = EntryStateError(difference).entry_state({}, stated)
    np.testing.assert_allclose(true.position, [2.0, 3.0, 4.0])
    np.testing.assert_allclose(true.velocity, [0.1, 0.2, 0.3])
    turn = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(attitude), true.inertial_from_body))
    np.testing.assert_allclose(turn, [0.0, 0.0, 0.01], atol=1e-12)
    assert np.array_equal(true.covariance, stated.covariance)


def test_sensor_errors_are_removed_as_they_were_applied():
    names = ("accelerometer_bias", "accelerometer_scale", "accelerometer_misalignment", "gyro_bias", "gyro_scale")
    random = np.random.default_rng(1)
    effect = ImuErrors({name: 1e-2 * random.standard_normal(3) for name in names})
    force, rate = 10.0 * random.standard_normal((2, 20, 3))
    read = effect.imu({}, np.arange(20.0), force, rate)
    assert np.abs(read[0] - force).max() > 1e-2
    np.testing.assert_allclose(effect.corrected({}, np.arange(20.0), *read), (force, rate), rtol=1e-12)
    assert effect.is_sensor_effect


@pytest.mark.parametrize(("mach", "knudsen"), [(15.0, 1e-6), (1.5, 1e-6), (30.0, 1.0)])
def test_errors_of_the_database_have_its_sigma_in_every_flow(mach, knudsen):
    angle = np.radians([0.0, 4.0, 12.0])
    ones = np.ones(3)
    flow = FlightCondition(
        time=ones, altitude=ones, velocity_body=np.ones((3, 3)), rate=np.zeros((3, 3)), speed=ones, density=ones,
        mach=mach * ones, knudsen=knudsen * ones, dynamic_pressure=ones, alpha_total=angle,
    )  # fmt: skip
    totals = AeroCoefficients(1.6 * ones, 0.1 * ones, -0.1 * ones, 0.0 * ones, 0.0 * ones)
    random = np.random.default_rng(3)
    drawn = [DatabaseError(random, "MER", 2.0).coefficients({}, flow, totals) for _ in range(400)]
    sigma = three_sigma("MER", flow.mach, flow.knudsen, totals.ca)
    odd = np.tanh(np.degrees(angle) / 4.0)
    for name, three, shape in (("ca", sigma.ca, 1.0), ("cn", sigma.cn, odd), ("cm_nose", sigma.cm, odd)):
        errors = np.array([getattr(d, name) for d in drawn]) - getattr(totals, name)
        expected = 2.0 / 3.0 * three * shape * np.ones(3)
        # bilinear interpolation between nodes lowers the sigma by a few percent
        np.testing.assert_allclose(errors.std(axis=0), expected, rtol=0.25, atol=1e-12)
