"""The sphere-cone forebody: shape, panels, names, and what it refuses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.aero.body import SphereCone, centre_of_pressure, sphere_cone
from edl_filter.errors import InputError

MER = SphereCone(2.65, 0.6625, 0.0662, math.radians(70.0))


@st.composite
def bodies(draw):
    """Any body that can be built: nose and shoulder take shares of the room there is."""
    angle = math.radians(draw(st.floats(20.0, 85.0)))
    shoulder = draw(st.floats(0.0, 0.45))
    room = (0.5 - shoulder * (1.0 - math.cos(angle))) / math.cos(angle)
    nose = draw(st.floats(0.0, 1.0)) * room
    diameter = draw(st.floats(0.3, 20.0))
    return SphereCone(diameter, nose * diameter, shoulder * diameter, angle)


@given(bodies())
def test_panels_close_the_projected_area_and_the_volume(body):
    panels = body.panels(12, 16)
    np.testing.assert_allclose(np.linalg.norm(panels.normal, axis=1), 1.0, rtol=1e-12)
    assert np.all(panels.centre[:, 0] <= 1e-12)
    assert np.all(panels.area > 0.0)
    seen_from_ahead = panels.area @ panels.normal
    np.testing.assert_allclose(seen_from_ahead, [body.reference_area, 0.0, 0.0], atol=1e-9 * body.diameter**2)
    # divergence theorem with the flat lid at the largest diameter: both fields x e_x and r e_r / 2 give the volume
    from_x = panels.area @ (panels.normal[:, 0] * (panels.centre[:, 0] + body.length))
    from_r = panels.area @ np.sum(panels.normal[:, 1:] * panels.centre[:, 1:], axis=1) / 2.0
    assert from_x == pytest.approx(from_r, rel=1e-8)


@given(bodies())
def test_meridian_is_smooth_and_ends_at_the_largest_diameter(body):
    line = body.meridian(40)
    assert np.all(np.diff(line.radius) > -1e-12)
    assert np.all(np.diff(line.x) < 1e-12)
    # the normal turns one way only: no kink at a join
    assert np.all(np.diff(np.arctan2(line.normal_r, line.normal_x)) > -1e-12)
    assert line.radius[-1] <= body.diameter / 2.0 * (1.0 + 1e-12)
    rise = line.length @ line.normal_x
    run = line.length @ line.normal_r
    assert rise == pytest.approx(body.diameter / 2.0, rel=1e-9)
    assert run == pytest.approx(body.length, rel=1e-9)


def test_area_of_a_hemisphere_a_disc_and_a_sharp_cone():
    assert SphereCone(2.0, 1.0, 0.0, 0.0).panels(10, 8).area.sum() == pytest.approx(2.0 * math.pi)
    assert SphereCone(2.0, 0.7, 0.0, math.pi / 2).panels(2, 8).area.sum() == pytest.approx(math.pi)
    assert SphereCone(2.0, 0.0, 0.0, math.radians(30)).panels(2, 8).area.sum() == pytest.approx(2.0 * math.pi)
    assert SphereCone(2.0, 0.0, 0.0, math.radians(45)).length == pytest.approx(1.0)


def test_panels_equal_plain_loops():
    panels = MER.panels(3, 4)
    line = MER.meridian(3)
    row = 0
    for x, r, nx, nr, length in zip(*line, strict=True):
        for step in range(4):
            azimuth = 2.0 * math.pi * (step + 0.5) / 4
            across, down = math.sin(azimuth), math.cos(azimuth)
            np.testing.assert_allclose(panels.centre[row], [x, r * across, r * down], atol=1e-15)
            np.testing.assert_allclose(panels.normal[row], [nx, nr * across, nr * down], atol=1e-15)
            assert panels.area[row] == pytest.approx(length * r * math.pi / 2.0)
            row += 1
    assert row == len(panels.area)


@pytest.mark.parametrize(
    ("sizes", "said"),
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
def test_says_what_is_wrong_with_a_body(sizes, said):
    with pytest.raises(InputError, match=said):
        SphereCone(*sizes)


def test_refuses_too_few_points():
    with pytest.raises(InputError, match="azimuths"):
        MER.panels(4, 2)
    with pytest.raises(InputError, match="point"):
        MER.meridian(0)


def test_named_bodies(mevad):
    table = mevad / "geometry.csv"
    assert sphere_cone("mer", table) == MER
    assert sphere_cone("Stardust", table).diameter == pytest.approx(0.8128)
    with pytest.raises(InputError, match=r"'Beagle'.*Viking, Pathfinder, MER"):
        sphere_cone("Beagle", table)


def test_the_packages_own_bodies():
    assert sphere_cone("MER") == MER


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("vehicle,D_m\nA,1\n", "columns Rn_m, Rc_m, cone_half_angle_deg are missing"),
        ("vehicle,D_m,Rn_m,Rc_m,cone_half_angle_deg\nA,1,wide,0,60\n", "row of A .* not a number"),
        ("vehicle,D_m,Rn_m,Rc_m,cone_half_angle_deg\nA,1,0.2\n", "row of A .* not a number"),
        ("vehicle,D_m,Rn_m,Rc_m,cone_half_angle_deg\nA,1,9,0,60\n", "A: .*overlap"),
    ],
)
def test_says_what_is_wrong_with_a_table(tmp_path, text, said):
    path = tmp_path / "geometry.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        sphere_cone("A", path)


def test_centre_of_pressure():
    assert centre_of_pressure(0.2, -0.1) == pytest.approx(0.5)
    np.testing.assert_array_equal(centre_of_pressure([0.0, 0.5], [-0.1, -0.25]), [np.nan, 0.5])
