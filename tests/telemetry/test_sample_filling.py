"""Samples that stand for lost ones: from which side they are filled, and the rotation across a gap."""

import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.estimation.autoregression import Interpolation
from edl_filter.navigation.noise import IDENTITY, sample_attitudes
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.record import SampleFinding
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.sample_filling import (
    ACROSS_OPENING,
    BY_AUTOREGRESSION,
    _drag_before,
    _shortening,
    filled,
    tilt_variance,
    with_limits,
)
from edl_filter.telemetry.sample_repair import repaired


def alone(telemetry):
    return replace(telemetry, checking=())


def test_filled_stretches_are_not_extrapolated_from_each_other(builtin_flight):
    """Many short stretches where a reading begins to vary: no filled value is far outside the range of the readings."""
    telemetry = alone(read_flight_file(builtin_flight))
    force = telemetry.driving.specific_force.copy()
    force[:300] = 0.0
    force[:600][np.random.default_rng(3).random(600) < 0.5] = np.nan
    record = replace(telemetry.driving, specific_force=force)
    filled = repaired(replace(telemetry, driving=record), parachute=252.75).driving
    low, high = np.nanmin(force, axis=0), np.nanmax(force, axis=0)
    assert np.isfinite(filled.specific_force).all()
    assert np.all((filled.specific_force >= 2 * low - high) & (filled.specific_force <= 2 * high - low))
    assert np.all(filled.force_fill_sigma < 10.0 * (high - low))


@pytest.mark.parametrize(("begin", "end"), [(283.0, 303.0), (206.0, 226.0)], ids=["after", "before"])
def test_a_stretch_on_one_side_of_the_parachute_is_filled_from_that_side(begin, end, builtin_flight):
    """Another process acts on the other side, and the shock between them is part of neither."""
    telemetry, deployment = alone(read_flight_file(builtin_flight)), 252.75
    record = telemetry.driving
    lost = (record.time > begin) & (record.time <= end)
    beyond = record.time < deployment + 1.5 if begin > deployment else record.time > deployment - 0.5
    fills = []
    for factor in (1.0, 3.0):  # the other side and the shock, changed
        force, rate = record.specific_force.copy(), record.angular_rate.copy()
        for values in (force, rate):
            values[beyond] *= factor
            values[lost] = np.nan
        changed = replace(record, specific_force=force, angular_rate=rate)
        outcome = repaired(replace(telemetry, driving=changed), CheckSettings(enabled=False), deployment).driving
        fills.append(
            np.hstack([v[lost] for v in (outcome.specific_force, outcome.angular_rate,
                                         outcome.force_fill_sigma, outcome.rate_fill_sigma)])
        )  # fmt: skip
    np.testing.assert_array_equal(*fills)
    deceleration = np.abs(record.specific_force[lost, 0]).mean()
    assert np.abs(fills[0][:, 0] - record.specific_force[lost, 0]).mean() < 0.1 * deceleration


@pytest.mark.slow
def test_the_rotation_across_a_gap_has_the_coning_of_an_oscillation_whose_phase_is_lost(builtin_flight):
    """The rates' sums alone have 8 times the square of the error about the spin axis that is stated here."""
    telemetry = alone(read_flight_file(builtin_flight))
    record, squares = telemetry.driving, []
    for begin in (60.0, 75.0, 140.0, 150.0, 160.0, 170.0, 180.0, 190.0, 200.0, 210.0):
        lost = (record.time > begin) & (record.time <= begin + 20.0)
        values = {k: np.where(lost[:, None], np.nan, getattr(record, k)) for k in ("specific_force", "angular_rate")}
        gap = replace(telemetry, driving=replace(record, **values))
        filled = repaired(gap, CheckSettings(enabled=False), 252.75).driving
        dt = record.interval[lost]
        middle, end = sample_attitudes(dt, filled.angular_rate[lost], IDENTITY)
        true = sample_attitudes(dt, record.angular_rate[lost], IDENTITY)[1]
        error = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(end), true))
        to_end = rotations.to_matrix(rotations.multiply(rotations.conjugate(end), middle))
        sigma = np.hypot(filled.rate_fill_sigma[lost], filled.rate_noise[lost, None]) * dt[:, None]
        covariance = np.einsum("nij,nj,nkj->ik", to_end, sigma**2, to_end)
        squares.append(error**2 / np.diag(covariance))
    assert np.max(squares) < 9.0
    assert np.all(np.mean(squares, axis=0) < 2.0)


#: s; of the shipped flight.
DEPLOYMENT = 252.75
READINGS = ("specific_force", "angular_rate")


def across_deployment(telemetry, begin, end, changed=None):
    """Record without the samples between two times after the deployment, filled; `changed` acts on its readings."""
    record = telemetry.driving
    lost = (record.time > DEPLOYMENT + begin) & (record.time <= DEPLOYMENT + end)
    values = {k: getattr(record, k).copy() for k in READINGS}
    for v in values.values():
        if changed is not None:
            changed(record.time, v)
        v[lost] = np.nan
    gap = replace(telemetry, driving=replace(record, **values))
    return lost, repaired(gap, CheckSettings(enabled=False), DEPLOYMENT)


def test_what_the_parachute_opens_in_is_filled_from_each_side(builtin_flight):
    """Before the deployment the readings after it do not matter; both parts are named."""
    telemetry = alone(read_flight_file(builtin_flight))

    def tripled_after(time, values):
        values[time > DEPLOYMENT] *= 3.0

    lost, plain = across_deployment(telemetry, -1.0, 1.0)
    _, changed = across_deployment(telemetry, -1.0, 1.0, tripled_after)
    before = lost & (telemetry.driving.time <= DEPLOYMENT)
    after = lost & ~before
    for name in ("specific_force", "angular_rate", "force_fill_sigma", "rate_fill_sigma"):
        a, b = (getattr(t.driving, name) for t in (plain, changed))
        np.testing.assert_array_equal(a[before], b[before])
        assert np.any(a[after] != b[after])
    true = telemetry.driving.specific_force
    np.testing.assert_allclose(plain.driving.specific_force[before, 0], true[before, 0], atol=0.1)
    values = {k: np.where(lost[:, None], np.nan, getattr(telemetry.driving, k)) for k in READINGS}
    _, repairs = filled(replace(telemetry.driving, **values), None, CheckSettings(), DEPLOYMENT)
    parts = [(DEPLOYMENT - 1.0, DEPLOYMENT, BY_AUTOREGRESSION), (DEPLOYMENT, DEPLOYMENT + 1.0, ACROSS_OPENING)]
    for repair, part in zip(repairs, 2 * parts, strict=True):  # of forces and of rates
        assert repair[:2] == pytest.approx(part[:2], abs=0.13) and repair[2] == part[2]


@pytest.mark.parametrize("end", [0.5, 1.0, 2.5])
def test_the_force_of_the_opening_canopy_is_between_that_of_both_sides(end, builtin_flight):
    """The velocity change is within three sigmas; the canopy of the simulator is full after 0.6 s."""
    telemetry = alone(read_flight_file(builtin_flight))
    lost, complete = across_deployment(telemetry, -1.0, end)
    record, true = complete.driving, telemetry.driving
    after = lost & (record.time > DEPLOYMENT)
    dt, count = record.interval[after][0], np.count_nonzero(after)
    error = dt * np.sum(record.specific_force[after] - true.specific_force[after], axis=0)
    sigma = dt * np.sqrt(count) * record.force_fill_sigma[after][0]
    assert np.all(np.abs(error) < 3.0 * sigma)
    assert sigma[0] < dt * np.sum(np.abs(true.specific_force[after, 0]))  # no more than the whole change


def fills_of(covariances):
    count = len(covariances[0])
    return [Interpolation(np.zeros(count), c, 1, 1.0) for c in covariances]


def test_independent_rates_of_exact_forces_need_no_further_variance():
    covariance = 0.04 * np.eye(10)
    sigma = np.full((10, 3), 0.2)
    force = np.tile([-50.0, 1.0, 2.0], (10, 1))
    out = tilt_variance(fills_of([covariance] * 3), sigma, force, np.zeros((10, 3)), 0.1)
    np.testing.assert_allclose(out, 0.0, atol=1e-12)


def test_the_variance_by_tilt_is_that_of_drawn_rates():
    """Oscillating rates about y and z under a force of uncertain size along x, both drawn; the third axis is exact."""
    rng, count, interval = np.random.default_rng(2), 16, 0.125
    t = interval * np.arange(count)
    waves = 0.3 * np.stack((np.cos(9.0 * t), np.sin(9.0 * t)))
    wave = waves.T @ waves
    force, force_sigma = np.tile([-40.0, 0.0, 0.0], (count, 1)), np.tile([5.0, 0.0, 0.0], (count, 1))
    fills = fills_of([np.zeros((count, count)), wave, wave])
    rate_sigma = np.zeros((count, 3))
    rate_sigma[:, 1:] = np.sqrt(wave.sum() / count)
    variance = tilt_variance(fills, rate_sigma, force, force_sigma, interval)
    change = []
    for _ in range(4000):
        rate = rng.normal(size=(2, 2)) @ waves  # about y and z
        # errors of the force are independent of each other, so that the product is that of the mean square angle
        axial = -40.0 + 5.0 * rng.normal(size=count)
        angle = interval * np.cumsum(rate, axis=1)
        change.append((np.sum(angle[1] * axial) * interval, -np.sum(angle[0] * axial) * interval))
    weight = -40.0 * interval * np.tril(np.ones((count, count))).T.sum(axis=1) * interval
    linear = np.sum((weight * rate_sigma[0, 1]) ** 2)
    assert variance[0] == 0.0
    np.testing.assert_allclose(variance[1:] + linear, np.mean(np.square(change), axis=0), rtol=0.15)


def test_a_force_that_is_turned_is_shorter_by_the_square_of_drawn_angles(builtin_flight):
    """Filled rates with independent errors about y and z, and the readings for 2 s after them."""
    record, rng = read_flight_file(builtin_flight).driving, np.random.default_rng(5)
    force = np.tile([-40.0, 0.0, 0.0], (len(record), 1))
    lost = np.isin(np.arange(len(record)), [2000, 2001, 2004, 2100])  # 12 s apart: two groups
    sigma = np.where(lost[:, None], [0.0, 0.9, 0.5], 7.0)
    variance = _shortening(record, force, sigma, lost)
    np.testing.assert_array_equal(np.flatnonzero(variance[:, 0]), np.flatnonzero(lost))
    np.testing.assert_array_equal(variance[:, 1:], 0.0)
    shortened = []
    for _ in range(4000):
        rate = np.where(lost[2000:2021, None], rng.normal(size=(21, 2)) * [0.9, 0.5], 0.0)
        angle = np.linalg.norm(np.cumsum(0.125 * rate, axis=0), axis=1)
        shortened.append(np.sum(0.125 * 40.0 * (1.0 - np.cos(angle))))
    expected = np.sqrt(np.mean(np.square(shortened)))
    stated = 0.125 * np.sqrt(variance[2000:2005, 0].sum())
    assert expected < 1.05 * stated < 1.3 * expected  # errors of successive samples add up at most


def test_the_drag_of_a_full_canopy_is_extrapolated_as_it_decelerates():
    """``dv/dt = -k v²`` has a closed solution; lateral forces have their mean and scatter."""
    time = 0.125 * np.arange(30)
    force = -60.0 / (1.0 + 0.2 * time) ** 2
    observed = np.arange(30) >= 10
    fill = _drag_before(np.where(observed, force, 0.0), observed, 0, 10)
    np.testing.assert_allclose(fill.values, force[:10], rtol=1e-9)
    assert np.abs(fill.covariance).max() < 1e-15
    lateral = np.where(np.arange(30) % 2 == 0, 0.3, -0.1)
    fill = _drag_before(lateral, observed, 0, 10)
    np.testing.assert_allclose(fill.values, 0.1, rtol=1e-12)
    np.testing.assert_allclose(fill.covariance, np.var(lateral[10:20], ddof=1) * np.eye(10))
    steep = _drag_before(np.where(observed, -60.0 * np.exp(-3.0 * time), 0.0), observed, 0, 10)
    assert np.all(steep.values >= -4.0 * 60.0 * np.exp(-3.0 * time[10])) and np.all(np.isfinite(steep.values))


def test_the_other_imu_need_not_be_linear(builtin_flight):
    """Its axial force differs as that of both rovers' IMUs does: 0.03 m/s² at 12 m/s², as much less at 48 m/s²."""
    telemetry = read_flight_file(builtin_flight)
    second = telemetry.checking[0]
    force = second.specific_force.copy()
    axial = -force[:, 0]
    force[:, 0] += 2.65e-6 * axial * (axial - 30.0) * (axial - 61.0)
    pair = replace(telemetry, checking=(replace(second, specific_force=force),))
    record = telemetry.driving
    outcomes = []
    for begin in np.arange(60.0, 240.0, 30.0):
        lost = (record.time > begin) & (record.time <= begin + 5.0)
        missing = replace(record, specific_force=np.where(lost[:, None], np.nan, record.specific_force))
        complete = repaired(replace(pair, driving=missing), parachute=252.75).driving
        difference = (complete.specific_force - record.specific_force)[lost, 0] @ record.interval[lost]
        variance = complete.force_fill_sigma[lost, 0] ** 2 + record.force_noise[lost] ** 2
        outcomes.append((difference, np.sqrt(np.sum(record.interval[lost] ** 2 * variance))))
    error, sigma = np.array(outcomes).T
    assert np.abs(error / sigma).max() < 3.0 and np.sqrt(np.mean((error / sigma) ** 2)) < 1.3
    assert sigma.max() < 0.06  # m/s; constant errors of the calibration would leave up to 0.2


def test_a_saturated_sample_that_its_neighbours_fill_is_at_the_limit_with_the_missed_part_as_sigma(builtin_flight):
    record = read_flight_file(builtin_flight).driving
    force = np.tile([-20.0, 1.0, 2.0], (len(record), 1))
    force[102] = [-45.0, 1.0, 2.0]  # already beyond the limit
    record = replace(record, specific_force=force, force_fill_sigma=np.full_like(force, 3.0))
    begin, end = record.time[99], record.time[102]
    finding = SampleFinding(
        record.name, "force x", begin, end, 3, "saturated", interpolated=((begin, end),), limit=(-36.0, 0.0, 12.0)
    )
    axis = np.array([-3.0, 0.0, 1.0]) / np.sqrt(10.0)
    deficit = (np.sqrt(36.0**2 + 12.0**2) - (60.0 + 2.0) / np.sqrt(10.0)) * axis
    limited = with_limits(record, [finding])
    expected, sigma = force.copy(), np.full_like(force, 3.0)
    expected[100:102] += deficit
    sigma[100:102] = np.sqrt(9.0 + 3 * deficit**2)
    np.testing.assert_allclose(limited.specific_force, expected, atol=1e-12)
    np.testing.assert_allclose(limited.force_fill_sigma, sigma, atol=1e-12)
    for elsewhere in (
        replace(finding, imu="secondary"),
        replace(finding, limit=None),
        replace(finding, interpolated=()),
    ):
        np.testing.assert_array_equal(with_limits(record, [elsewhere]).specific_force, force)


def test_an_impact_that_saturates_the_only_imu_is_inside_its_sigma(builtin_flight, tmp_path):
    """The neighbours of an impact do not show it: they alone are wrong by more than ten of their sigmas."""
    path = Path(shutil.copy(builtin_flight, tmp_path / "flight.h5"))
    impact = np.array([-150.0, -260.0, -310.0, -210.0, -160.0, -120.0])
    with h5py.File(path, "a") as file:
        del file["imu/secondary"]
        force = file["imu/primary/specific_force"]
        force[:] += np.random.default_rng(0).normal(scale=1e-3, size=force.shape)  # equal values are rare
        rows = slice(2400, 2400 + len(impact))
        mounting = rotations.to_matrix(file["imu/primary"].attrs["body_from_imu"])
        axis = int(np.argmax(np.abs(mounting[0])))  # nearest to the body's x
        true = force[rows, axis] + impact
        force[rows, axis] = np.maximum(true, -100.0)
    telemetry = read_flight_file(path)
    assert {f.kind for f in telemetry.findings} == {"saturated"}
    record, lost = telemetry.driving, np.isnan(telemetry.driving.specific_force[:, 0])
    assert np.count_nonzero(lost) == len(impact)
    outcome = repaired(telemetry, parachute=252.75)
    error = (outcome.driving.specific_force[lost] @ mounting)[:, axis] - true
    total = np.sqrt(np.sum((outcome.driving.force_fill_sigma[lost] @ np.abs(mounting))[:, axis] ** 2))
    assert abs(error.sum()) < 3.0 * total
    neighbours, _ = filled(record, None, CheckSettings(), 252.75)
    error = (neighbours.specific_force[lost] @ mounting)[:, axis] - true
    total = np.sqrt(np.sum((neighbours.force_fill_sigma[lost] @ np.abs(mounting))[:, axis] ** 2))
    assert abs(error.sum()) > 10.0 * total


@pytest.mark.parametrize("second", [False, True], ids=["one IMU", "two IMUs"])
@pytest.mark.parametrize("key", ["specific_force", "angular_rate"])
@pytest.mark.parametrize("axis", [0, 2])
def test_two_axes_that_are_read_are_kept_where_the_third_is_stuck(second, key, axis, builtin_flight, tmp_path):
    """The axes of the IMU are oblique to those of the body; the errors are along the lost axis alone."""
    truth = read_flight_file(builtin_flight)
    path = shutil.copy(builtin_flight, tmp_path / "flight.h5")
    with h5py.File(path, "a") as file:
        values = file[f"imu/primary/{key}"]
        values[800:840, axis] = values[800, axis]
        matrix = rotations.to_matrix(file["imu/primary"].attrs["body_from_imu"])
    telemetry = read_flight_file(path)
    telemetry = telemetry if second else alone(telemetry)
    (finding,) = telemetry.findings
    assert finding.kind == "stuck" and np.isnan(getattr(telemetry.driving, key)).all(axis=1).sum() == finding.samples
    outcome = repaired(telemetry, parachute=DEPLOYMENT).driving
    lost = np.isnan(getattr(telemetry.driving, key)).all(axis=1)
    error = (getattr(outcome, key) - getattr(truth.driving, key))[lost]
    sigma = (outcome.force_fill_sigma if key == "specific_force" else outcome.rate_fill_sigma)[lost]
    direction = matrix[:, axis]
    np.testing.assert_allclose(error - np.outer(error @ direction, direction), 0.0, atol=1e-12)
    assert np.all(np.abs(error.sum(axis=0)) <= 4.0 * np.sqrt((sigma**2).sum(axis=0)))
    whole = {key: np.where(lost[:, None], np.nan, getattr(telemetry.driving, key))}
    kind = "force" if key == "specific_force" else "rate"
    without = replace(telemetry.driving, **whole, **{f"partial_{kind}": np.zeros((len(lost), 2, 3))})
    unread = repaired(replace(telemetry, driving=without), parachute=DEPLOYMENT).driving
    unread_sigma = (unread.force_fill_sigma if key == "specific_force" else unread.rate_fill_sigma)[lost]
    assert np.linalg.norm(sigma) < (1.01 if second else 0.9) * np.linalg.norm(unread_sigma)


def test_a_stretch_in_which_not_the_same_axis_is_lost_throughout_is_filled_as_one(builtin_flight):
    """Its parts would have no readings on one side. The fill is that without the axes that are read."""
    telemetry = alone(read_flight_file(builtin_flight))
    record = telemetry.driving
    rate, partial = record.angular_rate.copy(), np.zeros((len(record), 2, 3))
    rate[800:820] = np.nan
    partial[800:810, 1] = [1.0, 0.0, 0.0]
    partial[800:810, 0, 1:] = record.angular_rate[800:810, 1:]
    changed = replace(record, angular_rate=rate)
    expected, repairs = filled(changed, None, CheckSettings(), DEPLOYMENT)
    complete, same = filled(replace(changed, partial_rate=partial), None, CheckSettings(), DEPLOYMENT)
    assert len(repairs) == 1 and repairs == same
    np.testing.assert_array_equal(complete.angular_rate, expected.angular_rate)
    np.testing.assert_array_equal(complete.rate_fill_sigma, expected.rate_fill_sigma)


def test_axes_that_the_other_imu_contradicts_are_lost_too(builtin_flight):
    """A spike along an axis that is read while another one is stuck."""
    telemetry = read_flight_file(builtin_flight)
    record = telemetry.driving
    rate, partial = record.angular_rate.copy(), np.zeros((len(record), 2, 3))
    rate[800:840] = np.nan
    partial[800:840, 1] = [1.0, 0.0, 0.0]
    partial[800:840, 0, 1:] = record.angular_rate[800:840, 1:]
    partial[820, 0, 1] += 1.5
    changed = replace(record, angular_rate=rate, partial_rate=partial)
    complete, _ = filled(changed, telemetry.checking[0], CheckSettings(), DEPLOYMENT)
    kept = np.delete(np.arange(800, 840), 20)
    np.testing.assert_array_equal(complete.angular_rate[kept, 1:], record.angular_rate[kept, 1:])
    assert abs(complete.angular_rate[820, 1] - record.angular_rate[820, 1]) < 1e-3
