"""Jacobian of the predictions, bin by bin.

The error of the path is linear in the error of the filter's vector (`transitions`); the derivatives of the prediction
with respect to state, air, database and vehicle are central differences of the forward model along the path. Every node
keeps its table: where one table ends and another begins a coefficient has a step, and a difference across it would
depend on its own step size. What the step contributes where the table is uncertain is noise, as the departure from
linearity in the density is. Both are those of the stated model, so that they are the same about every point and with
every effect: a difference of the log determinants would count as evidence where two models are compared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter import rotations
from edl_filter.aero.database import Database
from edl_filter.diagnosis.jacobians.coefficient_errors import field_loads
from edl_filter.diagnosis.jacobians.nuisance import StatedUncertainty
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN, PathNodes
from edl_filter.diagnosis.prediction.predicted_readings import (
    fine_rule_sigma,
    flow_at,
    predict,
    predict_increment,
    rate_step_from_moment,
)
from edl_filter.diagnosis.prediction.residuals import ModelInputs, Residuals
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.effects.perturbation import CoefficientUnits, FieldPerturbation, Perturbation
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.navigation.layout import consecutive_slices
from edl_filter.types import Array

#: Steps of the differences with respect to position (m), velocity (m/s), attitude (rad), and the rate (rad/s).
_NAV_STEPS = np.repeat([100.0, 0.05, 1e-5], 3)
_RATE_STEP = 1e-3


@dataclass(frozen=True)
class PredictionJacobian:
    """Derivatives of the predictions, bin by bin.

    Attributes
    ----------
    force : (B, 3, c) array
        Of the mean specific force, with respect to the columns of `columns`.
    rate_step : (B - 1, 3, c) array
        Of the steps of the mean rate.
    columns : dict
        position, velocity, attitude (error of the state), density (logarithm), wind_east, wind_north (m/s), ca, cn, cm
        (in sigmas of the numerical error), mass, inertia (logarithm), rate (rad/s), and field_ca, field_cn,
        field_cm (amplitudes of the discrepancy's modes), field_side_asymmetry, field_normal_asymmetry,
        field_pitch_asymmetry, field_yaw_asymmetry (amplitudes of the asymmetry) → slice of columns.
    force_nonlinearity, rate_step_nonlinearity : (B, 3), (B - 1, 3) arrays
        Departure of the stated model's predictions from linearity over two sigmas of density, combined with the error
        of the quadrature and with the times of the model's effects, which are resolved to the distance of two nodes.
    force_by_regime, rate_step_by_regime : (B, 3), (B - 1, 3) arrays
        Change of the stated model's predictions where the other one of two tables applies; zero without a step.
    """

    force: Array
    rate_step: Array
    columns: dict[str, slice]
    force_nonlinearity: Array
    rate_step_nonlinearity: Array
    force_by_regime: Array
    rate_step_by_regime: Array


class _AirProbe(Effect):
    """Small changes of the air, for differences."""

    name = "probe"
    parameters = tuple(Parameter(n, "", n) for n in ("east", "north", "density"))

    def wind(self, p: Values, altitude: Array) -> Array:
        return np.tile([p["east"], p["north"]], (len(altitude), 1))

    def density(self, p: Values, altitude: Array) -> Array:
        return np.full(len(altitude), 1.0 + p["density"])


def prediction_jacobian(
    inputs: ModelInputs,
    bins: TimeBins,
    residuals: Residuals,
    uncertainty: StatedUncertainty,
    units: CoefficientUnits,
    field: FieldPerturbation | None = None,
) -> PredictionJacobian:
    """Differentiate the predictions along the path.

    Parameters
    ----------
    inputs : ModelInputs
        The model, and the readings corrected by its sensor effects.
    bins : TimeBins
        Time bins of the comparison.
    residuals : Residuals
        With the path and the flow along it.
    uncertainty : StatedUncertainty
        Uncertainties that the mission states: of the density, for the departure from linearity.
    units : CoefficientUnits
        One sigma of the numerical error.
    field : FieldPerturbation, optional
        Modes and one sigma of the database's discrepancy; none with an exact database.
    """
    nodes, model, flow, tables = residuals.nodes, inputs.forward_model, residuals.flow, residuals.tables
    force_columns: list[Array] = []
    rate_columns: list[Array] = []

    def add_difference(plus: tuple[Array, Array], minus: tuple[Array, Array], step: float) -> None:
        force_columns.append((plus[0] - minus[0]) / step)
        rate_columns.append((plus[1] - minus[1]) / step)

    def predict_with_tables_kept(changed: ForwardModel, at: PathNodes) -> tuple[Array, Array]:
        return predict(changed, bins, _in_regime(flow.knudsen, flow_at(changed, at), model.database))

    def with_air(**change: float) -> ForwardModel:
        return model.with_effects((*model.effects, EffectInstance(_AirProbe(), change)))

    for j, step in enumerate(_NAV_STEPS):
        plus, minus = (predict_with_tables_kept(model, _displaced(nodes, j, s)) for s in (step, -step))
        add_difference(plus, minus, 2.0 * step)
    for name, step in (("density", 1e-3), ("east", 0.5), ("north", 0.5)):
        plus, minus = (predict_with_tables_kept(with_air(**{name: s}), nodes) for s in (step, -step))
        add_difference(plus, minus, 2.0 * step)
    nominal = predict(model, bins, flow, tables)
    perturbation = model.perturbation or Perturbation.zero(units)
    for name in ("ca", "cn", "cm"):
        increased = perturbation.with_unit(name)
        add_difference(predict(replace(model, perturbation=increased), bins, flow, tables), nominal, 1.0)
    force_columns += [-residuals.predicted_force, np.zeros_like(nominal[0])]  # mass, inertia
    without_moment = rate_step_from_moment(model, bins, flow, np.zeros_like(flow.rate))
    rate_columns += [np.zeros_like(nominal[1]), without_moment - nominal[1]]
    for change in _RATE_STEP * np.eye(3):
        plus, minus = (predict(model, bins, replace(flow, rate=flow.rate + s), tables) for s in (change, -change))
        add_difference(plus, minus, 2.0 * _RATE_STEP)
    widths = {"position": 3, "velocity": 3, "attitude": 3, "density": 1, "wind_east": 1, "wind_north": 1}
    widths |= {"ca": 1, "cn": 1, "cm": 1, "mass": 1, "inertia": 1, "rate": 3}
    if field is not None:
        for name, mode in field.modes.items():
            unit_force, unit_moment = field_loads(inputs, residuals, name, field)
            for shape in field.shapes(name, flow).T[:, :, None]:
                by_force, by_rate = predict_increment(model, bins, unit_force * shape, unit_moment * shape)
                force_columns.append(by_force)
                rate_columns.append(by_rate)
            widths[f"field_{name}"] = mode.count
    departure, by_regime = _nonlinearity_in_density(model, bins, nodes, uncertainty.density)
    quadrature = [fine_rule_sigma(correction) for correction in residuals.quadrature_correction]
    unresolved = _time_resolution_sigma(model, bins, flow, tables)
    return PredictionJacobian(
        force=np.stack(force_columns, axis=2),
        rate_step=np.stack(rate_columns, axis=2),
        columns=consecutive_slices(widths),
        force_nonlinearity=np.sqrt(departure[0] ** 2 + quadrature[0] ** 2 + unresolved[0] ** 2),
        rate_step_nonlinearity=np.sqrt(departure[1] ** 2 + quadrature[1] ** 2 + unresolved[1] ** 2),
        force_by_regime=by_regime[0],
        rate_step_by_regime=by_regime[1],
    )


def _time_resolution_sigma(
    model: ForwardModel, bins: TimeBins, flow: FlightCondition, tables: AeroCoefficients
) -> tuple[Array, Array]:
    """Sigma of force and steps of the rate by the times at which the model's effects begin or end.

    A time is resolved to the distance of two nodes (`selection.map_fit`) and distributed uniformly between them. The
    change of the predictions from one node to the next is half of that over two.
    """
    spacing = float(np.median(bins.interval)) / NODES_PER_BIN
    force, rate_step = np.zeros((len(bins.interval), 3)), np.zeros((len(bins.interval) - 1, 3))
    for i, instance in enumerate(model.effects):
        for q in instance.effect.places:
            if q.kind == "time" and np.isfinite(instance.values[q.name]):
                later, earlier = (
                    replace(instance, values=instance.values | {q.name: instance.values[q.name] + shift})
                    for shift in (spacing, -spacing)
                )
                plus, minus = (
                    predict(model.with_effects((*model.effects[:i], a, *model.effects[i + 1 :])), bins, flow, tables)
                    for a in (later, earlier)
                )
                force += (0.5 * (plus[0] - minus[0])) ** 2 / 12.0
                rate_step += (0.5 * (plus[1] - minus[1])) ** 2 / 12.0
    return np.sqrt(force), np.sqrt(rate_step)


def _nonlinearity_in_density(
    model: ForwardModel, bins: TimeBins, nodes: PathNodes, density_sigma: float
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Second difference of force and steps of the rate over two sigmas, and their change by the other table.

    Both of the stated model: without effects and perturbation.
    """
    stated = replace(model, effects=(), perturbation=None)
    flow = flow_at(stated, nodes)
    nominal = predict(stated, bins, flow)
    probes = [EffectInstance(_AirProbe(), {"density": s * 2.0 * density_sigma}) for s in (1.0, -1.0)]
    denser, thinner = (
        predict(stated, bins, _in_regime(flow.knudsen, flow_at(stated.with_effects((p,)), nodes), model.database))
        for p in probes
    )
    departure = denser[0] + thinner[0] - 2.0 * nominal[0], denser[1] + thinner[1] - 2.0 * nominal[1]
    if model.database.join != "switch":
        return departure, (np.zeros_like(nominal[0]), np.zeros_like(nominal[1]))
    mirrored = model.database.continuum_limit**2 / flow.knudsen  # on the other side of the limit
    other_table = predict(stated, bins, _in_regime(mirrored, flow, model.database))
    return departure, (other_table[0] - nominal[0], other_table[1] - nominal[1])


def _displaced(nodes: PathNodes, component: int, step: float) -> PathNodes:
    """Nodes with one component of the error of the state increased."""
    nav = nodes.nav.copy()
    if component < 6:
        nav[:, component] += step
    else:
        rotation = np.zeros(3)
        rotation[component - 6] = step
        nav[:, 6:] = rotations.multiply(nav[:, 6:], rotations.from_rotation_vector(rotation))
    return replace(nodes, nav=nav)


def _in_regime(knudsen: Array, flow: FlightCondition, database: Database) -> FlightCondition:
    """A flow whose Knudsen numbers select, node by node, the same one of two tables as the given ones ``(M,)`` do."""
    if database.join != "switch":
        return flow
    limit = database.continuum_limit
    rarefied = np.maximum(flow.knudsen, np.nextafter(limit, np.inf))
    return replace(flow, knudsen=np.where(knudsen > limit, rarefied, np.minimum(flow.knudsen, limit)))
