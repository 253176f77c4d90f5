"""Linearisation of a flight's model about a point, and the iteration of the point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from edl_filter import rotations
from edl_filter.diagnosis.jacobians.bin_rows import bin_rows
from edl_filter.diagnosis.jacobians.coefficient_errors import (
    asymmetry_units,
    database_units,
    field_modes,
    numerical_error_units,
)
from edl_filter.diagnosis.jacobians.nuisance import nuisance_layout
from edl_filter.diagnosis.jacobians.prediction_jacobian import prediction_jacobian
from edl_filter.diagnosis.jacobians.state_space import assemble_state_space
from edl_filter.diagnosis.jacobians.transitions import propagate_path
from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobians, stacked
from edl_filter.diagnosis.linear_model.flight_case import FlightCase
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel, perturbed
from edl_filter.diagnosis.linear_model.linearization_point import (
    LinearizationPoint,
    largest_change,
    perturbation_from_states,
    smoothed_point,
    states_at_edges,
    states_of_bins,
)
from edl_filter.diagnosis.noise.variance_components import ExcessVariance
from edl_filter.diagnosis.prediction.dead_reckoning import (
    DeadReckonedPath,
    corrected_readings,
    dead_reckon,
    path_deviation,
)
from edl_filter.diagnosis.prediction.interpolation_error import PredictedRotation, interpolation_errors
from edl_filter.diagnosis.prediction.predicted_readings import accelerations_at_nodes
from edl_filter.diagnosis.prediction.residuals import (
    ModelInputs,
    PathReference,
    compute_residuals,
    lever_arm_readings,
    own_lever_arm,
)
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_means
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.perturbation import FieldPerturbation
from edl_filter.estimation.kalman import WhiteningFilter
from edl_filter.estimation.linear_state_space import append_constant_states
from edl_filter.estimation.smoothing import smoothed_states
from edl_filter.navigation.layout import ONBOARD
from edl_filter.types import Array, IntArray

#: States of the attitude that was computed on board, which the model does not affect.
_ONBOARD_STATES = ("onboard_rate", "onboard_mounting", ONBOARD)


def linearize_at(
    case: FlightCase, point: LinearizationPoint, initial_excess: ExcessVariance | None = None
) -> LinearizedModel:
    """Linearise the model of a case about a point.

    Parameters
    ----------
    case : FlightCase
        The flight with what its mission states as uncertain.
    point : LinearizationPoint
        The linearisation point.
    initial_excess : ExcessVariance, optional
        Start of the estimation of the excess variance.
    """
    bins, uncertainty = case.bins, case.uncertainty
    if not point.constants:
        point = replace(point, constants=tuple(c.instance for c in case.constants))
    effects = (*case.effects, *point.constants)
    inputs = perturbed(case.model_inputs(effects), point)
    transitions = propagate_path(inputs.problem, bins, point.start, point.errors)
    reference = PathReference(bins, point.start.nav[:10], point.errors, transitions.onboard, deviation=point.deviation)
    residuals = compute_residuals(reference, inputs)
    _, acceleration = accelerations_at_nodes(inputs.forward_model, residuals.flow, residuals.tables)
    rotation, records = PredictedRotation(residuals.nodes.time, acceleration), (inputs.driving, *inputs.checking)
    errors = interpolation_errors(rotation, bins, inputs.problem.samples, records, effects)
    reference = replace(reference, interpolation_errors=errors)
    residuals = compute_residuals(reference, inputs)
    perturbation, field = point.perturbation, None
    if perturbation is not None:
        units, field = perturbation.units, perturbation.field
    else:
        units = numerical_error_units(residuals, uncertainty)
        if not uncertainty.discrepancy.is_exact:
            database = database_units(inputs, residuals, uncertainty.discrepancy)
            modes = field_modes(inputs, bins, residuals, uncertainty.discrepancy, database)
            asymmetry = asymmetry_units(inputs, residuals, uncertainty.discrepancy)
            limit = inputs.forward_model.database.continuum_limit
            field = FieldPerturbation.zero(modes, database, asymmetry, limit)
    jacobian = prediction_jacobian(inputs, bins, residuals, uncertainty, units, field)
    modes = {} if field is None else field.modes
    nuisance = nuisance_layout(inputs.problem.layout, inputs.checking, bins, uncertainty, modes)
    denoised = denoised_readings_by_imu(bins, case.denoised_inputs(effects), point.errors)
    tables, flow = inputs.forward_model.database, residuals.flow
    distance = uncertainty.discrepancy.flow_distance(
        flow.mach, flow.knudsen, tables.continuum_limit, tables.join == "switch"
    )
    rows = bin_rows(inputs, bins, residuals, denoised, nuisance, jacobian, uncertainty, distance, errors)
    state_space, index = assemble_state_space(
        inputs, bins, transitions, rows, nuisance, uncertainty, residuals, distance
    )
    model = LinearizedModel(
        case=case,
        effects=case.effects,
        point=point,
        reference=reference,
        inputs=inputs,
        residuals=residuals,
        jacobian=jacobian,
        index=index,
        nuisance=nuisance,
        units=units,
        field=field,
        state_space=state_space,
        constant_columns=np.zeros((index.count, 0)),
        initial_excess=initial_excess,
    )
    if not case.constants:
        return model
    # the point has their values: their columns are about zero change of them
    columns, _ = stacked(effect_jacobians(model, [(c.instance, tuple(c.sigma)) for c in case.constants]))
    sigma = np.array([s for c in case.constants for s in c.sigma.values()])
    return replace(model, state_space=append_constant_states(state_space, columns, sigma), constant_columns=columns)


def denoised_readings_by_imu(bins: TimeBins, inputs: ModelInputs, errors: Array) -> tuple[list[Array], Array]:
    """Means over the bins of the denoised specific force at each IMU, the driving one first, and of the rate.

    Parameters
    ----------
    bins : TimeBins
        Time bins of the comparison.
    inputs : ModelInputs
        With denoised readings.
    errors : (U, n) array
        Sensor errors by instrument, each in the filter's vector.

    Returns
    -------
    forces, rate : list of (B, 3) arrays and (B, 3) array
        m/s² and rad/s.
    """
    samples = inputs.problem.samples
    force, rate = corrected_readings(inputs.problem, errors, own_lever_arm(inputs))
    records = (inputs.driving, *inputs.checking)
    forces = [
        bin_means(bins.edges, samples.time, samples.interval, force + lever_arm_readings(record, samples, rate))
        for record in records
    ]
    return forces, bin_means(bins.edges, samples.time, samples.interval, rate)


def map_point(
    model: LinearizedModel, whiten: WhiteningFilter, white: Array, onboard: bool = True
) -> LinearizationPoint | None:
    """Most probable values (MAP) of the nuisance parameters, as a linearisation point.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    whiten : WhiteningFilter
        The whitening filter.
    white : (R,) array
        White residuals about the model's point.
    onboard : bool
        Whether the states of the on-board attitude change as well. It is propagated along the path, which then must be
        propagated anew.

    Returns
    -------
    LinearizationPoint or None
        None where the values are farther from what is stated than the settings allow, as with a model far from the
        truth.
    """
    settings, layout, prior_mean = model.settings, model.nuisance.layout, model.initial_mean
    initial, states = smoothed_states(whiten, white, prior_mean)
    shift = initial[: layout.size].copy()
    if not onboard:
        for name in _ONBOARD_STATES:
            if name in layout:
                shift[layout[name]] = 0.0
    prior_sigma = np.sqrt(np.diag(whiten.model.initial_covariance)[: layout.size])
    perturbation = perturbation_from_states(
        model.index,
        model.bins,
        model.nuisance,
        model.case.uncertainty.sigma,
        model.units,
        model.field,
        whiten.model.row_start,
        states,
    )
    credible = np.all(np.abs(shift - prior_mean[: layout.size]) <= settings.state_limit_sigmas * prior_sigma)
    if not (credible and np.all(np.abs(perturbation.density) < settings.log_density_limit)):
        return None
    start = model.point.start.plus(shift)
    errors = model.point.errors.copy()
    errors[int(model.inputs.problem.samples.unit[0])] = start.errors
    values = iter(initial[model.nuisance.size : model.nuisance.size + model.constant_columns.shape[1]].tolist())
    constants = tuple(
        replace(c.instance, values=c.instance.values | {name: next(values) for name in c.sigma})
        for c in model.case.constants
    )
    own = states[:, : model.nuisance.size]
    bin_states = states_of_bins(model.index, model.bins, model.nuisance, whiten.model.row_start, own)
    deviation = _smoothed_deviation(
        model, whiten.model.row_start, states, dead_reckon(model.inputs.problem, start.nav[:10], errors)
    )
    return LinearizationPoint(start, errors, perturbation, bin_states, constants, deviation)


def _smoothed_deviation(model: LinearizedModel, row_start: IntArray, states: Array, path: DeadReckonedPath) -> Array:
    """Deviation of the smoothed path from a dead-reckoned one at the bins' edges ``(B + 1, 9)``.

    `states` are smoothed errors about the model's path at every step ``(K, n)``.
    """
    layout, bins = model.nuisance.layout, model.bins
    nav = slice(layout["position"].start, layout["attitude"].stop)
    error = states_at_edges(model.index, bins, row_start, states[:, nav])
    before = model.residuals.path.nav[model.residuals.path.indices(bins.edges)]
    attitude = rotations.multiply(before[:, 6:], rotations.from_rotation_vector(error[:, 6:]))
    smoothed = np.concatenate((before[:, :6] + error[:, :6], attitude), axis=1)
    return path_deviation(smoothed, path.nav[path.indices(bins.edges)])


def at_map_point(
    model: LinearizedModel, whiten: WhiteningFilter, white: Array, effects: Sequence[EffectInstance]
) -> LinearizedModel | None:
    """The model with effects at given values, its point at the most probable nuisance parameters.

    The point is iterated with the Jacobians of the model (chord method: Kelley, Iterative Methods for Linear and
    Nonlinear Equations, SIAM 1995, section 5.4).

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    whiten : WhiteningFilter
        The whitening filter.
    white : (R,) array
        White residuals that are expected with the effects at these values.
    effects : sequence of EffectInstance
        Effects of the model.

    Returns
    -------
    LinearizedModel or None
        At the most probable point of the iteration; None where the first point is not credible.
    """
    settings, best, least, last = model.settings, None, np.inf, np.inf
    for _ in range(settings.nuisance_iterations):
        point = map_point(model, whiten, white, onboard=False)
        if point is None:
            return best
        model = model.at_point(point, effects)
        white = model.white_residuals(whiten)
        size = 0.5 * float(white @ white)
        if size < least:  # a chord iteration may diverge
            best, least = model, size
        if abs(last - size) < settings.fit_convergence_nats:
            break
        last = size
    return best


def linearize(
    case: FlightCase,
    iterations: int = 1,
    max_excess_share: float = 1.0,
    least_iterations: int = 1,
    first: LinearizedModel | None = None,
) -> LinearizedModel:
    """Linearise the model of a case, iterating the linearisation point.

    The first point is the smoothed reconstruction, which has no information from the aerodynamic model. With further
    iterations the point moves to the most probable nuisance parameters until it converges. A failing model may move the
    point away from the truth; so the iteration ends where more than `max_excess_share` of the rows have excess
    variance. The iteration is no descent: where the angle of attack passes the nodes of a table, the likelihood may
    fall by some nats from one point to the next. So the most probable model of all points is returned: of those that
    hold without excess variance, if there are any, or of those that hold, or of all if none holds. An effect is fitted
    about the most likely of its points too (`at_map_point`); if the model without it were about a less likely one, the
    difference would be a gain of every effect.

    Parameters
    ----------
    case : FlightCase
        The flight with what its mission states as uncertain.
    iterations : int
        Largest number of linearisation points.
    max_excess_share : float
        Share of the rows, 0 to 1.
    least_iterations : int
        Number of linearisation points up to which the excess variance does not end the iteration.
    first : LinearizedModel, optional
        The model about the smoothed reconstruction, if it is at hand.

    Returns
    -------
    LinearizedModel
    """
    first = first or linearize_at(case, smoothed_point(case.reconstruction))
    best = first
    for model in iterate_point(case, iterations, max_excess_share, first, least_iterations):  # large: one is kept
        best = max(best, model, key=lambda m: preference(m, m.white_excess_log_evidence))
    return best


def preference(model: LinearizedModel, log_evidence: float) -> tuple[bool, bool, float]:
    """Order of the linearisation points of one case: the largest is the best.

    Parameters
    ----------
    model : LinearizedModel
        About the point.
    log_evidence : float
        Log marginal likelihood less the penalty of the model's noise, nats.

    Returns
    -------
    tuple of (bool, bool, float)
        Whether the model holds, whether it holds without excess variance, and the log evidence.
    """
    return model.holds, model.holds and model.excess_variance.is_zero, log_evidence


def iterate_point(
    case: FlightCase, iterations: int, max_excess_share: float, model: LinearizedModel, least_iterations: int = 1
) -> Iterator[LinearizedModel]:
    """The model about its point and about the points that follow, until the point converges or the model fails.

    Parameters
    ----------
    case, iterations, max_excess_share, least_iterations
        As of `linearize`.
    model : LinearizedModel
        About the first point.

    Yields
    ------
    LinearizedModel
    """
    settings, last, last_share = case.settings, -np.inf, np.inf
    for i in range(iterations):
        yield model
        log_likelihood, share = model.white_excess_log_likelihood, model.excess_variance.share
        converged = model.holds and log_likelihood < last + settings.linearization_convergence_nats
        receding = not model.holds and share > settings.alternative_progress * last_share
        if i == iterations - 1 or converged or receding or (share > max_excess_share and i >= least_iterations - 1):
            return
        last, last_share = log_likelihood, share
        point = _next_point(model)
        if point is None:
            return
        model.release()  # of the models about all points, the last one has filters
        model = linearize_at(case, point, model.failing_excess)


def _next_point(model: LinearizedModel) -> LinearizationPoint | None:
    """The most probable point; None where it is not credible, or where the model's own point hardly differs from it."""
    whiten, size, sigma = model.white_excess_filter, model.nuisance.layout.size, model.case.uncertainty.sigma
    chord = at_map_point(model, whiten, model.white_residuals(whiten), model.effects)
    point = None if chord is None else map_point(chord, whiten, chord.white_residuals(whiten))
    if point is None:
        return None
    tolerance = model.settings.linearization_tolerance_sigmas
    spread = np.sqrt(np.maximum(np.diag(whiten.posterior_initial_covariance(size)), 0.0))
    fixed = np.all(np.abs(point.start.minus(model.point.start)) <= tolerance * spread + 1e-15)
    change = largest_change(model.point.perturbation, point.perturbation, sigma)
    return None if fixed and change <= tolerance else point
