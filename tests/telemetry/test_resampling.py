"""Two IMUs of one rigid body that sample at different rates: means, places and noise against the exact motion."""

from dataclasses import replace

import numpy as np
import pytest
from test_disagreement import CONSTANT, END, FAULTS, PARACHUTE, PROBABILITY, with_change
from test_relative_calibration import DT, TRUE, motion, two_records

from edl_filter.telemetry.disagreement import disagreements, independent_error
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.relative_calibration import relative_calibration
from edl_filter.telemetry.resampling import (
    angular_acceleration_error,
    averaged,
    comparable_records,
    covered,
    interpolation_sigma,
    means_between,
    means_error,
    moved_to,
    readings_integral,
    samples_less_often,
    with_interpolation_noise,
)
from edl_filter.telemetry.sample_repair import repaired, without_samples


@pytest.fixture(scope="module")
def telemetry(builtin_flight):
    return read_flight_file(builtin_flight)


def less_often(source, factor, first=0):
    """The record that the same IMU gives with longer samples: exact means of `factor` readings, from number `first`."""
    count = (len(source) - first) // factor
    rows = slice(first, first + factor * count)

    def mean(values):
        return values[rows].reshape(count, factor, 3).mean(axis=1)

    last = np.zeros(len(source), bool)
    last[first + factor - 1 : first + factor * count : factor] = True
    return replace(
        source.select(last), interval=np.full(count, factor * source.interval[0]),
        specific_force=mean(source.specific_force), angular_rate=mean(source.angular_rate),
        force_noise=source.force_noise[last] / np.sqrt(factor), rate_noise=source.rate_noise[last] / np.sqrt(factor),
        shared_rate_noise=source.shared_rate_noise[last] / np.sqrt(factor), stated_interval=np.nan,
    )  # fmt: skip


def test_means_between_own_edges_are_the_readings_and_triads_do_not_mix():
    _, checked = two_records(noise=0.0, count=200)
    edges = np.concatenate(([checked.start], checked.time))
    own = means_between(readings_integral(checked, checked.specific_force, checked.angular_rate), edges)
    np.testing.assert_allclose(own[0], checked.specific_force, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(own[1], checked.angular_rate, rtol=1e-9, atol=1e-9)
    inside = edges[1:-1] + 0.3 * DT
    force, rate = means_between(readings_integral(checked, checked.specific_force, checked.angular_rate), inside)
    (alone,) = means_between(readings_integral(checked, checked.angular_rate), inside)
    np.testing.assert_allclose(rate, alone, rtol=0, atol=1e-13)
    assert force.shape == rate.shape


def test_lost_samples_do_not_change_means_that_are_covered():
    """Between the samples, at half a sample of phase; a spline that takes a lost reading for zero oscillates there."""
    _, record = two_records(noise=0.0, count=200)
    edges = np.concatenate(([record.start], record.time))[2:-2] + 0.5 * DT
    complete = means_between(readings_integral(record, record.specific_force, record.angular_rate), edges)
    force, rate = record.specific_force.copy(), record.angular_rate.copy()
    force[80], rate[[80, 130, 131]] = np.nan, np.nan
    lost = replace(record, specific_force=force, angular_rate=rate)
    used = covered(lost, edges)
    assert 160 < np.count_nonzero(used) < 185
    for means, expected in zip(means_between(readings_integral(lost, force, rate), edges), complete, strict=True):
        assert np.abs(means - expected)[used].max() < 1e-4 * np.abs(expected).max()


def test_records_of_similar_rates_are_compared_as_they_are():
    reference, checked = two_records(count=300)
    assert comparable_records(reference, checked) == (reference, checked)
    assert with_interpolation_noise(checked, reference) is checked
    slower = replace(checked, time=1.4 * checked.time, interval=1.4 * checked.interval)
    assert not samples_less_often(slower, reference) and comparable_records(slower, reference)[0] is slower
    assert samples_less_often(less_often(checked, 2), reference) and not samples_less_often(reference, checked)


@pytest.mark.parametrize(("factor", "first"), [(2, 0), (3, 1), (8, 5)])
def test_means_over_longer_samples_are_those_of_the_readings_in_them(factor, first):
    reference, checked = two_records(noise=0.0, count=400)
    coarse = less_often(checked, factor, first)
    force = reference.specific_force.copy()
    force[200] = np.nan
    mean = averaged(replace(reference, specific_force=force), coarse)
    expected = less_often(reference, factor, first)
    inside = (coarse.time < reference.time[195]) | (coarse.time - coarse.interval > reference.time[204])
    np.testing.assert_allclose(mean.specific_force[inside], expected.specific_force[inside], atol=1e-10)
    np.testing.assert_allclose(mean.angular_rate[inside], expected.angular_rate[inside], atol=1e-12)
    assert np.isnan(mean.specific_force[coarse.index_at(reference.time[200:201] - 0.5 * DT)]).all()
    np.testing.assert_allclose(mean.rate_noise, expected.rate_noise)
    np.testing.assert_array_equal(mean.time, coarse.time)
    assert mean.name == reference.name


def test_a_force_is_moved_by_the_lever_arm_acceleration_of_the_rates():
    """Against the exact derivative of the rates."""
    reference, checked = two_records(noise=0.0, count=400)
    moved = moved_to(reference, checked)
    t = reference.time[:, None] - DT + DT * (np.arange(25) + 0.5) / 25.0
    rate, acceleration, _ = motion(t)
    arm = np.broadcast_to(checked.position[0] - reference.position[0], rate.shape)
    expected = (np.cross(acceleration, arm) + np.cross(rate, np.cross(rate, arm))).mean(axis=1)
    error = (moved.specific_force - reference.specific_force - expected)[8:-8]
    assert np.max(np.abs(error)) < 1e-4 < 0.1 < np.max(np.abs(expected))
    np.testing.assert_array_equal(moved.angular_rate, reference.angular_rate)
    np.testing.assert_array_equal(moved.position, checked.position)
    assert np.all(moved.force_noise >= reference.force_noise)


def test_a_force_near_a_lost_rate_is_lost():
    reference, checked = two_records(count=400)
    rate = reference.angular_rate.copy()
    rate[200, 1] = np.nan
    moved = moved_to(replace(reference, angular_rate=rate), checked)
    lost = np.flatnonzero(np.isnan(moved.specific_force).any(axis=1))
    assert lost[0] == 196 and lost[-1] == 204 and len(lost) == 9


@pytest.mark.parametrize("factor", [2, 3, 4])
def test_the_noise_contains_the_error_of_the_interpolation(factor):
    """At the samples of the faster IMU, on a body that swings at 0.7 Hz: the error is within the sigma."""
    reference, checked = two_records(noise=0.0, count=1000)
    coarse = less_often(checked, factor)
    noisy = with_interpolation_noise(coarse, reference)
    edges = np.concatenate(([reference.start], reference.time))
    force, rate = means_between(readings_integral(coarse, coarse.specific_force, coarse.angular_rate), edges)
    at_sample = coarse.index_at(reference.time - 0.5 * DT)
    inside = slice(40, -40)
    for means, exact, noise in (
        (force, checked.specific_force, noisy.force_noise), (rate, checked.angular_rate, noisy.rate_noise),
    ):  # fmt: skip
        error = np.max(np.abs(means - exact), axis=1)[inside]
        assert np.all(error < noise[at_sample][inside])
    assert np.median(noisy.rate_noise) > 1.5 * np.median(coarse.rate_noise)
    assert np.median(noisy.rate_noise) < 0.03 * factor  # of an amplitude of 0.12 rad/s


@pytest.mark.parametrize("longer", ["reference", "checked"])
@pytest.mark.parametrize("factor", [2, 4])
def test_the_calibration_is_that_of_equal_rates(longer, factor):
    """Lever arm, alignments and delay within the error that the interpolation of equal samples has, or four sigmas."""
    records = dict(zip(("reference", "checked"), two_records(seed=3, count=3000), strict=True))
    records[longer] = less_often(records[longer], factor, first=1)
    estimate = relative_calibration(records["reference"], records["checked"], -np.inf, np.inf)
    assert estimate is not None
    for name, true in TRUE.items():
        error = np.abs(np.atleast_1d(getattr(estimate, name)) - true)
        assert np.all(error < 4.0 * np.atleast_1d(getattr(estimate, f"{name}_sigma")) + 1e-4), name


@pytest.mark.parametrize("longer", [0, 1])
@pytest.mark.parametrize("factor", [2, 8])
def test_sound_imus_of_different_rates_agree(longer, factor, telemetry):
    records = [telemetry.driving, telemetry.checking[0]]
    records[longer] = less_often(records[longer], factor, first=1)
    assert disagreements(*records, END, PROBABILITY) == []


@pytest.mark.parametrize("name", CONSTANT)
def test_a_constant_error_is_no_disagreement_at_different_rates(name, telemetry):
    checked = less_often(with_change(telemetry.checking[0], *CONSTANT[name]), 2)
    assert disagreements(telemetry.driving, checked, END, PROBABILITY) == []


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("at_fault", [0, 1])
def test_a_change_in_flight_is_detected_at_different_rates(name, at_fault, telemetry):
    key, change, channel = FAULTS[name]
    records = [telemetry.driving, telemetry.checking[0]]
    records[at_fault] = with_change(records[at_fault], key, change, start=120.0)
    records[1] = less_often(records[1], 2)
    findings = disagreements(*records, END, PROBABILITY)
    assert channel in {f.channel for f in findings} and {f.kind for f in findings} == {"disagreement"}
    assert {f.imu for f in findings} == {telemetry.driving.name}


def test_noise_of_one_imu_is_its_own_error_at_different_rates(telemetry):
    driving = with_change(
        telemetry.driving, "angular_rate",
        lambda v: v + 5e-3 * np.random.default_rng(0).standard_normal(v.shape), start=120.0, end=160.0,
    )  # fmt: skip
    checked = less_often(telemetry.checking[0], 2)
    findings = disagreements(driving, checked, END, PROBABILITY)
    evidence = independent_error(driving, checked, findings, END)
    assert evidence[driving.name] > 100.0 and evidence[checked.name] == 0.0


def test_a_repair_adds_the_noise_once_and_keeps_the_record_as_read(telemetry):
    checked = less_often(telemetry.checking[0], 2)
    given = replace(telemetry, checking=(checked,))
    complete = repaired(given, parachute=PARACHUTE)
    assert complete.as_read is given and complete.findings == ()
    assert np.median(complete.checking[0].rate_noise) > 1.1 * np.median(checked.rate_noise)
    again = without_samples(complete, telemetry.driving.name, {"rate": [(150.0, 151.0)]}, parachute=PARACHUTE)
    assert again.as_read is given and len(again.findings) == 1
    np.testing.assert_array_equal(again.checking[0].rate_noise, complete.checking[0].rate_noise)


@pytest.mark.parametrize("lower_reach", [1, 2, 3])
def test_the_error_of_an_angular_acceleration_is_that_of_the_lower_order(lower_reach):
    """Means of t^n: both interpolations are exact up to their order, and the lower one is not beyond it."""
    edges = DT * np.arange(41)
    for power in range(9):
        means = (np.diff(edges ** (power + 1)) / (power + 1) / DT)[:, None] * [1.0, -2.0, 0.5]
        error = angular_acceleration_error(np.full(40, DT), means, lower_reach)[8:-8]
        exact = np.diff(edges**power)[8:-8, None] / DT * [1.0, -2.0, 0.5]
        if power < 2 * lower_reach:
            np.testing.assert_allclose(error, 0.0, atol=1e-9 * np.abs(exact).max())
        elif power == 2 * lower_reach + 1:  # at an even power the error is the same at both edges
            assert np.abs(error).min() > 1e-6
    np.testing.assert_allclose(
        interpolation_sigma(np.full(40, DT), means),
        np.linalg.norm(angular_acceleration_error(np.full(40, DT), means, 3), axis=1),
    )


def test_the_error_of_means_vanishes_where_a_cubic_spline_is_exact():
    reference, checked = two_records(count=200)
    edges = reference.edges[40:-40] + 0.3 * DT
    t = checked.edges
    cubic = (np.diff(t**3) / 3.0 / DT)[:, None] * np.ones(3)  # their integral is a cubic
    kink = np.where(checked.time[:, None] > 0.5 * (t[0] + t[-1]), 1.0, 0.0) * np.ones(3)
    smooth, stepped = means_error(checked, edges, cubic, kink)
    assert np.abs(smooth).max() < 1e-9 * np.abs(cubic).max()
    assert 0.01 < np.abs(stepped).max() < 1.0
    assert np.abs(stepped[:20]).max() < 1e-6
