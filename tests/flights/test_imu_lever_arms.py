"""The lever arm between the rovers' two IMUs, from the increments of the archive, and what the diagnosis makes of it.

The regression is independent of telemetry records, navigation and diagnosis: differences of the increments of HIGHRATE.
"""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from edl_filter import rotations
from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.residual_analysis.residual_map import model_rms
from edl_filter.telemetry.mer_archive import read_mer_tables

#: Begin of the regression, s after entry interface, and its end before the mortar fires, s.
BEGIN, MARGIN = 90.0, 0.5


@pytest.fixture(scope="module", params=["spirit", "opportunity"])
def flight(request):
    return request.getfixturevalue(request.param)


def lever_arm(mission, folder):
    """Position of the rover's IMU from the backshell's ``(3,)``, m, spacecraft axes, and its one sigma.

    The difference of specific force is ``w' × r + w × (w × r)``, a small rotation of the force between the two
    mountings and a difference of biases. Rates at the samples' edges are the derivative of a quintic spline
    through the summed increments of angle.
    """
    telemetry = mission.telemetry
    table = read_mer_tables(folder, telemetry.spacecraft).highrate
    deployed = mission.event_times()["parachute_deploy"]
    time = table.sclk - telemetry.epoch_sclk
    part = (time > BEGIN) & (time < deployed - MARGIN)
    assert np.ptp(np.diff(time[part])) < 1e-2  # no gap
    step = float(np.mean(np.diff(time[part])))

    def in_spacecraft_axes(imu, increments):
        return rotations.rotate(telemetry.imus[imu].spacecraft_from_imu_quaternion, increments[part]) / step

    force = in_spacecraft_axes("backshell", table.backshell_velocity_increment)
    difference = in_spacecraft_axes("rover", table.rover_velocity_increment) - force
    rate = in_spacecraft_axes("backshell", table.backshell_angle_increment)
    edges = step * np.arange(len(rate) + 1)
    angle = make_interp_spline(edges, np.concatenate((np.zeros((1, 3)), np.cumsum(rate * step, axis=0))), k=5)
    turning = np.diff(angle.derivative()(edges), axis=0) / step
    across = rotations.cross_matrix(rate)
    columns = np.concatenate(
        (
            rotations.cross_matrix(turning) + across @ across,
            -rotations.cross_matrix(force),
            np.broadcast_to(np.eye(3), (len(rate), 3, 3)),
        ),
        axis=2,
    )[4:-4].reshape(-1, 9)  # the spline's ends are less accurate
    values = difference[4:-4].reshape(-1)
    used = np.ones(len(values), bool)
    for _ in range(3):  # an increment over 51 instead of 50 readings is 2 % too large
        solution = np.linalg.lstsq(columns[used], values[used], rcond=None)[0]
        residuals = np.abs(values - columns @ solution)
        used = residuals < 5.0 * 1.4826 * np.median(residuals)
    assert np.mean(used) > 0.98
    covariance = np.mean(residuals[used] ** 2) * np.linalg.inv(columns[used].T @ columns[used])
    return solution[:3], np.sqrt(np.diag(covariance)[:3])


def test_the_missions_positions_are_those_of_the_data(flight, mer_folder):
    """The regression's sigma is 1 to 3 mm; it takes the readings of both IMUs as simultaneous, which moves it by 4 mm.

    Positions that are 1 cm too long, as the missions once had them, fail.
    """
    imus = flight.mission.telemetry.imus
    stated = np.array(imus["rover"].position) - np.array(imus["backshell"].position)
    fitted, sigma = lever_arm(flight.mission, mer_folder)
    assert np.all(sigma < 4e-3), sigma
    np.testing.assert_allclose(fitted, stated, atol=0.006)


def test_the_checking_imu_agrees_with_the_driving_one(flight):
    """With the positions of the register's rows, zero, at all times, y and z would be 7.6 and 6.6 to 13.5 and 17.9."""
    rms = model_rms(linearize(flight_case(flight)))
    assert rms["rover_force_y"] < 3.0 and rms["rover_force_z"] < 3.0, rms
