"""Perturbations of the forward model change the stated quantities, and only these."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.aero.discrepancy import AngleModes
from edl_filter.effects.perturbation import CoefficientUnits, FieldPerturbation, Perturbation
from edl_filter.pipeline.forward_model import forward_model_of


@pytest.fixture(scope="module")
def forward_model(practice_06):
    """The shipped mission's world."""
    r = practice_06
    return forward_model_of(r.mission, r.planet, r.atmosphere, ())


def perturbation(**changes):
    nothing = {name: np.zeros(2) for name in ("density", "ca", "cn", "cm")}
    time, ones = np.array([0.0, 200.0]), np.ones(2)
    units = CoefficientUnits(time, ca=ones, cn=ones, cm=ones)
    return replace(Perturbation(time=time, wind=np.zeros((2, 2)), units=units, **nothing), **changes)


def fast_flow(forward_model, r):
    """The flow where the shipped flight is fast and the air is thick."""
    nodes = zip(r.filter_pass.nodes, r.smoothed.states, strict=True)
    states = [(node.time, state.nav) for node, state in nodes if 100.0 < node.time < 150.0]
    time, nav = (np.array(x) for x in zip(*states, strict=True))
    return forward_model.flow(time, nav[:, :3], nav[:, 3:6], nav[:, 6:10], np.zeros((len(nav), 3)))


def test_none_changes_nothing(forward_model, practice_06):
    flow, perturbed = (
        fast_flow(forward_model, practice_06),
        fast_flow(replace(forward_model, perturbation=perturbation()), practice_06),
    )
    for expected, actual in zip(vars(flow).values(), vars(perturbed).values(), strict=True):
        np.testing.assert_array_equal(expected, actual)
    assert np.all(
        np.array(forward_model.loads(flow)) == np.array(replace(forward_model, perturbation=perturbation()).loads(flow))
    )


def test_density_and_wind_are_added_against_time(forward_model, practice_06):
    flow = fast_flow(forward_model, practice_06)
    denser = fast_flow(replace(forward_model, perturbation=perturbation(density=np.array([0.0, 0.2]))), practice_06)
    np.testing.assert_allclose(denser.density / flow.density, np.exp(1e-3 * flow.time), rtol=1e-12)
    windy = fast_flow(replace(forward_model, perturbation=perturbation(wind=np.full((2, 2), 10.0))), practice_06)
    change = np.linalg.norm(windy.velocity_body - flow.velocity_body, axis=1)
    np.testing.assert_allclose(change, np.hypot(10.0, 10.0), rtol=1e-9)


def test_coefficients_and_vehicle(forward_model, practice_06):
    flow = fast_flow(forward_model, practice_06)
    changes = perturbation(ca=np.full(2, 0.1), cn=np.full(2, 0.02), cm=np.full(2, 0.003), mass=0.01, inertia=-0.02)
    perturbed = replace(forward_model, perturbation=changes)
    expected, actual = forward_model.coefficients(flow), perturbed.coefficients(flow)
    for name, by in (("ca", 0.1), ("cn", 0.02), ("cm_nose", 0.003), ("cl", 0.0)):
        np.testing.assert_allclose(getattr(actual, name) - getattr(expected, name), by, atol=1e-12)
    units = CoefficientUnits(np.array([0.0, 200.0]), ca=np.array([0.0, 2.0]), cn=np.ones(2), cm=np.full(2, 0.5))
    actual = replace(forward_model, perturbation=replace(changes, units=units)).coefficients(flow)
    for name, by in (("ca", 1e-3 * flow.time), ("cn", 0.02), ("cm_nose", 0.0015)):
        np.testing.assert_allclose(getattr(actual, name) - getattr(expected, name), by, atol=1e-12)
    assert perturbed.rigid_body.mass == pytest.approx(np.exp(0.01) * forward_model.rigid_body.mass)
    np.testing.assert_allclose(perturbed.rigid_body.inertia, np.exp(-0.02) * forward_model.rigid_body.inertia)


@pytest.mark.parametrize("logarithm", [-6.6, -1.0, 1.0])
def test_mass_and_inertia_stay_positive_and_opposite_perturbations_cancel(forward_model, logarithm):
    """A step of a fit may be many sigmas long: with a relative change the inertia would reach zero."""
    body = forward_model.rigid_body
    changed = perturbation(mass=logarithm, inertia=logarithm).perturb_body(body)
    assert changed.mass > 0.0
    assert np.all(np.linalg.eigvalsh(changed.inertia) > 0.0)
    restored = perturbation(mass=-logarithm, inertia=-logarithm).perturb_body(changed)
    assert restored.mass == pytest.approx(body.mass, rel=1e-12)
    np.testing.assert_allclose(restored.inertia, body.inertia, rtol=1e-12)


# --- increments that are functions of the flow ----------------------------------------------------------------------

STEP = np.radians(0.05)
FIELD_TIME = np.array([100.0, 110.0, 130.0])
MODES = {
    "ca": AngleModes(np.array([[1.0, 0.0], [1.0, 2.0], [3.0, 4.0]]), np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])),
    "cn": AngleModes(np.zeros((3, 0)), np.zeros((3, 0))),
    "cm": AngleModes(np.array([[0.0], [1.0], [4.0]]), np.array([[0.0], [7.0], [14.0]])),
}
AMPLITUDES = {
    "ca": np.array([[1.0, -1.0], [3.0, 0.0], [5.0, 2.0]]), "cn": np.zeros((3, 0)), "cm": np.array([[2.0], [0.0], [1.0]])
}  # fmt: skip
UNITS = CoefficientUnits(np.array([0.0, 200.0]), ca=np.array([0.0, 0.2]), cn=np.ones(2), cm=np.full(2, 0.01))


def field(**changes):
    return replace(FieldPerturbation(FIELD_TIME, AMPLITUDES, MODES, UNITS, None, continuum_limit=1e-3), **changes)


def flow_of(time, angle, knudsen=1e-5):
    """What increments need of a flow."""
    return SimpleNamespace(time=time, alpha_total=angle, knudsen=np.broadcast_to(knudsen, np.shape(time)))


@pytest.mark.parametrize(
    ("time", "steps", "ca", "cm"),
    [
        (100.0, 0.0, 0.1 * 1.0, 0.0),
        (100.0, 1.0, 0.1 * (1.0 - 2.0), 0.02),
        (110.0, 1.5, 0.11 * 6.0, 0.0),
        (105.0, 1.0, 0.105 * (2.0 - 0.5 * 2.0), 0.01),  # half way in time
        (115.0, 0.5, 0.115 * (3.5 + 0.5 * 1.0), 0.01 * 0.25 * 0.5),  # a quarter in time, half way in angle
        (50.0, 1.0, 0.05 * (1.0 - 2.0), 0.02),  # constant before the first time and after the last
        (170.0, 1.0, 0.17 * (5.0 + 4.0), 0.01),
    ],
)
def test_increments_are_linear_in_time_and_in_angle(time, steps, ca, cm):
    increments = field().increments(flow_of(np.array([time]), np.array([steps * STEP])))
    assert increments["ca"] == pytest.approx([ca], rel=1e-9)
    assert increments["cn"] == pytest.approx([0.0]) and increments["cm"] == pytest.approx([cm], abs=1e-15)


def test_increments_of_many_samples_are_each_by_themselves():
    random = np.random.default_rng(3)
    time, angle = random.uniform(90.0, 140.0, 50), random.uniform(0.0, 2.0 * STEP, 50)
    combined = field().increments(flow_of(time, angle))
    for k in range(50):
        alone = field().increments(flow_of(time[k : k + 1], angle[k : k + 1]))
        assert all(alone[name][0] == pytest.approx(combined[name][k], rel=1e-12, abs=1e-15) for name in combined)


def test_increments_are_those_of_the_regime():
    """In rarefied flow those of the rarefied table's modes."""
    time, angle = np.full(3, 100.0), np.full(3, STEP)
    increments = field().increments(flow_of(time, angle, np.array([1e-5, 1e-3, 2e-3])))
    np.testing.assert_allclose(increments["ca"], [-0.1, -0.1, 0.2], rtol=1e-12)
    np.testing.assert_allclose(increments["cm"], [0.02, 0.02, 0.14], rtol=1e-12)


def test_increments_are_linear_in_the_amplitudes():
    time, angle = np.linspace(95.0, 135.0, 30), np.linspace(0.0, 2.0, 30) * STEP
    doubled = field(amplitudes={name: 2.0 * a for name, a in AMPLITUDES.items()}).increments(flow_of(time, angle))
    single = field().increments(flow_of(time, angle))
    zero = FieldPerturbation.zero(MODES, UNITS, None, 1e-3).increments(flow_of(time, angle))
    for name in single:
        np.testing.assert_allclose(doubled[name], 2.0 * single[name], rtol=1e-12, atol=1e-15)
        assert not zero[name].any()
    assert single["ca"].any() and single["cm"].any()


def test_standardised_increments_are_over_the_prior_standard_deviation_at_their_angle():
    """A coefficient without modes has none; at zero angle, where a mode vanishes, it is zero and not a number."""
    time, steps = np.array([100.0, 110.0, 100.0]), np.array([1.0, 2.0, 0.0])
    z = field().standardised(flow_of(time, steps * STEP))
    np.testing.assert_allclose(z["ca"], [(1.0 - 2.0) / np.sqrt(5.0), 9.0 / 5.0, 1.0], rtol=1e-3)
    np.testing.assert_allclose(z["cm"], [2.0, 0.0, 0.0], atol=1e-12)
    assert not z["cn"].any()


def test_standardised_increments_of_prior_amplitudes_are_standard_normal():
    random, count = np.random.default_rng(5), 20_000
    drawn = field(time=np.arange(count, dtype=float), amplitudes={
        name: random.standard_normal((count, modes.count)) for name, modes in MODES.items()
    })  # fmt: skip
    z = drawn.standardised(flow_of(np.arange(count), random.uniform(0.0, 2.0, count) * STEP))
    for name in ("ca", "cm"):
        assert abs(np.mean(z[name])) < 4.0 / np.sqrt(count) and abs(np.var(z[name]) - 1.0) < 4.0 * np.sqrt(2.0 / count)


#: Amplitudes of an asymmetry at `FIELD_TIME`, and one sigma of its coefficients.
FIXED = {
    "side_asymmetry": [1.0, 0.0, 2.0], "normal_asymmetry": [-1.0, 1.0, 1.0], "pitch_asymmetry": [0.0, 4.0, 0.0],
    "yaw_asymmetry": [3.0, 3.0, -3.0],
}  # fmt: skip
ASYMMETRY = CoefficientUnits(np.array([0.0, 200.0]), ca=np.ones(2), cn=np.array([0.0, 0.02]), cm=np.full(2, 0.001))


def asymmetric_field():
    """No increment of a coefficient; an asymmetry."""
    none = AngleModes(np.zeros((3, 0)), np.zeros((3, 0)))
    zero = FieldPerturbation.zero(dict.fromkeys(("ca", "cn", "cm"), none), UNITS, ASYMMETRY, 1e-3)
    amplitudes = {name: np.array([a]).T for name, a in FIXED.items()}
    return replace(zero, time=FIELD_TIME, amplitudes=dict.fromkeys(("ca", "cn", "cm"), np.zeros((3, 0))) | amplitudes)


@pytest.mark.parametrize(
    ("time", "side", "normal", "pitch", "yaw"),
    [
        (100.0, 0.01, -0.01, 0.0, 0.003),
        (105.0, 0.0105 * 0.5, 0.0, 0.002, 0.003),
        (120.0, 0.012, 0.012, 0.002, 0.0),
        (150.0, 0.03, 0.015, 0.0, -0.003),
    ],
)
def test_an_asymmetry_is_linear_in_time_and_the_same_at_all_angles(time, side, normal, pitch, yaw):
    for angle in (0.0, 1.0):
        fixed = asymmetric_field().body_fixed(flow_of(np.array([time]), np.array([angle])))
        for name, value in zip(FIXED, (side, normal, pitch, yaw), strict=True):
            assert fixed[name] == pytest.approx([value], abs=1e-15)


def test_an_asymmetry_is_standardised_by_its_own_sigma():
    z = asymmetric_field().standardised(flow_of(FIELD_TIME, np.zeros(3)))
    assert list(z) == ["ca", "cn", "cm", *FIXED]
    for name, amplitudes in FIXED.items():
        np.testing.assert_allclose(z[name], amplitudes, atol=1e-12)


def test_a_field_without_asymmetry_has_none():
    assert field().body_fixed(flow_of(FIELD_TIME, np.zeros(3))) == {}
    assert perturbation().body_fixed(flow_of(FIELD_TIME, np.zeros(3))) == {}


def test_the_loads_of_an_asymmetry_are_fixed_to_the_body(forward_model, practice_06):
    """The same in every direction of the flow: force right and up at the centre of mass, and the moment about it."""
    flow = fast_flow(forward_model, practice_06)
    plain = forward_model.loads(flow)
    asymmetric = replace(forward_model, perturbation=replace(perturbation(), field=asymmetric_field()))
    force, moment = (b - a for a, b in zip(plain, asymmetric.loads(flow), strict=True))
    push = flow.dynamic_pressure * forward_model.area
    side, normal, pitch, yaw = asymmetric_field().body_fixed(flow).values()
    np.testing.assert_allclose(force, push[:, None] * np.stack((0.0 * side, side, -normal), axis=1), atol=1e-9)
    about_centre = push[:, None] * forward_model.diameter * np.stack((0.0 * pitch, pitch, yaw), axis=1)
    assert np.ptp(force[:, 1]) > 0.0 and np.ptp(moment[:, 1]) > 0.0
    np.testing.assert_allclose(moment, about_centre, rtol=1e-9, atol=1e-7)


def test_a_large_amplitude_of_a_small_mode_is_no_large_increment():
    small = AngleModes(np.tile([1.0, 0.01], (3, 1)), np.tile([1.0, 0.01], (3, 1)))
    amplitudes = AMPLITUDES | {"ca": np.tile([0.5, 6.0], (3, 1))}
    z = field(modes=MODES | {"ca": small}, amplitudes=amplitudes).standardised(flow_of(FIELD_TIME, np.zeros(3)))
    np.testing.assert_allclose(z["ca"], (0.5 + 0.06) / np.hypot(1.0, 0.01), rtol=1e-12)


def test_a_field_changes_the_coefficients_by_its_increments(forward_model, practice_06):
    """Of the flow's own time and total angle, in addition to those against time; a field of zeros changes nothing."""
    flow = fast_flow(forward_model, practice_06)
    expected = forward_model.coefficients(flow)
    plain = perturbation(ca=np.full(2, 0.1))
    zero = replace(plain, field=FieldPerturbation.zero(MODES, UNITS, None, 1e-3))
    for name in ("ca", "cn", "cm_nose", "cl"):
        values = [getattr(replace(forward_model, perturbation=p).coefficients(flow), name) for p in (plain, zero)]
        np.testing.assert_array_equal(*values)
    wide = {
        name: AngleModes(*(np.linspace(t[0], t[-1], 1200) for t in (m.continuum, m.rarefied)))
        for name, m in MODES.items()
    }
    with_field = replace(plain, field=field(modes=wide))
    actual = replace(forward_model, perturbation=with_field).coefficients(flow)
    increments = with_field.field.increments(flow)
    assert np.ptp(increments["ca"]) > 0.1 and np.ptp(increments["cm"]) > 1e-3
    for name, by in (("ca", 0.1 + increments["ca"]), ("cn", 0.0), ("cm_nose", increments["cm"]), ("cl", 0.0)):
        np.testing.assert_allclose(getattr(actual, name) - getattr(expected, name), by, atol=1e-12)


def test_a_unit_of_a_coefficient_is_added_to_one_and_leaves_the_field(forward_model, practice_06):
    flow = fast_flow(forward_model, practice_06)
    start = perturbation(cn=np.full(2, 0.02), field=field())
    for name in ("ca", "cn", "cm"):
        unit = start.with_unit(name)
        assert unit.field is start.field
        for coefficient in ("ca", "cn", "cm"):
            np.testing.assert_array_equal(
                getattr(unit, coefficient), getattr(start, coefficient) + (name == coefficient)
            )
        before, after = (replace(forward_model, perturbation=p).coefficients(flow) for p in (start, unit))
        by = {n: getattr(after, n) - getattr(before, n) for n in ("ca", "cn", "cm_nose")}
        for total, difference in by.items():
            np.testing.assert_allclose(difference, float(total.startswith(name)), atol=1e-12)
