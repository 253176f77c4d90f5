"""Residuals: measured minus predicted, of every instrument and constraint, and their order in the residual vector.

Along a dead-reckoned path the forward model predicts specific force and steps of the rate (`predicted_readings`) as the
IMU samples them. A checking IMU is compared with the readings that the driving IMU implies for its place; the
constraints are compared with the path. Readings of all IMUs are corrected for the errors of their interpolation about
the linearisation point (`interpolation_error`), and predictions for that of the quadrature (`predicted_readings`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter import rotations
from edl_filter.diagnosis.prediction.dead_reckoning import (
    NODES_PER_BIN,
    DeadReckonedPath,
    PathNodes,
    dead_reckon,
    displace_nodes,
    path_nodes,
)
from edl_filter.diagnosis.prediction.interpolation_error import InterpolationErrors, positions_at
from edl_filter.diagnosis.prediction.predicted_readings import FINE_NODES_PER_BIN, flow_at, predict
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_means, bin_means_of_readings
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.imu_model.lever_arm import lever_arm_acceleration
from edl_filter.navigation.constraints import Altimeter, OnboardAttitude
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.increments import Samples
from edl_filter.telemetry.record import ImuRecord
from edl_filter.types import Array, IntArray


@dataclass(frozen=True)
class ModelInputs:
    """A model, and the measurements under its sensor effects.

    Attributes
    ----------
    problem : Problem
        Samples corrected for the effects' sensor errors, gravity and entry state with the effects.
    forward_model : ForwardModel
    driving : ImuRecord
        The IMU behind the samples, with the noise of its readings alone: motion within a sample disturbs integration,
        not the sample's mean.
    checking : tuple of ImuRecord
        The other IMUs, body axes.
    """

    problem: Problem
    forward_model: ForwardModel
    driving: ImuRecord
    checking: tuple[ImuRecord, ...]


@dataclass(frozen=True)
class PathReference:
    """What the path depends on, in addition to the model.

    Attributes
    ----------
    bins : TimeBins
    start : (10,) array
        Navigation state at the initial state's time.
    errors : (U, n) array
        Sensor errors by instrument, in the filter's vector.
    onboard : (C, 4) array or None
        On-board attitude propagated to the constraints' times; it depends on the gyros alone.
    interpolation_errors : InterpolationErrors or None
        Of the linearisation point; None: not corrected for.
    deviation : (B + 1, 9) array or None
        Of the path along which the flow is evaluated, from the dead-reckoned one (`dead_reckoning.displace_nodes`).
    """

    bins: TimeBins
    start: Array
    errors: Array
    onboard: Array | None
    interpolation_errors: InterpolationErrors | None = None
    deviation: Array | None = None


@dataclass(frozen=True)
class Residuals:
    """Measured minus predicted, and the predictions.

    Attributes
    ----------
    force : (B, 3) array
        Specific force, m/s².
    rate_step : (B - 1, 3) array
        Step of the mean rate between adjoining bins, rad/s.
    checking_force, checking_rate : tuples of (B, 3) arrays
        Of each checking IMU, m/s² and rad/s.
    constraints : tuple of (m,) arrays
    path : DeadReckonedPath
        Dead-reckoned.
    nodes : PathNodes
    flow : FlightCondition
        At the nodes.
    tables : AeroCoefficients
        Coefficients of the database there, without effects.
    predicted_force, predicted_rate_step : (B, 3), (B - 1, 3) arrays
    quadrature_correction : ((B, 3), (B - 1, 3)) arrays
        Part of the predictions: by the fine rule less by the nodes.
    """

    force: Array
    rate_step: Array
    checking_force: tuple[Array, ...]
    checking_rate: tuple[Array, ...]
    constraints: tuple[Array, ...]
    path: DeadReckonedPath
    nodes: PathNodes
    flow: FlightCondition
    tables: AeroCoefficients
    predicted_force: Array
    predicted_rate_step: Array
    quadrature_correction: tuple[Array, Array]


@dataclass(frozen=True)
class RowIndex:
    """Position of each residual in the residual vector, whose elements are the rows of the state-space model.

    Attributes
    ----------
    bin_rows : (B, width) array of int
        Row of each channel of each bin; -1 where it is not used.
    constraint_rows : tuple of slices
        By constraint.
    count : int
        Number of rows.
    step_interval : (K,) array
        Time between a step and the one before, s.
    time : (R,) array
        Of each row, s.
    column : (R,) array of int
        Of each row within its step's noise block.
    """

    bin_rows: IntArray
    constraint_rows: tuple[slice, ...]
    count: int
    step_interval: Array
    time: Array
    column: IntArray

    def stack(self, residuals: Residuals) -> Array:
        """All residuals as one vector ``(R,)``."""
        out = self.stack_predictions(
            residuals.force, residuals.rate_step, residuals.checking_force, residuals.checking_rate
        )
        for rows, residual in zip(self.constraint_rows, residuals.constraints, strict=True):
            out[rows] = residual
        return out

    def stack_predictions(
        self,
        force: Array,
        rate_step: Array,
        checking_force: tuple[Array, ...] = (),
        checking_rate: tuple[Array, ...] = (),
    ) -> Array:
        """Values of the bins as one vector ``(R,)``; zero in all other rows.

        Parameters
        ----------
        force, rate_step : (B, 3) and (B - 1, 3) arrays
            Specific force, m/s², and steps of the rate, rad/s.
        checking_force, checking_rate : tuples of (B, 3) arrays
            Of each checking IMU, m/s² and rad/s.
        """
        out = np.zeros(self.count)
        table = np.zeros(self.bin_rows.shape)
        table[:, :3], table[:-1, 3:6] = force, rate_step
        for i, (f, w) in enumerate(zip(checking_force, checking_rate, strict=True)):
            table[:, 6 + 6 * i : 9 + 6 * i], table[:, 9 + 6 * i : 12 + 6 * i] = f, w
        used = self.bin_rows >= 0
        out[self.bin_rows[used]] = table[used]
        return out

    def step_of_bins(self, row_start: IntArray) -> tuple[IntArray, IntArray]:
        """Bins whose force is compared, and the step of the model at which each ends.

        Parameters
        ----------
        row_start : (K + 1,) array of int
            First row of each step.
        """
        used = np.flatnonzero(self.bin_rows[:, 0] >= 0)
        return used, np.searchsorted(row_start, self.bin_rows[used, 0], side="right") - 1


def compute_residuals(reference: PathReference, inputs: ModelInputs) -> Residuals:
    """Residuals of a model along the path that its readings imply."""
    bins, problem, model = reference.bins, inputs.problem, inputs.forward_model
    samples = problem.samples
    path = dead_reckon(problem, reference.start, reference.errors, own_lever_arm(inputs))
    force, rate = bin_readings(bins, samples, (path.force, path.rate))
    errors = reference.interpolation_errors
    nodes, fine_nodes = (
        path_nodes(path, bins, rate, count, None if errors is None else errors.at_nodes(count))
        for count in (NODES_PER_BIN, FINE_NODES_PER_BIN)
    )
    if reference.deviation is not None:
        nodes, fine_nodes = (displace_nodes(n, bins.edges, reference.deviation) for n in (nodes, fine_nodes))
    flow = flow_at(model, nodes)
    tables = model.table_coefficients(flow)
    predicted_force, predicted_rate_step = predict(model, bins, flow_at(model, fine_nodes))
    by_nodes = predict(model, bins, flow, tables)
    checking = [_checking_residuals(record, bins, samples, path.rate, force, rate) for record in inputs.checking]
    residuals = Residuals(
        force=force - predicted_force,
        rate_step=np.diff(rate, axis=0) - predicted_rate_step,
        checking_force=tuple(f for f, _ in checking),
        checking_rate=tuple(w for _, w in checking),
        constraints=constraint_residuals(reference, path, problem),
        path=path,
        nodes=nodes,
        flow=flow,
        tables=tables,
        predicted_force=predicted_force,
        predicted_rate_step=predicted_rate_step,
        quadrature_correction=(predicted_force - by_nodes[0], predicted_rate_step - by_nodes[1]),
    )
    return correct_interpolation(residuals, errors)


def correct_interpolation(residuals: Residuals, errors: InterpolationErrors | None) -> Residuals:
    """Residuals whose readings are corrected for the errors of their interpolation.

    A checking IMU is compared with the driving one.

    Parameters
    ----------
    residuals : Residuals
        Not corrected.
    errors : InterpolationErrors or None
        None: no correction.

    Returns
    -------
    Residuals
    """
    if errors is None:
        return residuals
    driving_force, *lever_arm = errors.lever_arm
    driving_rate, *rate = errors.rate
    forces = zip(residuals.checking_force, lever_arm, strict=True)
    rates = zip(residuals.checking_rate, rate, strict=True)
    return replace(
        residuals,
        force=residuals.force - driving_force,
        rate_step=residuals.rate_step + np.diff(driving_rate, axis=0),
        checking_force=tuple(force + driving_force - error for force, error in forces),
        checking_rate=tuple(value + error - driving_rate for value, error in rates),
    )


def with_predictions(residuals: Residuals, bins: TimeBins, model: ForwardModel, changed_air: bool) -> Residuals:
    """Residuals along the same path with the predictions of another forward model, and the same quadrature correction.

    Parameters
    ----------
    residuals : Residuals
        With the predictions of a model.
    bins : TimeBins
        Time bins of the comparison.
    model : ForwardModel
        The other model, with the same planet.
    changed_air : bool
        Whether its air differs; otherwise the flow at the nodes is kept.
    """
    flow, tables = residuals.flow, residuals.tables
    if changed_air:
        flow = flow_at(model, residuals.nodes)
        tables = model.table_coefficients(flow)
    by_nodes = predict(model, bins, flow, tables)
    predicted_force, predicted_rate_step = (
        p + c for p, c in zip(by_nodes, residuals.quadrature_correction, strict=True)
    )
    return replace(
        residuals,
        force=residuals.force + residuals.predicted_force - predicted_force,
        rate_step=residuals.rate_step + residuals.predicted_rate_step - predicted_rate_step,
        predicted_force=predicted_force,
        predicted_rate_step=predicted_rate_step,
        flow=flow,
        tables=tables,
    )


def bin_readings(bins: TimeBins, samples: Samples, readings: tuple[Array, Array]) -> tuple[Array, Array]:
    """Means over the bins ``(B, 3)`` of force and rate that are given by sample ``(N, 3)``."""
    force, rate = (bin_means(bins.edges, samples.time, samples.interval, x) for x in readings)
    return force, rate


def constraint_residuals(reference: PathReference, path: DeadReckonedPath, problem: Problem) -> tuple[Array, ...]:
    """Measured minus predicted of every constraint along a path.

    Parameters
    ----------
    reference : PathReference
        Sensor errors and on-board attitudes along the path.
    path : DeadReckonedPath
        States of the path.
    problem : Problem
        Samples and constraints.

    Returns
    -------
    tuple of (m,) arrays
        One for each constraint, in the units of its components.
    """
    constraints = problem.constraints
    index = problem.samples.indices([c.time for c in constraints])
    units = problem.samples.unit[np.maximum(index - 1, 0)]
    nav = path.nav[index]
    if reference.onboard is not None:
        nav = np.concatenate((nav, reference.onboard), axis=1)
    residuals: dict[int, Array] = {}
    by_sphere: dict[float, list[int]] = {}
    onboard: dict[int, Array] = {}
    for i, c in enumerate(constraints):
        if isinstance(c, Altimeter):  # there may be thousands of them: all at once
            by_sphere.setdefault(c.surface_radius, []).append(i)
        elif isinstance(c, OnboardAttitude):
            onboard[i] = c.inertial_from_body
        else:
            prediction = c.predict(nav[i][:, None], reference.errors[units[i]][:, None], problem.layout)[0]
            residuals[i] = c.measured - prediction
    for which in by_sphere.values():
        heights = constraints[which[0]].predict(nav[which].T, reference.errors[units[which]].T, problem.layout)
        residuals |= {i: constraints[i].measured - h for i, h in zip(which, heights, strict=True)}
    if onboard:
        which = list(onboard)
        rotation = rotations.rotation_vector_between(np.array(list(onboard.values())), nav[which, 10:])
        residuals |= dict(zip(which, -rotation, strict=True))
    return tuple(residuals[i] for i in range(len(constraints)))


def _checking_residuals(
    record: ImuRecord, bins: TimeBins, samples: Samples, sample_rate: Array, force: Array, rate: Array
) -> tuple[Array, Array]:
    """Readings of a checking IMU less those that the driving IMU implies, means over the bins ``(B, 3)``.

    Parameters
    ----------
    record : ImuRecord
        The checking IMU.
    bins : TimeBins
        Time bins of the comparison.
    samples : Samples
        Samples of the driving IMU.
    sample_rate : (N, 3) array
        Rate by sample, rad/s. The lever-arm acceleration is computed sample by sample: over longer steps its tangential
        part loses an order.
    force, rate : (B, 3) arrays
        Means of the driving IMU over the bins, m/s² and rad/s.
    """
    measured_force, measured_rate = (
        bin_means_of_readings(bins, record, values) for values in (record.specific_force, record.angular_rate)
    )
    lever_arm = lever_arm_readings(record, samples, sample_rate)
    return (
        measured_force - force - bin_means(bins.edges, samples.time, samples.interval, lever_arm),
        measured_rate - rate,
    )


def lever_arm_readings(record: ImuRecord, samples: Samples, sample_rate: Array) -> Array:
    """Lever-arm acceleration of an IMU at the samples of the driving one ``(N, 3)``, m/s², from its rates (rad/s)."""
    # the rates are the driving IMU's, so that their instrument is that of the samples
    return lever_arm_acceleration(samples.interval, sample_rate, positions_at(record, samples), samples.unit)


def own_lever_arm(inputs: ModelInputs) -> Array:
    """Lever-arm acceleration of the driving IMU that its readings contain ``(N, 3)``, m/s²."""
    samples = inputs.problem.samples
    return lever_arm_readings(inputs.driving, samples, samples.mean_rate)
