"""Measurement rows of the time bins: design matrix, noise and residuals of each bin.

A row of the design matrix is the derivative of one residual with respect to all states: those of the path, of the
sensors and of the model. Noise beyond that of the readings stands for departures of the model from linearity, for
discontinuities of the torque, and for the regime of the flow where the density does not determine it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from edl_filter.diagnosis.jacobians.nuisance import NuisanceLayout, StatedUncertainty, checking_state
from edl_filter.diagnosis.jacobians.prediction_jacobian import PredictionJacobian
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.interpolation_error import InterpolationErrors
from edl_filter.diagnosis.prediction.residuals import ModelInputs, Residuals
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_means, bin_sigma
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.imu_model.lever_arm import edge_weights
from edl_filter.imu_model.sensor_errors import reading_jacobian
from edl_filter.types import Array, BoolArray

#: Share of a bin's gyro noise that a step of the rate has in addition to the noise of the two bins' means, which are
#: states: the covariance of the rows is regular, and the variance of a step increases by 0.1 %.
_STEP_NOISE_SHARE = 0.05
#: Sigmas of the density within which the regime of the flow is uncertain (the limit is beyond them in 0.3 %), and over
#: which the variance declines beyond: with a step of it the likelihood would have steps, as the path moves.
_REGIME_SIGMAS, _DECLINE_SIGMAS = 3.0, 0.25
#: Variance of the errors of two tables in units of that of one: its upper bound, (1 + 1)² where they are correlated.
_EITHER_REGIME = 4.0
#: Factor over the median around it from which a change of the rate's slope is a discontinuity, and number of edges of
#: that median, ten before and ten after: smooth motion changes less over ten bins, and one discontinuity does not
#: change a median.
_DISCONTINUITY, _MEDIAN_EDGES = 3.0, 21
#: Largest error of eighth order over the largest difference between sixth and fourth order at the edges around a
#: discontinuity: 2.2 to 8.6, by its place in the bin.
_ERROR_RATIO = 9.0


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
    denoised: tuple[Sequence[Array], Array],
    nuisance: NuisanceLayout,
    jacobian: PredictionJacobian,
    uncertainty: StatedUncertainty,
    flow_distance: Array,
    interpolation: InterpolationErrors,
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
    denoised : (forces, rate)
        Means over the bins ``(B, 3)`` of the denoised force at each IMU, the driving one first, and of the rate.
    nuisance : NuisanceLayout
        Positions of the nuisance parameters.
    jacobian : PredictionJacobian
        Jacobian of the predictions.
    uncertainty : StatedUncertainty
        Uncertainties that the mission states.
    flow_distance : (M - 1,) array
        Distances between adjoining nodes, in correlation lengths of the database's discrepancy.
    interpolation : InterpolationErrors
        For which the residuals are corrected.
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

    # gyro noise: the step of the rate itself, the moments at the mean of both rates, and the rotation within both bins
    eye = np.eye(3)
    by_rate = jacobian.rate_step[:, :, jacobian.columns["rate"]]
    before, after = nuisance["gyro_noise_before"], nuisance["gyro_noise_after"]
    design[:, 3:6, before], design[:, 3:6, after] = -eye, eye
    within = jacobian.rate_step[:, :, jacobian.columns["attitude"]] * (bins.interval[:-1] / 6.0)[:, None, None]
    design[:-1, 3:6, before] += within - 0.5 * by_rate
    design[:-1, 3:6, after] -= within + 0.5 * by_rate

    forces, rate = denoised
    rate_step = np.concatenate((np.diff(rate, axis=0), np.zeros((1, 3))))
    driving_blocks = reading_jacobian(forces[0], rate)
    for name, block in driving_blocks.items():
        if name in layout:
            part = layout[name]
            if name.startswith("accelerometer"):
                design[:, :3, part] += block
            else:
                at_edge = 0.5 * (block[:-1] + block[1:])
                design[:-1, 3:6, part] -= np.einsum("bij,bjk->bik", by_rate, at_edge)
                if name == "gyro_scale":
                    design[:, 3:6, part] += rate_step[:, :, None] * eye
    middle = 0.5 * (bins.edges[1:] + bins.edges[:-1])
    position = driving.position[driving.index_at(middle)]
    path_rate = bin_means(bins.edges, samples.time, samples.interval, residuals.path.rate)
    driving_lever = discontinuity_sigma(bins, path_rate, position)
    values = np.full((b, width), np.nan)
    values[:, :3], values[:-1, 3:6] = residuals.force, residuals.rate_step
    noise = np.zeros((b, width, width))
    noise[:, range(3), range(3)] = (sigma_f**2)[:, None] + jacobian.force_nonlinearity**2 + driving_lever**2
    noise[:, range(3, 6), range(3, 6)] = ((_STEP_NOISE_SHARE * sigma_w) ** 2)[:, None]
    noise[:-1, range(3, 6), range(3, 6)] += jacobian.rate_step_nonlinearity**2
    # which of two tables applies is not known about the limit: their difference and the errors of both are noise there
    either = weight_of_either_regime(inputs.forward_model, residuals.flow.altitude, uncertainty.density)
    variance = _EITHER_REGIME * discrepancy[:, :6]
    variance[:, :3] += jacobian.force_by_regime**2
    variance[:-1, 3:] += jacobian.rate_step_by_regime**2
    noise[:, range(6), range(6)] += either[:, None] * variance
    # of the step of the angular acceleration where the other table begins to apply, (rad/s²)²
    step_variance = maximum_filter1d(variance[:, 3:] / bins.interval[:, None] ** 2, 3, axis=0)
    for i, record in enumerate(inputs.checking):
        f0, w0 = 6 + 6 * i, 9 + 6 * i
        at_bin = record.index_at(middle)
        checking_unit = record.unit[at_bin]
        values[:, f0 : f0 + 3], values[:, w0 : w0 + 3] = residuals.checking_force[i], residuals.checking_rate[i]
        for name, block in reading_jacobian(forces[1 + i], rate).items():
            row = slice(f0, f0 + 3) if name.startswith("accelerometer") else slice(w0, w0 + 3)
            if name in layout:  # the driving IMU's error enters the prediction
                design[:, row, layout[name]] = -driving_blocks[name]
            for unit in np.unique(checking_unit):
                state = checking_state(i, unit, name)
                if state in nuisance:
                    design[:, row, nuisance[state]] = np.where((checking_unit == unit)[:, None, None], block, 0.0)
        design[:, w0 : w0 + 3, before] = -eye
        checking_f = bin_sigma(bins, record.time, record.interval, record.force_noise)
        checking_w = bin_sigma(bins, record.time, record.interval, record.rate_noise)
        lever = discontinuity_sigma(bins, path_rate, record.position[at_bin] - position)
        noise[:, range(f0, f0 + 3), range(f0, f0 + 3)] = (sigma_f**2 + checking_f**2)[:, None] + lever**2
        response = np.hypot(interpolation.step_response[0], interpolation.step_response[1 + i])
        misplaced = response**2 * step_variance  # the place of that step within a sample is not known
        noise[:, range(w0, w0 + 3), range(w0, w0 + 3)] = (checking_w**2)[:, None] + either[:, None] * misplaced
        for c in range(3):  # the driving IMU's noise is common to its own row and to those of all checking IMUs
            noise[:, c, f0 + c] = noise[:, f0 + c, c] = -(sigma_f**2)
            for j in range(i):
                noise[:, 6 + 6 * j + c, f0 + c] = noise[:, f0 + c, 6 + 6 * j + c] = sigma_f**2
    used = np.isfinite(values) & bins.valid[:, None]
    used[:-1, 3:6] &= bins.valid[1:, None]
    used[-1, 3:6] = False
    design[~used] = 0.0
    return BinRows(design, noise, used, np.where(used, values, 0.0))


def weight_of_either_regime(model: ForwardModel, altitude: Array, density_sigma: float) -> Array:
    """Weight of the variance where either of two tables may apply, by bin ``(B,)``: one near the limit, zero far off.

    By the Knudsen number at the stated density, so that the rows' noise is the same about every point and with every
    effect: their log determinant would change by hundreds of nats, which would count as evidence where two models are
    compared. Within `_REGIME_SIGMAS` the weight is one: the table about a point follows its density, and is wrong in
    a few bins with the whole difference, wherever they lie.

    Parameters
    ----------
    model : ForwardModel
        With the database.
    altitude : (M,) array
        At the nodes, m.
    density_sigma : float
        Relative sigma of the density.
    """
    database = model.database
    bins = (len(altitude) - 1) // NODES_PER_BIN
    if database.join != "switch" or density_sigma == 0.0:
        return np.zeros(bins)
    knudsen = model.gas.knudsen(model.atmosphere.density(altitude), model.diameter)
    distance = np.abs(np.log(knudsen / database.continuum_limit)) / density_sigma
    beyond = np.maximum(distance - _REGIME_SIGMAS, 0.0) / _DECLINE_SIGMAS
    in_bin = np.max(np.exp(-0.5 * beyond**2)[:-1].reshape(-1, NODES_PER_BIN), axis=1)
    return np.maximum(in_bin, np.append(in_bin[1:], 0.0))  # the step of the rate spans the next bin too


def discontinuity_sigma(bins: TimeBins, rate: Array, position: Array) -> Array:
    """Error of a lever-arm acceleration where the torque is discontinuous.

    The tangential part is the difference of the rates at the bin's edges, of eighth order in the means
    (`imu_model.lever_arm`). At a discontinuity of the rate's slope the error of that order is up to nine times the
    difference between sixth and fourth order (`_ERROR_RATIO`); a discontinuity is where this difference exceeds
    `_DISCONTINUITY` times its median over the ten bins before and after (`_MEDIAN_EDGES`).

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
    discontinuous = size > _DISCONTINUITY * median_filter(size, _MEDIAN_EDGES)
    edge_error = np.where(discontinuous[:, None], _ERROR_RATIO * np.nan_to_num(change), 0.0)
    before, after = (np.cross(e, position) / bins.interval[:, None] for e in (edge_error[:-1], edge_error[1:]))
    return np.hypot(before, after)
