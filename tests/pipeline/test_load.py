"""What events change: bodies, positions of the IMUs, and the velocity of the navigated point."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.effects.types import Body
from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.world import VehicleChangeConfig
from edl_filter.navigation.increments import effective_samples
from edl_filter.navigation.trajectory import propagate_state
from edl_filter.pipeline import load
from edl_filter.pipeline.forward_model import changed_bodies, forward_model_of
from edl_filter.pipeline.load import (
    centre_of_mass_shifts,
    changed_position,
    event_times,
    impacts_from,
    moved_by_events,
    read_atmosphere,
    read_telemetry,
    with_velocity_steps,
)

SHIFT = [0.03, 0.01, -0.02]
EVENT = f"vehicle.events={{ballast: {{time_s: 100.0, sigma_s: 0.02, mass: 800.0, centre_of_mass_shift: {SHIFT}}}}}"


def test_bodies_that_events_leave():
    """Each event changes the body that the one before left."""
    inertia = {"xx": 260.0, "yy": 200.0, "zz": 205.0}
    events = [
        (10.0, VehicleChangeConfig(mass=800.0, centre_of_mass_shift=SHIFT)),
        (20.0, VehicleChangeConfig(imu_positions={"secondary": [0.1, 0.2, 0.3]})),
        (30.0, VehicleChangeConfig(inertia=inertia, centre_of_mass_shift=SHIFT)),
    ]
    entry = Body(832.0, np.diag([270.0, 205.0, 210.0]), np.array([0.0, 0.1, 0.0]))
    (first, ballast), (last, rest) = changed_bodies(entry, events)
    assert (first, last) == (10.0, 30.0) and ballast.mass == rest.mass == 800.0
    np.testing.assert_allclose(ballast.offset, [0.03, 0.11, -0.02])
    np.testing.assert_allclose(rest.offset, [0.06, 0.12, -0.04])
    np.testing.assert_array_equal(ballast.inertia, entry.inertia)
    np.testing.assert_array_equal(rest.inertia, np.diag([260.0, 200.0, 205.0]))


def test_a_landing_before_the_deployment_is_refused(practice_06):
    flight = practice_06.telemetry
    late = replace(flight, events=flight.events | {"landing": 200.0})
    with pytest.raises(InputError, match=r"landing at 200 s and parachute_deploy at 252.75 s; expected the landing"):
        event_times(practice_06.mission, late)


def test_samples_that_end_with_the_stop_contain_no_impact(practice_06):
    """A vehicle at rest from the landing on moved before it only; without such a landing it may bounce after it."""
    flight, events = practice_06.telemetry, practice_06.event_times
    landing = events["landing"]
    end = flight.driving.time[flight.driving.index_at(np.array(landing - 1e-6))]
    assert impacts_from(flight, events) == pytest.approx(landing, abs=1e-9) == end
    assert impacts_from(flight, events | {"landing": landing - 0.05}) == end
    assert impacts_from(replace(flight, landing=None), events) == landing
    assert impacts_from(flight, {}) == np.inf


def test_the_forward_model_has_the_body_of_each_time():
    """Specific force, angular acceleration and centre of mass change at the event, with the effects on both bodies."""
    mission = Mission.load("builtin:practice_mer", [EVENT])
    effects = (EffectInstance(find_effect("mass"), {"k": 0.1}),)
    model = forward_model_of(mission, mission.planet_model(0.0), read_atmosphere(mission), effects)
    time = np.array([0.0, 99.9, 100.0, 300.0])
    force = np.tile([832.0, 0.0, -800.0], (4, 1))
    expected = force / (1.1 * np.array([832.0, 832.0, 800.0, 800.0]))[:, None]
    np.testing.assert_allclose(model.specific_force(time, force), expected)
    centre = model.centre_of_mass(time)
    np.testing.assert_allclose((centre[2:] - centre[:2]) * model.diameter, np.tile([-0.03, 0.01, -0.02], (2, 1)))
    unchanged = replace(model, changed_bodies=())  # the event does not change the inertia
    np.testing.assert_array_equal(
        model.angular_acceleration(time, force, force), unchanged.angular_acceleration(time, force, force)
    )


def test_positions_follow_the_centre_of_mass():
    time = np.array([9.9, 10.1, 20.1, 30.1])
    events = [
        (10.0, VehicleChangeConfig(centre_of_mass_shift=SHIFT)),
        (20.0, VehicleChangeConfig(imu_positions={"secondary": [1.0, 2.0, 3.0]})),
        (30.0, VehicleChangeConfig(centre_of_mass_shift=SHIFT)),
    ]
    stated = np.tile([0.5, 0.0, 0.0], (4, 1))
    fixed, moved = (changed_position(stated, name, time, events) for name in ("primary", "secondary"))
    np.testing.assert_allclose(fixed - stated, -np.outer([0, 1, 1, 2], SHIFT))
    np.testing.assert_allclose(moved[:2], fixed[:2])
    np.testing.assert_allclose(moved[2:], [[1.0, 2.0, 3.0], [0.97, 1.99, 3.02]])


def test_telemetry_of_a_flight_file_has_the_positions_that_events_leave():
    mission = Mission.load("builtin:practice_mer", [EVENT])
    unmoved = read_telemetry(Mission.load("builtin:practice_mer"))
    telemetry = read_telemetry(mission)
    pairs = zip((telemetry.driving, *telemetry.checking), (unmoved.driving, *unmoved.checking), strict=True)
    for record, before in pairs:
        middle = record.time - 0.5 * record.interval
        np.testing.assert_allclose(record.position - before.position, -np.outer(middle > 100.0, SHIFT), atol=1e-15)
    shifts = centre_of_mass_shifts(mission, telemetry.driving)
    assert list(shifts) == [100.0]
    np.testing.assert_array_equal(shifts[100.0], SHIFT)


def test_an_unknown_imu_is_refused():
    event = "vehicle.events={kick: {time_s: 100.0, sigma_s: 0.02, imu_positions: {third: [0, 0, 0]}}}"
    mission = Mission.load("builtin:practice_mer", [event])
    with pytest.raises(InputError, match=r"vehicle.events.kick.imu_positions: found 'third'; .* primary"):
        moved_by_events(mission, read_telemetry(Mission.load("builtin:practice_mer")))


def test_the_navigated_point_gains_the_velocity_of_its_new_place():
    """A body that turns about its old centre of mass at constant rate, without forces: w × d, and no aerodynamics."""
    telemetry = read_telemetry(Mission.load("builtin:practice_mer"))
    n, rate, shift = 80, np.array([0.2, 0.5, -0.3]), np.array([0.05, -0.02, 0.04])
    record = telemetry.driving.select(np.arange(len(telemetry.driving)) < n)
    record = replace(
        record, specific_force=np.zeros((n, 3)), angular_rate=np.tile(rate, (n, 1)), position=np.zeros((n, 3))
    )
    samples = effective_samples(record)
    event = float(samples.time[n // 2])
    stepped = with_velocity_steps(samples, {event: shift})
    np.testing.assert_array_equal(stepped.mean_force, samples.mean_force)
    start = np.array([3.5e6, 0.0, 0.0, 0.0, 100.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    plain, moved = (propagate_state(start, s.interval, s.force, s.rate, 0.0, 0.0, 1.0) for s in (samples, stepped))
    change = (moved - plain)[:, 3:6]
    np.testing.assert_array_equal(change[: n // 2 + 1], 0.0)
    expected = rotations.rotate(plain[n // 2, 6:10], np.cross(rate, shift))
    # the step is in the axes of the sample's middle, half a sample's rotation (0.04 rad) after the event
    np.testing.assert_allclose(change[n // 2 + 1 :], np.tile(expected, (n - n // 2 - 1, 1)), atol=0.04 * 0.03)


def test_the_other_imu_can_drive():
    mission = Mission.load(shipped_mission("practice_mer"), ["telemetry.driving=secondary"])
    telemetry = read_telemetry(mission)
    assert telemetry.driving.name == "secondary" and telemetry.checking[0].name == "primary"
    with pytest.raises(InputError, match="found 'third'; the flight file has primary, secondary"):
        read_telemetry(Mission.load(shipped_mission("practice_mer"), ["telemetry.driving=third"]))


def test_phoenix_has_no_public_telemetry():
    with pytest.raises(InputError, match="Phoenix"):
        read_telemetry(Mission.load(shipped_mission("phoenix")))


def test_samples_are_compared_with_one_blas_thread(monkeypatch):
    """The regressions of a few columns take a hundred times longer where BLAS threads wait for each other."""
    during = []

    def repaired(telemetry, *_):
        during.extend(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
        return telemetry

    monkeypatch.setattr(load, "repaired", repaired)
    with threadpool_limits(2, user_api="blas"):
        read_telemetry(Mission.load("builtin:practice_mer", ["telemetry.path=builtin:practice_06"]))
    assert during and set(during) == {1}
