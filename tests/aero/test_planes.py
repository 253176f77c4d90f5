import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from edl_filter.aero.planes import moments_at_cm, split, total_from_planes

speeds = st.floats(-500.0, 500.0)
coefficients = st.floats(-0.2, 0.2)


def test_design_section_2():
    cn, cy, cm, cn_yaw = split(0.05, -0.03, 3.0, 4.0)
    assert (cn, cy, cm, cn_yaw) == pytest.approx((0.05 * 0.8, -0.05 * 0.6, -0.03 * 0.8, 0.03 * 0.6))


def test_without_lateral_flow():
    assert split(0.0, 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0, 0.0)
    assert np.isfinite(split(np.full(2, 0.1), 0.1, np.array([0.0, 1.0]), 0.0)).all()


@given(coefficients, coefficients, speeds, speeds)
@example(0.1, 0.1, 5e-324, 5e-324)
def test_round_trip(cnt, cmt, v, w):
    assert total_from_planes(*split(cnt, cmt, v, w), v, w) == pytest.approx((cnt, cmt), abs=1e-12)


@given(*[coefficients] * 9)
def test_moments_are_moved_by_the_cross_product(ca, cy, cn, cl, cm, cn_yaw, x, y, z):
    force = np.array([-ca, cy, -cn])
    nose_from_cm = np.array([x, -y, -z])  # the centre of mass is x behind the nose, y right, z down
    expected = np.array([cl, cm, cn_yaw]) + np.cross(nose_from_cm, force)
    np.testing.assert_allclose(moments_at_cm((ca, cy, cn), (cl, cm, cn_yaw), (x, y, z)), expected, atol=1e-12)


@given(coefficients, coefficients, speeds, speeds)
def test_moving_the_total_or_its_planes_is_the_same(cnt, cmt, v, w):
    """For a centre of mass on the axis."""
    cn, cy, cm, cn_yaw = split(cnt, cmt, v, w)
    moved = moments_at_cm((1.6, cy, cn), (0.0, cm, cn_yaw), (0.25, 0.0, 0.0))
    _, _, *expected = split(cnt, cmt + 0.25 * cnt, v, w)
    np.testing.assert_allclose(moved[1:], expected, atol=1e-12)
