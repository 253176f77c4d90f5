"""The sphere-cone forebody: shape, panels, vehicles by name, and errors."""

import math

import numpy as np
import pytest
from forebodies import MER
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.aero.body import SphereCone, _bodies, sphere_cone
from edl_filter.errors import InputError


@st.composite
def bodies(draw):
    """Any valid body: the nose radius is a fraction of the largest one that the shoulder permits."""
    angle = math.radians(draw(st.floats(20.0, 85.0)))
    shoulder = draw(st.floats(0.0, 0.45))
    largest_nose = (0.5 - shoulder * (1.0 - math.cos(angle))) / math.cos(angle)
    nose = draw(st.floats(0.0, 1.0)) * largest_nose
    diameter = draw(st.floats(0.3, 20.0))
    return SphereCone(diameter, nose * diameter, shoulder * diameter, angle)


@given(bodies())
def test_panels_have_the_projected_area_and_the_volume(body):
    panels = body.panels(12, 16)
    np.testing.assert_allclose(np.linalg.norm(panels.normal, axis=1), 1.0, rtol=1e-12)
    assert np.all(panels.centre[:, 0] <= 1e-12)
    assert np.all(panels.area > 0.0)
    projected_area = panels.area @ panels.normal
    np.testing.assert_allclose(projected_area, [body.reference_area, 0.0, 0.0], atol=1e-9 * body.diameter**2)
    # Divergence theorem, closed by a disc at the largest diameter: the fields x e_x and r e_r / 2 both give the volume
    from_x = panels.area @ (panels.normal[:, 0] * (panels.centre[:, 0] + body.length))
    from_r = panels.area @ np.sum(panels.normal[:, 1:] * panels.centre[:, 1:], axis=1) / 2.0
    assert from_x == pytest.approx(from_r, rel=1e-8)


@given(bodies())
def test_meridian_is_smooth_and_ends_at_the_largest_diameter(body):
    meridian = body.meridian(40)
    assert np.all(np.diff(meridian.radius) > -1e-12)
    assert np.all(np.diff(meridian.x) < 1e-12)
    # The direction of the normal is monotone: no kink at a joint
    assert np.all(np.diff(np.arctan2(meridian.normal_r, meridian.normal_x)) > -1e-12)
    assert meridian.radius[-1] <= body.diameter / 2.0 * (1.0 + 1e-12)
    radial_extent = meridian.length @ meridian.normal_x
    axial_extent = meridian.length @ meridian.normal_r
    assert radial_extent == pytest.approx(body.diameter / 2.0, rel=1e-9)
    assert axial_extent == pytest.approx(body.length, rel=1e-9)


def test_area_of_a_hemisphere_a_disc_and_a_sharp_cone():
    assert SphereCone(2.0, 1.0, 0.0, 0.0).panels(10, 8).area.sum() == pytest.approx(2.0 * math.pi)
    assert SphereCone(2.0, 0.7, 0.0, math.pi / 2).panels(2, 8).area.sum() == pytest.approx(math.pi)
    assert SphereCone(2.0, 0.0, 0.0, math.radians(30)).panels(2, 8).area.sum() == pytest.approx(2.0 * math.pi)
    assert SphereCone(2.0, 0.0, 0.0, math.radians(45)).length == pytest.approx(1.0)


def test_panels_equal_loops():
    panels = MER.panels(3, 4)
    meridian = MER.meridian(3)
    row = 0
    for x, r, nx, nr, length in zip(*meridian, strict=True):
        for step in range(4):
            azimuth = 2.0 * math.pi * (step + 0.5) / 4
            right, down = math.sin(azimuth), math.cos(azimuth)
            np.testing.assert_allclose(panels.centre[row], [x, r * right, r * down], atol=1e-15)
            np.testing.assert_allclose(panels.normal[row], [nx, nr * right, nr * down], atol=1e-15)
            assert panels.area[row] == pytest.approx(length * r * math.pi / 2.0)
            row += 1
    assert row == len(panels.area)


@pytest.mark.parametrize(
    ("dimensions", "message"),
    [
        ((0.0, 0.1, 0.0, 1.0), "diameter"),
        ((math.nan, 0.1, 0.0, 1.0), "diameter"),
        ((1.0, -0.1, 0.0, 1.0), "nose_radius"),
        ((1.0, 0.1, math.inf, 1.0), "shoulder_radius"),
        ((1.0, 0.1, 0.6, 1.0), "shoulder_radius"),
        ((1.0, 0.1, 0.0, 70.0), "cone_half_angle .* radians"),
        ((1.0, 0.1, 0.0, math.nan), "cone_half_angle"),
        ((1.0, 0.8, 0.1, 0.5), "overlap"),
        ((1.0, 0.3, 0.1, 0.0), "cannot widen"),
    ],
)
def test_invalid_body_raises(dimensions, message):
    with pytest.raises(InputError, match=message):
        SphereCone(*dimensions)


def test_too_few_points_raise():
    with pytest.raises(InputError, match="azimuths"):
        MER.panels(4, 2)
    with pytest.raises(InputError, match="point"):
        MER.meridian(0)


def test_bodies_by_name():
    assert sphere_cone("mer") == sphere_cone("MER") == MER
    assert sphere_cone("Stardust").diameter == pytest.approx(0.8128)
    with pytest.raises(InputError, match=r"'Beagle'.*Viking, Pathfinder, MER"):
        sphere_cone("Beagle")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("vehicle,D_m\nA,1\n", "columns Rn_m, Rc_m, cone_half_angle_deg are missing"),
        ("vehicle,D_m,Rn_m,Rc_m,cone_half_angle_deg\nA,1,wide,0,60\n", "row of A .* not a number"),
        ("vehicle,D_m,Rn_m,Rc_m,cone_half_angle_deg\nA,1,0.2\n", "row of A .* not a number"),
        ("vehicle,D_m,Rn_m,Rc_m,cone_half_angle_deg\nA,1,9,0,60\n", "A: .*overlap"),
    ],
)
def test_invalid_table_raises(tmp_path, text, message):
    path = tmp_path / "geometry.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        _bodies(path)
