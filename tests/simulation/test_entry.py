import numpy as np
import slow_flight as slow

from edl_filter import rotations
from edl_filter.planet import ellipsoid
from edl_filter.simulation.entry import attitude, inertial_state

GIVEN = (3.522e6, -0.3, 2.8, 5600.0, -0.2, 1.4)


def test_state_has_the_conditions_stated():
    r, v = inertial_state(slow.MARS, *GIVEN)
    latitude, longitude, radius = ellipsoid.areocentric_from_fixed(slow.MARS.rotation.to_fixed(0.0, r))
    np.testing.assert_allclose([radius, latitude, longitude], GIVEN[:3], rtol=1e-12)
    up = r / radius
    east = np.cross([0.0, 0.0, 1.0], up) / np.cos(latitude)
    north = np.cross(up, east)
    np.testing.assert_allclose(np.linalg.norm(v), GIVEN[3], rtol=1e-12)
    np.testing.assert_allclose(np.arcsin(v @ up / GIVEN[3]), GIVEN[4], rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(v @ east, v @ north), GIVEN[5], rtol=1e-12)


def test_attitude_has_the_angles_stated():
    r, v = inertial_state(slow.MARS, *GIVEN)
    for alpha, beta, bank in ((0.0, 0.0, 0.0), (0.1, -0.05, 0.0), (-0.2, 0.15, 2.0)):
        q = attitude(v, r, alpha, beta, bank)
        x, y, z = rotations.rotate(rotations.conjugate(q), v / np.linalg.norm(v))
        np.testing.assert_allclose([np.arctan2(z, x), np.arcsin(y)], [alpha, beta], atol=1e-12)
    level = attitude(v, r, 0.0, 0.0, 0.0)
    down = rotations.rotate(level, [0.0, 0.0, 1.0])
    assert down @ r < 0.0 and abs(rotations.rotate(level, [0.0, 1.0, 0.0]) @ r) < 1e-6
