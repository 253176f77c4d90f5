"""Forms of the effects that act on vehicle, planet, air and aerodynamics, against the formulas written out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from standins import BODY, PLANET, STATE, H, N, T, flow, totals

from edl_filter.effects import Active, Body
from edl_filter.effects.catalogue import effect_named
from edl_filter.rotations import from_rotation_vector, rotate


def on(name, **values):
    effect = effect_named(name)
    return effect, Active(effect, values).values


def coefficients(name, **values):
    effect, p = on(name, **values)
    return effect.coefficients(p, flow(), totals())


def test_mass_and_centre_of_mass():
    effect, p = on("mass", k=0.05)
    assert effect.vehicle(p, BODY).mass == pytest.approx(832.0 * 1.05)
    effect, p = on("com_offset", dy=4e-3, dz=-3e-3)
    moved = effect.vehicle(p, Body(1.0, np.eye(3), np.array([0.0, 1e-3, 0.0])))
    np.testing.assert_allclose(moved.offset, [0.0, 5e-3, -3e-3])


def test_tensor_elements_are_minus_the_products():
    effect, p = on("products_of_inertia", a=1.0, b=2.0, c=3.0)
    change = effect.vehicle(p, BODY).inertia - BODY.inertia
    np.testing.assert_allclose(change, -np.array([[0, 1, 2], [1, 0, 3], [2, 3, 0]]))


def test_oblateness_is_added():
    effect, p = on("gravity_oblateness", J2=1e-3)
    assert effect.gravity(p, PLANET).j2 == pytest.approx(2.96e-3)


@given(st.floats(-0.9, 0.9), st.floats(8e3, 25e3), st.floats(0.0, 6.28))
def test_density_wave(amplitude, length, phase):
    effect, p = on("density_wave", A=amplitude, L=length, phase=phase)
    np.testing.assert_allclose(effect.density(p, H), 1 + amplitude * np.sin(2 * np.pi * H / length + phase))


def test_wind_is_there_in_its_layer_only():
    effect, p = on("wind", east=30.0, north=-20.0, h_lo=10e3, h_hi=30e3)
    heights = np.array([0.0, 10e3, 20e3, 30e3, 45e3])
    expected = np.outer([0.0, 0.5, 1.0, 0.5, 0.0], [30.0, -20.0])
    np.testing.assert_allclose(effect.wind(p, heights), expected, atol=0.01)


def test_air_at_rest_in_inertial_space():
    effect, p = on("atmosphere_rotation", k=1.0)
    assert effect.atmosphere_rate(p) == 0.0


def test_scales_of_the_coefficients():
    before = totals()
    np.testing.assert_allclose(coefficients("axial_force_scale", k=0.05).ca, 1.05 * before.ca)
    np.testing.assert_allclose(coefficients("normal_force_scale", k=-0.3).cn, 0.7 * before.cn)
    np.testing.assert_allclose(coefficients("pitching_moment_scale", k=0.2).cm_nose, 1.2 * before.cm_nose)


def test_base_pressure_ends_at_mach_10():
    mach = flow().mach
    expected = np.where(mach < 10, 0.15 * (1 - mach / 10) ** 2, 0.0)
    assert 0 < np.sum(mach < 10) < N
    np.testing.assert_allclose(coefficients("base_pressure", a=0.15).ca - 1.7, expected)


def test_static_instability_is_nose_up_and_ends_at_8_degrees():
    effect, p = on("static_instability", a=4e-3)
    angles = np.radians([0.0, 2.0, 4.0, 8.0, 8.5, 12.0, 20.0])
    mach = np.array([18.0, 18.0, 18.0, 18.0, 18.0, 18.0, 10.0])
    added = effect.coefficients(p, flow(mach=mach, alpha_total=angles), totals()).cm_nose - totals().cm_nose
    np.testing.assert_allclose(added, [0.0, 4e-3 * np.sin(np.pi / 4), 4e-3, 0, 0, 0, 0], atol=1e-15)
    at_22 = effect.coefficients(p, flow(mach=np.full(N, 22.0), alpha_total=np.full(N, np.radians(4))), totals())
    np.testing.assert_allclose(at_22.cm_nose - totals().cm_nose, 4e-3 * np.exp(-1.0))


def test_pitch_damping_below_mach_3_5():
    mach = np.array([5.0, 3.6, 3.5, 3.49, 3.0, 2.0, 1.0])
    effect, p = on("pitch_damping", a=0.6)
    added = effect.coefficients(p, flow(mach=mach), totals()).cmq + 0.1
    np.testing.assert_allclose(added, [0, 0, 0, 0.6, 0.6, 0.6, 0.6], atol=1e-15)


def test_rolling_moment():
    np.testing.assert_allclose(coefficients("rolling_moment", k=5e-4, c=1e-6).cl, 5e-4 * flow().alpha_total + 1e-6)


@pytest.mark.parametrize("end", [np.inf, 121.0])
def test_remnant_torque_is_body_fixed_from_its_beginning_to_its_end(end):
    effect, p = on("remnant_torque", Cl=1e-6, Cm=2e-3, Cn=-1e-3, t0=110.0, t1=end)
    force, moment = effect.force_moment(p, flow())
    there = (T >= 110.0) & (end > T)
    size = there * flow().dynamic_pressure * np.pi / 4 * 2.65**3
    np.testing.assert_allclose(moment, np.outer(size, [1e-6, 2e-3, -1e-3]))
    assert not force.any()


def test_entry_state_is_turned_as_a_whole():
    effect, p = on("attitude_frame", rx=1e-3, ry=-5e-3, rz=2e-3)
    turned, r = effect.entry_state(p, STATE), from_rotation_vector([1e-3, -5e-3, 2e-3])
    np.testing.assert_allclose(turned.position, rotate(r, STATE.position))
    np.testing.assert_allclose(turned.velocity, rotate(r, STATE.velocity))
    np.testing.assert_array_equal(turned.inertial_from_body, STATE.inertial_from_body)
    np.testing.assert_allclose(turned.covariance, np.eye(9), atol=1e-15)
