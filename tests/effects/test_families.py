"""Effects on vehicle, planet, air, aerodynamics, entry state and readings against numbers worked out by hand.

Each number has its derivation in a comment. Where an effect has a symmetry, a slope or an inverse in closed form, that
is tested too; that every effect is off at zero is tested in `test_catalogue`.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from standins import BODY, PLANET, STATE, H, N, T, flow, totals

from edl_filter import rotations
from edl_filter.effects import Body, EffectInstance
from edl_filter.effects.forward_model import compose_air_rotation, compose_entry_state, invert_entry_state
from edl_filter.effects.registry import catalogue, find_effect
from edl_filter.telemetry.record import InitialState

RADIUS = 3396190.0
#: Effects that are not linear in their sizes: rotations.
ROTATIONS = ("accelerometer_misalignment", "attitude_frame")


def on(name, **values):
    effect = find_effect(name)
    return effect, EffectInstance(effect, values).values


def changes(name, flight=None, **values):
    """Changes of all coefficients by an effect, by name."""
    effect, p = on(name, **values)
    before = totals()
    after = effect.coefficients(p, flow() if flight is None else flight, before)
    return {c: getattr(after, c) - getattr(before, c) for c in ("ca", "cn", "cm_nose", "cl", "cmq")}


def only(changed, name):
    """The change of one coefficient, where no other one changes."""
    assert all(not values.any() for c, values in changed.items() if c != name)
    return changed[name]


# vehicle


def test_mass():
    effect, p = on("mass", k=0.05)
    body = effect.vehicle(p, BODY)
    assert body.mass == pytest.approx(873.6, rel=1e-15)  # 832 · 1.05 = 832 + 41.6
    np.testing.assert_array_equal(body.inertia, BODY.inertia)


def test_centre_of_mass():
    """Forward (+x) is towards the nose; 26.5 mm are a hundredth of the diameter of 2.65 m."""
    effect, p = on("com_offset", dx=26.5e-3, dy=-5.3e-3, dz=2.65e-3)
    body = effect.vehicle(p, Body(1.0, np.eye(3), np.array([0.0, 10.6e-3, 0.0])))
    # behind the nose 0.27 - 0.01; to the right (10.6 - 5.3) mm / 2.65 m = 0.002; down 2.65 mm / 2.65 m = 0.001
    np.testing.assert_allclose(body.centre(0.27, 2.65), [0.26, 0.002, 0.001], rtol=1e-13)


@pytest.mark.parametrize(("parameter", "axes"), [("a", (0, 1)), ("b", (0, 2)), ("c", (1, 2))])
def test_products_of_inertia_are_those_of_point_masses(parameter, axes):
    """Two masses of 2 kg at ±(0.5, 0.5) m in a plane have the product 2 · 2 · 0.5 · 0.5 = 1 kg m².

    About the diagonal through them, which is (1, 1)/√2 of the plane, they have no moment of inertia. Without the
    product it would be their moment about either axis, 2 · 2 · 0.25 = 1 kg m².
    """
    effect, p = on("products_of_inertia", **{parameter: 1.0})
    first, second = axes
    diagonal, normal = np.zeros((2, 3))
    diagonal[[first, second]] = np.sqrt(0.5)
    normal[3 - first - second] = 1.0
    moments = np.diag(np.ones(3) + normal)  # 1 about each axis of the plane, 2 about its normal
    inertia = effect.vehicle(p, Body(4.0, moments)).inertia
    np.testing.assert_allclose(inertia @ diagonal, 0.0, atol=1e-15)
    np.testing.assert_allclose(inertia @ normal, 2.0 * normal, atol=1e-15)
    np.testing.assert_array_equal(inertia, inertia.T)


# planet


def test_oblateness_at_the_equator_and_at_the_pole():
    """``g = mu/a² (1 + 3/2 J2)`` at the equator and ``mu/a² (1 - 3 J2)`` at the pole, at the radius a of J2."""
    effect, p = on("gravity_oblateness", J2=1e-3)
    places = RADIUS * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    change = np.linalg.norm(effect.gravity(p, PLANET).gravity(places), axis=1)
    change -= np.linalg.norm(PLANET.gravity(places), axis=1)
    # mu/a² = 4.28e13 / 3396190² = 3.7107339 m/s²; times 1.5e-3 and -3e-3
    np.testing.assert_allclose(change, [5.5661008e-3, -11.1322017e-3], rtol=1e-7)


# air


def test_density_scale_is_one_factor():
    effect, p = on("density_scale", k=-0.15)
    np.testing.assert_allclose(effect.density(p, H), 0.85, rtol=1e-15)


def test_density_wave_at_parts_of_a_wavelength():
    """A twelfth of 12 km is 30 degrees, whose sine is one half."""
    effect, p = on("density_wave", A=0.2, L=12e3)
    heights = np.array([0.0, 1e3, 3e3, 6e3, 7e3, 9e3, 15e3])
    np.testing.assert_allclose(effect.density(p, heights), [1.0, 1.1, 1.2, 1.0, 0.9, 0.8, 1.2], rtol=1e-14)
    effect, p = on("density_wave", A=0.2, L=12e3, phase=np.pi / 2.0)
    np.testing.assert_allclose(effect.density(p, heights[:3]), [1.2, 1.0 + 0.1 * np.sqrt(3.0), 1.0], rtol=1e-14)


@given(st.floats(-0.9, 0.9), st.floats(8e3, 25e3), st.floats(0.0, 6.28))
def test_density_wave_has_its_period_and_no_mean(amplitude, length, phase):
    effect, p = on("density_wave", A=amplitude, L=length, phase=phase)
    density, half, one_wavelength = (effect.density(p, H + shift) for shift in (0.0, 0.5 * length, length))
    np.testing.assert_allclose(one_wavelength, density, atol=1e-12)
    np.testing.assert_allclose(half + density, 2.0, atol=1e-12)  # opposite half a wavelength above
    over_a_wavelength = effect.density(p, length * np.arange(64) / 64.0)
    assert np.mean(over_a_wavelength) == pytest.approx(1.0, abs=1e-12)
    assert np.ptp(over_a_wavelength) == pytest.approx(2.0 * abs(amplitude), abs=0.01)


def test_wind_is_half_at_the_edges_of_its_layer_and_full_within():
    """``(1 + tanh 1)/2 = 1/(1 + e⁻²) = 0.8807971`` one scale of 2 km inside an edge, and 1 minus that outside."""
    effect, p = on("wind", east=30.0, north=-20.0, h_lo=10e3, h_hi=50e3)
    heights = np.array([-10e3, 8e3, 10e3, 12e3, 30e3, 48e3, 50e3, 52e3, 70e3])
    inside = [0.0, 0.1192029, 0.5, 0.8807971, 1.0, 0.8807971, 0.5, 0.1192029, 0.0]
    wind = effect.wind(p, heights)
    np.testing.assert_allclose(wind[:, 0] / 30.0, inside, atol=1e-7)
    np.testing.assert_allclose(wind[:, 1] / -20.0, inside, atol=1e-7)


def test_wind_is_symmetric_about_the_middle_of_its_layer():
    effect, p = on("wind", east=30.0, north=-20.0, h_lo=10e3, h_hi=14e3)
    above = np.linspace(0.0, 20e3, 50)
    np.testing.assert_allclose(effect.wind(p, 12e3 + above), effect.wind(p, 12e3 - above), atol=1e-13)


@pytest.mark.parametrize(("k", "rate"), [(0.0, 1.0), (0.25, 0.75), (1.0, 0.0), (-1.0, 2.0)])
def test_air_rotation(k, rate):
    """At the equator the air moves at ``7.088e-5 rad/s · 3396190 m = 240.7219472 m/s`` towards the east (y)."""
    instance = EffectInstance(find_effect("atmosphere_rotation"), {"k": k})
    assert instance.effect.atmosphere_rate(instance.values) == rate
    planet = compose_air_rotation(PLANET, [instance])
    relative = planet.velocity_relative(np.array([RADIUS, 0.0, 0.0]), np.array([0.0, 1000.0, 0.0]))
    np.testing.assert_allclose(relative, [0.0, 1000.0 - 240.7219472 * rate, 0.0], atol=1e-6)


# aerodynamics: `totals` has CA 1.7, CN from 0 to 0.05, Cm from 0 to -0.02; `flow` angles from 0 to 0.2 rad


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


# entry state


def test_entry_state_rotates_about_the_pole():
    """By 0.1 rad about z: cos 0.1 = 0.9950042, sin 0.1 = 0.0998334.

    x: 3.5e6 · 0.9950042 - 1e5 · 0.0998334 = 3472531.237 m; y: 3.5e6 · 0.0998334 + 1e5 · 0.9950042 = 448917.375 m; the
    velocity (-3000, 4000, 1000) m/s likewise, its z stays.
    """
    effect, p = on("attitude_frame", rz=0.1)
    true = effect.entry_state(p, STATE)
    np.testing.assert_allclose(true.position, [3472531.237, 448917.375, 0.0], atol=1e-3)
    np.testing.assert_allclose(true.velocity, [-3384.346162, 3680.516411, 1000.0], atol=1e-6)
    np.testing.assert_array_equal(true.inertial_from_body, STATE.inertial_from_body)


def test_entry_covariance_rotates_with_position_and_velocity_only():
    """A quarter turn about z exchanges the variances of x and y; those of the attitude stay."""
    stated = InitialState(0.0, STATE.position, STATE.velocity, STATE.inertial_from_body, np.diag(np.arange(1.0, 10.0)))
    effect, p = on("attitude_frame", rz=np.pi / 2.0)
    variances = effect.entry_state(p, stated).covariance
    np.testing.assert_allclose(variances, np.diag([2.0, 1.0, 3.0, 5.0, 4.0, 6.0, 7.0, 8.0, 9.0]), atol=1e-14)


def test_the_stated_entry_state_is_the_inverse():
    instances = [EffectInstance(find_effect("attitude_frame"), {"rx": 3e-3, "ry": -4e-3, "rz": 5e-3})]
    stated = invert_entry_state(STATE, instances)
    assert np.linalg.norm(stated.position - STATE.position) > 1e4
    true = compose_entry_state(stated, instances)
    np.testing.assert_allclose(true.position, STATE.position, atol=1e-6)
    np.testing.assert_allclose(true.velocity, STATE.velocity, atol=1e-9)


# readings

FORCE, RATE = np.tile([-40.0, 2.0, 0.0], (N, 1)), np.tile([0.2, 0.0, -0.1], (N, 1))


@pytest.mark.parametrize(
    ("name", "values", "force", "rate"),
    [
        ("accelerometer_bias", {"bx": 0.1, "bz": -0.2}, [-39.9, 2.0, -0.2], [0.2, 0.0, -0.1]),
        ("accelerometer_scale", {"sx": 0.01, "sy": -0.02}, [-40.4, 1.96, 0.0], [0.2, 0.0, -0.1]),
        # a quarter turn about z takes x to y and y to -x
        ("accelerometer_misalignment", {"mz": np.pi / 2.0}, [-2.0, -40.0, 0.0], [0.2, 0.0, -0.1]),
        ("gyro_bias", {"by": 1e-3}, [-40.0, 2.0, 0.0], [0.2, 1e-3, -0.1]),
        ("gyro_scale", {"sx": 0.05, "sz": 0.1}, [-40.0, 2.0, 0.0], [0.21, 0.0, -0.11]),
        # a constant is the same at any delay
        ("imu_time_offset", {"tau": 0.3}, [-40.0, 2.0, 0.0], [0.2, 0.0, -0.1]),
    ],
)
def test_readings(name, values, force, rate):
    effect, p = on(name, **values)
    read_force, read_rate = effect.imu(p, T, FORCE, RATE)
    np.testing.assert_allclose(read_force, np.tile(force, (N, 1)), atol=1e-13)
    np.testing.assert_allclose(read_rate, np.tile(rate, (N, 1)), atol=1e-13)


def test_a_delay_of_a_linear_rate_is_a_constant():
    """A rate that rises by 0.01 rad/s² is 0.003 rad/s lower 0.3 s before; intervals of 5 s, ends left out."""
    effect, p = on("imu_time_offset", tau=0.3)
    rate = np.outer(0.01 * (T - 2.5), [1.0, -1.0, 0.0])
    _, delayed = effect.imu(p, T, FORCE, rate)
    np.testing.assert_allclose((delayed - rate)[1:-1], np.tile([-0.003, 0.003, 0.0], (N - 2, 1)), atol=1e-13)


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if e.acts("imu") and n != "imu_time_offset"])
def test_corrected_is_the_inverse_of_imu(name):
    """In both orders, at three times the plausible sizes; a shift in time is its own case (`test_sensor_chain`)."""
    effect = find_effect(name)
    p = EffectInstance(
        effect, {q.name: 3.0 * q.sigma * s for q, s in zip(effect.sizes, (1, -1, 0.5), strict=True)}
    ).values
    rng = np.random.default_rng(3)
    force, rate = 40.0 * rng.normal(size=(N, 3)), 0.2 * rng.normal(size=(N, 3))
    assert not all(np.array_equal(a, b) for a, b in zip(effect.imu(p, T, force, rate), (force, rate), strict=True))
    for first, second in ((effect.imu, effect.corrected), (effect.corrected, effect.imu)):
        back_force, back_rate = second(p, T, *first(p, T, force, rate))
        np.testing.assert_allclose(back_force, force, atol=1e-12)
        np.testing.assert_allclose(back_rate, rate, atol=1e-14)


@pytest.mark.parametrize("axis", range(3))
def test_a_small_misalignment_is_a_cross_product(axis):
    """``R(m) f = f + m × f`` to first order: by central differences."""
    effect, step = find_effect("accelerometer_misalignment"), 1e-6
    name = f"m{'xyz'[axis]}"
    plus, minus = (effect.imu(on(effect.name, **{name: s})[1], T, FORCE, RATE)[0] for s in (step, -step))
    np.testing.assert_allclose((plus - minus) / (2.0 * step), np.cross(np.eye(3)[axis], FORCE), atol=1e-8)


def test_the_lever_arm_is_the_displacement():
    effect, p = on("imu_lever_arm", dx=0.1, dy=-0.2, dz=0.3)
    np.testing.assert_array_equal(effect.imu_position(p), [0.1, -0.2, 0.3])


# all


def response(effect, p):
    """What all hooks that may be linear return, as one vector."""
    body, changed = effect.vehicle(p, BODY), effect.coefficients(p, flow(), totals())
    parts = [
        *effect.imu(p, T, FORCE, RATE), effect.imu_position(p), [effect.gravity(p, PLANET).j2],
        [effect.atmosphere_rate(p)], effect.wind(p, H), effect.density(p, H), changed.ca, changed.cn, changed.cm_nose,
        changed.cl, changed.cmq, *effect.force_moment(p, flow()), [body.mass], body.inertia, body.offset,
    ]  # fmt: skip
    return np.concatenate([np.ravel(x) for x in parts])


@pytest.mark.parametrize("name", [n for n in catalogue() if n not in (*ROTATIONS, "imu_time_offset")])
def test_effects_are_linear_in_their_sizes(name):
    """Sizes are linearised by the diagnosis: twice the size is twice the change, and changes of two sizes add."""
    effect = find_effect(name)
    off = EffectInstance(effect, {}).values
    reference = response(effect, off)
    each = [response(effect, off | {q.name: q.sigma}) - reference for q in effect.sizes]
    for q, change in zip(effect.sizes, each, strict=True):
        double = response(effect, off | {q.name: 2.0 * q.sigma}) - reference
        np.testing.assert_allclose(double, 2.0 * change, rtol=1e-9, atol=1e-12)
    together = response(effect, off | {q.name: q.sigma for q in effect.sizes}) - reference
    np.testing.assert_allclose(together, np.sum(each, axis=0), rtol=1e-9, atol=1e-12)


def test_rotations_keep_lengths_and_angles():
    """The effects that are not linear are rotations: they keep scalar products."""
    effect, p = on("accelerometer_misalignment", mx=0.02, my=-0.03, mz=0.01)
    rng = np.random.default_rng(5)
    first, second = rng.normal(size=(2, N, 3))
    (turned_first, _), (turned_second, _) = (effect.imu(p, T, f, RATE) for f in (first, second))
    np.testing.assert_allclose(np.sum(turned_first * turned_second, axis=1), np.sum(first * second, axis=1), atol=1e-13)
    effect, p = on("attitude_frame", rx=1e-3, ry=-5e-3, rz=2e-3)
    true = effect.entry_state(p, STATE)
    for a, b in ((true.position, STATE.position), (true.velocity, STATE.velocity)):
        assert np.linalg.norm(a) == pytest.approx(np.linalg.norm(b), rel=1e-14)
    assert true.position @ true.velocity == pytest.approx(STATE.position @ STATE.velocity, rel=1e-12)
    turn = rotations.to_rotation_vector(rotations.from_rotation_vector([1e-3, -5e-3, 2e-3]))
    first_order = STATE.position + np.cross(turn, STATE.position)
    assert np.linalg.norm(true.position - first_order) < 2.0 * 0.5 * (turn @ turn) * np.linalg.norm(STATE.position)
