"""MAP fits on a simulated flight: along a curved ridge of the posterior, and where no point is credible."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from late_torque import TORQUE

from edl_filter import Mission
from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.selection import map_fit as module
from edl_filter.diagnosis.selection.map_fit import (
    NullModelFit,
    fit_linear,
    fit_map,
    fit_null_model,
    most_probable_null,
)
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import append_constant_states
from edl_filter.estimation.regression import regress
from edl_filter.simulation import Scenario, simulate

TRUTH = {"sx": 1.2e-3, "sy": -4e-4, "sz": 7e-4}


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A spinning vehicle whose gyros have a scale error, linearised with half of that error in the model."""
    scale = find_effect("gyro_scale")
    path = tmp_path_factory.mktemp("fit") / "flight.h5"
    simulate(Scenario.load("builtin:mer"), [EffectInstance(scale, TRUTH)], 11).write(path)
    half = EffectInstance(scale, {name: 0.5 * value for name, value in TRUTH.items()})
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
    return linearize(load_case(mission, (half,)), iterations=2)


@pytest.fixture(scope="module")
def fit(model):
    """The model's effects fitted, with the linearisation point."""
    return fit_map(model, model.effects, model.fitted_noise_filter, moving=True)


def test_parameters_that_the_initial_state_compensates_are_estimated(model, fit):
    """A scale about x changes the roll by degrees, and the initial roll compensates that: both must move."""
    estimates, start = fit.parameters(("gyro_scale", None)), fit.point.start
    errors = {name: (estimates[name][0] - true) / estimates[name][1] for name, true in TRUTH.items()}
    assert max(map(abs, errors.values())) < 4.0, errors
    assert estimates["sx"][1] < 0.1 * TRUTH["sx"]
    change = start.minus(model.point.start)
    assert abs(change[8]) + abs(change[6]) > 1e-4


def test_a_fit_from_the_estimates_stays_there(model, fit):
    again = fit_map(model, fit.effects, model.fitted_noise_filter, moving=True)
    for name, (value, sigma) in fit.parameters(("gyro_scale", None)).items():
        assert again.parameters(("gyro_scale", None))[name][0] == pytest.approx(value, abs=0.5 * sigma)


def test_without_a_credible_point_the_effects_stay_as_they_are(model, monkeypatch):
    """And nothing is raised."""
    monkeypatch.setattr(module, "at_map_point", lambda *_, **__: None)
    fit = fit_map(model, model.effects, model.fitted_noise_filter, moving=True)
    assert fit.effects == model.effects
    assert np.isfinite(fit.evidence)


@pytest.mark.parametrize("name", ["rolling_moment", "pitching_moment_scale", "axial_force_scale"])
def test_for_a_linear_effect_the_fit_is_a_regression(model, name):
    """Laplace's approximation of the evidence is exact then, and one step suffices."""
    candidate, whiten = EffectInstance(find_effect(name), {}), model.stated_noise_filter
    fixed = tuple(replace(a, fixed=True) for a in model.effects)
    without, fit = (fit_map(model, effects, whiten) for effects in (fixed, (*fixed, candidate)))
    assert without.names == () and without.columns.shape[1] == 0
    log_likelihood = whiten.log_likelihood(model.white_residuals(whiten))
    of_readings = model.case.log_abs_det_jacobian(model.effects)  # the density is that of the readings
    assert without.evidence == pytest.approx(log_likelihood + of_readings, rel=1e-12) and abs(of_readings) > 1.0
    linear = regress(without.white, fit.columns, fit.sigma)
    assert fit.evidence - without.evidence == pytest.approx(linear.gain, abs=1e-6)
    assert fit.gain_over_zero((name, None)) == pytest.approx(linear.gain, abs=1e-6)  # Savage-Dickey is exact here
    np.testing.assert_allclose(fit.covariance, linear.covariance, rtol=1e-6)
    np.testing.assert_allclose(fit.parameter_sigma, np.sqrt(np.diag(linear.covariance)), rtol=1e-6)
    estimates = [fit.parameters((name, None))[q][0] for _, q in fit.names]
    np.testing.assert_allclose(estimates, linear.estimate, atol=1e-5 * fit.parameter_sigma.min())
    np.testing.assert_allclose(fit.white, without.white - fit.columns @ linear.estimate, atol=1e-5)


def test_a_wave_of_negative_amplitude_is_returned_with_a_positive_one(model):
    """With its columns and covariance: they agree with the values that are returned."""
    wave = find_effect("density_wave")
    start = {"A": 0.01, "L": 12e3, "phase": 1.0}
    opposite = {"A": -0.01, "L": 12e3, "phase": 1.0 + np.pi}
    positive, negative = (
        fit_map(model, (*model.effects, EffectInstance(wave, values)), model.stated_noise_filter, steps=1)
        for values in (start, opposite)
    )
    assert positive.parameters(("density_wave", None))["A"][0] >= 0.0
    first_step = positive.parameters(("density_wave", None))
    assert all(first_step[name][0] != value for name, value in start.items())  # of the sizes and of the places
    i, k = (positive.names.index((("density_wave", None), name)) for name in ("A", "phase"))
    for name, (value, sigma) in positive.parameters(("density_wave", None)).items():
        assert negative.parameters(("density_wave", None))[name] == pytest.approx((value, sigma), rel=1e-3)
    np.testing.assert_allclose(
        negative.columns[:, i], positive.columns[:, i], atol=1e-4 * np.abs(positive.columns[:, i]).max()
    )
    assert negative.covariance[i, k] == pytest.approx(positive.covariance[i, k], rel=1e-2)


def test_after_the_step_of_all_parameters_there_is_one_of_the_sizes_alone():
    """If some parameters are places: their columns are left out of the second step."""
    columns = np.random.default_rng(12).standard_normal((20, 3))
    information, gradient = columns.T @ columns, np.array([1.0, -2.0, 0.5])

    def steps_of(kinds):
        free = [(("effect", None), SimpleNamespace(kind=kind)) for kind in kinds]
        return list(module._gauss_newton_steps(information, gradient, free))

    together = np.linalg.solve(information, gradient)
    first, second = steps_of(["size", "time", "size"])
    np.testing.assert_allclose(first, together)
    np.testing.assert_allclose(second[[0, 2]], np.linalg.solve(information[::2, ::2], gradient[::2]))
    assert second[1] == 0.0
    for kinds in (["size"] * 3, ["time"] * 3):
        (only,) = steps_of(kinds)
        np.testing.assert_allclose(only, together)


# --- the share that an effect explains ------------------------------------------------------------------------------


@pytest.mark.parametrize(("likelihood", "share"), [(100.0, 0.0), (90.0, 0.0), (150.0, 0.5), (200.0, 1.0), (300.0, 1.0)])
def test_the_explained_share_is_linear_up_to_the_likelihood_of_a_model_that_holds(likelihood, share):
    null = NullModelFit(0.0, 0.0, 0.3, white_log_likelihood=100.0, holding_log_likelihood=200.0)
    assert null.explained_share(likelihood) == pytest.approx(share)


def test_the_explained_share_has_no_least_deficit():
    null = NullModelFit(0.0, 0.0, 0.3, white_log_likelihood=100.0, holding_log_likelihood=100.5)
    assert null.explained_share(100.25) == pytest.approx(0.5)


def test_where_nothing_is_left_to_explain_everything_is_explained():
    assert NullModelFit(0.0, 0.0, 0.0, 200.0, 150.0).explained_share(210.0) == 1.0


def test_the_most_probable_null_model_has_the_largest_likelihood_with_white_noise():
    """Its evidence is at the noise that it shows; the share of an effect is computed with white excess variance."""
    nulls = [NullModelFit(10.0, 9.0, 0.3, 7.0, 50.0), NullModelFit(12.0, 8.0, 0.3, 5.0, 60.0)]
    best = most_probable_null(nulls)
    assert (best.evidence, best.holding_log_likelihood, best.white_log_likelihood) == (12.0, 60.0, 7.0)


def test_a_point_that_would_lose_evidence_does_not_move(model, monkeypatch):
    """As where the chord iteration diverges: here it ends a hundred metres off the most probable point."""

    def displaced(current, whiten, white, effects):
        shift = np.zeros(model.nuisance.layout.size)
        shift[0] = 100.0
        return current.at_point(replace(current.point, start=current.point.start.plus(shift)), effects)

    bias = EffectInstance(find_effect("accelerometer_bias"), {"bx": 2e-3})
    effects = (*(replace(a, fixed=True) for a in model.effects), bias)
    fixed = fit_map(model, effects, model.fitted_noise_filter)
    monkeypatch.setattr(module, "at_map_point", displaced)
    moving = fit_map(model, effects, model.fitted_noise_filter, moving=True)
    assert moving.evidence == pytest.approx(fixed.evidence, abs=model.settings.fit_convergence_nats)
    assert moving.point is model.point


# --- one further effect about the point where the model holds --------------------------------------------------------


def test_the_linear_gain_is_the_marginal_likelihood_of_the_augmented_state_space(model):
    """The effect's sizes as constant states with their priors: another computation of the same ratio."""
    fixed = replace(model, effects=tuple(replace(a, fixed=True) for a in model.effects))
    torque = EffectInstance(find_effect("rolling_moment"), {"k": 1e-4})
    fit = fit_linear(fixed, torque, model.stated_noise_filter, null_evidence=0.0)
    jacobian = effect_jacobian(fixed, torque.at_zero())
    augmented = whitening_filter(append_constant_states(model.state_space, jacobian.rows, jacobian.sigma))
    before, after = (w.log_likelihood(model.white_residuals(w)) for w in (model.stated_noise_filter, augmented))
    assert fit.evidence == pytest.approx(after - before, abs=1e-6)
    assert [name for _, name in fit.names] == list(jacobian.names)
    np.testing.assert_allclose(
        fit.white,
        model.white_residuals(model.stated_noise_filter)
        - fit.columns @ [fit.parameters(("rolling_moment", None))[name][0] for name in jacobian.names],
        atol=1e-9,
    )


def test_places_of_a_linear_fit_move_by_the_estimates_of_the_regression(model):
    wave = EffectInstance(find_effect("density_wave"), {"A": 0.01, "L": 12e3, "phase": 1.0})
    fit = fit_linear(model, wave, model.stated_noise_filter, null_evidence=0.0)
    linear = regress(model.white_residuals(model.stated_noise_filter), fit.columns, fit.sigma)
    change = dict(zip((name for _, name in fit.names), linear.estimate, strict=True))
    values = fit.effects[-1].values
    assert values["phase"] == pytest.approx(1.0 + change["phase"], abs=1e-9) and abs(change["phase"]) > 1e-3
    assert values["L"] == pytest.approx(12e3 + change["L"], rel=1e-9) and abs(change["L"]) > 1.0


def test_places_of_a_linear_fit_stay_within_their_bounds_and_their_order(model):
    wind = EffectInstance(find_effect("wind"), {"east": 5.0, "north": 0.0, "h_lo": 59.9e3, "h_hi": 60.2e3})
    fit = fit_linear(model, wind, model.stated_noise_filter, null_evidence=0.0)
    values = fit.effects[-1].values
    assert values["h_lo"] <= 60e3 and values["h_lo"] < values["h_hi"] <= 100e3
    assert fit.parameter_sigma.shape == (4,)


def test_a_fit_that_starts_beyond_the_bounds_begins_at_them(model):
    """A screening is linear: it can return an amplitude with which the density would be negative."""
    wave = EffectInstance(find_effect("density_wave"), {"A": 1.16, "L": 20e3, "phase": 4.7})
    fit = fit_map(model, (*model.effects, wave), model.fitted_noise_filter, steps=1)
    assert np.all(np.isfinite(fit.columns)) and np.isfinite(fit.evidence)
    assert abs(fit.parameters(("density_wave", None))["A"][0]) <= 0.9


def test_the_evidence_of_a_linear_fit_at_a_bound_is_that_at_the_limited_size(model):
    """With the quadratic form of Laplace's approximation: the log posterior falls by half the squared distance."""
    scale = find_effect("axial_force_scale")
    (k,) = scale.sizes
    narrow = type("NarrowScale", (type(scale),), {"parameters": (replace(k, low=-1e-7, high=1e-7),)})()
    free, limited = (
        fit_linear(model, EffectInstance(e, {}), model.stated_noise_filter, null_evidence=0.0) for e in (scale, narrow)
    )
    estimate, sigma = free.parameters((scale.name, None))["k"]
    assert abs(estimate) > 1e-7, "the bound must act"
    expected = np.copysign(1e-7, estimate)
    assert limited.parameters((scale.name, None))["k"] == pytest.approx((expected, sigma), rel=1e-9)
    loss = 0.5 * ((estimate - expected) / sigma) ** 2
    assert free.evidence - limited.evidence == pytest.approx(loss, rel=1e-6)
    np.testing.assert_allclose(free.white - limited.white, free.columns[:, 0] * (expected - estimate), atol=1e-9)


# --- times ----------------------------------------------------------------------------------------------------------


def test_the_null_model_pays_the_penalty_of_its_noise(late_model):
    """Evidence and likelihood are those of the fit less the cost of variances and colour; the share has no penalty."""
    whiten, penalty = late_model.fitted_noise_filter, late_model.noise_penalty
    assert penalty >= late_model.excess_variance.penalty > 5.0
    null = fit_null_model(late_model, late_model.effects)
    steps = late_model.settings.null_fit_iterations
    fit = fit_map(late_model, late_model.effects, whiten, steps=steps)
    assert null.evidence == pytest.approx(fit.evidence - penalty, abs=1e-6)
    assert null.log_likelihood == pytest.approx(whiten.log_likelihood(fit.white) - penalty, abs=1e-6)
    assert null.white_log_likelihood == late_model.white_excess_log_likelihood


def test_the_likelihood_of_the_null_model_is_that_of_the_measured_readings(model, fit, monkeypatch):
    """The determinant of the map of the readings is in it: that of the gyros' scale errors is large."""
    monkeypatch.setattr(module, "fit_map", lambda *_, **__: fit)
    null = fit_null_model(model, model.effects)
    of_readings = model.case.log_abs_det_jacobian(fit.effects)
    expected = model.fitted_noise_filter.log_likelihood(fit.white) + of_readings - model.noise_penalty
    assert null.log_likelihood == pytest.approx(expected, abs=1e-6) and abs(of_readings) > 1.0


def test_the_variance_of_a_time_contains_the_spacing_of_the_nodes(late_model):
    """A time between two nodes is distributed uniformly: a twelfth of the squared spacing."""
    fit = fit_map(late_model, late_model.effects, late_model.fitted_noise_filter, steps=1)
    linear = np.linalg.inv(fit.columns.T @ fit.columns + np.diag(1.0 / fit.sigma**2))
    spacing = np.median(late_model.bins.interval) / NODES_PER_BIN
    expected = [spacing**2 / 12.0 if name == "t0" else 0.0 for _, name in fit.names]
    tolerance = 1e-6 * np.sqrt(np.outer(np.diag(linear), np.diag(linear)))
    assert np.all(np.abs(fit.covariance - linear - np.diag(expected)) <= tolerance)
    assert max(expected) > 1e-3 * linear.max()


@pytest.mark.parametrize("nodes_off", [-4, -1, 1, 3])
def test_a_time_ends_between_the_nodes_of_the_largest_likelihood(late_model, nodes_off):
    """The likelihood is a step function of the time: it is searched from node to node, within a time bin."""
    nodes = late_model.residuals.nodes.time
    k = int(np.searchsorted(nodes, TORQUE["t0"]))
    (late,) = late_model.effects
    start = replace(
        late, values=late.values | TORQUE | {"t0": 0.9 * nodes[k + nodes_off] + 0.1 * nodes[k + nodes_off - 1]}
    )
    fit = fit_map(late_model, (start,), late_model.fitted_noise_filter)
    assert fit.effects[0].values["t0"] == pytest.approx(0.5 * (nodes[k - 1] + nodes[k]), abs=1e-9)
