"""Rates that are late against the forces of the same IMU, by the dynamics of a rigid vehicle."""

import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_telemetry
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.pipeline.trust import judge
from edl_filter.telemetry.record import ImuRecord
from edl_filter.telemetry.triad_delay import delay_of_rates, with_triad_delay

INERTIA = np.array([[250.0, 3.0, -2.0], [3.0, 200.0, 4.0], [-2.0, 4.0, 190.0]])
POSITION = np.array([0.2, -0.1, 0.15])
END, FINE = 80.0, 0.005


@pytest.fixture(scope="module")
def motion():
    """Rates, their derivative and the force at the centre of mass of a spinning, oscillating vehicle, every 5 ms."""
    stiffness, force_slope = 5000.0, 3.1  # N m per rad; m/s^2 per rad

    def accelerations(t, state):
        alpha, beta, *omega = state
        moment = np.array([0.0, 30.0 - stiffness * alpha, stiffness * beta - 20.0])
        omega = np.array(omega)
        change = np.linalg.solve(INERTIA, moment - np.cross(omega, INERTIA @ omega))
        rate = np.array([omega[1] + omega[0] * beta, -omega[2] - omega[0] * alpha])
        return [*rate, *change]

    time = np.arange(0.0, END + 30.0, FINE)
    state = solve_ivp(
        accelerations, (0.0, time[-1]), [0.05, -0.03, 0.2, 0.0, 0.0], t_eval=time, rtol=1e-9, atol=1e-12
    ).y
    change = np.array([accelerations(t, s)[2:] for t, s in zip(time, state.T, strict=True)])
    alpha, beta = state[:2]
    force = np.column_stack((np.full(len(time), -50.0), -force_slope * beta, -force_slope * alpha))
    return time, state[2:].T, change, force


def record_of(motion, interval=0.125, delay=0.0, seed=0, position=POSITION):
    """Means over the intervals, read with noise; the rates are those of `delay` earlier."""
    time, omega, change, force = motion
    at_imu = force + np.cross(change, position) + np.cross(omega, np.cross(omega, position))
    edges = np.arange(1.0, time[-1] - 2.0, interval)
    rng = np.random.default_rng(seed)

    def means(values, moved):
        integral = np.vstack((np.zeros(3), np.cumsum(0.5 * (values[1:] + values[:-1]) * FINE, axis=0)))
        at = np.column_stack([np.interp(edges - moved, time, column) for column in integral.T])
        return np.diff(at, axis=0) / interval

    count = len(edges) - 1
    return ImuRecord(
        name="primary", time=edges[1:], interval=np.full(count, interval),
        specific_force=means(at_imu, 0.0) + 3e-3 * rng.standard_normal((count, 3)),
        angular_rate=means(omega, delay) + 2e-5 * rng.standard_normal((count, 3)),
        position=np.tile(position, (count, 1)), force_noise=np.full(count, 3e-3), rate_noise=np.full(count, 2e-5),
        shared_rate_noise=np.zeros(count), coning_corrected=np.zeros(count, bool),
        sculling_corrected=np.zeros(count, bool), unit=np.zeros(count, int), units=("primary",),
        source=np.zeros(count, int), sources=("flight",), errors=(SensorErrors(),),
    )  # fmt: skip


@pytest.mark.parametrize("interval", [0.125, 0.05, 0.01])
@pytest.mark.parametrize("delay", [0.0, 0.05, -0.125, 0.25])
def test_the_delay_of_the_rates_is_estimated(motion, interval, delay):
    estimate, sigma = delay_of_rates(record_of(motion, interval, delay), INERTIA, END)
    assert estimate == pytest.approx(delay, abs=max(0.004, 0.02 * abs(delay)))
    assert sigma < 0.005


def test_the_inertia_counts_in_proportion_only_and_an_error_of_the_lever_arm_hardly(motion):
    record = record_of(motion, delay=0.06)
    estimate, _ = delay_of_rates(record, INERTIA, END)
    assert delay_of_rates(record, 7.0 * INERTIA, END)[0] == pytest.approx(estimate, rel=1e-9)
    elsewhere = replace(record, position=record.position + np.array([0.1, 0.1, -0.1]))
    assert delay_of_rates(elsewhere, INERTIA, END)[0] == pytest.approx(0.06, abs=0.01)


def test_biases_misaligned_and_scaled_sensors_have_no_delay(motion):
    record = record_of(motion)
    force = 1.02 * record.specific_force + 0.05
    rate = record.angular_rate @ (np.eye(3) + 0.01 * np.array([[0, 1, -1], [-1, 0, 1], [1, -1, 0]])) + 1e-3
    estimate, _ = delay_of_rates(replace(record, specific_force=force, angular_rate=rate), INERTIA, END)
    assert abs(estimate) < 0.005


def test_a_flight_that_does_not_determine_it_has_none(motion):
    record = record_of(motion)
    assert delay_of_rates(record.select(record.time < 20.0), INERTIA, END) is None
    rng = np.random.default_rng(1)
    still = replace(record, angular_rate=2e-5 * rng.standard_normal((len(record), 3)))
    assert delay_of_rates(still, INERTIA, END) is None
    filled = replace(record, rate_fill_sigma=np.where(record.time[:, None] % 8.0 < 1.0, 1e-3, 0.0) * np.ones(3))
    assert delay_of_rates(filled, INERTIA, END) is None
    record = record_of(motion, position=np.zeros(3))
    assert delay_of_rates(record, INERTIA, END) is not None
    tumbling = replace(record, specific_force=record.specific_force * [1.0, -1.0, -1.0])  # the force would destabilise
    assert delay_of_rates(tumbling, INERTIA, END) is None


def test_rovers_and_practice_flight_have_no_delay(spirit, opportunity, practice_06):
    for reconstruction, greatest in ((spirit, 0.015), (opportunity, 0.008), (practice_06, 0.003)):
        telemetry, end = reconstruction.telemetry, reconstruction.event_times["parachute_deploy"] - 1.0
        inertia = reconstruction.mission.vehicle.inertia.tensor
        estimate, sigma = delay_of_rates(telemetry.driving, inertia, end)
        assert abs(estimate) < greatest and sigma < 0.003
        assert with_triad_delay(telemetry, inertia, end) is telemetry
        assert with_triad_delay(telemetry, inertia, np.inf) is telemetry


def test_late_gyros_of_the_only_imu_are_not_trusted_unless_the_model_has_the_delay(builtin_flight, tmp_path):
    path = shutil.copy(builtin_flight, tmp_path / "flight.h5")
    with h5py.File(path, "a") as file:
        del file["imu/secondary"]
        rates = file["imu/primary/angular_rate"]
        rates[1:] = rates[()][:-1]
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
    result = reconstruct(mission, leave_one_out=False)
    (finding,) = (f for f in result.telemetry.findings if f.kind == "delay")
    assert "rates are 0.12" in finding.repair and "later than forces" in finding.repair
    trust = judge(result)
    assert not trust.trustworthy and "different clocks" in trust.headline and "imu_time_offset" in trust.headline
    delay = EffectInstance(find_effect("imu_time_offset"), {"tau": 0.125})
    assert judge(reconstruct(mission, (delay,), leave_one_out=False)).trustworthy
    # with the checks off nothing is said
    off = Mission.load("builtin:practice_mer", [f"telemetry.path={path}", "sample_checks.enabled=false"])
    assert not any(f.kind == "delay" for f in read_telemetry(off).findings)
