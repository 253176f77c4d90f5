"""Errors of interpolated rates and lever-arm accelerations, against rotations whose integrals have a closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from edl_filter import Mission
from edl_filter.diagnosis.linear_model import linearization
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point
from edl_filter.diagnosis.prediction.dead_reckoning import node_times, rate_integral
from edl_filter.diagnosis.prediction.interpolation_error import (
    InterpolationErrors,
    PredictedRotation,
    lever_arm_error,
    node_errors,
    rate_error,
    resampling_error,
    step_response,
)
from edl_filter.diagnosis.prediction.predicted_readings import FINE_NODES_PER_BIN
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_means_of_readings
from edl_filter.diagnosis.residual_analysis.residual_map import model_rms
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.imu_model.lever_arm import EDGE_REACH, lever_arm_acceleration, lever_arm_acceleration_at
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.increments import effective_samples
from edl_filter.simulation import Scenario, simulate
from edl_filter.telemetry.flight_file_writer import write_flight_file
from edl_filter.telemetry.record import ImuRecord

DT, COUNT, NODES = 0.125, 80, 4
ARM = np.array([0.3, -0.4, 0.2])
TIME = DT * np.arange(1, COUNT + 1)
#: Four times a sample, on which no change of slope lies.
NODE_TIMES = np.linspace(0.0, DT * COUNT, NODES * COUNT + 1)


def triangle_wave(axis_phases=(0.0, 0.31, 0.57), period=0.83, amplitude=12.0):
    """Angular acceleration (rad/s²) with changes of slope: functions of time, one for each axis."""
    breaks = np.arange(-1.0, DT * COUNT + 1.0, period / 2.0)
    slope = 2.0 * amplitude / (period / 2.0)
    signs = np.resize([1.0, -1.0], len(breaks) - 1)
    pieces = np.array([signs * slope, -signs * amplitude])
    return [PPoly(pieces, breaks + phase * period) for phase in axis_phases]


def record_of(mean_rate):
    zeros = np.zeros(COUNT)
    return ImuRecord(
        "first", TIME, np.full(COUNT, DT), np.zeros((COUNT, 3)), mean_rate, np.zeros((COUNT, 3)), zeros, zeros, zeros,
        zeros.astype(bool), zeros.astype(bool), zeros.astype(int), ("first",), zeros.astype(int), ("test",),
        (SensorErrors(),),
    )  # fmt: skip


def samples_of(mean_rate):
    return effective_samples(record_of(mean_rate))


def lever_arm_errors(samples, time, alpha, positions, rate_errors=None):
    none = np.zeros((COUNT, 3))
    return lever_arm_error(
        PredictedRotation(time, alpha), samples, none if rate_errors is None else rate_errors, positions
    )


def delay(tau, imu=None):
    return EffectInstance(find_effect("imu_time_offset"), {"tau": tau}, imu=imu)


def motion(acceleration):
    """Mean rates and the exact mean acceleration of the place, by fine quadrature inside each sample."""
    rates = [a.antiderivative() for a in acceleration]
    edges = np.append(0.0, TIME)
    mean_rate = np.column_stack([np.diff(r.antiderivative()(edges)) / DT for r in rates])
    fine = (np.arange(400) + 0.5) / 400.0
    inner = (edges[:-1, None] + DT * fine).ravel()
    alpha, omega = (np.column_stack([f(inner) for f in functions]) for functions in (acceleration, rates))
    exact = lever_arm_acceleration_at(alpha, omega, ARM).reshape(COUNT, 400, 3).mean(axis=1)
    return mean_rate, exact


def delayed_means(acceleration, tau):
    """Mean rates over the intervals that end `tau` before the samples, from the antiderivatives."""
    edges = np.append(0.0, TIME) - tau
    return np.column_stack([np.diff(a.antiderivative(2)(edges)) / DT for a in acceleration])


# --- rates -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tau", [0.5 * DT, -0.5 * DT, 0.3 * DT, 2.5 * DT])
def test_the_error_of_rates_that_are_shifted_in_time_is_predicted(tau):
    acceleration = triangle_wave()
    exact, read = delayed_means(acceleration, 0.0), delayed_means(acceleration, tau)
    corrected = delay(tau).effect.corrected({"tau": tau}, TIME, np.zeros((COUNT, 3)), read)[1]
    alpha = np.column_stack([a(NODE_TIMES) for a in acceleration])
    predicted = rate_error(PredictedRotation(NODE_TIMES, alpha), record_of(read), (delay(tau),), True)
    inside = slice(8, COUNT - 8)
    size = np.sqrt(np.mean((exact - corrected)[inside] ** 2))
    assert size > 1e-3  # rad/s: some tens of sigmas of a gyro
    assert np.sqrt(np.mean((exact - corrected - predicted)[inside] ** 2)) < 0.15 * size


@pytest.mark.parametrize("per_bin", [4, 16])
def test_the_error_of_attitudes_and_rates_inside_the_bins_is_predicted(per_bin):
    """The angular acceleration changes its slope inside bins; the prediction has it at four nodes in each."""
    acceleration, bins = triangle_wave(), TimeBins(np.append(0.0, TIME), np.ones(COUNT, bool))
    time, interpolated = node_times(bins, per_bin), rate_integral(bins, delayed_means(acceleration, 0.0))
    angle, rate = (np.column_stack([a.antiderivative(k)(time) for a in acceleration]) for k in (2, 1))
    true = angle - angle[0] - interpolated(time), rate - interpolated.derivative()(time)
    alpha = np.column_stack([a(NODE_TIMES) for a in acceleration])
    predicted = node_errors(PredictedRotation(NODE_TIMES, alpha), bins, per_bin)
    inside = slice(8 * per_bin, -8 * per_bin)
    np.testing.assert_allclose(predicted[0][::per_bin], 0.0, atol=1e-12)
    for error, exact in zip(predicted, true, strict=True):
        size = np.sqrt(np.mean(exact[inside] ** 2))
        assert np.sqrt(np.mean((exact - error)[inside] ** 2)) < 0.2 * size
    assert np.abs(predicted[0][inside]).max() > 1e-4  # rad


def test_attitudes_of_a_slow_motion_are_interpolated_without_error():
    bins, acceleration = TimeBins(np.append(0.0, TIME), np.ones(COUNT, bool)), np.sin(2.0 * np.pi * 0.5 * NODE_TIMES)
    rotation = PredictedRotation(NODE_TIMES, np.repeat(acceleration[:, None], 3, axis=1))
    angle, rate = node_errors(rotation, bins, 16)
    inside = slice(8 * 16, -8 * 16)
    assert np.abs(angle[inside]).max() < 1e-7 and np.abs(rate[inside]).max() < 2e-6


def test_rates_that_no_delay_shifts_have_no_error():
    alpha = np.column_stack([a(NODE_TIMES) for a in triangle_wave()])
    rotation, record = PredictedRotation(NODE_TIMES, alpha), record_of(np.zeros((COUNT, 3)))
    scale = EffectInstance(find_effect("gyro_scale"), {"sx": 0.01, "sy": 0.0, "sz": 0.0})
    for effects, driving in (((), True), ((scale,), True), ((delay(0.06, "second"),), True), ((delay(0.06),), False)):
        assert not rate_error(rotation, record, effects, driving).any(), effects
    assert rate_error(rotation, record, (delay(0.06, "first"),), False).any()
    assert np.abs(rate_error(rotation, record, (delay(0.0),), True)).max() < 1e-12


def test_only_samples_of_the_instrument_that_is_late_have_an_error():
    alpha = np.column_stack([a(NODE_TIMES) for a in triangle_wave()])
    unit = (TIME > 5.0).astype(int)
    record = replace(record_of(np.zeros((COUNT, 3))), unit=unit, units=("first", "later"), errors=(SensorErrors(),) * 2)
    error = rate_error(PredictedRotation(NODE_TIMES, alpha), record, (delay(0.06, "later"),), True)
    assert not error[unit == 0].any() and error[unit == 1].any()


def test_rates_outside_the_prediction_have_no_error():
    alpha, half = np.column_stack([a(NODE_TIMES) for a in triangle_wave()]), NODES * COUNT // 2
    rotation = PredictedRotation(NODE_TIMES[40 : half + 1], alpha[40 : half + 1])
    error = rate_error(rotation, record_of(np.zeros((COUNT, 3))), (delay(0.06),), True)
    assert not error[:10].any() and not error[COUNT // 2 :].any() and error[10 : COUNT // 2].all()


@pytest.mark.parametrize("taus", [(0.3 * DT, 0.2 * DT), (0.5 * DT, -0.4 * DT)])
def test_two_delays_of_one_imu_are_chained(taus):
    """Of the catalogue and of a user: the second one acts on the reading of the first."""
    acceleration = triangle_wave()
    effects = tuple(delay(tau) for tau in taus)
    corrected = delayed_means(acceleration, sum(taus))
    for a in effects[::-1]:
        corrected = a.effect.corrected(a.values, TIME, np.zeros((COUNT, 3)), corrected)[1]
    true = delayed_means(acceleration, 0.0) - corrected
    alpha = np.column_stack([a(NODE_TIMES) for a in acceleration])
    predicted = rate_error(PredictedRotation(NODE_TIMES, alpha), record_of(np.zeros((COUNT, 3))), effects, True)
    inside = slice(8, COUNT - 8)
    assert np.sqrt(np.mean((true - predicted)[inside] ** 2)) < 0.15 * np.sqrt(np.mean(true[inside] ** 2))


def test_the_neighbours_of_a_sample_without_reading_are_interpolated_as_they_were_corrected():
    acceleration, tau = triangle_wave(), 0.06
    read = delayed_means(acceleration, tau)
    read[40] = np.nan
    corrected = delay(tau).effect.corrected({"tau": tau}, TIME, np.zeros((COUNT, 3)), read)[1]
    true = delayed_means(acceleration, 0.0) - corrected
    alpha = np.column_stack([a(NODE_TIMES) for a in acceleration])
    predicted = rate_error(PredictedRotation(NODE_TIMES, alpha), record_of(read), (delay(tau),), True)
    near = [37, 38, 39, 41, 42, 43]
    assert np.sqrt(np.mean((true - predicted)[near] ** 2)) < 0.15 * np.sqrt(np.mean(true[near] ** 2))
    assert not predicted[40].any()


def test_samples_beyond_the_prediction_take_part_in_the_interpolation():
    """At the prediction's end the error is that of a prediction that goes on: the acceleration is continued."""
    slope = np.tile(0.3 * NODE_TIMES[:, None], 3)  # no error anywhere but where the rates end
    half = NODES * COUNT // 2
    rotation = PredictedRotation(NODE_TIMES[:half], slope[:half])
    error = rate_error(rotation, record_of(np.zeros((COUNT, 3))), (delay(0.06),), True)
    assert np.abs(error[8:]).max() < 5e-5


@pytest.mark.parametrize("tau", [0.5 * DT, 0.24 * DT, 1.5 * DT])
def test_the_response_is_the_largest_error_of_a_step_at_any_place(tau):
    """Against steps whose integrals have a closed form, at 33 places within a sample."""
    edges = np.append(0.0, TIME)

    def largest_error(onset):
        exact, read = (
            np.diff(0.5 * np.maximum(edges - d - onset, 0.0) ** 2)[:, None] / DT * np.ones(3) for d in (0.0, tau)
        )
        corrected = delay(tau).effect.corrected({"tau": tau}, TIME, np.zeros((COUNT, 3)), read)[1]
        return np.abs(exact - corrected)[8:-8].max()  # the rates end at the end of the record

    true = max(largest_error(DT * (40.0 + place)) for place in np.linspace(0.0, 1.0, 33))
    response = step_response(record_of(np.zeros((COUNT, 3))), (delay(tau),), True)
    assert 0.8 * true < response < 1.2 * true


def test_without_a_delay_there_is_no_response():
    record = record_of(np.zeros((COUNT, 3)))
    assert step_response(record, (), True) == 0.0
    assert step_response(record, (delay(0.06, "second"),), True) == 0.0
    assert step_response(record, (delay(0.06),), False) == 0.0


# --- samples of another clock ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("length", "phase"), [(DT, 0.05), (0.1, 0.0), (0.2, 0.03)])
def test_the_error_of_samples_that_end_inside_the_bins_is_predicted(length, phase):
    acceleration = triangle_wave()
    angles = [a.antiderivative(2) for a in acceleration]
    time = np.arange(length + phase, DT * COUNT, length)
    zeros = np.zeros(len(time))
    mean_rate = np.column_stack([(a(time) - a(time - length)) / length for a in angles])
    record = ImuRecord(
        "second", time, np.full(len(time), length), np.zeros((len(time), 3)), mean_rate, np.zeros((len(time), 3)),
        zeros, zeros, zeros, zeros.astype(bool), zeros.astype(bool), zeros.astype(int), ("second",), zeros.astype(int),
        ("test",), (SensorErrors(),),
    )  # fmt: skip
    edges = np.append(0.0, TIME)
    bins = TimeBins(edges, np.ones(COUNT, bool))
    true = np.column_stack([np.diff(a(edges)) / DT for a in angles]) - bin_means_of_readings(bins, record, mean_rate)
    rotation = PredictedRotation(NODE_TIMES, np.column_stack([a(NODE_TIMES) for a in acceleration]))
    predicted = resampling_error(rotation, bins, record, np.zeros_like(mean_rate))
    inside = np.isfinite(true).all(axis=1)
    assert inside.sum() > 70 and not predicted[~inside].any()
    size = np.sqrt(np.mean(true[inside] ** 2))
    assert size > 3e-4  # rad/s: several sigmas of a gyro
    assert np.sqrt(np.mean((predicted - true)[inside] ** 2)) < 0.15 * size


def test_samples_that_end_where_bins_end_have_no_error():
    rotation = PredictedRotation(NODE_TIMES, np.column_stack([a(NODE_TIMES) for a in triangle_wave()]))
    bins = TimeBins(np.append(0.0, TIME), np.ones(COUNT, bool))
    none = resampling_error(rotation, bins, record_of(np.zeros((COUNT, 3))), np.zeros((COUNT, 3)))
    assert np.abs(none).max() < 1e-12


# --- lever arms ------------------------------------------------------------------------------------------------------


def test_the_lever_arm_of_rates_that_are_shifted_in_time_is_predicted():
    acceleration, tau = triangle_wave(), 0.5 * DT
    _, exact = motion(acceleration)
    read = delayed_means(acceleration, tau)
    corrected = delay(tau).effect.corrected({"tau": tau}, TIME, np.zeros((COUNT, 3)), read)[1]
    samples, places = samples_of(corrected), np.tile(ARM, (COUNT, 1))
    true = exact - lever_arm_acceleration(samples.interval, corrected, places, samples.unit)
    alpha = np.column_stack([a(NODE_TIMES) for a in acceleration])
    of_rates = rate_error(PredictedRotation(NODE_TIMES, alpha), record_of(read), (delay(tau),), True)
    (predicted,) = lever_arm_errors(samples, NODE_TIMES, alpha, [places], of_rates)
    inside = slice(8, COUNT - 8)
    assert np.sqrt(np.mean((predicted - true)[inside] ** 2)) < 0.15 * np.sqrt(np.mean(true[inside] ** 2))


def test_the_error_at_changes_of_slope_is_predicted():
    acceleration = triangle_wave()
    mean_rate, exact = motion(acceleration)
    samples, places = samples_of(mean_rate), np.tile(ARM, (COUNT, 1))
    true = exact - lever_arm_acceleration(samples.interval, mean_rate, places, samples.unit)
    alpha = np.column_stack([a(NODE_TIMES) for a in acceleration])
    (predicted,) = lever_arm_errors(samples, NODE_TIMES, alpha, [places])
    inside = slice(EDGE_REACH, COUNT - EDGE_REACH)
    size = np.sqrt(np.mean(true[inside] ** 2))
    assert size > 0.02  # m/s²: several sigmas of an accelerometer
    assert np.sqrt(np.mean((predicted - true)[inside] ** 2)) < 0.1 * size


def test_a_smooth_motion_has_none():
    w = 2.0 * np.pi * 0.7
    alpha = np.column_stack([3.0 * np.sin(w * NODE_TIMES + phase) for phase in (0.0, 1.0, 2.0)])
    edges = np.append(0.0, TIME)
    mean_rate = np.column_stack([np.diff(-3.0 * np.sin(w * edges + p) / w**2) / DT for p in (0.0, 1.0, 2.0)])
    (predicted,) = lever_arm_errors(samples_of(mean_rate), NODE_TIMES, alpha, [np.tile(ARM, (COUNT, 1))])
    assert np.abs(predicted).max() < 3e-3


def test_a_place_at_the_centre_of_mass_and_times_without_prediction_have_none():
    alpha = np.column_stack([a(NODE_TIMES) for a in triangle_wave()])
    samples, places = samples_of(np.zeros((COUNT, 3))), np.tile(ARM, (COUNT, 1))
    half = NODES * COUNT // 2
    at_centre, at_place = lever_arm_errors(samples, NODE_TIMES[: half + 1], alpha[: half + 1], [0.0 * places, places])
    assert np.all(at_centre == 0.0) and np.any(at_place != 0.0)
    assert np.all(at_place[:EDGE_REACH] == 0.0) and np.all(at_place[COUNT // 2 - EDGE_REACH :] == 0.0)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_it_is_linear_in_a_slow_rotation(factor):
    """Products of rates are of second order; without them it is proportional to the angular acceleration."""
    alpha = 1e-4 * np.column_stack([a(NODE_TIMES) for a in triangle_wave()])
    samples, places = samples_of(np.zeros((COUNT, 3))), [np.tile(ARM, (COUNT, 1))]
    (single,), (scaled,) = (lever_arm_errors(samples, NODE_TIMES, f * alpha, places) for f in (1.0, factor))
    np.testing.assert_allclose(scaled, factor * single, atol=1e-3 * np.abs(single).max())


def no_errors(rotation, bins, samples, records, effects):
    none = (np.zeros((len(bins.interval), 3)),) * len(records)
    at_nodes = np.zeros((FINE_NODES_PER_BIN * len(bins.interval) + 1, 3))
    return InterpolationErrors(none, none, (0.0,) * len(none), at_nodes, at_nodes)


def thinned(imu, per_sample, first=0, begin=0.0):
    """Means over so many samples of an IMU, from sample `first` on, that end after `begin`, s."""
    count = (len(imu.time) - first) // per_sample
    used = slice(first, first + count * per_sample)
    time = imu.time[used][per_sample - 1 :: per_sample]
    force, rate = (
        values[used].reshape(count, per_sample, 3).mean(axis=1) for values in (imu.specific_force, imu.angular_rate)
    )
    kept = time > begin
    return replace(
        imu, time=time[kept], specific_force=force[kept], angular_rate=rate[kept],
        sample_interval=per_sample * imu.sample_interval, accelerometer_noise=imu.accelerometer_noise / per_sample**0.5,
        gyro_noise=imu.gyro_noise / per_sample**0.5,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("per_sample", "first", "begin"), [(4, 0, 0.0), (5, 2, 0.0), (8, 0, 0.0), (5, 2, 100.0)])
def test_imus_with_different_clocks_agree(tmp_path, per_sample, first, begin):
    """The driving IMU reads at 8 Hz, the second one at 10, 8 (50 ms later) and 5 Hz, or from 100 s on.

    The noise of parts of a longer sample is smaller than that of independent samples, which is assumed.
    """
    contents = simulate(Scenario.load("builtin:mer", ["sampling.interval_s=0.025"]), (), 11).contents
    imus = {
        "primary": thinned(contents.imus["primary"], 5),
        "secondary": thinned(contents.imus["secondary"], per_sample, first, begin),
    }
    path = write_flight_file(tmp_path / "flight.h5", replace(contents, imus=imus))
    rms = model_rms(
        linearization.linearize(load_case(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])))
    )
    for name in ("secondary_force_x", "secondary_rate_x", "secondary_rate_y", "secondary_rate_z"):
        assert (0.4 if per_sample > 5 else 0.8) < rms[name] < 1.2, (name, rms[name])


@pytest.mark.slow
def test_forces_of_a_flight_with_large_angles_agree_with_the_true_model(tmp_path, monkeypatch):
    """The vehicle swings by 33 degrees at the peak of the dynamic pressure; without the correction the forces fail."""
    hidden = EffectInstance(find_effect("normal_force_scale"), {"k": 0.35})
    path = simulate(Scenario.load("builtin:mer"), (hidden,), 3).write(tmp_path / "flight.h5")
    case = load_case(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]), (hidden,))
    corrected = model_rms(linearization.linearize(case))
    monkeypatch.setattr(linearization, "interpolation_errors", no_errors)
    interpolated = model_rms(linearization.linearize(case))
    for name in ("force_x", "force_y", "force_z", "secondary_force_x", "secondary_force_y", "secondary_force_z"):
        assert 0.9 < corrected[name] < 1.2, name
        assert interpolated[name] > 2.0, name


@pytest.mark.slow
@pytest.mark.parametrize("imu", [None, "secondary"])
def test_a_model_with_gyros_that_are_late_by_half_a_sample_holds(tmp_path, monkeypatch, imu):
    hidden = delay(0.06, imu)
    path = simulate(Scenario.load("builtin:mer"), (hidden,), 3).write(tmp_path / "flight.h5")
    case = load_case(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]), (hidden,))
    assert linearization.linearize(case).excess_variance.is_zero
    monkeypatch.setattr(linearization, "interpolation_errors", no_errors)
    assert not linearization.linearize(case).holds


@pytest.mark.slow
def test_checking_rates_have_noise_where_the_place_of_the_step_between_two_tables_is_uncertain(tmp_path, monkeypatch):
    """The variance of the largest error of that step, within the bins in which either table may apply."""
    hidden = delay(0.06, "secondary")
    path = simulate(Scenario.load("builtin:mer"), (hidden,), 3).write(tmp_path / "flight.h5")
    changes = [f"telemetry.path={path}", "atmosphere.density_sigma=0.1"]
    case = load_case(Mission.load("builtin:practice_mer", changes), (hidden,))
    point = smoothed_point(case.reconstruction)
    model, errors = linearization.linearize_at(case, point), linearization.interpolation_errors

    def without_steps(*arguments):
        return replace(errors(*arguments), step_response=(0.0, 0.0))

    monkeypatch.setattr(linearization, "interpolation_errors", without_steps)
    without = linearization.linearize_at(case, point)
    difference = model.state_space.row_noise - without.state_space.row_noise
    rows = model.index.bin_rows
    changed = np.unique(np.nonzero(difference)[0])
    assert set(changed) <= set(rows[:, 9:12][rows[:, 9:12] >= 0].tolist()) and len(changed) > 20
    assert np.ptp(model.index.time[changed]) < 20.0
    response = step_response(case.reconstruction.telemetry.checking[0], (hidden,), False)
    step = np.abs(model.jacobian.rate_step_by_regime / model.bins.interval[:-1, None])
    near = np.abs(model.bins.edges[1:-1] - np.mean(model.index.time[changed])) < 10.0
    assert 0.3 < np.sqrt(difference.max()) / (response * step[near].max()) <= 1.001
