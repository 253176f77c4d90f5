"""The catalogue: names, declarations, and that every effect is off at zero."""

import numpy as np
import pytest
from standins import BODY, PLANET, STATE, H, N, T, flow, totals

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
