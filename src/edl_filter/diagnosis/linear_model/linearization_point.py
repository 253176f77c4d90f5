"""The linearisation point: initial state of the path, sensor errors, and the flight's own air, tables and vehicle.

The nuisance parameters enter the linear model one by one, but their products matter: density times attitude, a gyro's
bias times the initial roll. About the mission's values one percent of density and half a degree of attitude leave more
of a moment unexplained than its noise. Path and model are therefore linearised about the most probable values of the
nuisance parameters: an iterated smoother (Bell, SIAM J. Optim. 4 (1994) 626), which is Gauss–Newton on all of them at
once. The nuisance parameters are measured from what the mission states, wherever the point is, so that their prior does
not change; what the point contains of them is added to the residuals again by the rows (`nuisance_offset`). So are the
errors of the path, which the noise of the readings has as well: the flow is evaluated along the most probable path, not
along the one that is dead-reckoned from the most probable initial state (`deviation_offset`). The two differ by a metre
per second at the end of an entry, which is a tenth of a degree of the angle of attack.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.jacobians.nuisance import PERTURBED, NuisanceLayout
from edl_filter.diagnosis.jacobians.prediction_jacobian import PredictionJacobian
from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.perturbation import CoefficientUnits, FieldPerturbation, Perturbation
from edl_filter.effects.types import FlightCondition
from edl_filter.estimation.series import interpolate_columns
from edl_filter.navigation.layout import State
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.types import Array, IntArray


@dataclass(frozen=True)
class LinearizationPoint:
    """About what the model is linear.

    Attributes
    ----------
    start : State
        At the initial state's time, with the first instrument's errors.
    errors : (U, n) array
        Sensor errors by instrument, each in the filter's vector.
    perturbation : Perturbation, optional
        Of air, tables and vehicle; none at the first point.
    bin_states : (2, B, n) array, optional
        Means of the states from which the perturbation was taken, for each bin's rows (`states_of_bins`).
    constants : tuple of EffectInstance
        Constant nuisance parameters at their values (`stated_parameters`); empty at the first point.
    deviation : (B + 1, 9) array, optional
        Of the most probable path from the dead-reckoned one at the bins' edges, by the noise of the readings
        (`prediction.dead_reckoning.displace_nodes`); none at the first point.
    """

    start: State
    errors: Array
    perturbation: Perturbation | None = None
    bin_states: Array | None = None
    constants: tuple[EffectInstance, ...] = ()
    deviation: Array | None = None


def smoothed_point(reconstruction: Reconstruction) -> LinearizationPoint:
    """The first point: the smoothed reconstruction, which has no information from the aerodynamic model."""
    r = reconstruction
    errors = np.zeros((len(r.problem.instruments), r.problem.layout.size))
    units: set[int] = set()
    for node, state in zip(r.filter_pass.nodes, r.smoothed.states, strict=True):
        if node.unit not in units:
            units.add(node.unit)
            errors[node.unit] = state.errors
    return LinearizationPoint(r.smoothed.states[0], errors)


def perturbation_from_states(
    index: RowIndex,
    bins: TimeBins,
    nuisance: NuisanceLayout,
    sigma: dict[str, float],
    units: CoefficientUnits,
    field: FieldPerturbation | None,
    row_start: IntArray,
    states: Array,
) -> Perturbation:
    """Perturbation of air, tables and vehicle that smoothed states imply, at the bins' ends.

    Parameters
    ----------
    index : RowIndex
        Positions of the rows.
    bins : TimeBins
        Time bins of the comparison.
    nuisance : NuisanceLayout
        Positions of the nuisance parameters.
    sigma : dict
        One sigma of each nuisance parameter.
    units : CoefficientUnits
        One sigma of the coefficients' numerical errors.
    field : FieldPerturbation or None
        Modes and units of the database's discrepancy.
    row_start : (K + 1,) array of int
        First row of each step.
    states : (K, n) array
        Smoothed states at every step.
    """
    ends, at_end = bins.edges[1:], states_at_edges(index, bins, row_start, states)[1:]

    def against_time(name: str) -> Array:
        return at_end[:, nuisance[name].start] * sigma[name] if name in nuisance else np.zeros(len(ends))

    if field is not None:
        amplitudes = {name: at_end[:, part] for name, part in nuisance.fields.items()}
        field = replace(field, time=ends, amplitudes=amplitudes)
    return Perturbation(
        time=ends,
        density=against_time("density"),
        wind=np.column_stack((against_time("wind_east"), against_time("wind_north"))),
        ca=against_time("ca"),
        cn=against_time("cn"),
        cm=against_time("cm"),
        mass=float(against_time("mass")[0]),
        inertia=float(against_time("inertia")[0]),
        units=units,
        field=field,
    )


def states_at_edges(index: RowIndex, bins: TimeBins, row_start: IntArray, states: Array) -> Array:
    """Smoothed states at the bins' edges ``(B + 1, n)``.

    Linear in time across bins that are not compared, and held before the end of the first one that is.

    Parameters
    ----------
    index : RowIndex
        Positions of the rows.
    bins : TimeBins
        Time bins of the comparison.
    row_start : (K + 1,) array of int
        First row of each step.
    states : (K, n) array
        Smoothed states at every step.
    """
    used, step = index.step_of_bins(row_start)
    if not len(used):
        return np.zeros((len(bins.edges), states.shape[1]))
    return interpolate_columns(bins.edges, bins.edges[1:][used], states[step])


def states_of_bins(
    index: RowIndex, bins: TimeBins, nuisance: NuisanceLayout, row_start: IntArray, states: Array
) -> Array:
    """Means of the states that a perturbation has, for each bin's rows ``(2, B, n)``; zero for all other states.

    The first are means over the bins, of the specific force; the second are means over a bin and the next one with the
    triangular weight of a step of the rate. Between the bins' ends the states are linear in time, as in a
    `Perturbation`. Derivatives of a process are zero, since a perturbation has none.

    Parameters
    ----------
    index : RowIndex
        Positions of the rows.
    bins : TimeBins
        Time bins of the comparison.
    nuisance : NuisanceLayout
        Positions of the nuisance parameters.
    row_start : (K + 1,) array of int
        First row of each step.
    states : (K, n) array
        Smoothed states at every step.
    """
    perturbing = [nuisance[name].start for name in PERTURBED if name in nuisance]
    perturbing += [i for part in nuisance.fields.values() for i in range(part.start, part.stop)]
    out = np.zeros((2, len(bins.interval), states.shape[1]))
    out[:, :, perturbing] = _means_of_bins(bins, states_at_edges(index, bins, row_start, states[:, perturbing]))
    return out


def _means_of_bins(bins: TimeBins, at_edges: Array) -> Array:
    """Means ``(2, B, m)`` of what is linear between the bins' edges ``(B + 1, m)``.

    Over each bin, and over each bin and the next one with the triangular weight of a step of the rate.
    """
    begin, end, dt = at_edges[:-1], at_edges[1:], bins.interval[:, None]
    following = np.concatenate((end[1:], end[-1:]))
    next_dt = np.concatenate((dt[1:], dt[-1:]))
    weighted = dt * (begin + 2.0 * end) + next_dt * (2.0 * end + following)
    return np.stack((0.5 * (begin + end), weighted / (3.0 * (dt + next_dt))))


def deviation_offset(index: RowIndex, bins: TimeBins, jacobian: PredictionJacobian, deviation: Array) -> Array:
    """Change of the residuals ``(R,)`` by the deviation of a point's path, by the derivatives of the predictions.

    The errors of the path are measured from the dead-reckoned path, wherever the flow is evaluated.

    Parameters
    ----------
    index : RowIndex
        Positions of the rows.
    bins : TimeBins
        Time bins of the comparison.
    jacobian : PredictionJacobian
        About the point.
    deviation : (B + 1, 9) array
        Of the `LinearizationPoint`.
    """
    nav = slice(jacobian.columns["position"].start, jacobian.columns["attitude"].stop)
    over_bin, about_edge = _means_of_bins(bins, deviation)
    force = np.einsum("bij,bj->bi", jacobian.force[:, :, nav], over_bin)
    rate_step = np.einsum("bij,bj->bi", jacobian.rate_step[:, :, nav], about_edge[:-1])
    return index.stack_predictions(force, rate_step)


def nuisance_offset(index: RowIndex, design: Array, bin_states: Array) -> Array:
    """Change of the residuals ``(R,)`` by the states of a point, by the derivatives of the rows that estimate them.

    The nuisance parameters change the residuals by up to thousands of sigmas, so that any other linearisation, correct
    to a thousandth, would leave a residual that is not zero at the most probable point. A row contains a process at the
    bin's end and its derivative; the residuals contain its mean over the bin. Both are the same for a smooth process.
    The estimated derivative of the density, however, follows the noise of the forces from bin to bin, and what it
    changes in a row is in no residual: the means are added, so that the sum does not depend on the point.

    Parameters
    ----------
    index : RowIndex
        Positions of the rows.
    design : (R, n) array
        Of the state-space model.
    bin_states : (2, B, m) array
        Of `states_of_bins`; m ≤ n.
    """
    out = np.zeros(index.count)
    for mean, channels in zip(bin_states, (slice(0, 3), slice(3, 6)), strict=True):
        bins, channel = np.nonzero(index.bin_rows[:, channels] >= 0)
        rows = index.bin_rows[:, channels][bins, channel]
        out[rows] = np.einsum("rn,rn->r", design[rows, : mean.shape[1]], mean[bins])
    return out


def largest_change(before: Perturbation | None, after: Perturbation | None, sigma: dict[str, float]) -> float:
    """Largest difference of two perturbations, in sigmas of what the mission states; of a field's, of an amplitude."""
    changes = _changes(before, after, sigma)
    fields = [{} if d is None or d.field is None else d.field.amplitudes for d in (after, before)]
    for name in fields[0]:
        changes.append(np.max(np.abs(fields[0][name] - fields[1].get(name, 0.0)), initial=0.0))
    return float(max(changes, default=0.0))


def distance_from_stated(perturbation: Perturbation | None, flow: FlightCondition, sigma: dict[str, float]) -> float:
    """Largest perturbation, in sigmas of what the mission states; of a field, the standardised increment in a flow.

    A relative sigma of the density does not state whether the factor or its logarithm is normally distributed: the
    smaller distance counts.
    """
    if perturbation is None:
        return 0.0
    log_factor = np.abs(perturbation.density)
    density = np.minimum(log_factor, np.abs(np.expm1(perturbation.density)))
    distances = _changes(None, replace(perturbation, density=density), sigma)
    if perturbation.field is not None:
        distances += [np.max(np.abs(z), initial=0.0) for z in perturbation.field.standardised(flow).values()]
    return float(max(distances, default=0.0))


def _changes(before: Perturbation | None, after: Perturbation | None, sigma: dict[str, float]) -> list[float]:
    """Largest difference of each nuisance parameter with a stated sigma, in sigmas."""
    new, old = ({} if d is None else _by_name(d) for d in (after, before))
    return [np.max(np.abs(new.get(n, 0.0) - old.get(n, 0.0)) / s, initial=0.0) for n, s in sigma.items() if s > 0.0]


def _by_name(perturbation: Perturbation) -> dict[str, Array]:
    """By nuisance parameter, at the bins' ends ``(B,)``; coefficients in sigmas."""
    d, ones = perturbation, np.ones(len(perturbation.time))
    return {
        "density": d.density, "wind_east": d.wind[:, 0], "wind_north": d.wind[:, 1], "ca": d.ca, "cn": d.cn,
        "cm": d.cm, "mass": d.mass * ones, "inertia": d.inertia * ones,
    }  # fmt: skip
