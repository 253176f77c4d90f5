"""Effects on the coefficients, forces and moments, against numbers worked out by hand.

`totals` has CA 1.7, CN from 0 to 0.05, Cm from 0 to -0.02; `flow` has angles from 0 to 0.2 rad. That every effect is
off at zero is tested in `test_catalogue`.
"""

import numpy as np
import pytest
from standins import N, T, changes, flow, on, only


@pytest.mark.parametrize(
    ("name", "k", "coefficient", "last"),
    [
        ("axial_force_scale", 0.05, "ca", 0.085),  # 1.7 · 0.05
        ("normal_force_scale", -0.3, "cn", -0.015),  # 0.05 · -0.3
        ("pitching_moment_scale", 0.2, "cm_nose", -0.004),  # -0.02 · 0.2
    ],
)
def test_scales_of_the_coefficients(name, k, coefficient, last):
    assert only(changes(name, k=k), coefficient)[-1] == pytest.approx(last, rel=1e-13)


def test_base_pressure_ends_at_mach_10():
    """``0.15 (1 - M/10)²``: 0.15, 0.15 · 0.64, 0.15 · 0.25, 0.15 · 0.01, and nothing from Mach 10 on."""
    flight = flow(mach=np.array([0.0, 2.0, 5.0, 9.0, 10.0, 12.0, 25.0]))
    change = only(changes("base_pressure", flight, a=0.15), "ca")
    np.testing.assert_allclose(change, [0.15, 0.096, 0.0375, 0.0015, 0.0, 0.0, 0.0], atol=1e-15)


def test_base_pressure_has_no_kink_at_mach_10():
    """The slope at the end is zero on both sides; at Mach 5 it is -2 · 0.15 · 0.5 / 10 = -0.015 per Mach number."""
    step = 1e-4
    mach = np.array([10.0 - step, 10.0 + step, 5.0 - step, 5.0 + step, 1.0, 1.0, 1.0])
    below, above, low, high, *_ = only(changes("base_pressure", flow(mach=mach), a=0.15), "ca")
    assert abs(above - below) / (2.0 * step) < 1e-6
    assert (high - low) / (2.0 * step) == pytest.approx(-0.015, rel=1e-9)


def test_static_instability_over_the_angle():
    """Half a period of a sine over 8 degrees, at its Mach number: ``4e-3 sin 45° = 2.8284271e-3`` at 2 degrees."""
    angles = np.radians([0.0, 2.0, 4.0, 6.0, 8.0, 8.5, 20.0])
    flight = flow(mach=np.full(N, 18.0), alpha_total=angles)
    change = only(changes("static_instability", flight, a=4e-3), "cm_nose")
    np.testing.assert_allclose(change, [0.0, 2.8284271e-3, 4e-3, 2.8284271e-3, 0.0, 0.0, 0.0], atol=1e-10)


def test_static_instability_has_a_nose_up_slope_at_zero():
    """``a π / 8° = 4e-3 · 180 / 8 = 0.09`` per rad: the moment at small angles is destabilising."""
    step = 1e-6
    flight = flow(mach=np.full(N, 18.0), alpha_total=np.full(N, step))
    change = only(changes("static_instability", flight, a=4e-3), "cm_nose")
    np.testing.assert_allclose(change / step, 0.09, rtol=1e-9)


def test_static_instability_over_mach_number():
    """A Gaussian of width 4: ``4e-3/e = 1.4715178e-3`` four Mach numbers from its centre, on either side."""
    mach = np.array([10.0, 14.0, 18.0, 22.0, 26.0, 18.0, 18.0])
    flight = flow(mach=mach, alpha_total=np.full(N, np.radians(4.0)))
    change = only(changes("static_instability", flight, a=4e-3), "cm_nose")
    np.testing.assert_allclose(change[1:4], [1.4715178e-3, 4e-3, 1.4715178e-3], rtol=1e-7)
    np.testing.assert_allclose(change[[0, 4]], 7.3262556e-5, rtol=1e-7)  # 4e-3 e⁻⁴
    shifted = only(changes("static_instability", flight, a=4e-3, M0=14.0), "cm_nose")
    np.testing.assert_allclose(shifted[:3], change[1:4], rtol=1e-14)


def test_pitch_damping_below_mach_3_5():
    flight = flow(mach=np.array([5.0, 3.6, 3.5, 3.49, 3.0, 2.0, 1.0]))
    change = only(changes("pitch_damping", flight, a=0.6), "cmq")
    np.testing.assert_allclose(change, [0.0, 0.0, 0.0, 0.6, 0.6, 0.6, 0.6], atol=1e-15)


def test_rolling_moment():
    """``5e-4 · 0.2 + 1e-6 = 1.01e-4`` at the last angle, the constant alone at the first."""
    change = only(changes("rolling_moment", k=5e-4, c=1e-6), "cl")
    assert (change[0], change[-1]) == (pytest.approx(1e-6), pytest.approx(1.01e-4))


def test_remnant_torque_is_its_coefficients_times_q_s_d():
    """``q S D = 4000 · π/4 · 2.65³ = 58463.8612 N m``; S = 5.5154586 m²."""
    effect, p = on("remnant_torque", Cl=1e-6, Cm=2e-3, Cn=-1e-3, t0=0.0)
    force, moment = effect.force_moment(p, flow(dynamic_pressure=np.full(N, 4000.0)))
    np.testing.assert_allclose(moment, np.tile([0.0584638612, 116.9277224, -58.4638612], (N, 1)), rtol=1e-9)
    assert not force.any()


@pytest.mark.parametrize(
    ("end", "acting"),
    [
        (np.inf, [False, False, True, True, True, True, True]),
        (120.0, [False, False, True, True, False, False, False]),
    ],
)
def test_remnant_torque_begins_with_t0_and_ends_before_t1(end, acting):
    """Samples every 5 s from 100 to 130 s."""
    assert T[2] == 110.0 and T[4] == 120.0
    effect, p = on("remnant_torque", Cm=2e-3, t0=110.0, t1=end)
    _, moment = effect.force_moment(p, flow())
    np.testing.assert_array_equal(moment.any(axis=1), acting)
