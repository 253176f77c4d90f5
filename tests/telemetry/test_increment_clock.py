"""Samples with one increment more, and the clock that they imply: simulated oscillators, and both rovers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry.increment_clock import INCREMENT, IncrementClock, excess_increments, extra_increments
from edl_filter.telemetry.mer_archive import read_mer_tables

READ = 0.125
COUNT = round(READ / INCREMENT)


def angle(t):
    """Integral of a smooth rate: spin, and an oscillation of 0.6 Hz."""
    w = 2.0 * np.pi * 0.6
    return np.stack((0.21 * t + 1e-5 * t**2, 0.05 / w * np.sin(w * t), -0.05 / w * np.cos(w * t)), axis=-1)


def velocity(t):
    """Integral of a deceleration that rises and falls, with a lateral oscillation."""
    return np.stack(
        (-40.0 * t + 10.0 * np.sin(t / 80.0) * 80.0, 0.05 * np.cos(3.0 * t), 0.05 * np.sin(3.0 * t)), axis=-1
    )


def readings(ppm, phase, duration=600.0):
    """What a computer reads of an IMU whose oscillator is off by `ppm`.

    Returns the clock counts of the readings, sums of angle and velocity, increments per reading, and the true time at
    which the last increment of each reading ends.
    """
    length = INCREMENT / (1.0 + 1e-6 * ppm)
    counts = READ * np.arange(1, round(duration / READ) + 1)
    last = np.floor(counts / length + phase)
    first = np.concatenate(([np.floor(phase)], last[:-1]))
    end, begin = (last - phase) * length, (first - phase) * length
    return counts, angle(end) - angle(begin), velocity(end) - velocity(begin), (last - first).astype(int), end


@given(st.floats(6.0, 40.0), st.booleans(), st.floats(0.0, 1.0))
@settings(max_examples=25)
def test_an_oscillator_of_another_rate_is_recognised_and_its_times_are_those_of_the_increments(size, fast, phase):
    ppm = size if fast else -size
    sclk, angles, velocities, counts, end = readings(ppm, phase)
    index, extra = extra_increments(np.full(len(sclk), READ), angles, velocities)
    tested = np.arange(4, len(sclk) - 4)  # the interpolation needs four neighbours
    np.testing.assert_array_equal(index, tested[counts[tested] != COUNT])
    np.testing.assert_array_equal(extra, counts[index] - COUNT)
    clock = IncrementClock.from_slips(sclk[index], extra, "backshell")
    if len(index) < 2:
        return
    assert clock.rate_error == pytest.approx(1e-6 * ppm, rel=0.01)
    # a reading at which the increment ends within the clock's own rounding may fall on either side of the step
    error = np.abs(clock.time(sclk) - end)
    assert np.sort(error)[: -2 * len(index)].max() < 2e-5


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_readings_of_equal_counts_are_not_changed(noise):
    rng = np.random.default_rng(1)
    sclk, angles, velocities, counts, _ = readings(0.0, 0.5, 300.0)
    assert np.all(counts == COUNT)
    angles, velocities = (
        x + noise * rng.standard_normal(x.shape) * np.abs(x).max(axis=0) for x in (angles, velocities)
    )
    index, _ = extra_increments(np.full(len(sclk), READ), angles, velocities)
    assert len(index) == 0
    clock = IncrementClock.from_slips(np.array([]), np.array([], int), "rover")
    np.testing.assert_array_equal(clock.time(sclk), sclk)
    assert clock.rate_error == 0.0


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda a, v: (a * [[1.02]], v), "the velocity does not agree"),
        (lambda a, v: (a * [[1.0 / 0.98]], v * [[0.98]]), "the two have opposite signs"),
        (lambda a, v: (a * [[1.05]], v * [[1.05]]), "the excess is no whole number"),
    ],
)
def test_another_error_of_one_sample_is_no_additional_increment(change, why):
    sclk, angles, velocities, _, _ = readings(0.0, 0.5, 100.0)
    angles[400], velocities[400] = (x[0] for x in change(angles[400:401], velocities[400:401]))
    assert len(extra_increments(np.full(len(sclk), READ), angles, velocities)[0]) == 0, why


def test_two_neighbouring_errors_are_no_additional_increment():
    """The excess of the first is that of an increment, but no count of its own removes that of the neighbours."""
    sclk, angles, velocities, _, _ = readings(0.0, 0.5, 100.0)
    for x in (angles, velocities):
        x[400] *= 1.03
        x[401] *= 1.0125
    excess = excess_increments(angles, np.full(len(sclk), READ))
    assert 0.9 < excess[400] < 1.1
    assert len(extra_increments(np.full(len(sclk), READ), angles, velocities)[0]) == 0


def test_a_motion_that_is_not_smooth_is_not_tested():
    rng = np.random.default_rng(2)
    sclk, angles, velocities, counts, _ = readings(13.0, 0.0, 600.0)
    assert np.count_nonzero(counts != COUNT) >= 3
    shaken = (x * (1.0 + 0.01 * rng.standard_normal((len(x), 1))) for x in (angles, velocities))
    assert len(extra_increments(np.full(len(sclk), READ), *shaken)[0]) == 0


def test_missing_rows_are_not_tested():
    sclk, angles, velocities, _, _ = readings(13.0, 0.0, 400.0)
    full, _ = extra_increments(np.full(len(sclk), READ), angles, velocities)
    angles[full[0] + 2] = np.nan
    index, _ = extra_increments(np.full(len(sclk), READ), angles, velocities)
    np.testing.assert_array_equal(index, full[1:])


def test_a_sample_that_was_not_recognised_is_interpolated():
    slips = np.array([100.0, 290.0, 480.0, 670.0])
    complete = IncrementClock(slips)
    partial = IncrementClock(slips[[0, 2, 3]])
    times = np.arange(0.125, 900.0, 0.125)
    np.testing.assert_allclose(partial.lag(times), complete.lag(times), atol=1e-12)
    assert partial.rate_error == pytest.approx(complete.rate_error) == INCREMENT / 190.0


def test_the_lag_is_a_sawtooth_that_is_zero_at_the_samples():
    clock = IncrementClock(np.array([100.0, 300.0]))
    np.testing.assert_allclose(clock.lag(np.array([100.0, 200.0, 300.0, 400.0])), [0.0, 0.00125, 0.0, 0.00125])
    assert clock.lag(np.array([299.875]))[0] == pytest.approx(0.0025, rel=1e-3)
    slow = IncrementClock(np.array([100.0, 300.0]), extra=-1)
    np.testing.assert_allclose(slow.lag(np.array([100.0, 200.0])), [0.0025, 0.00125])


def test_with_a_single_sample_all_that_lies_before_is_one_increment_earlier():
    clock = IncrementClock(np.array([100.0]))
    np.testing.assert_array_equal(clock.lag(np.array([0.0, 99.875, 100.0, 200.0])), [INCREMENT, INCREMENT, 0.0, 0.0])


def test_samples_of_both_kinds_contradict_each_other():
    with pytest.raises(InputError, match=r"the rover's IMU has samples with one increment more and with one less"):
        IncrementClock.from_slips(np.array([10.0, 20.0]), np.array([1, -1]), "rover")


# --- the rovers -----------------------------------------------------------------------------------------------------

#: SCLK of the samples of 51 increments within HIGHRATE, and the oscillators' rates, parts per million.
ROVERS = {
    2: {"backshell": (126462206.125, 12.9), "rover": (126462253.125, 15.0)},
    1: {"backshell": (128278346.0, 15.4), "rover": (128278375.125, 16.3)},
}


@pytest.mark.parametrize("spacecraft", ROVERS)
def test_each_imu_of_each_rover_has_one_such_sample_in_highrate(mer_folder, spacecraft):
    tables = read_mer_tables(mer_folder, spacecraft)
    for unit, (sclk, ppm) in ROVERS[spacecraft].items():
        clock = tables.clocks[unit]
        assert [t for t in clock.slips if t > tables.highrate.sclk[0]] == [sclk]
        assert 1e6 * clock.rate_error == pytest.approx(ppm, abs=0.06)
        assert any(note.startswith(f"{unit} IMU: {len(clock.slips)} samples of 51 increments") for note in tables.notes)


@pytest.mark.parametrize(("spacecraft", "name"), [(2, "spirit"), (1, "opportunity")])
def test_the_gyros_of_the_two_imus_are_as_far_apart_as_their_clocks_say(mer_folder, request, spacecraft, name):
    """Independent of `telemetry`: the raw increments of both IMUs at equal clock counts, regressed on dw/dt."""
    tables = read_mer_tables(mer_folder, spacecraft)
    mission = request.getfixturevalue(name).mission
    rows, rate = tables.highrate, {}
    for unit in ("backshell", "rover"):
        matrix = rotations.to_matrix(mission.telemetry.imus[unit].spacecraft_from_imu_quaternion)
        rate[unit] = getattr(rows, f"{unit}_angle_increment") @ matrix.T / READ
    slips = [t for unit in rate for t in tables.clocks[unit].slips]
    start = rows.sclk[0] + 10.0
    compared = 0
    for begin in start + 15.0 * np.arange(9):
        if any(begin - 1.0 < t < begin + 16.0 for t in slips):
            continue
        k = np.flatnonzero((rows.sclk > begin) & (rows.sclk <= begin + 15.0))
        w = rate["backshell"]
        slope = (8.0 * (w[k + 1] - w[k - 1]) - (w[k + 2] - w[k - 2])) / (12.0 * READ)
        columns = [slope, *(np.cross(w[k], e) for e in np.eye(3)), *(np.tile(e, (len(k), 1)) for e in np.eye(3)),
                   *(w[k] * e for e in np.eye(3))]  # fmt: skip
        design = np.stack([c.ravel() for c in columns], axis=1)
        difference = (rate["rover"] - w)[k].ravel()
        estimate, _, _, _ = np.linalg.lstsq(design, difference, rcond=None)
        scatter = np.std(difference - design @ estimate)
        sigma = scatter * np.sqrt(np.linalg.inv(design.T @ design)[0, 0])
        middle = np.array([begin + 7.5])
        lag = {unit: float(tables.clocks[unit].lag(middle)[0]) for unit in rate}
        # the reading of the IMU whose increments end earlier lags
        assert estimate[0] == pytest.approx(lag["backshell"] - lag["rover"], abs=4.0 * sigma + 2e-5), begin - start
        compared += sigma < 5e-5
    assert compared >= 3
