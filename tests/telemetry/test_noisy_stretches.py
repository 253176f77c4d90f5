"""Noise of the only IMU that is higher than stated for some time: found with its sigma, and nothing else is found."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_telemetry
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.noisy_stretches import KIND, with_noise_of_stretches
from edl_filter.telemetry.record import ImuRecord
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.sample_repair import repaired, without_samples

COUNT, INTERVAL, FORCE_NOISE, RATE_NOISE = 2000, 0.125, 3e-3, 2e-5
UNTIL = 200.0


def smooth_record(seed=1):
    """A vehicle that decelerates, spins and oscillates, read with the stated noise."""
    rng = np.random.default_rng(seed)
    time = INTERVAL * np.arange(1, COUNT + 1)
    pulse = np.exp(-(((time - 110.0) / 30.0) ** 2))
    swing = np.outer(np.sin(2.0 * np.pi * 0.9 * time), [0.0, 1.0, -0.5]) * pulse[:, None]
    force = np.outer(pulse, [-60.0, 0.0, 0.0]) + swing + FORCE_NOISE * rng.standard_normal((COUNT, 3))
    rate = np.array([0.2, 0.0, 0.0]) + 0.02 * swing + RATE_NOISE * rng.standard_normal((COUNT, 3))
    return ImuRecord(
        name="primary", time=time, interval=np.full(COUNT, INTERVAL), specific_force=force, angular_rate=rate,
        position=np.zeros((COUNT, 3)), force_noise=np.full(COUNT, FORCE_NOISE), rate_noise=np.full(COUNT, RATE_NOISE),
        shared_rate_noise=np.zeros(COUNT), coning_corrected=np.zeros(COUNT, bool),
        sculling_corrected=np.zeros(COUNT, bool), unit=np.zeros(COUNT, int), units=("primary",),
        source=np.zeros(COUNT, int), sources=("flight",), errors=(SensorErrors(),),
    )  # fmt: skip


def with_noise(record, first, count, factor, triad="force", seed=2):
    attribute = {"force": "specific_force", "rate": "angular_rate"}[triad]
    values = getattr(record, attribute).copy()
    sigma = factor * getattr(record, f"{triad}_noise")[0]
    values[first : first + count] += sigma * np.random.default_rng(seed).standard_normal((count, 3))
    return replace(record, **{attribute: values})


@pytest.mark.parametrize("triad", ["force", "rate"])
@pytest.mark.parametrize(("first", "count", "factor"), [(300, 80, 15.0), (800, 40, 300.0), (1000, 240, 50.0)])
def test_a_stretch_of_noise_is_found_with_its_ends_and_its_sigma(triad, first, count, factor):
    record = with_noise(smooth_record(), first, count, factor, triad)
    out, (finding,) = with_noise_of_stretches(record, UNTIL)
    assert (finding.kind, finding.channel, finding.imu) == (KIND, triad, "primary")
    assert finding.start == pytest.approx(first * INTERVAL, abs=4 * INTERVAL)
    assert finding.end == pytest.approx((first + count) * INTERVAL, abs=4 * INTERVAL)
    inside = slice(first + 4, first + count - 4)
    fill, stated = getattr(out, f"{triad}_fill_sigma"), getattr(record, f"{triad}_noise")[0]
    # the variance of `count` differences, of which neighbours are dependent
    np.testing.assert_allclose(fill[inside], factor * stated, rtol=2.5 / np.sqrt(count))
    assert not fill[: first - 4].any() and not fill[first + count + 4 :].any()
    other = {"force": "rate", "rate": "force"}[triad]
    assert not getattr(out, f"{other}_fill_sigma").any()
    np.testing.assert_array_equal(out.specific_force, record.specific_force)
    np.testing.assert_array_equal(out.angular_rate, record.angular_rate)


def test_noise_that_continues_under_the_parachute_is_found_to_its_end():
    record = with_noise(smooth_record(), 1550, 100, 60.0)
    out, (finding,) = with_noise_of_stretches(record, UNTIL)
    assert finding.end == pytest.approx(1650 * INTERVAL, abs=6 * INTERVAL)
    assert np.all(out.force_fill_sigma[1560:1640] > 30.0 * FORCE_NOISE)
    # noise that begins under the parachute may be that of the parachute
    assert with_noise_of_stretches(with_noise(smooth_record(), 1620, 100, 60.0), UNTIL)[1] == []


@pytest.mark.parametrize("seed", range(10))
def test_smooth_motion_has_no_noise_beyond_the_stated(seed):
    record = smooth_record(seed)
    out, findings = with_noise_of_stretches(record, UNTIL)
    assert out is record and findings == []


def test_spikes_pulses_of_thrusters_and_growing_noise_are_none():
    spikes = smooth_record()
    spikes.specific_force[700:760:15] += 50.0
    assert with_noise_of_stretches(spikes, UNTIL)[1] == []
    pulses = smooth_record()
    pulses.angular_rate[:, 1] += INTERVAL * 0.02 * np.cumsum(np.mod(pulses.time, 6.0) < 1.0)
    pulses.specific_force[:, 2] += 0.3 * (np.mod(pulses.time, 6.0) < 1.0)
    assert with_noise_of_stretches(pulses, UNTIL)[1] == []
    buffet = smooth_record()
    growth = 40.0 * np.exp(-np.abs(buffet.time - 110.0) / 10.0)[:, None]
    buffet.specific_force[:] += growth * FORCE_NOISE * np.random.default_rng(4).standard_normal((COUNT, 3))
    assert with_noise_of_stretches(buffet, UNTIL)[1] == []


def test_lost_samples_within_a_stretch_and_short_records():
    record = with_noise(smooth_record(), 800, 80, 100.0)
    record.specific_force[830:834] = np.nan
    out, findings = with_noise_of_stretches(record, UNTIL)
    assert sum(f.samples for f in findings) == pytest.approx(76, abs=6)
    assert not out.force_fill_sigma[830:834].any()
    short = record.select(np.arange(COUNT) < 50)
    assert with_noise_of_stretches(short, UNTIL) == (short, [])


def test_samples_between_lost_ones_are_not_noise():
    """The cubic through samples on both sides of a lost stretch predicts an oscillation badly."""
    record = smooth_record()
    lost = np.zeros(COUNT, bool)
    lost[700:1100] = np.arange(400) % 8 < 4
    swinging = record.angular_rate + 0.5 * np.outer(np.sin(2.0 * np.pi * 0.9 * record.time), [0.0, 1.0, 1.0])
    limited = replace(record, angular_rate=np.where(lost[:, None], np.nan, swinging))
    out, findings = with_noise_of_stretches(limited, UNTIL)
    assert out is limited and findings == []


def noisy_flight(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    record = telemetry.driving
    rng = np.random.default_rng(5)
    force, rate = record.specific_force.copy(), record.angular_rate.copy()
    force[900:980] += 0.9 * rng.standard_normal((80, 3))
    rate[900:980] += 6e-3 * rng.standard_normal((80, 3))
    return replace(telemetry, driving=replace(record, specific_force=force, angular_rate=rate))


def test_repair_widens_the_sigma_of_the_only_imu(builtin_flight):
    telemetry = noisy_flight(builtin_flight)
    deployed = telemetry.events["parachute_deploy"]
    out = repaired(replace(telemetry, checking=()), parachute=deployed)
    assert {(f.kind, f.channel) for f in out.findings} == {(KIND, "force"), (KIND, "rate")}
    assert all("times the stated sigma" in f.repair for f in out.findings)
    np.testing.assert_array_equal(out.driving.specific_force, telemetry.driving.specific_force)
    # with another IMU the samples are taken from it; without a stated deployment or with the checks off nothing is done
    assert not any(f.kind == KIND for f in repaired(telemetry, parachute=deployed).findings)
    # but not if that one has ended before
    second = telemetry.checking[0]
    ended = replace(telemetry, checking=(second.select(second.time < 100.0),))
    kinds = {(f.imu, f.kind) for f in repaired(ended, parachute=deployed).findings}
    assert kinds == {("primary", KIND), ("secondary", "dead")}
    single = replace(telemetry, checking=())
    assert repaired(single).findings == ()
    assert repaired(single, CheckSettings(enabled=False), deployed).findings == ()


def test_noise_remains_evidence_in_a_hypothesis_on_the_other_imu(builtin_flight):
    """With the samples of the second IMU lost, the noise of the first one must not be added to its sigma."""
    telemetry = noisy_flight(builtin_flight)
    lost = {triad: [(110.0, 125.0)] for triad in ("force", "rate")}
    out = without_samples(telemetry, "secondary", lost, parachute=telemetry.events["parachute_deploy"])
    assert {(f.imu, f.kind) for f in out.findings} == {("secondary", "disagreement")}
    assert not out.driving.filled.any()


def test_the_rovers_and_the_practice_flight_have_none_with_one_imu(spirit, opportunity, practice_06):
    for reconstruction in (spirit, opportunity, practice_06):
        t = reconstruction.telemetry
        for record in (t.driving, *t.checking):
            findings = with_noise_of_stretches(record, reconstruction.event_times["parachute_deploy"] - 2.0)[1]
            assert findings == []


def test_one_imu_with_noise_in_a_mission(builtin_flight, tmp_path):
    """The reader of a mission uses the deployment that the flight file states."""
    path = tmp_path / "flight.h5"
    path.write_bytes(builtin_flight.read_bytes())
    with h5py.File(path, "a") as file:
        del file["imu/secondary"]
        file["imu/primary/specific_force"][900:980] += 0.9 * np.random.default_rng(6).standard_normal((80, 3))
    telemetry = read_telemetry(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]))
    assert [f.channel for f in telemetry.findings if f.kind == KIND] == ["force"]
