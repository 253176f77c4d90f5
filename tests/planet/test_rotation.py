"""Rotation of the planet against sines and cosines written out, and relative velocity as a derivative."""

import numpy as np
import pytest
from geodetic import fixed_position
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.planet import Planet, Rotation

MARS = Rotation(rate=7.088218e-5, prime_meridian_at_epoch=0.88365)
PLANET = Planet(
    name="mars",
    mu=4.282837e13,
    j2=1.960454e-3,
    gravity_radius=3396190.0,
    equatorial_radius=3396190.0,
    flattening=1.0 / 169.894447,
    rotation_rate=MARS.rate,
    prime_meridian_at_epoch=MARS.prime_meridian_at_epoch,
)

times = st.floats(-1e6, 1e6)
vectors = st.tuples(*[st.floats(-4e6, 4e6)] * 3).map(np.array)


def reference_fixed(time, vector):
    angle = MARS.prime_meridian_at_epoch + MARS.rate * time
    x, y, z = vector
    return np.array([x * np.cos(angle) + y * np.sin(angle), -x * np.sin(angle) + y * np.cos(angle), z])


@given(times, vectors)
def test_fixed_components(time, vector):
    np.testing.assert_allclose(MARS.to_fixed(time, vector), reference_fixed(time, vector), atol=1e-8)
    np.testing.assert_allclose(MARS.to_inertial(time, MARS.to_fixed(time, vector)), vector, atol=1e-8)


@given(times)
def test_prime_meridian_is_at_its_angle(time):
    angle = MARS.angle(time)
    np.testing.assert_allclose(MARS.to_fixed(time, [np.cos(angle), np.sin(angle), 0.0]), [1.0, 0.0, 0.0], atol=1e-15)
    assert np.linalg.norm(MARS.fixed_from_inertial(time)) == pytest.approx(1.0, abs=1e-15)


@given(vectors, vectors)
def test_relative_velocity_is_eq_3_6(position, velocity):
    relative = MARS.velocity_relative(position, velocity)
    expected = velocity - np.cross([0.0, 0.0, MARS.rate], position)
    np.testing.assert_allclose(relative, expected, atol=1e-9)


def test_relative_velocity_is_the_derivative_of_the_fixed_position():
    position, velocity = np.array([-2833658.0, -1800899.0, -1064442.0]), np.array([3522.0, -4166.0, 1383.0])
    dt = 0.05
    after, before = (MARS.to_fixed(sign * dt, position + sign * dt * velocity) for sign in (1.0, -1.0))
    expected = (after - before) / (2 * dt)
    relative = MARS.velocity_relative(position, velocity)
    np.testing.assert_allclose(MARS.to_fixed(0.0, relative), expected, atol=1e-6)
    # Computed by hand: (3522 - 127.651, -4166 + 200.856, 1383)
    assert np.linalg.norm(relative) == pytest.approx(5399.7, abs=0.1)


def test_point_on_the_ground_has_zero_relative_velocity():
    time = np.linspace(0.0, 500.0, 7)
    fixed = np.array([-3.1e6, 1.2e6, -8e5])
    inertial = MARS.to_inertial(time, fixed)
    velocity = np.cross([0.0, 0.0, MARS.rate], inertial)
    np.testing.assert_allclose(MARS.velocity_relative(inertial, velocity), 0.0, atol=1e-12)
    np.testing.assert_allclose(MARS.to_fixed(time, inertial), np.broadcast_to(fixed, (7, 3)), atol=1e-8)
    np.testing.assert_allclose(
        np.diff(inertial, axis=0) / np.diff(time)[:, None],
        0.5 * (velocity[1:] + velocity[:-1]),
        rtol=1e-4,
    )


def test_planet_delegates_to_the_formulas():
    time, position = 120.0, np.array([-2833658.0, -1800899.0, -1064442.0])
    latitude, longitude, altitude = PLANET.geodetic(time, position)
    fixed = fixed_position(PLANET, latitude, longitude, altitude)
    np.testing.assert_allclose(fixed, MARS.to_fixed(time, position), atol=1e-8)
    np.testing.assert_array_equal(PLANET.geodetic_from_fixed(MARS.to_fixed(time, position))[2], altitude)
    assert PLANET.rotation == MARS
    np.testing.assert_array_equal(
        PLANET.velocity_relative(position, position), MARS.velocity_relative(position, position)
    )
    assert np.linalg.norm(PLANET.gravity(position)) == pytest.approx(3.45, abs=0.01)
    assert PLANET.potential(position) == pytest.approx(PLANET.mu / 3522199.8, rel=2e-3)


def test_local_axes_of_inertial_positions():
    time, position = np.array([0.0, 4000.0]), np.array([[-2.8e6, -1.8e6, -1.0e6], [1.0e6, 3.3e6, 2.0e5]])
    axes = PLANET.enu_from_inertial(time, position)
    assert axes.shape == (2, 3, 3)
    latitude, longitude, _ = PLANET.geodetic(time, position)
    for i in range(2):
        east, north, up = MARS.to_fixed(time[i], axes[i])
        assert up == pytest.approx(
            [
                np.cos(latitude[i]) * np.cos(longitude[i]),
                np.cos(latitude[i]) * np.sin(longitude[i]),
                np.sin(latitude[i]),
            ]
        )
        assert east[2] == pytest.approx(0.0, abs=1e-15)
        np.testing.assert_allclose(np.cross(east, north), up, atol=1e-14)


def test_axes_rotate_eastward():
    quarter = Rotation(rate=np.pi / 2, prime_meridian_at_epoch=0.0)
    q = quarter.fixed_from_inertial([0.0, 1.0])
    np.testing.assert_allclose(rotations.rotate(q, [1.0, 0.0, 0.0]), [[1, 0, 0], [0, -1, 0]], atol=1e-15)
