"""Events of real flights, and the peak deceleration on constructed samples."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.trajectory import Trajectory
from edl_filter.postflight.airdata import air_data
from edl_filter.postflight.events import events, peak_deceleration
from edl_filter.telemetry.record import ImuRecord


def events_of(reconstruction):
    return events(reconstruction, air_data(reconstruction.trajectory, reconstruction.planet, reconstruction.atmosphere))


def record_and_trajectory(deceleration, interval):
    """A record and a trajectory over the same samples, the third one cut in two in the trajectory."""
    interval, deceleration = np.asarray(interval, float), np.asarray(deceleration, float)
    time, n = np.cumsum(interval), len(interval)
    force = np.zeros((n, 3))
    force[:, 0] = -deceleration
    ones, vectors = np.ones(n), np.zeros((n, 3))
    index = np.zeros(n, np.int64)
    record = ImuRecord(
        name="made",
        time=time,
        interval=interval,
        specific_force=force,
        angular_rate=vectors,
        position=vectors,
        force_noise=ones,
        rate_noise=ones,
        shared_rate_noise=ones,
        coning_corrected=ones > 2.0,
        sculling_corrected=ones > 2.0,
        unit=index,
        units=("a",),
        source=index,
        sources=("b",),
        errors=(SensorErrors(),),
    )
    cut = np.insert(time, 2, time[2] - 0.5 * interval[2])
    forces = np.insert(force, 2, force[2], axis=0)
    times = np.concatenate(([0.0], cut))
    forces = np.concatenate((forces[:1], forces))
    rows = len(times)
    empty = np.zeros((rows, 3))
    trajectory = Trajectory(times, empty, empty, np.zeros((rows, 4)), times, np.zeros((rows, 9, 9)), forces, empty)
    return trajectory, record


def test_peak_is_the_mean_of_two_successive_samples():
    trajectory, record = record_and_trajectory([1.0, 5.0, 9.0, 8.0, 2.0, 1.0], [0.125] * 6)
    peak = peak_deceleration(trajectory, record, 10.0)
    assert (peak.acceleration, peak.single) == (8.5, 9.0)
    assert peak.time == pytest.approx(0.375)


def test_peak_ignores_gaps_and_what_comes_after_the_parachute():
    trajectory, record = record_and_trajectory(
        [1.0, 2.0, 3.0, 99.0, 2.0, 50.0, 60.0], [0.1, 0.1, 0.1, 0.8, 0.1, 0.1, 0.1]
    )
    peak = peak_deceleration(trajectory, record, 1.25)
    assert (peak.acceleration, peak.single) == (2.5, 3.0)


def test_no_two_samples_no_peak():
    trajectory, record = record_and_trajectory([1.0, 2.0, 3.0, 4.0], [0.1] * 4)
    assert peak_deceleration(trajectory, record, 0.15) is None


def test_spirit(spirit):
    e = events_of(spirit)
    assert list(e)[:3] == ["entry_interface", "peak_deceleration", "parachute_deploy"]
    peak, chute = e["peak_deceleration"], e["parachute_deploy"]
    # the sample at 120.7 s (57.8 m/s² over a constant 125 ms) has 51 increments
    assert peak.acceleration_m_s2 == pytest.approx(56.97, abs=0.05)
    assert peak.acceleration_single_m_s2 == pytest.approx(56.98, abs=0.05)
    assert peak.time_s == pytest.approx(122.0, abs=0.1)
    assert chute.velocity_m_s == pytest.approx(410.0, abs=8.0)
    assert 7.3e3 - 400.0 < chute.height_above_site_m < 7.8e3 + 400.0
    assert chute.sclk == pytest.approx(126462336.5)
    assert chute.utc == "2004-01-04T04:24:03.032"
    assert chute.acceleration_m_s2 is None
    assert e["entry_interface"].height_above_site_m == pytest.approx(3522.2e3 - 3392.3e3, abs=500.0)


def test_opportunity(opportunity):
    e = events_of(opportunity)
    assert e["peak_deceleration"].acceleration_m_s2 == pytest.approx(61.5, abs=0.1)
    assert e["parachute_deploy"].velocity_m_s == pytest.approx(432.0, abs=8.0)
    assert e["parachute_deploy"].height_above_site_m == pytest.approx(7.8e3, abs=500.0)


def test_a_flight_without_a_clock_has_utc_alone(practice_06):
    e = events_of(practice_06)
    assert {event.sclk for event in e.values()} == {None}
    assert e["entry_interface"].utc == "2004-01-04T04:19:52.000"
    times = [event.time_s for event in e.values()]
    assert times == sorted(times)


@pytest.mark.parametrize("time_sigma", [0.0, 0.02, 0.3])
def test_the_sigma_of_a_state_contains_that_of_its_time(practice_06, time_sigma):
    telemetry = replace(practice_06.telemetry, event_sigmas={"parachute_deploy": time_sigma})
    chute = events_of(replace(practice_06, telemetry=telemetry))["parachute_deploy"]
    exact = events_of(replace(practice_06, telemetry=replace(telemetry, event_sigmas={})))["parachute_deploy"]
    air = air_data(practice_06.trajectory, practice_06.planet, practice_06.atmosphere)
    sinking = np.interp(chute.time_s, air.time, np.gradient(air.altitude, air.time))
    assert chute.altitude_sigma_m == pytest.approx(np.hypot(exact.altitude_sigma_m, sinking * time_sigma), rel=2e-2)
    assert chute.altitude_m == exact.altitude_m


def test_a_touchdown_later_than_stated_is_one_at_the_speed_before_it(practice_06):
    """The impact begins with it: its deceleration of 140 m/s² is no part of the uncertainty of the touchdown."""
    landing = events_of(practice_06)["landing"]
    assert practice_06.telemetry.event_sigmas["landing"] == 0.02
    assert landing.velocity_m_s > 60.0 and landing.velocity_sigma_m_s < 0.1
