"""Components of total coefficients in the planes, and the transfer of moments to the centre of mass."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from edl_filter.aero.planes import moments_at_cm, split

speeds = st.floats(-500.0, 500.0)
coefficients = st.floats(-0.2, 0.2)


def test_components_follow_the_sign_convention():
    cn, cy, cm, cn_yaw = split(0.05, -0.03, 3.0, 4.0)
    assert (cn, cy, cm, cn_yaw) == pytest.approx((0.05 * 0.8, -0.05 * 0.6, -0.03 * 0.8, 0.03 * 0.6))


def test_without_lateral_flow():
    assert split(0.0, 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0, 0.0)
    assert np.isfinite(split(np.full(2, 0.1), 0.1, np.array([0.0, 1.0]), 0.0)).all()


@given(coefficients, coefficients, speeds, speeds)
@example(0.1, 0.1, 5e-324, 5e-324)
def test_components_have_the_magnitude_and_direction_of_the_total(cnt, cmt, v, w):
    cn, cy, cm, cn_yaw = split(cnt, cmt, v, w)
    assert (np.hypot(cn, cy), np.hypot(cm, cn_yaw)) == pytest.approx((abs(cnt), abs(cmt)), abs=1e-12)
    lateral = np.hypot(v, w)
    if lateral >= np.finfo(float).tiny:
        sine, cosine = v / lateral, w / lateral
        assert cn * cosine - cy * sine == pytest.approx(cnt, abs=1e-12)
        assert cm * cosine - cn_yaw * sine == pytest.approx(cmt, abs=1e-12)
    else:
        assert (cn, cm) == pytest.approx((cnt, cmt), abs=1e-12)


@given(*[coefficients] * 9)
def test_transfer_of_moments_is_the_cross_product(ca, cy, cn, cl, cm, cn_yaw, x, y, z):
    force = np.array([-ca, cy, -cn])
    nose_from_cm = np.array([x, -y, -z])  # the centre of mass is x behind the nose, y to the right, z down
    expected = np.array([cl, cm, cn_yaw]) + np.cross(nose_from_cm, force)
    np.testing.assert_allclose(moments_at_cm((ca, cy, cn), (cl, cm, cn_yaw), (x, y, z)), expected, atol=1e-12)


@given(coefficients, coefficients, speeds, speeds)
def test_transfer_and_components_commute_for_a_centre_of_mass_on_the_axis(cnt, cmt, v, w):
    cn, cy, cm, cn_yaw = split(cnt, cmt, v, w)
    transferred = moments_at_cm((1.6, cy, cn), (0.0, cm, cn_yaw), (0.25, 0.0, 0.0))
    _, _, *expected = split(cnt, cmt + 0.25 * cnt, v, w)
    np.testing.assert_allclose(transferred[1:], expected, atol=1e-12)
