"""From a mission to its forward model: a centre of mass off the axis, by the mission, by an effect, or by both."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.mission import Mission
from edl_filter.pipeline.forward_model import body_of, forward_model_of
from edl_filter.pipeline.reconstruct import without_effects
from edl_filter.postflight.flight import derived_quantities

OFF_AXIS = "vehicle.centre_of_mass_offset=[0.002, -0.001]"
SHIFT = [0.01, 0.0053, -0.00265]


def shifted(dx, dy, dz):
    return [EffectInstance(find_effect("com_offset"), {"dx": dx, "dy": dy, "dz": dz})]


@pytest.fixture(scope="module")
def off_axis():
    return Mission.load("builtin:practice_mer", [OFF_AXIS])


def test_the_missions_offset_and_the_effects_add_up(off_axis):
    both = body_of(off_axis, shifted(*SHIFT))
    np.testing.assert_allclose(both.offset, [0.01, 2.65 * 0.002 + 0.0053, -2.65 * 0.001 - 0.00265])
    np.testing.assert_allclose(both.centre(0.27, 2.65), [0.27 - 0.01 / 2.65, 0.004, -0.002])
    on_axis = Mission.load("builtin:practice_mer")
    assert body_of(on_axis).centre(0.27, 2.65) == (0.27, 0.0, 0.0)


def test_moments_use_one_centre_of_mass(off_axis, practice_06):
    """Stated by the mission or by an effect, it is the same force at the same place: M - d × F."""
    r, t = practice_06, practice_06.trajectory
    plain = forward_model_of(r.mission, r.planet, r.atmosphere)
    stated, by_effect = (
        forward_model_of(off_axis, r.planet, r.atmosphere),
        plain.with_effects(shifted(0.0, *body_of(off_axis).offset[1:])),
    )
    both = stated.with_effects(shifted(*SHIFT))
    flow = plain.flow(t.time, t.position, t.velocity, t.inertial_from_body, t.angular_rate)
    force, moment = plain.loads(flow)
    np.testing.assert_allclose(stated.loads(flow)[1], by_effect.loads(flow)[1], atol=1e-9)
    for forward_model in (stated, both):
        expected = moment - np.cross(forward_model.rigid_body.offset, force)
        np.testing.assert_allclose(forward_model.loads(flow)[1], expected, atol=1e-6)
        np.testing.assert_array_equal(forward_model.loads(flow)[0], force)


def test_only_an_effect_changes_the_lever_arms_of_the_imus(off_axis, practice_06):
    telemetry = practice_06.telemetry
    assert without_effects(off_axis, telemetry, ()) is telemetry
    moved = without_effects(off_axis, telemetry, shifted(*SHIFT))
    change = moved.driving.position - telemetry.driving.position
    np.testing.assert_allclose(change, np.broadcast_to(-np.array(SHIFT), change.shape), atol=1e-15)


def test_coefficients_after_the_flight_are_about_the_same_centre(off_axis, practice_06):
    """The database's moments refer to the centre of mass, whatever moves it; the flight's do so already."""
    by_mission = derived_quantities(replace(practice_06, mission=off_axis)).postflight
    effects = tuple(shifted(0.0, *body_of(off_axis).offset[1:]))
    by_effect, plain = (
        derived_quantities(replace(practice_06, effects=effects)).postflight,
        derived_quantities(practice_06).postflight,
    )
    for name, values in by_mission.flight.database.value.items():
        np.testing.assert_allclose(by_effect.flight.database.value[name], values, rtol=1e-9, atol=1e-12)
    for name in ("Cl", "Cm", "Cn"):
        np.testing.assert_array_equal(by_mission.flight.coefficients.value[name], plain.flight.coefficients.value[name])
    ca = plain.flight.database.value["CA"]
    np.testing.assert_allclose(
        by_mission.flight.database.value["Cn"] - plain.flight.database.value["Cn"], -0.002 * ca, atol=1e-12
    )
