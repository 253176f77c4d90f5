"""Effects on the entry state, against numbers worked out by hand."""

import numpy as np
from standins import STATE, on

from edl_filter.effects import EffectInstance
from edl_filter.effects.forward_model import compose_entry_state, invert_entry_state
from edl_filter.effects.registry import find_effect
from edl_filter.telemetry.record import InitialState


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
