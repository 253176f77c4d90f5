"""From missions to problems and reconstructions: the shipped practice flight, with either filter."""

from dataclasses import replace

import numpy as np
import pytest
from left_out import left_out_sigmas
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.imu_model.lever_arm import EDGE_REACH, lever_arm_acceleration, lever_arm_acceleration_of_products
from edl_filter.mission import Mission, shipped_mission
from edl_filter.navigation.compiled_ukf import CompiledUKF
from edl_filter.navigation.ekf import ErrorStateEKF
from edl_filter.navigation.filter import new_filter
from edl_filter.pipeline.constraints import _velocity_sigma_at_stop
from edl_filter.pipeline.load import read_atmosphere
from edl_filter.pipeline.reconstruct import FlightInputs, assemble, reconstruct, without_effects
from edl_filter.simulation import Scenario, simulate


@pytest.fixture(scope="module")
def extended():
    """The practice flight as ``--set filter.method=ekf`` reconstructs it."""
    return reconstruct(Mission.load(shipped_mission("practice_mer"), ["filter.method=ekf"]))


def test_practice_flight_has_its_constraints(practice_06):
    names = [s.name for s in practice_06.constraint_checks]
    assert names == [
        "entry_state", "parachute", "altimeter", "landing", "rest_velocity", "rest_rate", "rest_gravity"
    ]  # fmt: skip


def test_velocity_at_the_stop_has_the_error_of_the_interpolated_rate(practice_06):
    """A vehicle stops turning within half a second: the velocity is wrong at the stop, and right four samples later."""
    interval, count, stop = 0.125, 60, 32
    edge = interval * np.arange(count + 1)
    rate_at = np.clip((stop * interval - edge) / 0.5, 0.0, 1.0)[:, None] * np.array([0.3, -0.2, 0.4])
    mean, change = 0.5 * (rate_at[1:] + rate_at[:-1]), np.diff(rate_at, axis=0)
    record = replace(
        practice_06.telemetry.driving.between(0.0, count * interval), time=edge[1:], interval=np.diff(edge),
        angular_rate=mean, position=np.tile([0.2, 0.3, -0.25], (count, 1)),
    )  # fmt: skip
    estimated = lever_arm_acceleration(record.interval, mean, record.position, record.unit)
    products = [(i, j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    squares = np.stack([mean[:, i] * mean[:, j] + change[:, i] * change[:, j] / 12.0 for i, j in products], axis=1)
    exact = lever_arm_acceleration_of_products(change / interval, squares, record.position)
    velocity = np.linalg.norm(np.cumsum((estimated - exact) * interval, axis=0), axis=1)  # behind each sample
    sigma = _velocity_sigma_at_stop(record, stop * interval)
    assert sigma > 1e-3
    assert sigma * np.sqrt(3.0) == pytest.approx(velocity[stop - 1], rel=0.02)
    # the centripetal acceleration during the stop leaves a constant of 0.03 mm/s
    assert np.max(velocity[stop - 1 + EDGE_REACH :]) < 5e-5
    assert _velocity_sigma_at_stop(record, (stop + EDGE_REACH) * interval) < 1e-12


@pytest.mark.parametrize("late", [1e-6, 2.6e-4, 5e-3])
def test_a_landing_between_two_samples_is_no_contradiction(practice_06, late):
    """Stamps that are late by a part of a sample: the impact of 600 m/s² is not after the stop.

    Five milliseconds are 0.5 m at the parachute, by the velocity of the descent.
    """

    def shifted(record):
        interval = record.interval + late * (np.arange(len(record)) == 0)
        return replace(record, time=record.time + late, interval=interval)

    flight = practice_06.telemetry
    inputs = FlightInputs(
        replace(flight, driving=shifted(flight.driving), checking=tuple(shifted(r) for r in flight.checking)),
        practice_06.atmosphere,
    )
    result = reconstruct(practice_06.mission, leave_one_out=False, inputs=inputs, compare_imus=False)
    assert result.recovery is None and all(f.accepted for f in result.filter_pass.fused)
    node, nominal = (int(np.argmin(np.abs(r.smoothed.time - flight.parachute.time))) for r in (result, practice_06))
    move = result.smoothed.states[node].minus(practice_06.smoothed.states[nominal])[:6]
    vertical = practice_06.smoothed.states[nominal].nav[:3]
    assert abs(move[:3] @ vertical) / np.linalg.norm(vertical) < 0.05 + 150.0 * late
    assert np.linalg.norm(move[3:]) < 0.05
    for name in ("rest_velocity", "rest_rate", "rest_gravity"):
        (nis,), (expected,) = (
            [f.innovation.nis for f in r.filter_pass.fused if f.constraint.name == name] for r in (result, practice_06)
        )
        assert nis < expected + 1.0


def in_longer_samples(record, count, first):
    """The record's means over `count` samples each, of which the first one has `first`."""
    starts = np.unique(np.append(0, np.arange(first, len(record), count)))
    size = np.diff(np.append(starts, len(record)))
    out = record.select(np.isin(np.arange(len(record)), starts + size - 1))

    def mean(values):
        return np.add.reduceat(values, starts, axis=0) / size[:, None]

    return replace(
        out, interval=np.add.reduceat(record.interval, starts), specific_force=mean(record.specific_force),
        angular_rate=mean(record.angular_rate), stated_interval=count * record.stated_interval,
        **{key: getattr(out, key) / np.sqrt(size) for key in ("force_noise", "rate_noise", "shared_rate_noise")},
    )  # fmt: skip


@pytest.mark.parametrize(
    "behind", [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(3, marks=pytest.mark.slow)]
)
def test_a_flight_that_lands_within_a_sample_is_consistent(behind):
    """A simulated flight of 32 Hz in samples of 8 Hz, of which one, two or three quarters are behind the stop."""
    scenario = Scenario.load("builtin:mer", ["sampling.interval_s=0.03125"])
    flight = simulate(scenario, seed=300)
    mission, telemetry = Mission.load(scenario.mission), flight.telemetry()
    first = (int(telemetry.driving.index_at(np.array(telemetry.landing.time))) + 1 + behind) % 4
    longer = replace(
        telemetry, driving=in_longer_samples(telemetry.driving, 4, first),
        checking=tuple(in_longer_samples(r, 4, first) for r in telemetry.checking),
    )  # fmt: skip
    edge = longer.driving.time[longer.driving.index_at(np.array(telemetry.landing.time))]
    assert edge - telemetry.landing.time == pytest.approx(behind / 32.0, abs=1e-6)
    result = reconstruct(mission, inputs=FlightInputs(longer, read_atmosphere(mission)))
    assert result.recovery is None and all(f.accepted for f in result.filter_pass.fused)
    for time in (flight.motion.deployed - 20.0, flight.motion.stopped + 10.0):
        k = int(np.argmin(np.abs(result.smoothed.time - time)))
        true, state = flight.motion.at(result.smoothed.time[k : k + 1])[0], result.smoothed.states[k].nav
        turn = Rotation.from_quat(state[6:10]).inv() * Rotation.from_quat(true[6:10])
        error = np.concatenate((true[:6] - state[:6], turn.as_rotvec()))
        assert error @ np.linalg.solve(result.smoothed.covariance[k][:9, :9], error) < chi2.ppf(0.999, 9)


def test_rest_is_stated_at_both_ends_of_the_window(practice_06):
    stated = {c.name: c for c in practice_06.problem.constraints if c.name.startswith("rest_")}
    landed, last = practice_06.telemetry.landing.time, practice_06.problem.samples.time[-1]
    assert stated["rest_velocity"].time == landed and stated["rest_gravity"].time == last
    assert stated["rest_gravity"].duration == pytest.approx(last - landed)
    sigma = 5e-4 / (last - landed)
    across = practice_06.telemetry.rest_force_sigma[1]  # the force of this flight at rest does not turn with the planet
    assert np.allclose(
        np.linalg.eigvalsh(stated["rest_gravity"].noise), [sigma**2, *[sigma**2 + across**2] * 2], rtol=1e-6
    )
    # this vehicle does not turn when it comes to rest
    assert stated["rest_velocity"].sigma == pytest.approx(5e-4, rel=1e-3)


def test_all_constraints_of_the_clean_practice_flight_are_consistent(practice_06):
    for s in practice_06.constraint_checks:
        assert s.consistent, s.name
        assert left_out_sigmas(s) < 3.0, s.name
        assert np.all(s.accepted)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("constraints.onboard_attitude={interval_s: 5, sigma_deg: 0.1}", "on-board attitude"),
        ("constraints.pre_entry_zero_force={start_s: -300, end_s: -5, sigma: 1e-3}", "no telemetry between -300"),
        (
            "constraints.steady_descent={start_s: 300, end_s: 310, horizontal_sigma: 10, vertical_sigma: 0.1}",
            "vehicle.parachute.drag_coefficient",
        ),
        ("constraints.rest={start_s: 900, end_s: 950, velocity_sigma: 0.1}", "no telemetry between 900"),
    ],
)
def test_a_message_names_what_the_telemetry_lacks(override, message):
    with pytest.raises(InputError, match=message):
        reconstruct(Mission.load(shipped_mission("practice_mer"), [override]))


def test_effects_of_zero_size_leave_the_telemetry(practice_06):
    telemetry, bias = practice_06.telemetry, find_effect("accelerometer_bias")
    zero, acting = EffectInstance(bias, {}), EffectInstance(bias, {"bx": 0.1})
    assert without_effects(practice_06.mission, telemetry, [zero]) is telemetry
    corrected = without_effects(practice_06.mission, telemetry, [zero, acting]).driving
    change = corrected.specific_force - telemetry.driving.specific_force
    np.testing.assert_allclose(change, np.tile([-0.1, 0.0, 0.0], (len(change), 1)), atol=1e-12)
    with pytest.raises(InputError, match="there is no such IMU"):
        without_effects(practice_06.mission, telemetry, [EffectInstance(bias, {}, "third")])


def test_problem_begins_at_the_entry_state(practice_06):
    mission = practice_06.mission
    problem = assemble(mission, practice_06.telemetry, practice_06.planet, read_atmosphere(mission))
    assert problem.epochs[0] == problem.initial.time
    assert np.max(np.diff(problem.epochs)) <= 1.25 * mission.filter.longest_interval_s
    times = [c.time for c in problem.constraints]
    assert times == sorted(times)
    cut = set(np.round(problem.samples.time, 5))
    assert all(round(t, 5) in cut for t in times if t > problem.initial.time)


def test_every_practice_vehicle_runs(practice):
    mission = Mission.load(shipped_mission("practice_phoenix"), [f"telemetry.path={practice(3)}"])
    flight = reconstruct(mission)
    assert flight.telemetry.driving.interval[0] == pytest.approx(0.05)
    assert all(s.consistent for s in flight.constraint_checks if s.name in ("altimeter", "parachute", "landing"))


def test_the_mission_chooses_the_filter(practice_06, extended):
    for reconstruction, filter_class in ((practice_06, CompiledUKF), (extended, ErrorStateEKF)):
        node = reconstruction.filter_pass.nodes[0]
        assert isinstance(new_filter(reconstruction.problem, node.state, node.covariance), filter_class)


def test_another_filter_is_refused():
    with pytest.raises(InputError, match=r"filter\.method: found .*enkf.*ukf.*ekf"):
        Mission.load(shipped_mission("practice_mer"), ["filter.method=enkf"])


def test_another_engine_is_refused():
    with pytest.raises(InputError, match=r"filter\.engine: found .*fast.*compiled.*filterpy"):
        Mission.load(shipped_mission("practice_mer"), ["filter.engine=fast"])
    assert Mission.load(shipped_mission("practice_mer"), ["filter.engine=filterpy"]).filter.engine == "filterpy"


@pytest.mark.parametrize(("rest", "sigmas", "relative"), [(5e-4, 0.06, 2e-3), (0.05, 0.03, 1e-3)])
def test_the_ekf_agrees_with_the_ukf(rest, sigmas, relative):
    """All smoothed states, and their sigmas: the flight is nearly linear.

    The velocity before the landing differs most, by 1 mm/s. Its sigma is 18 mm/s where the vehicle is at rest to
    0.5 mm/s, the default, and 43 mm/s where it is at rest to 0.05 m/s.
    """
    key = f"constraints.rest={{from: telemetry, velocity_sigma: {rest}}}"
    missions = [Mission.load(shipped_mission("practice_mer"), [key, f"filter.method={m}"]) for m in ("ekf", "ukf")]
    extended, unscented = (reconstruct(m, leave_one_out=False).smoothed for m in missions)
    for k, (state, twin) in enumerate(zip(extended.states, unscented.states, strict=True)):
        sigma = np.sqrt(np.diag(unscented.covariance[k]))
        assert np.max(np.abs(state.minus(twin)) / sigma) < sigmas
        np.testing.assert_allclose(np.sqrt(np.diag(extended.covariance[k])), sigma, rtol=relative)


def test_all_constraints_are_consistent_with_the_ekf(practice_06, extended):
    for check, twin in zip(extended.constraint_checks, practice_06.constraint_checks, strict=True):
        assert check.name == twin.name
        assert check.consistent and np.all(check.accepted), check.name
        assert left_out_sigmas(check) == pytest.approx(left_out_sigmas(twin), abs=0.05)
