"""Flights as files and in memory: random quantities, measurements and truth."""

import h5py
import numpy as np
import pytest
import slow_flight as slow

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.planet import ellipsoid
from edl_filter.simulation import Scenario, simulate
from edl_filter.simulation.simulate import attitude, inertial_state
from edl_filter.telemetry.flight_file import read_flight_file

#: Radius, latitude, longitude, speed, flight-path angle and azimuth at entry.
GIVEN = (3.522e6, -0.3, 2.8, 5600.0, -0.2, 1.4)


@pytest.fixture(scope="module")
def written(mer_flight, tmp_path_factory):
    return mer_flight.write(tmp_path_factory.mktemp("flight") / "mer.h5")


def test_the_file_is_a_flight_file_with_its_truth(mer_flight, written):
    telemetry = read_flight_file(written)
    assert set(telemetry.events) == {"parachute_deploy", "landing"}
    assert telemetry.landing.time == pytest.approx(telemetry.events["landing"] + 0.5)
    altimeter, motion = telemetry.altimeter, mer_flight.motion
    ground = np.linalg.norm(motion.at(np.array([motion.landed]))[0][:3])
    assert altimeter.surface_radius == pytest.approx(ground, abs=1e-6)  # where it touches down
    true = np.linalg.norm(motion.at(altimeter.time)[:, :3], axis=1) - ground
    np.testing.assert_allclose(np.std(altimeter.height - true), altimeter.sigma, rtol=0.2)
    assert 2300.0 < altimeter.height[0] < 2450.0 and true[-1] == pytest.approx(0.0, abs=1e-6)
    with h5py.File(written) as file:
        truth = file["truth"]
        assert truth.attrs["seed"] == 1
        n = len(telemetry.driving.time) + 1
        for key, shape in {"position": (n, 3), "attitude": (n, 4), "alpha_total": (n,), "density": (n,)}.items():
            assert truth[key].shape == shape
        assert truth["sensor_errors/primary/accelerometer_bias"].shape == (3,)
        assert list(truth["effects"]) == []


def test_memory_holds_what_the_file_holds(mer_flight, written):
    memory, file = mer_flight.telemetry(), read_flight_file(written)
    np.testing.assert_array_equal(memory.driving.specific_force, file.driving.specific_force)
    np.testing.assert_array_equal(memory.initial.covariance, file.initial.covariance)
    assert memory.parachute == file.parachute and memory.events == file.events


def test_forces_of_the_file_are_the_loads_of_the_world(mer_scenario):
    """Without errors, a sample is the mean of ForwardModel.loads over the mass, along the true motion."""
    quiet = [f"imus.primary.{key}=0" for key in vars_of("accelerometer", "gyro")]
    scenario = Scenario.load(
        "builtin:mer", [*quiet, "imus.primary.position=[0, 0, 0]", "imus.primary.velocity_quantum=0"]
    )
    effects = [
        EffectInstance(find_effect("pitching_moment_scale"), {"k": 0.1}),
        EffectInstance(find_effect("mass"), {"k": 0.03}),
        EffectInstance(find_effect("density_wave"), {"A": 0.1, "L": 12e3}),
    ]
    flight = simulate(scenario, effects)
    m, forward_model = flight.motion, flight.forward_model
    flow = forward_model.flow(m.time, *np.split(m.state[:, :13], [3, 6, 10], axis=1))
    force = forward_model.loads(flow)[0] / forward_model.rigid_body.mass
    means = (0.5 * (force[:-1] + force[1:]))[: 10 * len(flight.contents.imus["primary"].time)]
    means = means.reshape(-1, 10, 3).mean(axis=1)
    imu = flight.contents.imus["primary"]
    measured = rotations.rotate(imu.body_from_imu, imu.specific_force)
    before = (imu.time > 1.0) & (imu.time <= m.deployed)
    noise = imu.accelerometer_noise
    np.testing.assert_allclose(measured[before], means[before], rtol=0.0, atol=6.0 * noise)
    assert np.abs((measured - means)[before].mean(axis=0)).max() < 5.0 * noise / np.sqrt(before.sum()) + 2e-5
    assert np.abs(measured[before, 0]).max() > 40.0


def vars_of(*sensors):
    return [
        f"{sensor}_{error}_sigma"
        for sensor, errors in zip(sensors, (("bias", "scale", "misalignment"), ("bias", "scale")), strict=True)
        for error in errors
    ]


def test_the_same_seed_draws_the_same_whatever_the_effects(mer_scenario, mer_flight):
    repeated = simulate(mer_scenario)
    biased = simulate(mer_scenario, [EffectInstance(find_effect("accelerometer_bias"), {"bx": 0.5})])
    reseeded = simulate(mer_scenario, seed=2)
    first, *rest = (f.contents.imus["primary"].specific_force for f in (mer_flight, repeated, biased, reseeded))
    np.testing.assert_array_equal(first, rest[0])
    body = mer_flight.contents.imus["primary"].body_from_imu
    shift = rotations.rotate(body, rest[1] - first)
    np.testing.assert_allclose(shift.mean(axis=0), [0.5, 0.0, 0.0], atol=1e-3)
    assert not np.array_equal(first[:100], rest[2][:100])
    np.testing.assert_array_equal(mer_flight.contents.initial.position, biased.contents.initial.position)
    np.testing.assert_array_equal(biased.contents.imus["secondary"].angular_rate,
                                  mer_flight.contents.imus["secondary"].angular_rate)  # fmt: skip


def test_an_instrument_does_not_move_with_the_centre_of_mass(mer_scenario):
    """The offset shortens the lever arm, at whose end the IMU measures the acceleration of the spin: w × (w × r)."""
    spin = 2.0 * np.pi / 30.0
    shift = np.array([0.0, 0.02, -0.03])
    flights = [
        simulate(mer_scenario, effects)
        for effects in ((), [EffectInstance(find_effect("com_offset"), {"dy": shift[1], "dz": shift[2]})])
    ]
    early = [f.contents.imus["primary"] for f in flights]
    change = np.mean(early[1].specific_force[:24] - early[0].specific_force[:24], axis=0)
    change = rotations.rotate(early[0].body_from_imu, change)
    np.testing.assert_allclose(change, spin**2 * shift * [0.0, 1.0, 1.0], atol=2e-4)


def test_a_missions_centre_of_mass_off_the_axis_moves_no_instrument(mer_scenario, mer_flight, tmp_path):
    """Positions are stated from it: the primary reads the same until the first deceleration, and differs after it."""
    model = Mission.load("builtin:practice_mer", ["vehicle.centre_of_mass_offset=[0.01, -0.01]"])
    (tmp_path / "beside.yaml").write_text(model.text, encoding="utf-8")
    off_axis_scenario = Scenario.load("builtin:mer", [f"mission={tmp_path / 'beside.yaml'}"])
    on_axis, off_axis = (f.contents.imus["primary"].specific_force for f in (mer_flight, simulate(off_axis_scenario)))
    np.testing.assert_allclose(
        np.mean(off_axis[:24] - on_axis[:24], axis=0), 0.0, atol=2e-4
    )  # an arm would give 1.2e-3
    assert np.max(np.abs(off_axis[:1000] - on_axis[:1000])) > 0.1


def test_under_the_parachute_the_vehicle_drifts_with_the_air(mer_scenario):
    """Air that does not rotate moves at 230 m/s over the ground, and the vehicle with it."""
    flight = simulate(mer_scenario, [EffectInstance(find_effect("atmosphere_rotation"), {"k": 1.0})])
    m, planet = flight.motion, flight.forward_model.planet
    late = m.at(np.array([m.landed - 5.0]))[0]
    assert 200.0 < np.linalg.norm(planet.velocity_relative(late[:3], late[3:6])) < 260.0


def test_an_effect_in_an_imu_that_is_not_there(mer_scenario):
    with pytest.raises(InputError, match=r"imu: found 'third'.*primary, secondary"):
        simulate(mer_scenario, [EffectInstance(find_effect("gyro_bias"), {"bx": 1e-4}, imu="third")])


def test_a_turned_frame_is_undone_by_its_effect(mer_scenario, mer_flight):
    """The effect turns the stated state into the one that is stated without the effect."""
    turn = EffectInstance(find_effect("attitude_frame"), {"rx": 3e-3, "ry": -4e-3, "rz": 5e-3})
    stated = simulate(mer_scenario, [turn]).contents.initial
    plain = mer_flight.contents.initial
    assert np.linalg.norm(stated.position - plain.position) > 1e4
    undone = turn.effect.entry_state(turn.values, stated)
    np.testing.assert_allclose(undone.position, plain.position, atol=1e-3)
    np.testing.assert_allclose(undone.velocity, plain.velocity, atol=1e-6)
    np.testing.assert_allclose(stated.inertial_from_body, plain.inertial_from_body, atol=1e-12)


def test_its_reconstruction_is_consistent(mer_flight, written):
    """Every kind of constraint is consistent with its sigma, and the truth with the covariance of the estimate."""
    reconstruction = reconstruct(Mission.load("builtin:practice_mer", [f"telemetry.path={written}"]))
    nis = np.array([[f.innovation.nis, len(f.innovation.residual)] for f in reconstruction.filter_pass.fused]).sum(
        axis=0
    )
    assert abs(nis[0] - nis[1]) < 4.0 * np.sqrt(2.0 * nis[1])
    for node, state, covariance in zip(
        reconstruction.filter_pass.nodes,
        reconstruction.smoothed.states,
        reconstruction.smoothed.covariance,
        strict=True,
    ):
        true = mer_flight.motion.at(np.array([node.time]))[0]
        turn = rotations.multiply(rotations.conjugate(state.nav[6:10]), true[6:10])
        error = np.concatenate((true[:6] - state.nav[:6], rotations.to_rotation_vector(turn)))
        # 9 degrees of freedom: one in 10⁵ is above 40
        assert error @ np.linalg.solve(covariance[:9, :9], error) < 40.0, node.time


def test_the_altimeter_reads_at_its_own_interval(mer_flight):
    scenario = Scenario.load("builtin:mer", ["altimeter.interval_s=0.5", "seed=1"])
    seldom, often = simulate(scenario, seed=1).telemetry().altimeter, mer_flight.telemetry().altimeter
    np.testing.assert_allclose(np.diff(seldom.time), 0.5, atol=1e-9)
    assert len(often.time) == pytest.approx(4 * len(seldom.time), abs=4)


def test_state_has_the_conditions_stated():
    r, v = inertial_state(slow.MARS, *GIVEN)
    latitude, longitude, radius = ellipsoid.areocentric_from_fixed(slow.MARS.rotation.to_fixed(0.0, r))
    np.testing.assert_allclose([radius, latitude, longitude], GIVEN[:3], rtol=1e-12)
    up = r / radius
    east = np.cross([0.0, 0.0, 1.0], up) / np.cos(latitude)
    north = np.cross(up, east)
    np.testing.assert_allclose(np.linalg.norm(v), GIVEN[3], rtol=1e-12)
    np.testing.assert_allclose(np.arcsin(v @ up / GIVEN[3]), GIVEN[4], rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(v @ east, v @ north), GIVEN[5], rtol=1e-12)


def test_attitude_has_the_angles_stated():
    r, v = inertial_state(slow.MARS, *GIVEN)
    for alpha, beta, bank in ((0.0, 0.0, 0.0), (0.1, -0.05, 0.0), (-0.2, 0.15, 2.0)):
        q = attitude(v, r, alpha, beta, bank)
        x, y, z = rotations.rotate(rotations.conjugate(q), v / np.linalg.norm(v))
        np.testing.assert_allclose([np.arctan2(z, x), np.arcsin(y)], [alpha, beta], atol=1e-12)
    level = attitude(v, r, 0.0, 0.0, 0.0)
    down = rotations.rotate(level, [0.0, 0.0, 1.0])
    assert down @ r < 0.0 and abs(rotations.rotate(level, [0.0, 1.0, 0.0]) @ r) < 1e-6
