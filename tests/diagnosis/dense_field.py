"""The field of a database's discrepancy over a short stretch of a flight as a dense Gaussian process.

It is the twin of the field in the state-space model, for `jacobians/test_coefficient_errors`, and knows nothing of
transitions of the field: the covariance of its values and derivatives is the Matérn correlation of the distances along
the flow and its derivatives, mode by mode; the covariance of all other states is propagated step by step. Both are
added up for all pairs of rows of a short stretch.
"""

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.jacobians.nuisance import FIELD_STATES
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.types import Array

#: Number of bins of a stretch.
STRETCH = 60
RATE = np.sqrt(3.0)


@dataclass(frozen=True)
class Stretch:
    """Consecutive bins of a flight, as if it began with them.

    Attributes
    ----------
    model : LinearStateSpace
        The steps of these bins.
    residuals : (R,) array
    bins : (S,) array of int
        Bin of each step.
    """

    model: LinearStateSpace
    residuals: Array
    bins: Array


def distance_along_flow(model):
    """Distance of each node from the first ``(M,)``, in correlation lengths, from Mach and Knudsen number by hand."""
    flow, prior = model.residuals.flow, model.case.uncertainty.discrepancy
    database, total = model.inputs.forward_model.database, [0.0]
    for k in range(1, len(flow.time)):
        rarefied = [flow.knudsen[i] > database.continuum_limit for i in (k - 1, k)]
        if rarefied[0] != rarefied[1]:
            step = 100.0
        elif rarefied[0]:
            step = abs(np.log10(flow.knudsen[k] / flow.knudsen[k - 1])) / prior.log_knudsen_length
        else:
            step = abs(np.log(flow.mach[k] / flow.mach[k - 1])) / prior.log_mach_length
        total.append(total[-1] + step)
    return np.array(total)


def bin_of_regime_change(model):
    """The first bin in continuum flow."""
    rarefied = model.residuals.flow.knudsen > model.inputs.forward_model.database.continuum_limit
    return int(np.argmax(~rarefied)) // NODES_PER_BIN


def first_bin(model, where):
    """First bin of a stretch about the change of the regime, or where the dynamic pressure is largest."""
    if where == "regime change":
        return bin_of_regime_change(model) - STRETCH // 2
    return int(np.argmax(model.residuals.flow.dynamic_pressure)) // NODES_PER_BIN - STRETCH // 2


def stretch_of(model, first):
    """The rows and steps of `STRETCH` bins from a bin on; the stationary prior is that of the flight's beginning."""
    s = model.state_space
    used, steps = model.index.step_of_bins(s.row_start)
    chosen = (used >= first) & (used < first + STRETCH)
    assert np.count_nonzero(chosen) == STRETCH
    a, b = steps[chosen][0], steps[chosen][-1] + 1
    assert np.array_equal(np.arange(a, b), steps[chosen])  # no step of a constraint between them
    rows = slice(s.row_start[a], s.row_start[b])
    return Stretch(
        model=LinearStateSpace(
            increment=replace(s.increment, values=s.increment.values[a:b]),
            process_noise=replace(s.process_noise, values=s.process_noise.values[a:b]),
            row_start=s.row_start[a : b + 1] - s.row_start[a],
            design=s.design[rows],
            row_noise=s.row_noise[rows],
            initial_covariance=s.initial_covariance,
        ),
        residuals=model.residual_vector[rows],
        bins=used[chosen],
    )


def covariance_without_field(stretch, states):
    """Covariance ``(R, R)`` of the rows by all states but the field's, propagated from step to step."""
    s = stretch.model
    rows = [slice(a, b) for a, b in zip(s.row_start[:-1], s.row_start[1:], strict=True)]
    out = np.zeros((len(s.design), len(s.design)))
    p = s.initial_covariance[np.ix_(states, states)]
    transitions = [np.eye(len(states)) + s.increment[k][np.ix_(states, states)] for k in range(len(rows))]
    for k, own in enumerate(rows):
        p = transitions[k] @ p @ transitions[k].T + s.process_noise[k][np.ix_(states, states)]
        response = p @ s.design[own][:, states].T
        out[own, own] = s.design[own][:, states] @ response
        for later in range(k + 1, len(rows)):
            response = transitions[later] @ response
            out[rows[later], own] = s.design[rows[later]][:, states] @ response
            out[own, rows[later]] = out[rows[later], own].T
    return out


def matern(x, y):
    """Covariances of values and derivatives at x and y ``(2, 2)``: ``k``, ``∂k/∂y``, ``∂k/∂x``, ``∂²k/∂x∂y``."""
    r = abs(x - y)
    decay = np.exp(-RATE * r)
    slope, curvature = -3.0 * (x - y) * decay, -3.0 * (1.0 - RATE * r) * decay
    return np.array([[(1.0 + RATE * r) * decay, -slope], [slope, -curvature]])


def field_loadings(model, stretch, x):
    """Derivatives of the rows with respect to value and derivative of each mode at the bin's end, ``(R, J, 2)``.

    By the Jacobian of the prediction. A force is a mean over the bin, so it is that at half the distance before its
    end, unless the regime of the flow changes within the bin.
    """
    jacobian, s = model.jacobian, stretch.model
    names = list(model.nuisance.fields)
    force = np.concatenate([jacobian.force[:, :, jacobian.columns[f"field_{n}"]] for n in names], axis=2)
    step = np.concatenate([jacobian.rate_step[:, :, jacobian.columns[f"field_{n}"]] for n in names], axis=2)
    out = np.zeros((len(s.design), force.shape[2], 2))
    for k, b in enumerate(stretch.bins):
        begin, end = s.row_start[k], s.row_start[k + 1]
        assert end - begin >= 6  # forces and rate steps are the first six rows
        distance = x[NODES_PER_BIN * (b + 1)] - x[NODES_PER_BIN * b]
        out[begin : begin + 3, :, 0], out[begin + 3 : begin + 6, :, 0] = force[b], step[b]
        if distance < 1.0:
            out[begin : begin + 3, :, 1] = -0.5 * distance * force[b]
    return out


def field_covariances(model, stretch):
    """Covariances: of the rows by the field ``(R, R)``, and of its amplitudes at all ends with them ``(S, J, R)``."""
    x = distance_along_flow(model)
    at_end = x[NODES_PER_BIN * (stretch.bins + 1)]
    loading, starts = field_loadings(model, stretch, x), stretch.model.row_start
    count = len(stretch.residuals)
    of_rows, of_amplitudes = np.zeros((count, count)), np.zeros((len(at_end), loading.shape[1], count))
    for i, xi in enumerate(at_end):
        first = slice(starts[i], starts[i + 1])
        for j, xj in enumerate(at_end):
            second, kernel = slice(starts[j], starts[j + 1]), matern(xi, xj)
            of_rows[first, second] = np.einsum("rja,ab,sjb->rs", loading[first], kernel, loading[second])
            of_amplitudes[i, :, second] = np.einsum("b,sjb->js", kernel[0], loading[second])
    return of_rows, of_amplitudes


def row_noise_of(stretch):
    """Covariance ``(R, R)`` of the rows' own noise."""
    s = stretch.model
    out = np.zeros((len(s.design), len(s.design)))
    for a, b in zip(s.row_start[:-1], s.row_start[1:], strict=True):
        out[a:b, a:b] = s.row_noise[a:b, : b - a]
    return out


def dense_covariances(model, stretch):
    """Covariances of the rows by all sources and by the field ``(R, R)``, of its amplitudes with them ``(S, J, R)``."""
    fields = model.nuisance.fields
    places = [i for f in fields.values() for i in range(f.start, f.start + FIELD_STATES * (f.stop - f.start))]
    remaining_states = np.setdiff1d(np.arange(stretch.model.size), places)
    by_field, of_amplitudes = field_covariances(model, stretch)
    return (
        covariance_without_field(stretch, remaining_states) + by_field + row_noise_of(stretch),
        by_field,
        of_amplitudes,
    )


def scaled_cholesky(covariance):
    """Scale of each row, and the Cholesky factor of the correlation matrix."""
    scale = np.sqrt(np.diag(covariance))
    return scale, np.linalg.cholesky(covariance / np.outer(scale, scale))


def refined_solution(covariance, residuals):
    """``C⁻¹ y`` by Cholesky factors, with residuals of the equations in extended precision.

    The condition number is some 1e9, and its product with the rounding error would exceed what is compared.
    """
    scale, lower = scaled_cholesky(covariance)
    matrix, right = (covariance / np.outer(scale, scale)).astype(np.longdouble), residuals / scale
    solution = np.zeros(len(right), np.longdouble)
    for _ in range(3):
        defect = (right - matrix @ solution).astype(float)
        solution = solution + np.linalg.solve(lower.T, np.linalg.solve(lower, defect))
    return solution.astype(float) / scale
