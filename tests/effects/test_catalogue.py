"""The catalogue: names, declarations, that every effect is off at zero, and which are linear in their sizes."""

import numpy as np
import pytest
from standins import BODY, FORCE, PLANET, RATE, STATE, H, N, T, flow, on, totals

from edl_filter import rotations
from edl_filter.effects import EffectInstance
from edl_filter.effects.parameters import KINDS
from edl_filter.effects.registry import catalogue, find_effect
from edl_filter.errors import InputError

NAMES = [
    "accelerometer_bias", "accelerometer_scale", "accelerometer_misalignment", "gyro_bias", "gyro_scale",
    "imu_lever_arm", "imu_time_offset", "mass", "com_offset", "products_of_inertia", "gravity_oblateness",
    "density_scale", "density_wave", "wind", "atmosphere_rotation", "axial_force_scale", "base_pressure",
    "normal_force_scale", "pitching_moment_scale", "static_instability", "pitch_damping", "rolling_moment",
    "remnant_torque", "attitude_frame"
]  # fmt: skip
#: Effects that are not linear in their sizes: rotations.
ROTATIONS = ("accelerometer_misalignment", "attitude_frame")
#: Plausible size of each effect's sizes, from the project's list.
SIGMAS = {
    "accelerometer_bias": [5e-3] * 3, "accelerometer_scale": [4e-3] * 3, "accelerometer_misalignment": [6e-3] * 3,
    "gyro_bias": [6e-5] * 3, "gyro_scale": [2e-3] * 3, "imu_lever_arm": [0.25] * 3, "imu_time_offset": [0.1],
    "mass": [0.07], "com_offset": [5e-3] * 3, "products_of_inertia": [8.0] * 3, "gravity_oblateness": [2e-3],
    "density_scale": [0.1], "density_wave": [0.1], "wind": [40.0, 40.0], "atmosphere_rotation": [1.0],
    "axial_force_scale": [0.05], "base_pressure": [0.15], "normal_force_scale": [0.35],
    "pitching_moment_scale": [0.2], "static_instability": [4e-3], "pitch_damping": [0.6],
    "rolling_moment": [5e-4, 5e-6], "remnant_torque": [5e-6, 1.5e-3, 1e-3], "attitude_frame": [5e-3] * 3,
}  # fmt: skip


def hooks(effect, p):
    """Return values of all hooks, as one list of arrays."""
    rng = np.random.default_rng(1)
    force, rate = rng.normal(size=(2, N, 3))
    planet, body, state = effect.gravity(p, PLANET), effect.vehicle(p, BODY), effect.entry_state(p, STATE)
    t = effect.coefficients(p, flow(), totals())
    return [
        *effect.imu(p, T, force, rate), *effect.corrected(p, T, force, rate), effect.imu_position(p),
        np.array([planet.mu, planet.j2]), np.array(effect.atmosphere_rate(p)), effect.wind(p, H), effect.density(p, H),
        t.ca, t.cn, t.cm_nose, t.cl, t.cmq, *effect.force_moment(p, flow()),
        np.array(body.mass), body.inertia, body.offset, state.position, state.velocity, state.covariance,
    ]  # fmt: skip


def test_the_names_are_the_designs_in_its_order():
    assert list(catalogue()) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_declarations_are_complete(name):
    effect = find_effect(name)
    assert effect.name == name and effect.family != "user"
    assert effect.summary and effect.source and effect.region
    assert effect.shows[0].isupper() and effect.shows.endswith(".")
    assert [q.sigma for q in effect.sizes] == SIGMAS[name]
    assert len({q.name for q in effect.parameters}) == len(effect.parameters)
    for q in effect.parameters:
        assert q.kind in KINDS and q.low <= q.default <= q.high and q.description
    for q in effect.sizes:
        assert q.default == 0.0 and (q.low <= -3.0 * q.sigma or q.low <= -0.9), "at least 3 sigma, or all there is"
        assert q.high >= 2.0 * q.sigma


@pytest.mark.parametrize("name", NAMES)
def test_every_effect_is_off_at_zero_and_not_elsewhere(name):
    effect = find_effect(name)
    off = EffectInstance(effect, {}).values
    reference = hooks(find_effect("mass"), {"k": 0.0})
    for values, expected in zip(hooks(effect, off), reference, strict=True):
        np.testing.assert_array_equal(values, expected)
    for q in effect.sizes:
        changed = hooks(effect, off | {q.name: q.sigma})
        assert any(not np.array_equal(a, b) for a, b in zip(changed, reference, strict=True)), q.name


@pytest.mark.parametrize("name", NAMES)
def test_hooks_keep_shapes(name):
    effect = find_effect(name)
    p = EffectInstance(effect, {q.name: q.sigma for q in effect.sizes}).values
    for values, expected in zip(hooks(effect, p), hooks(find_effect("mass"), {"k": 0.0}), strict=True):
        assert values.shape == expected.shape and np.all(np.isfinite(values))


@pytest.mark.parametrize(
    ("name", "nearest"),
    [("gyro_bais", "gyro_bias"), ("winds", "wind"), ("centre_of_mass_offset", "accepted"), ("lever_arm", "imu_lever")],
)
def test_an_unknown_name_has_the_nearest(name, nearest):
    with pytest.raises(InputError, match=f"found no effect '{name}'; .*{nearest}"):
        find_effect(name)


def test_what_is_not_named_takes_its_default():
    active = EffectInstance(find_effect("remnant_torque"), {"Cm": 1e-3, "t0": 130.0})
    assert active.values == {"Cl": 0.0, "Cm": 1e-3, "Cn": 0.0, "t0": 130.0, "t1": np.inf}


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
