"""Predictions at parachute deployment against formulas for one state."""

from math import acos, exp, log, sqrt

import numpy as np
import pytest
from geodetic import fixed_position
from test_constraints import AIR, BARE, MARS, TIME, check, local, to_body

from edl_filter.aero.database import load_database
from edl_filter.navigation.ekf import linearized_measurement
from edl_filter.navigation.layout import State
from edl_filter.navigation.parachute import AXIAL_FORCE, DYNAMIC_PRESSURE, MACH, FlowModel, ParachuteDeployment
from edl_filter.planet.gas import Gas

DATABASE = load_database(family="MER")
MODEL = FlowModel(MARS, AIR, Gas(), 2.65, DATABASE)
COMPONENTS = (AXIAL_FORCE, DYNAMIC_PRESSURE, MACH)


def deployment(components=COMPONENTS):
    size = len(components)
    return ParachuteDeployment(TIME, components, np.zeros(size), np.eye(size), MODEL, "test")


def in_air(nav):
    """East, north, up of the velocity relative to the air, and the altitude."""
    east, north, up, h = local(nav)
    return np.array([east - (10.0 + h / 1e3), north - (-20.0 + 2.0 * h / 1e3), up]), h


def test_logarithms_of_force_pressure_and_mach():
    def logs(nav, _):
        velocity, h = in_air(nav)
        speed, density = np.linalg.norm(velocity), 0.02 * exp(-2.0 * h / 20e3)
        temperature = 210.0 - min(max(h, 0.0), 20e3) / 1e3
        pressure, mach = 0.5 * density * speed**2, speed / sqrt(1.3 * 188.92 * temperature)
        enu = MARS.enu_from_inertial(TIME, nav[None, :3])[0]
        alpha = acos(to_body(nav[6:10], enu.T @ velocity)[0] / speed)
        ca = DATABASE.lookup(mach, Gas().knudsen(density, 2.65), alpha, speed).ca
        return [log(pressure * ca), log(pressure), log(mach)]

    check(deployment(), logs, rtol=1e-6)  # the air table ends at 20 km; below 0 and above its temperature is constant


def test_the_flow_has_angle_of_attack_and_flight_path_of_the_velocity_in_the_air():
    """Against the vectors of each state, nose first and tail first, descending and ascending."""
    rng = np.random.default_rng(5)
    states = [state(h).nav for h in (2e3, 6e3, 11e3)]
    for nav in states:
        nav[6:10] = rng.standard_normal(4)
        nav[6:10] /= np.linalg.norm(nav[6:10])
    states[2][3:6] *= -1.0
    flow = MODEL.at(TIME, np.array(states).T)
    for k, nav in enumerate(states):
        velocity, h = in_air(nav)
        speed = np.linalg.norm(velocity)
        body = to_body(nav[6:10], MARS.enu_from_inertial(TIME, nav[None, :3])[0].T @ velocity)
        assert flow.alpha_total[k] == pytest.approx(acos(body[0] / speed), rel=1e-9)
        assert flow.flight_path[k] == pytest.approx(np.arctan2(velocity[2], np.hypot(*velocity[:2])), rel=1e-9)
        assert (flow.altitude[k], flow.speed[k]) == pytest.approx((h, speed), rel=1e-9)
    assert np.ptp(flow.alpha_total) > 0.5 and np.sign(flow.flight_path).tolist() == [-1.0, -1.0, 1.0]


def test_the_sigma_of_the_axial_coefficient_is_a_third_of_the_three_sigma_of_the_database():
    flow = MODEL.at(TIME, state().nav[:, None])
    ca, sigma = MODEL.axial_coefficient(flow)
    entry = DATABASE.lookup(flow.mach, flow.knudsen, flow.alpha_total, flow.speed)
    np.testing.assert_array_equal(ca, entry.ca)
    np.testing.assert_allclose(3.0 * sigma, entry.three_sigma.ca, rtol=1e-14)
    assert 0.0 < sigma[0] < 0.2 * ca[0]


def test_a_subset_of_the_components_keeps_their_order():
    c = deployment((DYNAMIC_PRESSURE, MACH))
    nav = state().nav[:, None]
    both = c.predict(nav, np.zeros((9, 1)), BARE)[0]
    np.testing.assert_array_equal(both, deployment().predict(nav, np.zeros((9, 1)), BARE)[0][1:])


def state(altitude=5e3):
    position = MARS.rotation.to_inertial(TIME, fixed_position(MARS, 0.2, 0.5, altitude))
    enu = MARS.enu_from_inertial(TIME, position[None])[0]
    velocity = enu.T @ np.array([360.0, 20.0, -190.0]) + np.cross([0.0, 0.0, MARS.rotation_rate], position)
    return State(np.concatenate((position, velocity, [0.0, 0.0, 0.0, 1.0])), np.zeros(9))


@pytest.mark.parametrize(("component", "slope"), [(DYNAMIC_PRESSURE, -1e-4), (MACH, 0.0)])
def test_the_logarithm_of_the_pressure_is_linear_in_altitude_and_mach_hardly_depends_on_it(component, slope):
    """The scale height of the table is 10 km. A pressure itself would be curved: 10 % over 2 km."""
    c = deployment((component,))
    for altitude in (3e3, 5e3, 9e3):
        _, jacobian = linearized_measurement(c, state(altitude), BARE)
        up = state(altitude).nav[:3] / np.linalg.norm(state(altitude).nav[:3])
        assert jacobian[0, :3] @ up == pytest.approx(slope, abs=1e-5)


def test_a_faster_vehicle_has_twice_the_relative_change_in_pressure():
    """Along the air-relative velocity: 2 / V in pressure and 1 / V in Mach number."""
    values, jacobian = linearized_measurement(deployment(), state(), BARE)
    velocity, _ = in_air(state().nav)
    speed = np.linalg.norm(velocity)
    inertial = MARS.enu_from_inertial(TIME, state().nav[None, :3])[0].T @ velocity / speed
    slopes = jacobian[:, 3:6] @ inertial
    assert slopes[1] == pytest.approx(2.0 / speed, rel=1e-4)
    assert slopes[2] == pytest.approx(1.0 / speed, rel=1e-4)
    assert len(values) == 3
