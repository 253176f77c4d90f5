"""Areodetic and areocentric coordinates against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.planet import ellipsoid

A, F = 3396190.0, 1.0 / 169.894447

latitudes = st.floats(-np.pi / 2, np.pi / 2)
longitudes = st.floats(-3.14159, 3.14159)
altitudes = st.floats(-8.0e3, 1.0e7)


def definition_of_position(latitude, longitude, altitude, a, f):
    """Definition of areodetic coordinates, written out in extended precision; ``(..., 3)``, m."""
    latitude, longitude, altitude, a, f = (np.longdouble(v) for v in (latitude, longitude, altitude, a, f))
    e2 = f * (2 - f)
    n = a / np.sqrt(1 - e2 * np.sin(latitude) ** 2)
    components = np.broadcast_arrays(
        (n + altitude) * np.cos(latitude) * np.cos(longitude),
        (n + altitude) * np.cos(latitude) * np.sin(longitude),
        (n * (1 - e2) + altitude) * np.sin(latitude),
    )
    return np.stack(components, axis=-1)


@given(latitudes, longitudes, st.floats(-8.0e3, 4.0e5))
def test_round_trip_is_accurate_to_a_nanometre_at_entry_altitudes(latitude, longitude, altitude):
    # The point is rounded to float64: the comparison is with the coordinates of the rounded point
    point = definition_of_position(latitude, longitude, altitude, A, F).astype(float)
    lat, lon, alt = ellipsoid.geodetic_from_fixed(point, A, F)
    error = (definition_of_position(lat, lon, alt, A, F) - point).astype(float)
    up = ellipsoid.enu_from_fixed(lat, lon)[2]
    assert abs(up @ error) < 1e-9
    assert np.linalg.norm(error) < 3e-9  # rounding of the two angles, half an ulp of pi each, in metres
    assert abs(alt - altitude) < 2e-9
    assert abs(lat - latitude) < 1e-15 + 4e-16 * abs(latitude)


@given(latitudes, longitudes, altitudes, st.floats(0.0, 0.1))
def test_round_trip_for_any_flattening(latitude, longitude, altitude, flattening):
    point = definition_of_position(latitude, longitude, altitude, A, flattening).astype(float)
    lat, lon, alt = ellipsoid.geodetic_from_fixed(point, A, flattening)
    round_trip = definition_of_position(lat, lon, alt, A, flattening).astype(float)
    np.testing.assert_allclose(round_trip, point, rtol=0, atol=1e-15 * (A + altitude) * 4)
    assert alt == pytest.approx(altitude, abs=1e-15 * (A + altitude) * 4)


@pytest.mark.parametrize(
    ("point", "latitude", "altitude"),
    [
        ((A + 125e3, 0.0, 0.0), 0.0, 125e3),
        ((0.0, A, 0.0), 0.0, 0.0),
        ((0.0, 0.0, A * (1 - F) + 10.0), np.pi / 2, 10.0),
        ((0.0, 0.0, -A * (1 - F)), -np.pi / 2, 0.0),
    ],
)
def test_closed_forms_at_poles_and_equator(point, latitude, altitude):
    lat, _, alt = ellipsoid.geodetic_from_fixed(point, A, F)
    assert lat == pytest.approx(latitude, abs=1e-16)
    assert alt == pytest.approx(altitude, abs=1e-9)


@given(latitudes, longitudes, st.floats(3.3e6, 1.0e7))
def test_areodetic_equals_areocentric_on_a_sphere(latitude, longitude, radius):
    point = ellipsoid.fixed_from_areocentric(latitude, longitude, radius)
    lat, lon, alt = ellipsoid.geodetic_from_fixed(point, A, 0.0)
    np.testing.assert_allclose((lat, lon), ellipsoid.areocentric_from_fixed(point)[:2], atol=1e-15)
    assert alt == pytest.approx(radius - A, abs=4e-9)


@given(latitudes, longitudes, st.floats(1.0, 1.0e8))
def test_areocentric_round_trip(latitude, longitude, radius):
    point = ellipsoid.fixed_from_areocentric(latitude, longitude, radius)
    lat, lon, r = ellipsoid.areocentric_from_fixed(point)
    assert r == pytest.approx(radius, rel=1e-15)
    assert lat == pytest.approx(latitude, abs=1e-15)
    if abs(latitude) < 1.57:
        assert lon == pytest.approx(longitude, abs=1e-15)


def test_shapes_broadcast():
    latitude = np.linspace(-1.5, 1.5, 4)[:, None]
    longitude = np.linspace(-3.0, 3.0, 5)
    points = definition_of_position(latitude, longitude, 1000.0, A, F).astype(float)
    assert points.shape == (4, 5, 3)
    lat, lon, alt = ellipsoid.geodetic_from_fixed(points, A, F)
    np.testing.assert_allclose(lat, np.broadcast_to(latitude, (4, 5)), atol=1e-15)
    np.testing.assert_allclose(lon, np.broadcast_to(longitude, (4, 5)), atol=1e-15)
    np.testing.assert_allclose(alt, 1000.0, atol=3e-9)
    assert ellipsoid.fixed_from_areocentric(latitude, longitude, A).shape == (4, 5, 3)
    assert ellipsoid.enu_from_fixed(latitude, longitude).shape == (4, 5, 3, 3)


@given(st.floats(-1.5, 1.5), longitudes, st.floats(0.0, 1.0e5))
def test_local_axes_point_along_increasing_coordinates(latitude, longitude, altitude):
    axes = ellipsoid.enu_from_fixed(latitude, longitude)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    step = np.eye(3) * (1e-6, 1e-6, 1.0)
    coordinates = np.array([latitude, longitude, altitude])
    displacements = [
        definition_of_position(*(coordinates + d), A, F) - definition_of_position(*(coordinates - d), A, F)
        for d in step
    ]
    north, east, up = (v / np.linalg.norm(v) for v in displacements)
    np.testing.assert_allclose(axes, [east, north, up], atol=1e-7)


def test_thesis_entry_state_of_mer_a():
    # Facts file section 3: areocentric latitude -17.590 deg at |r| = 3522.2 km
    latitude, _, radius = ellipsoid.areocentric_from_fixed([-2833658.0, -1800899.0, -1064442.0])
    assert np.degrees(latitude) == pytest.approx(-17.590, abs=5e-4)
    assert radius == pytest.approx(3522199.8, abs=0.1)
