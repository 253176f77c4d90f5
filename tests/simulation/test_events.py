"""Events of a simulated flight: continuity of the structure, the new body afterwards, positions of the IMUs."""

from dataclasses import replace

import numpy as np
import pytest
from slow_flight import derivative

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.simulation import Scenario, simulate
from edl_filter.simulation.sensors import step_means

SHIFT = np.array([0.03, 0.01, -0.015])
BALLAST = (
    "events={ballast: {time_s: 150.0, sigma_s: 0.05, mass: 812.0, centre_of_mass_shift: [0.03, 0.01, -0.015], "
    "inertia: {xx: 262.0, yy: 200.0, zz: 204.0}, imu_positions: {secondary: [-0.4, 0.4, -0.3]}}}"
)


@pytest.fixture(scope="module")
def flight():
    return simulate(Scenario.load("builtin:mer", [BALLAST]))


def at_event(flight):
    """Index of the state at the event."""
    return int(np.argmin(np.abs(flight.motion.time - 150.0)))


def test_the_structure_moves_on_continuously(flight, mer_flight):
    """Up to the event both flights are one; there the state becomes that of the new centre of mass."""
    k, motion = at_event(flight), flight.motion
    old, new = mer_flight.motion.state[k], motion.state[k]
    np.testing.assert_array_equal(motion.state[:k], mer_flight.motion.state[:k])
    np.testing.assert_array_equal(new[6:13], old[6:13])
    np.testing.assert_allclose(new[:3] - old[:3], rotations.rotate(old[6:10], SHIFT), atol=1e-8)
    np.testing.assert_allclose(
        new[3:6] - old[3:6], rotations.rotate(old[6:10], np.cross(old[10:13], SHIFT)), atol=1e-11
    )


def test_the_new_body_flies_on(flight):
    """Accelerations before and after the event are those of the slow model with the body of either side."""
    k, motion, forward_model = at_event(flight), flight.motion, flight.forward_model
    ((_, after),) = forward_model.changed_bodies
    assert after.mass == 812.0
    for body, row in ((forward_model.body, motion.after[k - 1]), (after, motion.before[k])):
        state = motion.state[k].copy()
        simple = simple_world(forward_model, body)
        if body is forward_model.body:  # its own centre of mass
            state[:3] -= rotations.rotate(state[6:10], SHIFT)
            state[3:6] -= rotations.rotate(state[6:10], np.cross(state[10:13], SHIFT))
        np.testing.assert_allclose(row[:13], derivative(simple, 150.0, state[:13]), rtol=1e-5, atol=1e-6)


def simple_world(forward_model, body):
    """The world whose vehicle is one body all the time."""
    return replace(forward_model, body=body, changed_bodies=())


def test_what_an_imu_measures_is_the_motion_of_its_place(flight):
    """Integrated readings of the first IMU, noise-free, are the change of its velocity across the event."""
    k, motion = at_event(flight), flight.motion
    place = np.array([0.25, -0.35, 0.28])
    arm = np.where((motion.time[:-1] >= 150.0 - 1e-6)[:, None], place - SHIFT, place)
    force, _ = step_means(motion, arm)
    rows = slice(k - 2, k + 3)
    planet, state = flight.forward_model.gravity_planet, motion.state
    arms = np.where((motion.time >= 150.0 - 1e-6)[:, None], place - SHIFT, place)[rows]
    velocity = state[rows, 3:6] + rotations.rotate(state[rows, 6:10], np.cross(state[rows, 10:13], arms))
    h = np.diff(motion.time[rows])[:, None]
    rate = 0.5 * (state[rows, 10:13][1:] + state[rows, 10:13][:-1])
    middle = rotations.multiply(state[rows, 6:10][:-1], rotations.from_rotation_vector(0.5 * h * rate))
    gravity = planet.gravity(state[rows, :3])
    gained = rotations.rotate(middle, force[k - 2 : k + 2]) * h + 0.5 * (gravity[1:] + gravity[:-1]) * h
    assert np.linalg.norm(np.cross(state[k, 10:13], SHIFT)) > 2e-3  # of which none is in the readings
    np.testing.assert_allclose(gained.sum(axis=0), velocity[-1] - velocity[0], atol=5e-5)


def test_the_flight_file_records_what_changed(flight):
    contents = flight.contents
    assert contents.events["ballast"] == (150.0, 0.05)
    np.testing.assert_array_equal(contents.imus["primary"].position, [0.25, -0.35, 0.28])  # at entry
    stated = contents.truth["vehicle_events"]["ballast"]
    assert stated["mass"] == 812.0 and stated["centre_of_mass_shift"] == SHIFT.tolist()
    assert stated["imu_positions"] == {"secondary": [-0.4, 0.4, -0.3]} and stated["inertia"]["xx"] == 262.0


@pytest.mark.parametrize(
    ("event", "parts"),
    [
        ("{time_s: 150.01, mass: 800}", ("events.drop.time_s", "multiple of sampling.interval_s")),
        ("{time_s: 150, mass: 0}", ("events.drop.mass", "kg")),
        ("{time_s: 150, imu_positions: {third: [0, 0, 0]}}", ("events.drop.imu_positions", "primary, secondary")),
        ("{time_s: 150, position: [0, 0, 0]}", ("events.drop.position",)),
    ],
)
def test_wrong_events_are_refused(event, parts):
    with pytest.raises(InputError) as error:
        Scenario.load("builtin:mer", [f"events={{drop: {event}}}"])
    for part in parts:
        assert part in str(error.value)


def test_events_in_the_wrong_order_are_refused():
    events = "events={b: {time_s: 160, mass: 800}, a: {time_s: 150, mass: 790}}"
    with pytest.raises(InputError, match=r"events.a.time_s: .* after 160"):
        Scenario.load("builtin:mer", [events])


def test_an_event_after_the_landing_is_refused():
    with pytest.raises(InputError, match="it lands at"):
        simulate(Scenario.load("builtin:mer", ["events={late: {time_s: 900, mass: 800}}"]))
