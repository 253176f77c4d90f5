"""Predictions of each constraint, against a formula for one state, and the signs of their slopes."""

from math import atan2, cos, exp, sin, sqrt

import numpy as np
import pytest
import twins
from geodetic import fixed_position
from twins import FULL, TIME, points

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import constraints as models
from edl_filter.navigation.layout import UNITS, Layout
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import Gas

MARS = twins.MARS
BARE = Layout.of((SensorErrors(),), {})
AIR = Atmosphere(
    altitude=np.array([0.0, 20e3]),
    log_density=np.log([0.02, 0.02 * exp(-2.0)]),
    temperature=np.array([210.0, 190.0]),
    wind=np.array([[10.0, -20.0], [30.0, 20.0]]),
    gas=Gas(),
)


def check(constraint, formula, layout=FULL, rtol=1e-12, atol=0.0):
    """`predict` on all points at once, against `formula` (nav, errors) on each."""
    nav, errors = points()
    predicted = constraint.predict(nav, errors, layout)
    assert predicted.shape == (nav.shape[1], len(constraint.measured))
    assert len(constraint.components) == len(constraint.measured) == len(constraint.noise)
    for s in range(nav.shape[1]):
        np.testing.assert_allclose(predicted[s], formula(nav[:, s], errors[:, s]), rtol=rtol, atol=atol)


def air_relative(nav):
    """Ground-relative velocity, inertial axes: v - ω × r."""
    w = MARS.rotation_rate
    return nav[3] + w * nav[1], nav[4] - w * nav[0], nav[5]


def local(nav):
    """East, north, up of the ground-relative velocity, by latitude and inertial longitude."""
    latitude, _, altitude = MARS.geodetic(TIME, nav[:3])
    angle = atan2(nav[1], nav[0])
    x, y, z = air_relative(nav)
    out = cos(angle) * x + sin(angle) * y
    east = -sin(angle) * x + cos(angle) * y
    north = -sin(latitude) * out + cos(latitude) * z
    up = cos(latitude) * out + sin(latitude) * z
    return east, north, up, float(altitude)


def to_body(q, v):
    """Components in body axes of an inertial vector, by the direction cosines."""
    x, y, z, w = q
    c = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return c.T @ np.asarray(v)


def test_altimeter_is_height_above_its_sphere():
    c = models.Altimeter(TIME, 900.0, 10.0, 3.39e6)
    check(c, lambda nav, _: [sqrt(nav[0] ** 2 + nav[1] ** 2 + nav[2] ** 2) - 3.39e6], atol=1e-8)
    assert c.measured == [900.0]
    assert c.noise == [[100.0]]


def test_landing_site_is_planet_fixed():
    covariance = twins.random_covariance(np.random.default_rng(0), [3.0, 4.0, 5.0])
    c = models.LandingSite(TIME, np.array([1.0, 2.0, 3.0]), covariance, MARS)

    def fixed(nav, _):
        a = MARS.prime_meridian_at_epoch + MARS.rotation_rate * TIME
        return cos(a) * nav[0] + sin(a) * nav[1], -sin(a) * nav[0] + cos(a) * nav[1], nav[2]

    check(c, fixed, atol=1e-7)
    np.testing.assert_array_equal(c.noise, covariance)


def test_rest_velocity_is_against_the_turning_ground():
    c = models.RestVelocity(TIME, 0.5, MARS)
    check(c, lambda nav, _: air_relative(nav), rtol=1e-11)
    np.testing.assert_array_equal(c.measured, np.zeros(3))
    np.testing.assert_array_equal(c.noise, 0.25 * np.eye(3))


def test_a_vehicle_at_rest_has_no_velocity_and_a_constant_position():
    """Half an hour after the epoch: position and velocity both as predicted."""
    rock = fixed_position(MARS, 0.3, 1.0, -2000.0)
    site = models.LandingSite(1800.0, rock, np.eye(3), MARS)
    rest = models.RestVelocity(1800.0, 0.1, MARS)
    position = MARS.rotation.to_inertial(1800.0, rock)
    velocity = np.cross([0, 0, MARS.rotation_rate], position)
    nav = np.concatenate((position, velocity, [0, 0, 0, 1]))[:, None]
    np.testing.assert_allclose(site.predict(nav, np.zeros((9, 1)), BARE)[0], rock, atol=1e-8)
    np.testing.assert_allclose(rest.predict(nav, np.zeros((9, 1)), BARE)[0], 0.0, atol=1e-10)


def test_steady_descent_is_in_local_axes():
    c = models.SteadyDescent(TIME, 40.0, 10.0, 0.12, MARS, AIR)

    def drift(nav, _):
        east, north, up, h = local(nav)
        return [east, north, -up / sqrt(2.0 * 40.0 / (0.02 * exp(-2.0 * h / 20e3)))]

    check(c, drift, rtol=1e-9)
    np.testing.assert_allclose(c.noise, np.diag([100.0, 100.0, 0.0144]))
    np.testing.assert_array_equal(c.measured, [0.0, 0.0, 1.0])


def test_dynamic_pressure_is_of_the_moving_air():
    c = models.DynamicPressure(TIME, 700.0, 20.0, 0.1, MARS, AIR)

    def pressure(nav, _):
        east, north, up, h = local(nav)
        density = 0.02 * exp(-2.0 * h / 20e3)
        east, north = east - (10.0 + 20.0 * h / 20e3), north - (-20.0 + 40.0 * h / 20e3)
        return [0.5 * density * (east**2 + north**2 + up**2)]

    check(c, pressure, rtol=1e-9)
    assert c.noise[0, 0] == pytest.approx(20.0**2 + 70.0**2)


@pytest.mark.parametrize("layout", [FULL, BARE])
def test_rest_gravity_is_the_mean_acceleration_over_its_window(layout):
    c = models.RestGravity(TIME, 20.0, 0.01, MARS)

    def acceleration(nav, _):
        return (nav[3:6] - np.cross([0.0, 0.0, MARS.rotation_rate], nav[:3])) / 20.0

    check(c, acceleration, layout, rtol=1e-9)
    np.testing.assert_allclose(c.noise, 1e-4 * np.eye(3))
    drift = np.diag([0.0, 4e-6, 9e-6])
    drifting = models.RestGravity(TIME, 20.0, 0.01, MARS, drift_covariance=drift)
    np.testing.assert_allclose(drifting.noise, 1e-4 * np.eye(3) + drift)


@pytest.mark.parametrize("layout", [FULL, BARE])
def test_rest_rate_is_the_planets(layout):
    c = models.RestRate(TIME, np.zeros(3), 1e-5, MARS)

    def reading(nav, errors):
        rate = to_body(nav[6:10], [0.0, 0.0, MARS.rotation_rate])
        return rate if layout is BARE else (1 + errors[FULL["gyro_scale"]]) * rate + errors[FULL["gyro_bias"]]

    check(c, reading, layout, atol=1e-18)


@pytest.mark.parametrize("layout", [FULL, BARE])
def test_before_entry_the_bias_is_read(layout):
    c = models.ZeroSpecificForce(TIME, np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0]))
    check(c, lambda _, e: e[FULL["accelerometer_bias"]] if layout is FULL else np.zeros(3), layout)
    np.testing.assert_array_equal(c.noise, np.diag([1.0, 4.0, 9.0]))
    np.testing.assert_array_equal(c.measured, [0.1, 0.2, 0.3])


def test_onboard_attitude_is_the_rotation_to_the_propagated_one():
    q = rotations.normalise([0.3, -0.2, 0.5, 0.7])
    c = models.OnboardAttitude(TIME, q, 1e-3)
    turns = np.array([[0.1, 0.0, 0.0], [0.0, -0.2, 0.0], [0.3, 0.2, -0.1], [0.0, 0.0, 1.0]])
    nav, errors = points()
    nav[10:] = rotations.multiply(q, rotations.from_rotation_vector(turns)).T
    np.testing.assert_allclose(c.predict(nav, errors, FULL), turns, atol=1e-13)
    np.testing.assert_array_equal(c.noise, 1e-6 * np.eye(3))
    np.testing.assert_array_equal(c.measured, np.zeros(3))


def slope(constraint, nav, direction, layout=FULL, errors=None, step=1e-3):
    """Slope of the prediction with respect to the navigation state along `direction`."""
    errors = np.zeros((FULL.size, 1)) if errors is None else errors
    ahead, behind = (
        constraint.predict((nav + sign * step * direction)[:, None], errors, layout)[0] for sign in (1, -1)
    )
    return (ahead - behind) / (2 * step)


def test_signs_of_the_slopes():
    """Higher is higher; rising is up; drifting east is east; faster or lower is more dynamic pressure."""
    nav = np.zeros(14)
    nav[:3] = MARS.rotation.to_inertial(TIME, fixed_position(MARS, 0.2, 0.4, 9e3))
    enu = MARS.enu_from_inertial(TIME, nav[:3])
    east, north, up = (np.concatenate((np.zeros(3), e, np.zeros(8))) for e in enu)
    above = np.concatenate((enu[2], np.zeros(11)))
    nav[3:6] = np.cross([0, 0, MARS.rotation_rate], nav[:3]) - 80.0 * enu[2] + 300.0 * enu[0]
    nav[9] = nav[13] = 1.0
    assert slope(models.Altimeter(TIME, 0.0, 1.0, 3.39e6), nav, above)[0] == pytest.approx(1.0, abs=1e-3)
    descent = models.SteadyDescent(TIME, 40.0, 1.0, 1.0, MARS, AIR)
    for axis, direction in enumerate((east, north)):
        np.testing.assert_allclose(slope(descent, nav, direction), np.eye(3)[axis], atol=1e-9)
    assert slope(descent, nav, up)[2] < 0.0  # sinking more slowly
    assert slope(descent, nav, above, step=1.0)[2] < 0.0  # thinner air, faster terminal speed
    pressure = models.DynamicPressure(TIME, 0.0, 1.0, 0.0, MARS, AIR)
    assert slope(pressure, nav, east)[0] > 0.0
    assert slope(pressure, nav, up)[0] < 0.0  # sinking more slowly
    assert slope(pressure, nav, above, step=1.0)[0] < 0.0


def test_components_name_their_units():
    classes = [c for c in vars(models).values() if isinstance(c, type) and isinstance(vars(c).get("components"), tuple)]
    assert len(classes) == 9
    for c in classes:
        assert all(name.endswith(")") and "(" in name for name in c.components)
    assert len({c.name for c in classes}) == 9
    assert UNITS["position"] == "m"
