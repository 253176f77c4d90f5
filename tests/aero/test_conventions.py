"""Reference area and angles of the flow against their definitions."""

import numpy as np
import pytest

from edl_filter.aero.conventions import attack_and_sideslip, reference_area, total_angle


def test_reference_area_is_that_of_a_disc():
    assert reference_area(2.65) == pytest.approx(np.pi * 1.325**2, rel=1e-15)


def test_angles_are_those_of_the_components():
    velocity = np.random.default_rng(2).standard_normal((40, 3))
    u, v, w = velocity.T
    speed = np.sqrt(u**2 + v**2 + w**2)
    alpha, beta = attack_and_sideslip(velocity)
    np.testing.assert_allclose(total_angle(velocity), np.arccos(u / speed), rtol=1e-12)
    np.testing.assert_allclose(beta, np.arcsin(v / speed), rtol=1e-12)
    np.testing.assert_allclose(np.tan(alpha), w / u, rtol=1e-12)
    np.testing.assert_array_equal(np.sign(alpha), np.sign(w))


def test_small_angles_are_resolved():
    """The cosine of an angle of 1e-9 rad is 1."""
    np.testing.assert_allclose(total_angle(np.array([[5e3, 3e-6, 4e-6]])), 1e-9, rtol=1e-12)
