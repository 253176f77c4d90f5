"""The linearisation point: the smoothed reconstruction first, then the most probable nuisance parameters."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from edl_filter import Mission
from edl_filter.diagnosis.linear_model.flight_case import flight_case, load_case
from edl_filter.diagnosis.linear_model.linearization import linearize, linearize_at, map_point
from edl_filter.diagnosis.linear_model.linearization_point import (
    distance_from_stated,
    largest_change,
    nuisance_offset,
    perturbation_from_states,
    smoothed_point,
    states_of_bins,
)
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN, dead_reckon, path_deviation
from edl_filter.estimation.smoothing import smoothed_states
from edl_filter.simulation import Scenario, simulate


@pytest.fixture(scope="module")
def case(practice_06):
    """The shipped flight."""
    return flight_case(practice_06)


@pytest.fixture(scope="module")
def models(case):
    """The flight linearised about the reconstruction, and about the point to which the iteration converges."""
    return linearize(case), linearize(case, iterations=4)


def next_point(model, whiten=None, **options):
    """Most probable nuisance parameters, at the stated noise if no filter is given."""
    whiten = whiten or model.stated_noise_filter
    return map_point(model, whiten, model.white_residuals(whiten), **options)


def posterior_sigma(model):
    size = model.nuisance.layout.size
    return np.sqrt(np.diag(model.stated_noise_filter.posterior_initial_covariance(size)))


def test_the_first_point_is_the_smoothed_reconstruction(case):
    point = smoothed_point(case.reconstruction)
    assert point.perturbation is None
    np.testing.assert_array_equal(point.start.nav, case.reconstruction.smoothed.states[0].nav)
    np.testing.assert_array_equal(point.errors[0], point.start.errors)


def test_the_iteration_converges(models):
    """In posterior sigmas of the initial state, and in stated sigmas of air, tables and vehicle."""
    first, last = (np.abs(next_point(m).start.minus(m.point.start) / posterior_sigma(m)).max() for m in models)
    assert last < 0.3 < first
    point, sigma = models[1].point, models[1].case.uncertainty.sigma
    assert largest_change(point.perturbation, next_point(models[1]).perturbation, sigma) < 0.3
    assert largest_change(None, point.perturbation, sigma) > 0.5  # this flight's density is not the table's


def test_the_distance_from_what_is_stated_is_that_of_the_parameter_farthest_off(models):
    """Of the database, of which the flight sees increments: their largest over the prior sigma at the flown flow."""
    model = models[1]
    sigma, flow, perturbation = model.case.uncertainty.sigma, model.residuals.flow, model.point.perturbation
    assert distance_from_stated(None, flow, sigma) == 0.0
    log_factor = perturbation.density
    density = np.max(np.minimum(np.abs(log_factor), np.abs(np.expm1(log_factor)))) / sigma["density"]
    alone = replace(perturbation, wind=0.0 * perturbation.wind, mass=0.0, inertia=0.0, ca=0.0 * perturbation.ca,
                    cn=0.0 * perturbation.cn, cm=0.0 * perturbation.cm, field=None)  # fmt: skip
    assert distance_from_stated(alone, flow, sigma) == pytest.approx(density, rel=1e-12)
    assert distance_from_stated(perturbation, flow, sigma) >= density
    for size in (-0.5, 0.4):  # the factor and its logarithm have the same relative sigma: the smaller distance
        wrong = replace(alone, density=np.full_like(alone.density, size))
        expected = min(abs(size), abs(np.exp(size) - 1.0)) / sigma["density"]
        assert distance_from_stated(wrong, flow, sigma) == pytest.approx(expected, rel=1e-12)


def test_the_points_density_is_nearer_to_the_truth_than_the_tables(tmp_path):
    """Of a simulated flight, whose density is stored with it."""
    path = simulate(Scenario.load("builtin:mer"), (), 7).write(tmp_path / "flight.h5")
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
    model = linearize(load_case(mission, ()), iterations=4)
    with h5py.File(path) as file:
        truth = {name: file["truth"][name][:] for name in ("time", "density")}
    flow = model.residuals.flow
    felt = flow.dynamic_pressure > 100.0
    true = np.interp(flow.time[felt], truth["time"], np.log(truth["density"]))
    table = np.log(model.inputs.forward_model.atmosphere.density(flow.altitude[felt]))
    assert np.std(np.log(flow.density[felt]) - true) < 0.5 * np.std(table - true)


@pytest.mark.slow
def test_the_onboard_attitude_can_be_excluded(spirit):
    model = linearize(flight_case(spirit))
    layout, start = model.nuisance.layout, model.point.start
    without, with_onboard = (
        next_point(model, model.fitted_noise_filter, onboard=o).start.minus(start) for o in (False, True)
    )
    onboard = np.zeros(layout.size, bool)
    for name in ("onboard_rate", "onboard_mounting", "onboard_attitude"):
        onboard[layout[name]] = True
    assert not without[onboard].any() and with_onboard[onboard].any()
    np.testing.assert_allclose(without[~onboard], with_onboard[~onboard])


def test_there_is_no_point_beyond_the_limits(spirit):
    """At the stated noise Spirit's proxy database, if it were exact, would move the density beyond all belief."""
    changes = ["aerodynamics.coefficient_sigma=0.0", "aerodynamics.discrepancy.asymmetry_sigma=0.0"]
    exact = Mission.load("builtin:mer_a", ["telemetry.path=builtin:mer_a", *changes])
    model = linearize(flight_case(replace(spirit, mission=exact)))
    assert model.field is None and next_point(model) is None
    assert next_point(model, model.fitted_noise_filter) is not None


@pytest.mark.parametrize("limit", ["state_limit_sigmas", "log_density_limit"])
def test_the_limits_are_settings(models, limit):
    first = models[0]
    case = first.case
    mission = case.mission.model_copy(update={"diagnosis": case.settings.model_copy(update={limit: 1e-6})})
    strict = replace(first, case=replace(case, reconstruction=replace(case.reconstruction, mission=mission)))
    assert next_point(first) is not None and next_point(strict) is None


def displaced_by(model, size):
    """The model about a point with a part of the perturbation that is most probable, and with its states."""
    point = next_point(model)
    p = point.perturbation
    against_time = {name: size * getattr(p, name) for name in ("density", "wind", "ca", "cn", "cm", "mass", "inertia")}
    field = p.field
    if field is not None:
        field = replace(field, amplitudes={name: size * a for name, a in field.amplitudes.items()})
    perturbation = replace(p, field=field, **against_time)
    return model.at_point(replace(model.point, perturbation=perturbation, bin_states=size * point.bin_states), ())


@pytest.fixture(scope="module")
def inexact_model(case):
    """The flight with a database, mass and inertia that are not exact."""
    changes = ("aerodynamics.coefficient_sigma=1.0", "vehicle.mass_sigma=4.0", "vehicle.inertia_sigma=0.03")
    return linearize(load_case(Mission.load("builtin:practice_mer", changes), ()))


@pytest.mark.parametrize("name", ["exact", "inexact"])
def test_the_offset_cancels_a_small_perturbation(models, inexact_model, name):
    """Nuisance parameters are measured from what the mission states: residuals do not change, to first order."""
    model = models[0] if name == "exact" else inexact_model
    displaced = displaced_by(model, 1e-2)
    change = np.linalg.norm(displaced.index.stack(displaced.residuals) - model.residual_vector)
    assert change > 1e-2
    assert np.linalg.norm(displaced.residual_vector - model.residual_vector) < 1e-2 * change


def test_the_offset_has_the_means_over_the_bins_of_each_row(inexact_model):
    """By the derivatives of the rows; states that a perturbation has not, and derivatives, are not in the point."""
    model, point = inexact_model, next_point(inexact_model)
    nuisance, states = model.nuisance, point.bin_states
    assert states.shape == (2, len(model.bins.middle), nuisance.size)
    density = nuisance["density"].start
    assert not states[..., :density].any() and states[..., density].any() and not states[..., density + 1].any()
    assert all(states[..., f].any() for f in nuisance.fields.values())
    sigma = model.case.uncertainty.sigma["density"]
    assert states[0, 300, density] * sigma == pytest.approx(np.mean(point.perturbation.density[299:301]))
    offset = nuisance_offset(model.index, model.state_space.design, states)
    for b in (10, 300, 800):
        for mean, rows in zip(states[:, b], (model.index.bin_rows[b, :3], model.index.bin_rows[b, 3:6]), strict=True):
            np.testing.assert_allclose(offset[rows], model.state_space.design[rows, : nuisance.size] @ mean, rtol=1e-12)
    checking = model.index.bin_rows[:, 6:]
    constraints = [row for rows in model.index.constraint_rows for row in range(rows.start, rows.stop)]
    assert constraints and not offset[constraints].any() and not offset[checking[checking >= 0]].any()


@pytest.mark.parametrize("name", ["density", "field"])
def test_the_offset_cancels_a_perturbation_that_varies_from_bin_to_bin(inexact_model, name):
    """As the most probable density does, which follows the noise of the forces: the twin integrates the loads."""
    model, nuisance = inexact_model, inexact_model.nuisance
    whiten = model.stated_noise_filter
    count = len(whiten.model.row_start)
    parts = [nuisance["density"].start] if name == "density" else [f.start for f in nuisance.fields.values()]
    states = np.zeros((count, nuisance.size))
    sign = np.random.default_rng(3).choice([-1.0, 1.0], (count, len(parts)))
    states[:, parts] = (3e-3 if name == "density" else 1e-3) * sign
    states[:, [i + 1 for i in parts]] = 1.0 if name == "density" else 0.0  # a derivative that no residual contains
    perturbation = perturbation_from_states(
        model.index, model.bins, nuisance, model.case.uncertainty.sigma, model.units, model.field,
        whiten.model.row_start, states,
    )  # fmt: skip
    means = states_of_bins(model.index, model.bins, nuisance, whiten.model.row_start, states)
    point = replace(model.point, perturbation=perturbation, bin_states=means)
    displaced, sigma = model.at_point(point, ()), model.stated_noise_sigma
    change = (displaced.index.stack(displaced.residuals) - model.residual_vector) / sigma
    assert np.abs(change).max() > 0.1
    size = np.linalg.norm(change)
    left = np.linalg.norm((displaced.residual_vector - model.residual_vector) / sigma)
    ends = states[1 : len(model.bins.middle) + 1]
    at_ends = replace(displaced, point=replace(point, bin_states=np.stack((ends, ends))))
    assert left < 0.1 * size < 0.2 * np.linalg.norm((at_ends.residual_vector - model.residual_vector) / sigma)


def about_another_initial_state(model, shift, deviates):
    """The model with its path dead-reckoned from another initial state, and its flow along the same path or not."""
    start, edges = model.point.start.plus(shift), model.bins.edges
    path = dead_reckon(model.inputs.problem, start.nav[:10], model.point.errors)
    before, after = (p.nav[p.indices(edges)] for p in (model.residuals.path, path))
    deviation = path_deviation(before, after) if deviates else None
    return linearize_at(model.case, replace(model.point, start=start, deviation=deviation))


@pytest.mark.parametrize(
    "state",
    [pytest.param("position", marks=pytest.mark.slow), pytest.param("velocity", marks=pytest.mark.slow), "attitude"],
)
def test_the_likelihood_does_not_depend_on_the_initial_state_of_the_path(models, state):
    """Where the flow is evaluated along the same path: the errors are measured from the dead-reckoned one.

    The difference is nearly of second order in the shift: -0.15 nats with 1e-4 rad, -0.44 with 2e-4 and -1.4 with 4e-4.
    """
    model = models[0]
    shift = np.zeros(model.nuisance.layout.size)
    shift[model.nuisance.layout[state]] = {"position": 500.0, "velocity": 2.0, "attitude": 1e-4}[state]
    same, another = (about_another_initial_state(model, shift, deviates) for deviates in (True, False))
    np.testing.assert_allclose(same.residuals.flow.alpha_total, model.residuals.flow.alpha_total, rtol=0.0, atol=1e-6)
    assert same.log_likelihood == pytest.approx(model.log_likelihood, abs=0.2)
    assert np.abs(same.index.stack(same.residuals) - same.residual_vector).max() > 1e-4
    assert abs(another.log_likelihood - model.log_likelihood) > 1.0


def test_the_flow_is_evaluated_along_the_most_probable_path(models):
    """The smoothed errors, added to the path about which they were computed."""
    model = models[0]
    whiten = model.stated_noise_filter
    states = smoothed_states(whiten, model.white_residuals(whiten), model.initial_mean)[1]
    displaced = model.at_point(next_point(model), ())
    assert np.abs(displaced.point.deviation).max() > 1e-3
    before = model.residuals.path
    used, step = model.index.step_of_bins(whiten.model.row_start)
    ends = model.bins.edges[1:][used]
    smoothed = before.nav[before.indices(ends), :6] + states[step, :6]
    at_ends = displaced.residuals.nodes.nav[NODES_PER_BIN::NODES_PER_BIN][used]
    np.testing.assert_allclose(at_ends[:, :6], smoothed, rtol=0.0, atol=1e-6)
    attitude = Rotation.from_quat(before.nav[before.indices(ends), 6:]) * Rotation.from_rotvec(states[step, 6:9])
    assert (attitude.inv() * Rotation.from_quat(at_ends[:, 6:])).magnitude().max() < 1e-9


def test_two_successive_points_are_equally_likely(models):
    """Where the iteration has converged; by a tenth of the gain that names an effect."""
    point = next_point(models[1])
    following = linearize_at(models[1].case, point)
    assert following.log_likelihood == pytest.approx(models[1].log_likelihood, abs=0.6)
