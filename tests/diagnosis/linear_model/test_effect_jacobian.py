"""Jacobians of effects on the shipped flight: against differences of whole residuals; places of the scan grid."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from edl_filter.diagnosis.linear_model import effect_jacobian as effect_jacobian_module
from edl_filter.diagnosis.linear_model.effect_jacobian import (
    effect_jacobian,
    effect_jacobians,
    is_ordered,
    prior_sigma,
    scan_grid,
    scan_range,
)
from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.prediction.dead_reckoning import corrected_readings, node_rates
from edl_filter.diagnosis.prediction.predicted_readings import predict
from edl_filter.diagnosis.prediction.reading_difference import difference_on_fixed_path
from edl_filter.diagnosis.prediction.residuals import bin_readings, compute_residuals, own_lever_arm
from edl_filter.effects import Effect, EffectInstance, Parameter
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()


@pytest.fixture(scope="module")
def case(practice_06):
    """The shipped flight."""
    return flight_case(practice_06)


@pytest.fixture(scope="module")
def model(case):
    """The shipped flight, linearised."""
    return linearize(case)


def residuals_with(model, inputs_of, *effects):
    """All residuals with effects in the model, from the same initial state: the whole chain again."""
    return model.index.stack(compute_residuals(model.reference, inputs_of(effects)))


def rows_of(model, *channels):
    rows = model.index.bin_rows[:, list(channels)]
    return rows[rows >= 0]


FORCE, MOMENT, CHECKING_FORCE, CHECKING_RATE = (0, 1, 2), (3, 4, 5), (6, 7, 8), (9, 10, 11)


def test_columns_are_minus_the_derivative_of_the_residuals(case, model):
    """Of an effect that does not change the path, evaluated on the existing one."""
    effect = find_effect("pitching_moment_scale")
    j = effect_jacobian(model, EffectInstance(effect, {}))
    assert j.names == ("k",) and j.sigma == [0.2] and not j.initial_mean.any()
    at_zero, displaced = (residuals_with(model, case.model_inputs, EffectInstance(effect, {"k": k})) for k in (0, 1e-3))
    expected = (at_zero - displaced) / 1e-3
    assert np.linalg.norm(expected - j.rows[:, 0]) < 1e-3 * np.linalg.norm(expected)
    moments = j.rows[rows_of(model, *MOMENT), 0]
    assert np.abs(moments).max() > 1e-3  # rad/s a bin for the whole coefficient
    assert np.delete(j.rows[:, 0], rows_of(model, *MOMENT)) == pytest.approx(0.0, abs=1e-12)


def test_columns_of_a_sensor_effect_are_computed_from_denoised_readings(case, model):
    effect = find_effect("gyro_scale")
    column = effect_jacobian(model, EffectInstance(effect, {}), ["sx"]).rows[:, 0]
    plus, minus = (
        residuals_with(model, case.denoised_inputs, EffectInstance(effect, {"sx": s})) for s in (1e-5, -1e-5)
    )
    np.testing.assert_allclose(column, (minus - plus) / 2e-5, rtol=1e-3, atol=1e-3 * np.abs(column).max())


@pytest.mark.parametrize(
    "values",
    [{}, {"gyro_scale": {"sx": 0.01}}, {"imu_lever_arm": {"x": 0.1}}, {"imu_time_offset": {"tau": 2e-3}}],
    ids=lambda v: next(iter(v), "none"),
)
def test_denoised_readings_have_the_same_edges_and_corrections(case, values):
    """They are prepared in fewer steps; the samples' edges and the corrections by effects must be the same."""
    effects = tuple(EffectInstance(find_effect(name), v) for name, v in values.items())
    inputs, denoised_inputs = case.model_inputs(effects), case.denoised_inputs(effects)
    samples, denoised = inputs.problem.samples, denoised_inputs.problem.samples
    assert np.all(np.isin(samples.time, denoised.time))
    assert denoised.time[0] - denoised.interval[0] == pytest.approx(inputs.problem.initial.time, abs=1e-9)
    same_time = np.searchsorted(denoised.time, samples.time)
    difference = np.abs(denoised.mean_force[same_time] - samples.mean_force)
    assert np.median(difference) < 0.01 < np.max(difference)  # the noise of a sample, and not zero
    assert [r.name for r in inputs.checking] == [r.name for r in denoised_inputs.checking]


@pytest.mark.parametrize("name", ["gyro_bias", "accelerometer_bias"])
def test_columns_of_an_effect_that_is_a_state_too_agree_with_the_states_columns(model, name):
    """The biases are states of the filter: white columns of effect and state must agree.

    Otherwise their small difference would appear as evidence. Computed by differences of the whole chain they differed
    by a thousandth, which was 300 sigmas where the columns themselves were 24.
    """
    effect, state = find_effect(name), model.nuisance.layout[name]
    j = effect_jacobian(model, EffectInstance(effect, {}))
    of_effect = model.stated_noise_filter(j.rows, j.initial_mean) * j.sigma
    unit = np.zeros((model.nuisance.size, 3))
    unit[state] = np.eye(3)
    of_state = -model.stated_noise_filter(np.zeros((len(of_effect), 3)), unit) * j.sigma
    assert np.linalg.norm(of_state, axis=0).min() > 5.0
    assert np.linalg.norm(of_effect - of_state, axis=0).max() < 0.5


def test_the_derivative_is_about_the_effects_value(model):
    """Force over mass falls with the square of the mass: the slope at ``k`` is that at zero over ``(1 + k)²``."""
    effect = find_effect("mass")
    at_zero, heavy = (effect_jacobian(model, EffectInstance(effect, {"k": k})).rows[:, 0] for k in (0.0, 0.25))
    np.testing.assert_allclose(heavy, at_zero / 1.25**2, rtol=1e-3, atol=1e-9 + 1e-5 * np.abs(at_zero).max())
    assert np.abs(at_zero[rows_of(model, 0)]).max() > 1.0  # m/s²: the deceleration itself


def test_an_effect_in_the_model_is_replaced_and_not_added(model):
    heavy = EffectInstance(find_effect("mass"), {"k": 0.25})
    with_effect = replace(model, effects=(heavy,), inputs=model.model_inputs((heavy,)))
    np.testing.assert_allclose(effect_jacobian(with_effect, heavy).rows, effect_jacobian(model, heavy).rows, atol=1e-12)


@pytest.mark.parametrize("name", ["density_scale", "atmosphere_rotation", "wind"])
def test_a_change_of_the_air_acts_by_the_jacobian_of_the_nuisance_parameters(model, name):
    """In the model or not: a density scale is the nuisance density everywhere, and must be known no better than it."""
    instance = EffectInstance(find_effect(name), {"h_lo": 5e3, "h_hi": 60e3} if name == "wind" else {})
    with_effect = replace(model, effects=(instance,), inputs=model.model_inputs((instance,)))
    rows = effect_jacobian(model, instance).rows
    np.testing.assert_allclose(effect_jacobian(with_effect, instance).rows, rows, atol=1e-9 * np.abs(rows).max())
    if name == "density_scale":
        used = model.index.bin_rows[:, 0] >= 0
        expected = model.jacobian.force[used, 0, model.jacobian.columns["density"].start]
        np.testing.assert_allclose(rows[model.index.bin_rows[used, 0], 0], expected, rtol=1e-6)


def test_a_bias_acts_on_its_own_sensor_and_otherwise_by_the_path_alone(model):
    """An accelerometer's bias is in the force itself; by the velocity it changes the direction of the flow."""
    j = effect_jacobian(model, EffectInstance(find_effect("accelerometer_bias"), {}))
    assert j.names == ("bx", "by", "bz")
    without_air = model.index.time < 30.0
    assert without_air[model.index.bin_rows[:, 0]].sum() > 50
    for axis in range(3):
        column = j.rows[:, axis]
        for channel in range(3):
            rows = rows_of(model, channel)
            expected = float(channel == axis)  # scale and misalignment as they were estimated: some 1e-4
            np.testing.assert_allclose(column[rows[without_air[rows]]], expected, atol=3e-3)
        moments = rows_of(model, *MOMENT)
        np.testing.assert_allclose(column[moments[without_air[moments]]], 0.0, atol=1e-5)
        np.testing.assert_allclose(column[rows_of(model, *CHECKING_RATE)], 0.0, atol=1e-12)
        for channel in range(3):  # relative to the driving IMU the checking one has the opposite error
            rows = rows_of(model, CHECKING_FORCE[channel])
            np.testing.assert_allclose(column[rows], -float(channel == axis), atol=3e-3)


def test_a_bias_of_the_accelerometers_does_not_change_the_measured_rates(model):
    """The moments' rows change because the prediction on another path does, and for nothing else."""
    effect = find_effect("accelerometer_bias")
    measured, predictions = [], []
    for bx in (-0.01, 0.01):
        inputs = model.model_inputs([EffectInstance(effect, {"bx": bx})])
        residuals = compute_residuals(model.reference, inputs)
        predictions.append(residuals.predicted_rate_step)
        measured.append(residuals.rate_step + predictions[-1])
    np.testing.assert_allclose(measured[0], measured[1], rtol=0.0, atol=1e-14, equal_nan=True)
    assert np.nanmax(np.abs(predictions[0] - predictions[1])) > 1e-6


@pytest.mark.parametrize(
    "name", ["accelerometer_scale", "gyro_scale", "imu_lever_arm", "com_offset", "products_of_inertia"]
)
def test_the_difference_on_a_fixed_path_is_that_of_whole_residuals(case, model, name):
    """Of the driving IMU, of a checking one, and of the vehicle; the path is that without the effect."""
    effect, reference = find_effect(name), model.reference
    for imu in (None, case.reconstruction.telemetry.checking[0].name) if effect.is_sensor_effect else (None,):
        step = effect.sizes[0].sigma
        sides = []
        for sign in (1.0, -1.0):
            inputs = case.denoised_inputs((EffectInstance(effect, {effect.sizes[0].name: sign * step}, imu),))
            readings = corrected_readings(inputs.problem, reference.errors, own_lever_arm(inputs))
            force, rate = bin_readings(model.bins, inputs.problem.samples, readings)
            flow = replace(model.residuals.flow, rate=node_rates(model.bins, rate))
            predicted = predict(inputs.forward_model, model.bins, flow, model.residuals.tables)
            checking = compute_residuals(reference, inputs)  # of readings: they do not depend on the path
            sides.append((inputs, *readings, force - predicted[0], np.diff(rate, axis=0) - predicted[1], checking))
        plus, minus = sides
        change = difference_on_fixed_path(model.bins, plus[:3], minus[:3], model.residuals, effect.is_sensor_effect)
        pairs = [(change.force, plus[3] - minus[3]), (change.rate_step, plus[4] - minus[4])]
        for channel in ("checking_force", "checking_rate"):
            pairs += [
                (c, a - b) for c, a, b in zip(*(getattr(r, channel) for r in (change, plus[5], minus[5])), strict=True)
            ]
        for actual, expected in pairs:  # means over bins are differences of integrals of 1e4 m/s, rounded to 2e-12 m/s
            np.testing.assert_allclose(actual, expected, rtol=0.0, atol=4e-11)
        assert max(np.nanmax(np.abs(expected)) for _, expected in pairs) > 1e-5


@pytest.mark.parametrize("driving", [True, False])
@pytest.mark.parametrize("name", ["accelerometer_bias", "accelerometer_scale", "accelerometer_misalignment"])
def test_a_stated_error_of_an_imu_has_the_column_of_its_effect_where_two_are_compared(case, model, name, driving):
    """Both act on the reading at the place of the IMU, whose lever-arm acceleration is up to 0.7 m/s²."""
    imu = None if driving else case.reconstruction.telemetry.checking[0].name
    rows = effect_jacobian(model, EffectInstance(find_effect(name), {}, imu)).rows
    part = model.nuisance.layout[name] if driving else model.nuisance[f"checking0.0_{name}"]
    used = (np.abs(rows).max(axis=1) > 1e-6) & np.isin(model.index.column, (6, 7, 8))
    difference = model.state_space.design[used][:, part] - rows[used]
    assert np.sqrt(np.mean(difference**2)) < 0.01 and np.abs(rows[used]).max() >= 0.999


def test_jacobians_of_several_processes_are_those_of_this_one(model, monkeypatch):
    """In their order, of effects that change the path and of others; the expensive ones are kept about the point."""
    names = ("accelerometer_scale", "wind", "gyro_bias", "mass")
    instances = [(EffectInstance(find_effect(n), {}), None) for n in names]
    instances.append((instances[0][0], ["sy"]))
    fresh, divided = replace(model, computed_jacobians={}), []

    def in_a_copy(function, items):
        values = pickle.loads(pickle.dumps([function(i) for i in items]))
        fresh.computed_jacobians.clear()  # what a copy keeps is lost with it
        divided.append([instances[i][0].name for i in items])
        return values

    monkeypatch.setattr(effect_jacobian_module, "map_processes", in_a_copy)
    jacobians = effect_jacobians(fresh, instances)
    assert [j.instance.name for j in jacobians] == [*names, "accelerometer_scale"]
    for j, (instance, chosen) in zip(jacobians, instances, strict=True):
        expected = effect_jacobian(replace(model, computed_jacobians={}), instance, chosen)
        assert j.names == expected.names
        for name in ("rows", "initial_mean", "sigma"):
            np.testing.assert_array_equal(getattr(j, name), getattr(expected, name))
    assert divided == [["accelerometer_scale", "gyro_bias", "mass", "accelerometer_scale"]]
    monkeypatch.setattr(effect_jacobian_module, "_derivative", None)
    monkeypatch.setattr(effect_jacobian_module, "map_processes", lambda function, items: [function(i) for i in items])
    assert [j.instance.name for j in effect_jacobians(fresh, instances[::2])] == [names[0], names[2], names[0]]


def test_an_effect_whose_hooks_fail_is_left_out_or_its_error_raised(model, monkeypatch):
    def derivative(model, instance, *_):
        if instance.name == "wind":
            raise InputError("no wind")
        return np.zeros(model.index.count), np.zeros(model.nuisance.size)

    monkeypatch.setattr(effect_jacobian_module, "_derivative", derivative)
    instances = [(EffectInstance(find_effect(n), {}), None) for n in ("wind", "mass")]
    failed = {}
    assert [j.instance.name for j in effect_jacobians(model, instances, failed)] == ["mass"]
    assert failed == {"wind": "no wind"}
    with pytest.raises(InputError, match="no wind"):
        effect_jacobians(model, instances)


def test_a_jacobian_about_one_point_is_computed_once(model, monkeypatch):
    """Whether an effect of zero size is in the model or not; about another point or other values it is another one."""
    calls = []
    derivative = effect_jacobian_module._derivative
    monkeypatch.setattr(effect_jacobian_module, "_derivative", lambda *args: calls.append(args[2]) or derivative(*args))
    fresh = replace(model, computed_jacobians={})
    scale = EffectInstance(find_effect("accelerometer_scale"), {})
    rows = effect_jacobian(fresh, scale).rows
    np.testing.assert_array_equal(effect_jacobian(fresh.with_effects((scale,)), scale, ["sx", "sy", "sz"]).rows, rows)
    assert calls == ["sx", "sy", "sz"]
    effect_jacobian(fresh, replace(scale, values={"sx": 1e-3}))
    effect_jacobian(fresh.with_effects((replace(scale, values={"sx": 1e-3}),)), scale)
    effect_jacobian(fresh.at_point(fresh.point, ()), scale)
    assert len(calls) == 12


def test_columns_of_several_parameters_are_those_of_each(model):
    effect = find_effect("com_offset")
    all_sizes = effect_jacobian(model, EffectInstance(effect, {}))
    dz = effect_jacobian(model, EffectInstance(effect, {}), ["dz"])
    assert dz.names == ("dz",)
    np.testing.assert_array_equal(dz.rows[:, 0], all_sizes.rows[:, all_sizes.names.index("dz")])


def test_a_rotated_frame_changes_the_stated_initial_mean(model):
    """The only effect on the initial state: position and velocity rotate with the frame, nothing else changes."""
    j = effect_jacobian(model, EffectInstance(find_effect("attitude_frame"), {}), ["rz"])
    nav, layout = model.point.start.nav, model.inputs.problem.layout
    x, y = nav[:2]
    initial_mean = j.initial_mean[:, 0]
    assert np.abs(initial_mean[layout["position"]]) == pytest.approx(np.abs([y, x, 0.0]), rel=1e-4, abs=1.0)
    assert np.abs(initial_mean[layout["velocity"]]) == pytest.approx(np.abs([nav[4], nav[3], 0.0]), rel=1e-4, abs=1e-3)
    assert not initial_mean[layout.size :].any()


class Placed(Effect):
    """An effect with places of all kinds."""

    name = "placed"
    parameters = (
        Parameter("a", "N", "size", 1.0),
        Parameter("h_lo", "m", "from", kind="altitude", low=0.0, high=60e3, scan=4),
        Parameter("h_hi", "m", "to", kind="altitude", low=0.0, high=60e3, scan=4),
        Parameter("t0", "s", "from", kind="time", scan=3),
        Parameter("p", "rad", "phase of a wave", kind="phase", low=0.0, high=2.0 * np.pi, scan=6),
        Parameter("m", "", "not scanned", kind="mach", low=1.0, high=25.0, default=7.0),
    )


def altitudes(lowest):
    """Four altitudes from 3 km below `lowest`, or zero, to 60 km, at increasing distances."""
    first = max(0.0, lowest - 3e3)
    return set(first + (60e3 - first) * (np.arange(4) / 3.0) ** 1.7)


@pytest.mark.parametrize("lowest", [0.0, 8e3])
def test_the_scan_grid_has_all_combinations_of_ordered_places(lowest):
    grid = scan_grid(Placed(), 60.0, 240.0, lowest, SETTINGS)
    assert len(grid) == math.comb(4, 2) * 3 * 6
    assert all(p["h_lo"] < p["h_hi"] for p in grid)
    assert {p["t0"] for p in grid} == {60.0, 150.0, 240.0}  # bounds are the flight's
    scanned = sorted(altitudes(lowest))
    assert {p["h_lo"] for p in grid} == set(scanned[:-1]) and {p["h_hi"] for p in grid} == set(scanned[1:])
    assert {p["m"] for p in grid} == {7.0}
    assert sorted({p["p"] for p in grid}) == pytest.approx(np.arange(6) * np.pi / 3.0)  # the circle is not closed
    assert all("a" not in p for p in grid)


def test_times_are_also_scanned_at_the_changes_within_their_bounds():
    grid = scan_grid(Placed(), 60.0, 240.0, 0.0, SETTINGS, changes=(239.7, 150.0, 12.0, 61.1))
    assert {p["t0"] for p in grid} == {60.0, 61.1, 150.0, 239.7, 240.0}
    assert len(grid) == math.comb(4, 2) * 5 * 6
    assert scan_grid(find_effect("wind"), 60.0, 240.0, 8e3, SETTINGS, changes=(100.0,)) == scan_grid(
        find_effect("wind"), 60.0, 240.0, 8e3, SETTINGS
    )


def test_an_effect_without_places_has_one_combination():
    assert scan_grid(find_effect("gyro_bias"), 0.0, 1.0, 8e3, SETTINGS) == [{}]


def test_waves_are_scanned_at_equal_steps_of_the_wave_number_over_half_a_turn():
    """The sign of the amplitude covers the other half of the turn."""
    grid = scan_grid(find_effect("density_wave"), 60.0, 240.0, 8e3, SETTINGS)
    assert sorted({1.0 / p["L"] for p in grid}) == pytest.approx(np.linspace(1.0 / 25e3, 1.0 / 8e3, 28))
    assert sorted({p["phase"] for p in grid}) == pytest.approx(np.arange(4) * np.pi / 4.0)
    assert len(grid) == 28 * 4


@pytest.mark.parametrize("length", [8.2e3, 8.7e3, 9.9e3, 12.2e3, 17e3, 24e3])
@pytest.mark.parametrize("phase", [0.2, 1.9, 4.04])
def test_a_wave_at_any_place_is_similar_to_one_of_the_scan(length, phase):
    """Over 10 to 70 km of altitude, with at least three quarters of its squared norm: none lies between the places."""
    altitude = np.linspace(10e3, 70e3, 500)
    wave = find_effect("density_wave")

    def shape(places):
        y = wave.density({"A": 1.0, **places}, altitude) - 1.0
        return y / np.linalg.norm(y)

    grid = scan_grid(wave, 60.0, 240.0, 8e3, SETTINGS)
    assert max((shape(p) @ shape({"L": length, "phase": phase})) ** 2 for p in grid) > 0.75


@pytest.mark.parametrize("name", ["wind", "remnant_torque", "density_wave", "static_instability"])
def test_scan_grids_of_the_catalogue(name):
    effect = find_effect(name)
    grid = scan_grid(effect, 60.0, 240.0, 8e3, SETTINGS)
    assert 1 <= len(grid) <= math.prod(max(q.scan, 1) for q in effect.places)
    assert len({tuple(p.items()) for p in grid}) == len(grid)
    assert all(is_ordered(EffectInstance(effect, p)) for p in grid)


def test_the_scan_begins_where_the_air_is_felt(model):
    begin, lowest = scan_range(model)
    flow = model.residuals.flow
    pressure = np.interp(begin + np.array([-0.1, 0.1]), flow.time, flow.dynamic_pressure)
    assert pressure[0] < SETTINGS.scan_start_pressure_pa < pressure[1]
    assert lowest == flow.altitude.min() == pytest.approx(8e3, abs=4e3)


def test_the_order_of_places():
    effect = Placed()
    assert is_ordered(EffectInstance(effect, {"h_lo": 1.0, "h_hi": 2.0}))
    assert not is_ordered(EffectInstance(effect, {"h_lo": 2.0, "h_hi": 2.0}))
    assert not is_ordered(EffectInstance(effect, {"h_lo": 3.0, "h_hi": 2.0}))


def test_the_prior_sigma_of_a_place_is_that_of_a_uniform_distribution():
    by_name = {q.name: q for q in Placed.parameters}
    draws = np.random.default_rng(0).uniform(0.0, 60e3, 100_000)
    assert prior_sigma(by_name["h_lo"]) == pytest.approx(draws.std(), rel=0.01)
    assert prior_sigma(by_name["a"]) == 1.0
    assert np.isfinite(prior_sigma(by_name["t0"]))
