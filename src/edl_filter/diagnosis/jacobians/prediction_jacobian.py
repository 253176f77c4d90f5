"""Jacobian of the predictions, and the measurement rows of every time bin.

The error of the path is linear in the error of the filter's vector (`transitions`); the derivatives of the prediction
with respect to state, air, database and vehicle are central differences of the forward model along the path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from edl_filter import rotations
from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, AngleModes, DiscrepancyPrior
from edl_filter.aero.grid import GridTable
from edl_filter.diagnosis.jacobians.nuisance import NuisanceLayout, StatedUncertainty, checking_state
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN, PathNodes
from edl_filter.diagnosis.prediction.residuals import (
    ModelInputs,
    Residuals,
    flow_at,
    predict,
    predict_increment,
    quadrature_error,
    rate_step_from_moment,
)
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_means
from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.effects.perturbation import CoefficientUnits, FieldPerturbation, Perturbation
from edl_filter.imu_model.lever_arm import edge_weights
from edl_filter.imu_model.sensor_errors import reading_jacobian
from edl_filter.types import Array, BoolArray

#: Steps of the differences with respect to position (m), velocity (m/s), attitude (rad), and the rate (rad/s).
_NAV_STEPS = np.repeat([100.0, 0.05, 1e-5], 3)
_RATE_STEP = 1e-3
#: Share of a bin's gyro noise that a step of the rate has in addition to the noise of the two bins' means.
_STEP_NOISE_SHARE = 0.05
#: Sigmas of the density within which the regime of the flow is uncertain, and variance of the errors of two tables.
_REGIME_SIGMAS, _EITHER_REGIME = 3.0, 4.0
#: Factor over the median around it from which a change of the rate's slope is a discontinuity.
_DISCONTINUITY = 3.0


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
        position, velocity, attitude (error of the state), density (relative), wind_east, wind_north (m/s), ca, cn, cm
        (in sigmas of the numerical error), mass, inertia (relative), rate (rad/s), and field_ca, field_cn, field_cm
        (amplitudes of the discrepancy's modes) → slice of columns.
    force_nonlinearity, rate_step_nonlinearity : (B, 3), (B - 1, 3) arrays
        Departure of the predictions from linearity over two sigmas of density (where one table ends and another begins,
        the time of the transition is uncertain by a tenth of a second), combined with the quadrature error.
    """

    force: Array
    rate_step: Array
    columns: dict[str, slice]
    force_nonlinearity: Array
    rate_step_nonlinearity: Array


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

    for j, step in enumerate(_NAV_STEPS):
        plus, minus = (_predict_at(model, bins, _displaced(nodes, j, s)) for s in (step, -step))
        add_difference(plus, minus, 2.0 * step)

    def with_air(**change: float) -> tuple[Array, Array]:
        return _predict_at(model.with_effects((*model.effects, EffectInstance(_AirProbe(), change))), bins, nodes)

    for name, step in (("density", 1e-3), ("east", 0.5), ("north", 0.5)):
        add_difference(with_air(**{name: step}), with_air(**{name: -step}), 2.0 * step)
    nominal = predict(model, bins, flow, tables)
    perturbation = model.perturbation or Perturbation.zero(units)
    for name in ("ca", "cn", "cm"):
        increased = perturbation.with_unit(name)
        add_difference(predict(replace(model, perturbation=increased), bins, flow, tables), nominal, 1.0)
    force, moment = model.loads(flow, tables)
    force_columns += [-nominal[0], np.zeros_like(nominal[0])]  # mass, inertia
    without_moment = rate_step_from_moment(model, bins, flow, np.zeros_like(moment))
    rate_columns += [np.zeros_like(nominal[1]), without_moment - nominal[1]]
    for change in _RATE_STEP * np.eye(3):
        plus, minus = (predict(model, bins, replace(flow, rate=flow.rate + s), tables) for s in (change, -change))
        add_difference(plus, minus, 2.0 * _RATE_STEP)
    widths = {"position": 3, "velocity": 3, "attitude": 3, "density": 1, "wind_east": 1, "wind_north": 1}
    widths |= {"ca": 1, "cn": 1, "cm": 1, "mass": 1, "inertia": 1, "rate": 3}
    if field is not None:
        for name, mode in field.modes.items():
            unit_force, unit_moment = coefficient_loads(inputs, residuals, name, field.units)
            for shape in field.shapes(name, flow).T[:, :, None]:
                by_force, by_rate = predict_increment(model, bins, unit_force * shape, unit_moment * shape)
                force_columns.append(by_force)
                rate_columns.append(by_rate)
            widths[f"field_{name}"] = mode.count
    columns, start = {}, 0
    for name, width in widths.items():
        columns[name] = slice(start, start + width)
        start += width
    two_sigma = 2.0 * uncertainty.density
    denser, thinner = with_air(density=two_sigma), with_air(density=-two_sigma)
    quadrature = quadrature_error(model, bins, flow, force, moment)
    nonlinearity = [
        np.hypot(a + b - 2.0 * c, r) for a, b, c, r in zip(denser, thinner, nominal, quadrature, strict=True)
    ]
    return PredictionJacobian(np.stack(force_columns, axis=2), np.stack(rate_columns, axis=2), columns, *nonlinearity)


def bins_of_either_regime(model: ForwardModel, residuals: Residuals, density_sigma: float) -> BoolArray:
    """Bins ``(B,)`` in which either of two tables with independent errors may apply.

    Parameters
    ----------
    model : ForwardModel
        With the database.
    residuals : Residuals
        With the flow along the path.
    density_sigma : float
        Relative sigma of the density, which the Knudsen number has too.
    """
    database, knudsen = model.database, residuals.flow.knudsen
    if database.join != "switch":
        return np.zeros((len(knudsen) - 1) // NODES_PER_BIN, bool)
    near = np.abs(np.log(knudsen / database.continuum_limit)) < _REGIME_SIGMAS * density_sigma
    uncertain = np.any(near[:-1].reshape(-1, NODES_PER_BIN), axis=1)
    return uncertain | np.append(uncertain[1:], False)  # the step of the rate spans the next bin too


def interpolated_angles(table: object) -> Array:
    """Angles between which a table is linear ``(A,)``, rad; empty for smooth tables."""
    return table.alpha if isinstance(table, GridTable) and table.interpolation == "linear" else np.zeros(0)


def coefficient_loads(
    inputs: ModelInputs, residuals: Residuals, name: str, units: CoefficientUnits
) -> tuple[Array, Array]:
    """Change of force (N) and moment (N m) at the nodes ``(M, 3)`` by one unit of a coefficient.

    Parameters
    ----------
    inputs : ModelInputs
        The model, and the readings corrected by its sensor effects.
    residuals : Residuals
        With the flow along the path.
    name : str
        ``ca``, ``cn`` or ``cm``.
    units : CoefficientUnits
        The units.
    """
    model, flow, tables = inputs.forward_model, residuals.flow, residuals.tables
    perturbation = Perturbation.zero(units).with_unit(name)
    # effects act on the tables before a perturbation is added; the loads are linear in the sum
    nominal = replace(model, perturbation=Perturbation.zero(units)).loads(flow, tables)
    changed = replace(model, perturbation=perturbation).loads(flow, tables)
    return changed[0] - nominal[0], changed[1] - nominal[1]


def field_modes(
    inputs: ModelInputs, bins: TimeBins, residuals: Residuals, prior: DiscrepancyPrior, units: CoefficientUnits
) -> dict[str, AngleModes]:
    """Modes of the database's discrepancy that a flight resolves.

    Parameters
    ----------
    inputs : ModelInputs
        The model, and the readings corrected by its sensor effects.
    bins : TimeBins
        Time bins of the comparison.
    residuals : Residuals
        With the flow along the path.
    prior : DiscrepancyPrior
        Of the discrepancy.
    units : CoefficientUnits
        One sigma of the database.
    """
    driving = inputs.driving
    sigma_f = bin_sigma(bins, driving.time, driving.interval, driving.force_noise)
    sigma_w = np.sqrt(2.0) * bin_sigma(bins, driving.time, driving.interval, driving.rate_noise)[:-1]
    angle, modes, database = residuals.flow.alpha_total, {}, inputs.forward_model.database
    table_angles = interpolated_angles(database.continuum), interpolated_angles(database.rarefied)
    for name in FIELD_COEFFICIENTS:
        force, rate_step = predict_increment(
            inputs.forward_model, bins, *coefficient_loads(inputs, residuals, name, units)
        )
        information = np.sum(force**2, axis=1) / sigma_f**2
        information[:-1] += np.sum(rate_step**2, axis=1) / sigma_w**2
        information = np.where(bins.valid & np.isfinite(information), information, 0.0) / NODES_PER_BIN
        modes[name] = prior.angle_modes(name, angle[:-1], np.repeat(information, NODES_PER_BIN), table_angles)
    return modes


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


def _predict_at(model: ForwardModel, bins: TimeBins, nodes: PathNodes) -> tuple[Array, Array]:
    return predict(model, bins, flow_at(model, nodes))


@dataclass(frozen=True)
class BinRows:
    """Measurement rows of the time bins.

    Attributes
    ----------
    design : (B, 6 + 6 p, n + m) array
        Specific force, step of the rate, then force and rate of each of p checking IMUs.
    noise : (B, 6 + 6 p, 6 + 6 p) array
        Covariance of the rows' own noise.
    used : (B, 6 + 6 p) array of bool
    values : (B, 6 + 6 p) array
        The residuals.
    """

    design: Array
    noise: Array
    used: BoolArray
    values: Array


def bin_rows(
    inputs: ModelInputs,
    bins: TimeBins,
    residuals: Residuals,
    denoised: tuple[Array, Array],
    nuisance: NuisanceLayout,
    jacobian: PredictionJacobian,
    uncertainty: StatedUncertainty,
    flow_distance: Array,
) -> BinRows:
    """Design matrix, noise and residuals of the rows at the bins' ends.

    Parameters
    ----------
    inputs : ModelInputs
        The model, and the readings corrected by its sensor effects.
    bins : TimeBins
        Time bins of the comparison.
    residuals : Residuals
        Residuals about the linearisation point.
    denoised : (force, rate)
        Means over the bins ``(B, 3)`` of denoised readings.
    nuisance : NuisanceLayout
        Positions of the nuisance parameters.
    jacobian : PredictionJacobian
        Jacobian of the predictions.
    uncertainty : StatedUncertainty
        Uncertainties that the mission states.
    flow_distance : (M - 1,) array
        Distances between adjoining nodes, in correlation lengths of the database's discrepancy.
    """
    samples, layout = inputs.problem.samples, nuisance.layout
    b, imus = len(bins.interval), len(inputs.checking)
    width = 6 + 6 * imus
    design = np.zeros((b, width, nuisance.size))
    driving = inputs.driving
    sigma_f = bin_sigma(bins, driving.time, driving.interval, driving.force_noise)
    sigma_w = bin_sigma(bins, driving.time, driving.interval, driving.rate_noise)

    altitude = residuals.flow.altitude[::NODES_PER_BIN]
    correlation_steps = uncertainty.correlation_steps(bins.interval, np.diff(altitude))
    for name in ("position", "velocity", "attitude"):
        part = layout[name]
        design[:, :3, part] = jacobian.force[:, :, jacobian.columns[name]]
        design[:-1, 3:6, part] = jacobian.rate_step[:, :, jacobian.columns[name]]
    for name, scale in uncertainty.sigma.items():
        if name in nuisance:
            part, column = nuisance[name], jacobian.columns[name].start
            # the value at the bin's end, where the step of the rate is; the force is a mean half a bin earlier
            design[:, :3, part.start] = jacobian.force[:, :, column] * scale
            design[:-1, 3:6, part.start] = jacobian.rate_step[:, :, column] * scale
            if part.stop - part.start == 2:
                half_step = -0.5 * correlation_steps[name]
                design[:, :3, part.start + 1] = half_step[:, None] * design[:, :3, part.start]

    bin_distance = np.sum(flow_distance.reshape(b, NODES_PER_BIN), axis=1)
    discrepancy = np.zeros((b, width))
    for name, part in nuisance.fields.items():
        columns = jacobian.columns[f"field_{name}"]
        design[:, :3, part] = jacobian.force[:, :, columns]
        design[:-1, 3:6, part] = jacobian.rate_step[:, :, columns]
        derivative = slice(part.stop, 2 * part.stop - part.start)
        half_step = np.where(bin_distance < 1.0, -0.5 * bin_distance, 0.0)  # not from one regime to the other
        design[:, :3, derivative] = half_step[:, None, None] * jacobian.force[:, :, columns]
        discrepancy[:, :3] += np.sum(jacobian.force[:, :, columns] ** 2, axis=2)
        discrepancy[:-1, 3:6] += np.sum(jacobian.rate_step[:, :, columns] ** 2, axis=2)

    # gyro noise: the step of the rate itself, and the rotation within the two bins of the step
    eye = np.eye(3)
    before, after = nuisance["gyro_noise_before"], nuisance["gyro_noise_after"]
    design[:, 3:6, before], design[:, 3:6, after] = -eye, eye
    within = jacobian.rate_step[:, :, jacobian.columns["attitude"]] * (bins.interval[:-1] / 6.0)[:, None, None]
    design[:-1, 3:6, before] += within
    design[:-1, 3:6, after] -= within

    force, rate = denoised
    rate_step = np.concatenate((np.diff(rate, axis=0), np.zeros((1, 3))))
    sensor_blocks = reading_jacobian(force, rate)
    for name, block in sensor_blocks.items():
        if name in layout:
            part = layout[name]
            if name.startswith("accelerometer"):
                design[:, :3, part] += block
            else:
                by_rate = jacobian.rate_step[:, :, jacobian.columns["rate"]]
                at_edge = 0.5 * (block[:-1] + block[1:])
                design[:-1, 3:6, part] -= np.einsum("bij,bjk->bik", by_rate, at_edge)
                if name == "gyro_scale":
                    design[:, 3:6, part] += rate_step[:, :, None] * eye
    middle = 0.5 * (bins.edges[1:] + bins.edges[:-1])
    position = driving.position[driving.index_at(middle)]
    path_rate = bin_means(bins.edges, samples.time, samples.interval, residuals.path.rate)
    driving_lever = lever_arm_error(bins, path_rate, position)
    values = np.full((b, width), np.nan)
    values[:, :3], values[:-1, 3:6] = residuals.force, residuals.rate_step
    noise = np.zeros((b, width, width))
    noise[:, range(3), range(3)] = (sigma_f**2)[:, None] + jacobian.force_nonlinearity**2 + driving_lever**2
    noise[:, range(3, 6), range(3, 6)] = ((_STEP_NOISE_SHARE * sigma_w) ** 2)[:, None]
    noise[:-1, range(3, 6), range(3, 6)] += jacobian.rate_step_nonlinearity**2
    # which of two tables applies is not known about the limit: the errors of both are noise there
    either = bins_of_either_regime(inputs.forward_model, residuals, uncertainty.density)
    noise[:, range(6), range(6)] += np.where(either[:, None], _EITHER_REGIME * discrepancy[:, :6], 0.0)
    for i, record in enumerate(inputs.checking):
        f0, w0 = 6 + 6 * i, 9 + 6 * i
        at_bin = record.index_at(middle)
        checking_unit = record.unit[at_bin]
        values[:, f0 : f0 + 3], values[:, w0 : w0 + 3] = residuals.checking_force[i], residuals.checking_rate[i]
        for name, block in sensor_blocks.items():
            row = slice(f0, f0 + 3) if name.startswith("accelerometer") else slice(w0, w0 + 3)
            if name in layout:  # the driving IMU's error enters the prediction
                design[:, row, layout[name]] = -block
            for unit in np.unique(checking_unit):
                state = checking_state(i, unit, name)
                if state in nuisance:
                    design[:, row, nuisance[state]] = np.where((checking_unit == unit)[:, None, None], block, 0.0)
        design[:, w0 : w0 + 3, before] = -eye
        checking_f = bin_sigma(bins, record.time, record.interval, record.force_noise)
        checking_w = bin_sigma(bins, record.time, record.interval, record.rate_noise)
        lever = lever_arm_error(bins, path_rate, record.position[at_bin] - position)
        noise[:, range(f0, f0 + 3), range(f0, f0 + 3)] = (sigma_f**2 + checking_f**2)[:, None] + lever**2
        noise[:, range(w0, w0 + 3), range(w0, w0 + 3)] = (checking_w**2)[:, None]
        for c in range(3):  # the driving IMU's noise is common to its own row and to those of all checking IMUs
            noise[:, c, f0 + c] = noise[:, f0 + c, c] = -(sigma_f**2)
            for j in range(i):
                noise[:, 6 + 6 * j + c, f0 + c] = noise[:, f0 + c, 6 + 6 * j + c] = sigma_f**2
    used = np.isfinite(values) & bins.valid[:, None]
    used[:-1, 3:6] &= bins.valid[1:, None]
    used[-1, 3:6] = False
    return BinRows(np.where(used[:, :, None], design, 0.0), noise, used, np.where(used, values, 0.0))


def numerical_error_units(residuals: Residuals, uncertainty: StatedUncertainty) -> CoefficientUnits:
    """One sigma of the numerical error of the coefficients at the nodes."""
    flow, tables, relative = residuals.flow, residuals.tables, uncertainty.numerical
    return CoefficientUnits(
        flow.time, ca=relative * tables.ca, cn=relative * tables.cn, cm=relative * np.abs(tables.cm_nose)
    )


def database_units(inputs: ModelInputs, residuals: Residuals, prior: DiscrepancyPrior) -> CoefficientUnits:
    """One sigma of the database's discrepancy at the nodes."""
    flow, database = residuals.flow, inputs.forward_model.database
    third = np.full(len(flow.mach), prior.scale / 3.0)
    limits = database.lookup(flow.mach, flow.knudsen, flow.alpha_total, flow.speed).three_sigma
    if database.increments is not None:  # their own covariance holds where they apply
        remainder = database.increments.remainder(flow.mach, flow.knudsen, flow.alpha_total, database.continuum_limit)
        third = third * np.sqrt(remainder)
    return CoefficientUnits(flow.time, ca=third * limits.ca, cn=third * limits.cn, cm=third * limits.cm)


def lever_arm_error(bins: TimeBins, rate: Array, position: Array) -> Array:
    """Error of a lever-arm acceleration where the torque is discontinuous.

    The tangential part is the difference of the rates at the bin's edges, of eighth order in the means
    (`imu_model.lever_arm`). At a discontinuity of the rate's slope the error of that order is up to nine times the
    difference between sixth and fourth order; a discontinuity is where this difference exceeds `_DISCONTINUITY` times
    its median over the ten bins before and after.

    Parameters
    ----------
    bins : TimeBins
        Time bins of the comparison.
    rate : (B, 3) array
        Means over the bins, rad/s.
    position : (B, 3) array
        Lever arm in each bin, m.

    Returns
    -------
    (B, 3) array
        m/s².
    """
    change = np.zeros((len(rate) + 1, 3))
    if len(rate) > 6:
        pairs = (rate[2:-3] + rate[3:-2], rate[1:-4] + rate[4:-1], rate[:-5] + rate[5:])
        sixth, fourth = (sum(w * p for w, p in zip(edge_weights(k), pairs, strict=False)) for k in (3, 2))
        change[3:-3] = sixth - fourth
    size = np.linalg.norm(np.nan_to_num(change), axis=1)
    discontinuous = size > _DISCONTINUITY * median_filter(size, 21)
    edge_error = np.where(discontinuous[:, None], 9.0 * np.nan_to_num(change), 0.0)
    before, after = (np.cross(e, position) / bins.interval[:, None] for e in (edge_error[:-1], edge_error[1:]))
    return np.hypot(before, after)


def bin_sigma(bins: TimeBins, time: Array, interval: Array, noise: Array) -> Array:
    """One sigma of the means over bins of samples with independent noise.

    Parameters
    ----------
    bins : TimeBins
        Time bins of the comparison.
    time, interval, noise : (N,) arrays
        End and length of the samples' intervals, s; one sigma of each sample.

    Returns
    -------
    (B,) array
    """
    variance = bin_means(bins.edges, time, interval, noise**2 * interval)
    return np.sqrt(variance / bins.interval)
