"""Bad and missing samples of a flight: found under the right name, filled, and nothing is found in clean telemetry."""

import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy.ndimage import median_filter

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_telemetry
from edl_filter.simulation import Scenario, simulate
from edl_filter.telemetry import spikes
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.sample_filling import filled
from edl_filter.telemetry.sample_repair import repaired, without_samples

FORCE, RATE = "specific_force", "angular_rate"
FIRST = 800  # 100 s after entry


def parachute(telemetry):
    return telemetry.events["parachute_deploy"]


def alone(telemetry):
    return replace(telemetry, checking=())


@pytest.fixture
def corrupted(builtin_flight, tmp_path):
    """Read the built-in flight with changed samples of its primary IMU."""

    def read(change, settings=None):
        path = shutil.copy(builtin_flight, tmp_path / "flight.h5")
        with h5py.File(path, "a") as file:
            group = file["imu/primary"]
            data = {key: group[key][()] for key in ("time", FORCE, RATE)}
            data = change(data) or data
            for key, values in data.items():
                del group[key]
                group[key] = values
        return read_flight_file(path, settings)

    return read


def removed(count):
    return lambda data: {key: np.delete(v, slice(FIRST, FIRST + count), axis=0) for key, v in data.items()}


def replaced(key, count, values, axis=slice(None)):
    def change(data):
        data[key][FIRST : FIRST + count, axis] = values

    return change


def all_replaced(count, value):
    def change(data):
        for key in (FORCE, RATE):
            data[key][FIRST : FIRST + count] = value

    return change


def added(key, axis, size):
    def change(data):
        data[key][FIRST, axis] += size

    return change


def frozen(data):
    data[FORCE][FIRST : FIRST + 40, 1] = data[FORCE][FIRST, 1]


def clipped(data):
    data[FORCE][:1500, 0] = np.maximum(data[FORCE][:1500, 0], -40.0)
    data[FORCE][:1500, 0] = np.minimum(data[FORCE][:1500, 0], 40.0)


def swapped(data):
    order = np.arange(len(data["time"]))
    order[FIRST : FIRST + 4] = [FIRST + 2, FIRST + 3, FIRST, FIRST + 1]
    return {key: values[order] for key, values in data.items()}


def sent_twice(data):
    return {key: np.insert(v, FIRST + 4, v[FIRST : FIRST + 4], axis=0) for key, v in data.items()}


def repeated_with_new_times(data):
    for key in (FORCE, RATE):
        data[key][FIRST + 4 : FIRST + 8] = data[key][FIRST : FIRST + 4]


def stopped(data):
    return {key: values[:1200] for key, values in data.items()}


def clock_back(data):
    data["time"][FIRST:] -= 0.5


def clock_ahead(data):
    data["time"][FIRST:] += 0.5


def wrong_times(step):
    def change(data):
        data["time"][FIRST : FIRST + 3] += step

    return change


def drifting(ratio, first=0):
    def change(data):
        data["time"][first:] += ratio * (data["time"][first:] - data["time"][first])

    return change


def rounded(carried):
    def change(data):
        for key, step in ((FORCE, 6.25e-3), (RATE, 1e-4)):
            increments = data[key] * 0.125 / step
            if carried:
                increments = np.diff(np.round(np.cumsum(increments, axis=0)), axis=0, prepend=0.0)
            data[key] = np.round(increments) * step / 0.125

    return change


FAULTS = {
    "gap": (removed(8), "missing"),
    "long gap": (removed(80), "missing"),
    "spike in force": (replaced(FORCE, 1, -1000.0, 0), "spike"),
    "small spike in force": (added(FORCE, 1, 3.0), "spike"),
    "spike in rate": (added(RATE, 1, 1.5), "spike"),
    "burst": (replaced(FORCE, 6, np.array([200.0, -150, 90, 180, -220, 140]), 0), "spike"),
    "far spike": (replaced(FORCE, 1, 1e5, 2), "out_of_range"),
    "not finite": (all_replaced(4, np.nan), "not_finite"),
    "zeros": (all_replaced(8, 0.0), "all_zero"),
    "stuck": (frozen, "stuck"),
    "saturated": (clipped, "saturated"),
    "reordered": (swapped, "reordered"),
    "sent twice": (sent_twice, "duplicated"),
    "repeated": (repeated_with_new_times, "duplicated"),
    "clock back": (clock_back, "clock_jump"),
    "clock ahead": (clock_ahead, "clock_jump"),
    "early times": (wrong_times(-0.375), "clock_jump"),
    "late times": (wrong_times(7.0), "clock_jump"),
    "dead": (stopped, "dead"),
    "clock drift": (drifting(1e-4), "clock_drift"),
    "fast clock": (drifting(-1e-2), "clock_drift"),
    "drift from mid-flight": (drifting(1e-3, 900), "clock_drift"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_and_repaired_from_the_other_imu(name, corrupted, builtin_flight):
    change, kind = FAULTS[name]
    truth = read_flight_file(builtin_flight).driving
    telemetry = repaired(corrupted(change), parachute=252.75)
    assert {f.kind for f in telemetry.findings} == {kind}
    assert all(f.repair and f.imu == "primary" for f in telemetry.findings)
    imu = telemetry.driving
    assert len(imu) == len(truth)
    np.testing.assert_allclose(imu.time, truth.time, atol=1e-9)
    for key, fill, noise in (
        (FORCE, imu.force_fill_sigma, imu.force_noise), (RATE, imu.rate_fill_sigma, imu.rate_noise)
    ):  # fmt: skip
        error, dt = getattr(imu, key) - getattr(truth, key), imu.interval[:, None]
        filled = fill[:, 0] > 0.0
        before_parachute = filled & (imu.time < 250.0)
        np.testing.assert_allclose(error[~filled], 0.0, atol=1e-12)
        sigma = np.sqrt(np.sum(((fill**2 + noise[:, None] ** 2) * dt**2)[before_parachute], axis=0))
        assert np.all(np.abs((error * dt)[before_parachute].sum(axis=0)) <= 4.0 * sigma)
        assert np.all(fill[before_parachute] < 0.01 * (1.0 + np.abs(getattr(truth, key)).max()))


@pytest.mark.parametrize(
    "name", ["gap", "spike in force", "spike in rate", "far spike", "not finite", "zeros", "stuck"]
)
def test_a_fault_of_the_only_imu_is_named_and_filled_by_its_dynamics(name, corrupted, builtin_flight):
    change, kind = FAULTS[name]
    truth = read_flight_file(builtin_flight).driving
    telemetry = repaired(alone(corrupted(change)), parachute=252.75)
    assert {f.kind for f in telemetry.findings} == {kind}
    assert all("fitted oscillation" in f.repair for f in telemetry.findings)
    imu = telemetry.driving
    for key, fill in ((FORCE, imu.force_fill_sigma), (RATE, imu.rate_fill_sigma)):
        rows = fill[:, 0] > 0.0
        error = (getattr(imu, key) - getattr(truth, key))[rows].sum(axis=0)
        assert np.all(np.abs(error) <= 4.0 * np.sqrt((fill[rows] ** 2).sum(axis=0)))


BURST = np.array([200.0, -150.0, 90.0, 180.0, -220.0, 140.0])


def with_burst(key, values, axis):
    def change(data):
        data[key][FIRST : FIRST + len(values), axis] += values

    return change


@pytest.mark.parametrize(("key", "triad", "values"), [
    (FORCE, "force", BURST), (FORCE, "force", BURST[:2]), (FORCE, "force", np.where(np.arange(6) == 3, 0.0, BURST)),
    (FORCE, "force", np.full(12, 60.0)), (RATE, "rate", 0.01 * BURST), (RATE, "rate", np.full(3, -1.5)),
])  # fmt: skip
@pytest.mark.parametrize("axis", [0, 2])
def test_a_burst_in_the_only_imu_is_named_and_filled(key, triad, values, axis, corrupted, builtin_flight):
    truth = read_flight_file(builtin_flight).driving
    telemetry = repaired(alone(corrupted(with_burst(key, values, axis))), parachute=252.75)
    assert [(f.channel, f.kind, f.samples) for f in telemetry.findings] == [(triad, "burst", len(values))]
    imu = telemetry.driving
    fill = getattr(imu, f"{triad}_fill_sigma")
    rows = fill[:, 0] > 0.0
    np.testing.assert_array_equal(np.flatnonzero(rows), FIRST + np.arange(len(values)))
    error = (getattr(imu, key) - getattr(truth, key))[rows].sum(axis=0)
    assert np.all(np.abs(error) <= 4.0 * np.sqrt((fill[rows] ** 2).sum(axis=0)))


@pytest.mark.parametrize("values", [np.full(13, 60.0), np.full(6, 0.9), np.repeat([60.0, 0.0, -60.0], [5, 3, 5])])
def test_what_a_vehicle_may_do_is_no_burst(values, corrupted):
    """A step that lasts, thrusters, and an oscillation that begins; longer runs are for the other checks."""
    telemetry = repaired(alone(corrupted(with_burst(FORCE, values, 2))), parachute=252.75)
    bursts = [(f.start, f.samples) for f in telemetry.findings if f.kind == "burst"]
    if len(values) == 13 and values[6] == 0.0:  # two bursts with three sound samples between them
        assert [samples for _, samples in bursts] == [5, 5]
    else:
        assert bursts == []


@pytest.mark.parametrize("distance", [-4, -2, -1, 3, 4, 6])
@pytest.mark.parametrize(("key", "triad", "size"), [(FORCE, "force", 3.0), (RATE, "rate", 0.3)])
def test_a_spike_near_lost_samples_is_found(distance, key, triad, size, corrupted, builtin_flight):
    """Three samples are lost; one near them, which the test of four neighbours does not reach, is wrong."""

    def change(data):
        data[key][FIRST + distance, 1] += size
        return removed(3)(data)

    truth = read_flight_file(builtin_flight).driving
    telemetry = repaired(alone(corrupted(change)), parachute=252.75)
    interval = truth.interval[0]
    assert sorted((f.kind, f.channel, round(f.start / interval), f.samples) for f in telemetry.findings) == sorted([
        ("missing", "all", FIRST, 3), ("spike", triad, FIRST + distance, 1)
    ])  # fmt: skip
    rows = np.arange(FIRST - 4, FIRST + 7)
    error = np.abs(getattr(telemetry.driving, key) - getattr(truth, key))[rows]
    assert error.max() < 0.2 * size


def test_two_neighbours_that_are_wrong_are_found(corrupted):
    """The smaller one is not predicted once the larger one is known to be bad."""
    telemetry = repaired(alone(corrupted(with_burst(RATE, np.array([1.5, -0.08]), 1))), parachute=252.75)
    assert {f.channel for f in telemetry.findings} == {"rate"}
    np.testing.assert_array_equal(np.flatnonzero(telemetry.driving.filled), [FIRST, FIRST + 1])


@pytest.mark.parametrize("scale", [6.0, 12.0, 25.0])
def test_a_smooth_peak_is_no_burst(scale):
    """A steep entry, sampled seldom: the deceleration leaves its median over 25 samples by curvature alone."""
    n = np.arange(400)
    force = -300.0 * np.exp(-(((n - 200) / scale) ** 2))[:, None] * [1.0, 0.0, 0.01]
    force += 3e-3 * np.random.default_rng(1).standard_normal(force.shape)
    departure = np.abs(force - median_filter(force, (25, 1)))[:, 0]
    assert departure.max() > 10.0
    assert not spikes._bursts(force, 2.0).any()
    assert spikes._bursts(np.where((np.abs(n - 150) < 3)[:, None], force + 40.0, force), 2.0).sum() == 5


def test_without_a_deployment_no_burst_is_looked_for(builtin_flight):
    """The parachute's shock and the landing would be some."""
    telemetry = alone(read_flight_file(builtin_flight))
    assert repaired(telemetry).findings == ()


def test_spikes_near_many_lost_samples_are_found_one_by_one(builtin_flight):
    """Every tenth sample is lost; spikes of different size in one flight do not make sound samples bad."""
    record = read_flight_file(builtin_flight).driving
    values = record.specific_force[:1900].copy()
    values[::10] = np.nan
    rows = np.array([802, 822, 862, 903, 1302])
    values[rows, 2] += [5.0, 50.0, 5.0, -8.0, 20.0]
    bad = spikes._spikes_near_lost(values, record.force_noise[:1900], 15.0, 1.0)
    np.testing.assert_array_equal(np.flatnonzero(bad), rows)


def test_thrusters_near_lost_samples_are_no_spikes(builtin_flight):
    record = read_flight_file(builtin_flight).driving
    values = record.specific_force[:1900].copy()
    values[np.arange(1900) % 60 < 12, 1] += 0.9
    values[::10] = np.nan
    assert not spikes._spikes_near_lost(values, record.force_noise[:1900], 15.0, 1.0).any()


def test_a_shock_after_the_parachute_is_no_burst(corrupted, builtin_flight):
    record = alone(read_flight_file(builtin_flight))
    force = record.driving.specific_force.copy()
    rows = np.flatnonzero(record.driving.time > 255.0)[:6]
    force[rows, 0] += BURST
    shaken = replace(record, driving=replace(record.driving, specific_force=force))
    assert repaired(shaken, parachute=252.75).findings == ()


@pytest.mark.parametrize("rover", ["mer_a", "mer_b"])
def test_telemetry_of_the_rovers_has_no_bad_samples(rover):
    telemetry = read_telemetry(Mission.load(f"builtin:{rover}"))
    assert telemetry.findings == ()
    assert not telemetry.driving.filled.any()
    assert repaired(alone(telemetry), parachute=parachute(telemetry)).findings == ()


def test_practice_flights_have_no_bad_samples(practice):
    for n in range(1, 9):
        telemetry = read_flight_file(practice(n))
        assert repaired(telemetry, parachute=parachute(telemetry)) is telemetry
        alone_telemetry = alone(telemetry)
        assert repaired(alone_telemetry, parachute=parachute(telemetry)) is alone_telemetry


def test_a_fault_of_the_checking_imu_is_not_blamed_on_the_driving_one(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    force = telemetry.checking[0].specific_force.copy()
    force[FIRST, 1] += 50.0
    changed = replace(telemetry, checking=(replace(telemetry.checking[0], specific_force=force),))
    outcome = repaired(changed, parachute=252.75)
    assert [(f.imu, f.kind, f.samples) for f in outcome.findings] == [("secondary", "spike", 1)]
    assert not outcome.driving.filled.any()


def test_a_shock_that_both_imus_see_is_no_spike(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    shock = np.zeros((len(telemetry.driving), 3))
    shock[FIRST, 0] = -60.0
    driving, checking = (
        replace(record, specific_force=record.specific_force + shock)
        for record in (telemetry.driving, telemetry.checking[0])
    )
    outcome = repaired(replace(telemetry, driving=driving, checking=(checking,)), parachute=252.75)
    assert outcome.findings == ()


def test_without_another_imu_a_long_gap_is_refused(corrupted):
    with pytest.raises(
        InputError, match=r"no usable samples of its (force|rate) from 100\.000 to 140\.000 s.*longest_gap_s"
    ):
        repaired(alone(corrupted(removed(320))), parachute=252.75)


@pytest.mark.parametrize(
    ("key", "axis", "value", "words"),
    [(RATE, 1, 0.0, "rate y: stuck axis"), (FORCE, 2, 0.5, "force z: stuck axis"),
     (RATE, slice(None), 0.0, "rate z: stuck axis"), (FORCE, 0, np.nan, "force: values that are not finite")],
)  # fmt: skip
def test_an_axis_that_is_dead_throughout_lets_the_other_imu_drive(key, axis, value, words, corrupted, builtin_flight):
    def dead(data):
        data[key][:, axis] = value

    telemetry = repaired(corrupted(dead), parachute=252.75)
    sound = read_flight_file(builtin_flight).checking[0]
    assert telemetry.driving.name == "secondary" and not telemetry.driving.filled.any()
    np.testing.assert_array_equal(telemetry.driving.angular_rate, sound.angular_rate)
    assert any("secondary drives the reconstruction" in f.repair for f in telemetry.findings)
    with pytest.raises(InputError, match=rf"no usable samples of its .* Found in primary: .*{words} from 0\.0 to 36"):
        repaired(alone(corrupted(dead)), parachute=252.75)


@pytest.mark.parametrize(("share", "name"), [(0.5, "secondary"), (0.98, "primary")])
def test_an_imu_that_is_saturated_most_of_the_time_does_not_drive(share, name, corrupted, builtin_flight):
    """The few readings that it has would not determine the errors of the other IMU against it."""

    def limited(data):
        limit = share * np.abs(data[RATE][data["time"] < 250.0, 0]).max()
        data[RATE][:, 0] = np.clip(data[RATE][:, 0], -limit, limit)

    telemetry = repaired(corrupted(limited), parachute=252.75)
    assert telemetry.driving.name == name
    repairs = {f.repair for f in telemetry.findings if f.kind == "saturated"}
    assert repairs == {"secondary drives the reconstruction" if name == "secondary" else "filled from secondary"}
    truth = next(
        r
        for r in (read_flight_file(builtin_flight).driving, *read_flight_file(builtin_flight).checking)
        if r.name == name
    )
    error, sigma = telemetry.driving.angular_rate - truth.angular_rate, telemetry.driving.rate_fill_sigma
    filled_rows = sigma.max(axis=1) > 0.0
    np.testing.assert_array_equal(error[~filled_rows], 0.0)
    if filled_rows.any():
        assert np.sqrt(np.mean((error[filled_rows] / np.hypot(sigma, 2e-5)[filled_rows]) ** 2)) < 1.5


def test_detection_can_be_switched_off(corrupted):
    settings = CheckSettings(enabled=False)
    assert repaired(corrupted(FAULTS["stuck"][0], settings), settings, 252.75).findings == ()
    assert repaired(corrupted(FAULTS["gap"][0], settings), settings, 252.75).findings != ()


@pytest.mark.parametrize("carried", [True, False])
def test_the_finer_of_two_imus_drives(carried, corrupted, builtin_flight):
    telemetry = repaired(corrupted(rounded(carried)), parachute=252.75)
    assert {(f.imu, f.channel, f.kind) for f in telemetry.findings} == {
        ("primary", "force", "coarse"), ("primary", "rate", "coarse")
    }  # fmt: skip
    assert all("secondary drives" in f.repair for f in telemetry.findings)
    np.testing.assert_array_equal(
        telemetry.driving.specific_force, read_flight_file(builtin_flight).checking[0].specific_force
    )
    coarse = telemetry.checking[0]
    assert coarse.name == "primary"
    np.testing.assert_allclose(coarse.force_noise, np.hypot(2.941995e-3, 0.05 / np.sqrt(6.0)), rtol=1e-6)
    assert coarse.errors[0].gyro_bias == pytest.approx(8e-4 / np.sqrt(12.0), rel=1e-3)


@pytest.mark.parametrize("carried", [True, False])
def test_the_only_imu_states_the_errors_of_its_coarse_steps(carried, corrupted, builtin_flight):
    truth = read_flight_file(builtin_flight).driving
    telemetry = repaired(alone(corrupted(rounded(carried))), parachute=252.75)
    assert {f.kind for f in telemetry.findings} == {"coarse"}
    imu = telemetry.driving
    for key, noise, bias in (
        (FORCE, imu.force_noise[0], imu.errors[0].accelerometer_bias),
        (RATE, imu.rate_noise[0], imu.errors[0].gyro_bias),
    ):
        error = getattr(imu, key) - getattr(truth, key)
        assert np.sqrt(np.mean(error**2)) < 1.1 * noise
        assert np.all(np.abs(error.mean(axis=0)) < 3.0 * bias)


def test_the_clock_of_a_single_imu_is_named_and_its_scale_uncertain(corrupted, builtin_flight):
    truth = read_flight_file(builtin_flight).driving
    telemetry = repaired(alone(corrupted(drifting(1e-3))), parachute=252.75)
    assert [(f.kind, f.repair.split(",")[0]) for f in telemetry.findings] == [("clock_drift", "+1000 ppm")]
    errors, stated = telemetry.driving.errors[0], truth.errors[0]
    assert errors.gyro_scale == pytest.approx(np.hypot(stated.gyro_scale, 1e-3))
    assert errors.accelerometer_scale == pytest.approx(np.hypot(stated.accelerometer_scale, 1e-3))


def test_two_clocks_of_which_the_steps_do_not_show_the_wrong_one_are_named(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    driving = telemetry.driving
    slow = replace(
        driving, time=driving.time * 1.001, interval=driving.interval * 1.001, stated_interval=0.125 * 1.001
    )  # its stated interval follows its clock
    outcome = repaired(replace(telemetry, driving=slow), parachute=252.75)
    assert [(f.imu, f.kind) for f in outcome.findings] == [("primary", "clock_drift")]
    assert "not corrected" in outcome.findings[0].repair


def test_a_stated_interval_that_is_rounded_in_both_imus_is_no_drift(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    records = [replace(r, stated_interval=0.1251) for r in (telemetry.driving, *telemetry.checking)]
    outcome = repaired(replace(telemetry, driving=records[0], checking=tuple(records[1:])), parachute=252.75)
    assert outcome.findings == ()
    np.testing.assert_array_equal(outcome.driving.time, telemetry.driving.time)


def test_a_record_that_begins_late_is_completed_from_the_other_imu(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    late = replace(telemetry, driving=telemetry.driving.select(np.arange(len(telemetry.driving)) >= 160))
    outcome = repaired(late, parachute=252.75)
    assert [(f.imu, f.kind, f.samples) for f in outcome.findings] == [("primary", "missing", 160)]
    np.testing.assert_allclose(outcome.driving.time, telemetry.driving.time, atol=1e-9)
    error = (outcome.driving.angular_rate - telemetry.driving.angular_rate)[:160].sum(axis=0)
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.sum(outcome.driving.rate_fill_sigma[:160] ** 2, axis=0)))
    assert repaired(alone(late), parachute=252.75).driving.start == late.driving.start


def test_the_median_force_at_rest_is_compared_with_gravity(builtin_flight, tmp_path):
    path = shutil.copy(builtin_flight, tmp_path / "flight.h5")
    with h5py.File(path, "a") as file:
        time, force = file["imu/primary/time"][()], file[f"imu/primary/{FORCE}"][()]
        at_rest = np.flatnonzero(time > file["constraints/landing"].attrs["time"])
        force[at_rest[: len(at_rest) // 4]] *= 60.0  # the impact, by a clock that is late
        file[f"imu/primary/{FORCE}"][...] = force
    assert len(read_flight_file(path).driving) == len(time)


def test_a_record_that_begins_a_part_of_a_sample_late_covers_the_flight(builtin_flight):
    """Its first sample is as much longer, without another fault."""
    telemetry = read_flight_file(builtin_flight)
    late = replace(telemetry.driving, time=telemetry.driving.time + 0.02)
    outcome = repaired(replace(telemetry, driving=late, checking=()), parachute=parachute(telemetry))
    assert outcome.driving.start == pytest.approx(telemetry.initial.time, abs=1e-9)
    np.testing.assert_allclose(outcome.driving.interval[[0, 1]], [0.145, 0.125], rtol=1e-9)
    np.testing.assert_array_equal(outcome.driving.time, late.time)


@pytest.mark.parametrize("count", [2, 8, 9, 20])
def test_a_second_imu_of_a_few_samples_is_dead(builtin_flight, count):
    """It is shorter than what a reading needs of its neighbours."""
    telemetry = read_flight_file(builtin_flight)
    few = telemetry.checking[0].between(0.0, telemetry.checking[0].time[count - 1])
    outcome = repaired(replace(telemetry, checking=(few,)), parachute=parachute(telemetry))
    assert {(f.imu, f.kind) for f in outcome.findings} == {("secondary", "dead")}
    np.testing.assert_array_equal(outcome.driving.specific_force, telemetry.driving.specific_force)


def test_an_imu_at_fault_loses_the_axes_that_it_reads_too(builtin_flight):
    """What a stretch at fault has of a stuck axis is no reading."""
    telemetry = read_flight_file(builtin_flight)
    partial = np.zeros((len(telemetry.driving), 2, 3))
    partial[800:840, 1] = [1.0, 0.0, 0.0]
    rate = telemetry.driving.angular_rate.copy()
    rate[800:840] = np.nan
    driving = replace(telemetry.driving, angular_rate=rate, partial_rate=partial)
    lost = {"rate": [(100.0, 102.5)]}
    outcome = without_samples(replace(telemetry, driving=driving), "primary", lost, parachute=252.75).driving
    assert not outcome.partial_rate[800:820].any() and outcome.partial_rate[820:840, 1, 0].all()


@pytest.mark.parametrize(("before", "size", "marked"), [(3, 50.0, True), (2, 50.0, False), (3, 20.0, False)])
def test_an_imu_with_several_spikes_has_them_under_the_parachute_too(before, size, marked, corrupted):
    """The only IMU; of the size of those before the parachute, which cannot be told from shocks otherwise."""
    rows = [*(FIRST + 60 * np.arange(before)), 2120, 2180]

    def change(data):
        data[FORCE][rows[:before], 1] += 50.0
        data[FORCE][rows[before:], 2] += size

    telemetry = repaired(alone(corrupted(change)), parachute=252.75)
    assert {f.kind for f in telemetry.findings} == {"spike"}
    expected = rows if marked else rows[:before]
    np.testing.assert_array_equal(np.flatnonzero(telemetry.driving.filled), expected)


def test_samples_whose_neighbours_are_bad_are_not_shown_to_be_sound():
    """One or two between two bad samples, and two next to a run of more than five."""
    bad = np.zeros(60, bool)
    bad[[5, 8, 20, 24]] = True
    bad[[40, 41, 43, 45, 46]] = True
    expected = bad.copy()
    expected[[6, 7]] = True
    bad[51] = expected[51] = True  # two samples after the two next to the run
    expected[38:51] = True
    np.testing.assert_array_equal(spikes._joined(bad), expected)


@pytest.mark.parametrize("place", [-1, 0])
def test_an_outlier_next_to_a_stretch_does_not_determine_what_fills_it(place, builtin_flight):
    """A second IMU has the stretch; the sample before or after it is wrong by a hundred sigmas and is not marked."""
    telemetry = read_flight_file(builtin_flight)
    record, lost = telemetry.driving, slice(FIRST, FIRST + 40)
    errors = []
    for size in (0.0, 3.5e-3):
        rate = record.angular_rate.copy()
        rate[lost] = np.nan
        rate[FIRST - 1 if place else FIRST + 40, 1] += size
        complete, _ = filled(replace(record, angular_rate=rate), telemetry.checking[0], CheckSettings(), 252.75)
        errors.append(complete.angular_rate[lost] - record.angular_rate[lost])
    assert np.abs(errors[1] - errors[0]).max() < 2e-5  # one sigma of a sample


@pytest.mark.parametrize("seed", range(3))
def test_all_samples_of_a_short_burst_of_noise_are_filled(seed, corrupted, builtin_flight):
    """Of 5 s, in which the noise raises the scale of its own test: many of its samples are not marked by themselves."""

    def noisy(data):
        data[RATE][FIRST : FIRST + 40] += 6e-3 * np.random.default_rng(seed).standard_normal((40, 3))

    truth = read_flight_file(builtin_flight).driving.angular_rate
    record = repaired(corrupted(noisy), parachute=252.75).driving
    rows = np.flatnonzero(record.rate_fill_sigma.max(axis=1) > 0.0)
    assert set(range(FIRST, FIRST + 40)) <= set(rows) <= set(range(FIRST - 4, FIRST + 44))
    assert np.abs(record.angular_rate - truth).max() < 1e-3


@pytest.mark.parametrize("part", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5])
def test_a_step_of_the_signal_is_no_spike(part, phase):
    """Forces that change by a step within a sample, as where the flow changes, on an oscillation."""
    rng = np.random.default_rng(1)
    time = 0.05 * np.arange(400)
    values = np.column_stack([np.sin(3.0 * time + phase + k) for k in range(3)]) + 2e-3 * rng.standard_normal((400, 3))
    noise = np.full(400, 3e-3)
    stepped, spike = values.copy(), values.copy()
    stepped[200] += 0.14 * part
    stepped[201:] += 0.14
    spike[200, 1] += 0.14
    assert not spikes._single_spikes(stepped, noise, 8.0).any()
    np.testing.assert_array_equal(np.flatnonzero(spikes._single_spikes(spike, noise, 8.0)), [200])


@pytest.mark.slow
def test_a_large_spike_in_one_imu_does_not_make_the_landing_one(tmp_path):
    """It falsified the calibration of one IMU against the other, so that both seemed to be alone in the impact."""
    flight = simulate(Scenario.load("builtin:phoenix"), seed=114)
    path = flight.write(tmp_path / "flight.h5")
    with h5py.File(path, "a") as file:
        force = file["imu/primary/specific_force"]
        force[1382] = force[1382] + np.array([1000.0, 0.0, 0.0])
    telemetry = read_flight_file(path)
    out = repaired(telemetry, parachute=telemetry.events["parachute_deploy"])
    assert [(f.imu, f.kind, f.samples) for f in out.findings if f.kind != "rest_drift"] == [("primary", "spike", 1)]
