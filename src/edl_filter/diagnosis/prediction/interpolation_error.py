"""Errors of readings that are interpolated between samples, predicted by the forward model.

Readings of an IMU are interpolated between the means over the samples for four reasons: the acceleration of the IMU's
place needs the rates at the edges of the samples and the products of the rates inside them (`imu_model.lever_arm`), a
time offset of the gyros needs the rates between the samples (`effects.sensors.delayed`), the bins of the comparison end
inside the samples of a checking IMU with another clock (`time_bins.bin_means`), and the forward model needs attitudes
and rates inside the bins (`dead_reckoning.path_nodes`). The interpolation has the order of
its stencil where the motion is smooth. It has not where the moment changes its slope inside a sample: at the nodes of
an aerodynamic table that is linear between them. Motion near half of the sampling frequency cannot be interpolated at
all. On a vehicle that swings through 33° at 8 Hz the lever-arm acceleration is wrong by up to 60 sigmas of an
accelerometer; a step of rates that are shifted by half a sample is wrong by five sigmas at angles of 8°; attitudes
inside a bin of 0.125 s are wrong by up to 0.2 mrad at 1.2 Hz and 15°, and predicted moments by 0.8 sigmas RMS.

The forward model predicts the angular acceleration at several nodes in each bin. The same interpolation of the means
of the predicted rates, compared with the predicted rates themselves, shows its error. Only differences of rates over a
few samples enter, so that the error of the prediction does not accumulate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from edl_filter.diagnosis.prediction.dead_reckoning import node_times, rate_integral
from edl_filter.diagnosis.prediction.predicted_readings import FINE_NODES_PER_BIN
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_means, bin_means_of_readings
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.sensor_chain import samples_of, sensor_effects
from edl_filter.imu_model.lever_arm import (
    EDGE_REACH,
    lever_arm_acceleration,
    lever_arm_acceleration_of_products,
)
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.rotation_corrections import gauss_legendre
from edl_filter.telemetry.record import SAME_TIME, ImuRecord
from edl_filter.types import Array

#: Gauss-Legendre nodes in a sample: exact for products of rates that are polynomials of fourth degree.
QUADRATURE_NODES = 5
#: Parts of a sample over which a sensor that reads at another time is simulated.
PARTS = 8
#: Places of a step of the angular acceleration within a sample at which its interpolation error is computed, and half
#: the number of samples of that computation: beyond, a spline's error is below one part in 10⁹.
STEP_PLACES, STEP_SAMPLES = (0.0, 0.25, 0.5, 0.75), 16
#: Time before and after the prediction over which its acceleration is continued, s: more than a time offset reaches.
MARGIN_S = 4.0


@dataclass(frozen=True)
class InterpolationErrors:
    """What interpolated readings lack of the true ones, means over the bins.

    Attributes
    ----------
    lever_arm : tuple of (B, 3) arrays
        Of the lever-arm acceleration of the driving IMU and each checking one, m/s².
    rate : tuple of (B, 3) arrays
        Of the rates of the driving IMU and each checking one, rad/s; zero in bins that the IMU does not cover.
    step_response : tuple of float
        Largest error of the same by a step of the angular acceleration of 1 rad/s², rad/s.
    node_angle, node_rate : (B FINE_NODES_PER_BIN + 1, 3) arrays
        Of the integral of the rate and of the rate at the nodes of the fine rule, rad and rad/s.
    """

    lever_arm: tuple[Array, ...]
    rate: tuple[Array, ...]
    step_response: tuple[float, ...]
    node_angle: Array
    node_rate: Array

    def at_nodes(self, per_bin: int) -> tuple[Array, Array]:
        """Errors ``(M, 3)`` of the integral of the rate, rad, and of the rate, rad/s, with `per_bin` nodes in a bin."""
        every = FINE_NODES_PER_BIN // per_bin
        return self.node_angle[::every], self.node_rate[::every]


class PredictedRotation:
    """A rotation that starts with zero rate and has a predicted angular acceleration.

    Parameters
    ----------
    time : (M,) array
        s, increasing.
    angular_acceleration : (M, 3) array
        Predicted at `time`, rad/s², body axes. It is constant before the first and after the last time.
    """

    def __init__(self, time: Array, angular_acceleration: Array) -> None:
        self.begin, self.end = float(time[0]), float(time[-1])
        self._acceleration = CubicSpline(time, angular_acceleration, axis=0)
        self._rate = self._acceleration.antiderivative()
        self._angle = self._rate.antiderivative()

    def angle(self, time: Array) -> Array:
        """Integrals ``(..., 3)`` of the rate since the start, at times ``(...)`` up to the end, rad."""
        return np.asarray(self._angle(time), float)

    def rate(self, time: Array) -> Array:
        """Rates ``(..., 3)`` at times ``(...)`` from the start to the end, rad/s."""
        return np.asarray(self._rate(time), float)

    def mean_rate(self, edges: Array) -> Array:
        """Mean rates ``(N, 3)`` between adjoining edges ``(N + 1,)`` (s), rad/s."""
        inside = np.clip(edges, self.begin, self.end)
        beyond = (edges - inside)[:, None]
        angle = self._angle(inside) + beyond * (self._rate(inside) + 0.5 * beyond * self._acceleration(inside))
        return np.asarray(np.diff(angle, axis=0) / np.diff(edges)[:, None], float)


def node_errors(rotation: PredictedRotation, bins: TimeBins, per_bin: int) -> tuple[Array, Array]:
    """Integral of the rate and rate of a predicted rotation at the nodes, less those interpolated from its means.

    Parameters
    ----------
    rotation : PredictedRotation
        Predicted from the first to the last edge of the bins.
    bins : TimeBins
        B time bins of the comparison.
    per_bin : int
        Number of nodes in a bin.

    Returns
    -------
    angle, rate : (B per_bin + 1, 3) arrays
        rad, zero at the edges, and rad/s.
    """
    time, interpolated = node_times(bins, per_bin), rate_integral(bins, rotation.mean_rate(bins.edges))
    return rotation.angle(time) - interpolated(time), rotation.rate(time) - interpolated.derivative()(time)


def rate_error(
    rotation: PredictedRotation, record: ImuRecord, effects: Sequence[EffectInstance], driving: bool
) -> Array:
    """Mean rates of a predicted rotation, less those that readings corrected for a time offset give.

    Parameters
    ----------
    rotation : PredictedRotation
        Predicted.
    record : ImuRecord
        N samples of an IMU.
    effects : sequence of EffectInstance
        Those with `Effect.interpolates_rates` that act on the record are applied to the means over parts of the
        samples, and inverted from the means over the samples.
    driving : bool
        As in `effects.sensor_chain.corrected_record`.

    Returns
    -------
    (N, 3) array
        rad/s; zero in samples on which no such effect acts, in those outside the prediction and in those without a
        reading.
    """
    error = np.zeros((len(record), 3))
    edges = record.edges
    near = np.flatnonzero((edges[1:] > rotation.begin - MARGIN_S) & (edges[:-1] < rotation.end + MARGIN_S))
    acting = [(a, samples_of(record, a.imu, driving)[near]) for a in sensor_effects(effects)]
    acting = [(a, affected) for a, affected in acting if a.effect.interpolates_rates and affected.any()]
    if not acting:
        return error
    parts = edges[near[0]] + np.append(0.0, np.cumsum(np.repeat(record.interval[near] / PARTS, PARTS)))
    none, none_in_parts = np.zeros((len(near), 3)), np.zeros((len(near) * PARTS, 3))
    read = rotation.mean_rate(parts)
    for a, affected in acting:
        changed = a.effect.imu(a.values, parts[1:], none_in_parts, read)[1]
        read = np.where(np.repeat(affected, PARTS)[:, None], changed, read)
    rate = np.mean(read.reshape(len(near), PARTS, 3), axis=1)
    rate[np.isnan(record.angular_rate[near])] = np.nan
    for a, affected in acting[::-1]:
        rate = np.where(affected[:, None], a.effect.corrected(a.values, record.time[near], none, rate)[1], rate)
    covered = (edges[near] >= rotation.begin - SAME_TIME) & (edges[near + 1] <= rotation.end + SAME_TIME)
    covered &= np.any([affected for _, affected in acting], axis=0)
    error[near[covered]] = np.nan_to_num(rotation.mean_rate(parts[::PARTS]) - rate)[covered]
    return error


def resampling_error(rotation: PredictedRotation, bins: TimeBins, record: ImuRecord, rate_errors: Array) -> Array:
    """Mean rates of a predicted rotation over the bins, less those that a checking IMU's samples give.

    Parameters
    ----------
    rotation : PredictedRotation
        Predicted.
    bins : TimeBins
        B time bins of the comparison.
    record : ImuRecord
        N samples of the IMU.
    rate_errors : (N, 3) array
        `rate_error` of the samples, rad/s.

    Returns
    -------
    (B, 3) array
        rad/s; zero in bins that the IMU does not cover.
    """
    read = bin_means_of_readings(bins, record, rotation.mean_rate(record.edges) - rate_errors)
    return np.nan_to_num(rotation.mean_rate(bins.edges) - read)


def step_response(record: ImuRecord, effects: Sequence[EffectInstance], driving: bool) -> float:
    """Largest `rate_error` of a step of the angular acceleration of 1 rad/s², rad/s.

    The error depends on the place of the step within a sample, in size and in sign. Where the place is not known, what
    remains of a predicted error is as large as this.

    Parameters
    ----------
    record, effects, driving
        As of `rate_error`; the record has more than twice `STEP_SAMPLES` samples.
    """
    acting = [a for a in effects if a.effect.interpolates_rates and samples_of(record, a.imu, driving).any()]
    if not acting:
        return 0.0
    affected = np.flatnonzero(np.any([samples_of(record, a.imu, driving) for a in acting], axis=0))
    middle = int(np.clip(affected[len(affected) // 2], STEP_SAMPLES, len(record) - STEP_SAMPLES - 1))
    edges, step = record.edges, float(record.interval[middle])
    time = np.arange(edges[middle - STEP_SAMPLES], edges[middle + STEP_SAMPLES], step / 64.0)
    errors = []
    for place in STEP_PLACES:
        acceleration = np.where(time > edges[middle] + place * step, 1.0, 0.0)
        rotation = PredictedRotation(time, np.repeat(acceleration[:, None], 3, axis=1))
        errors.append(np.max(np.abs(rate_error(rotation, record, acting, driving))))
    return float(max(errors))


def lever_arm_error(
    rotation: PredictedRotation, samples: Samples, rate_errors: Array, positions: Sequence[Array]
) -> list[Array]:
    """Mean lever-arm acceleration of a predicted rotation, less that interpolated from its mean rates.

    Parameters
    ----------
    rotation : PredictedRotation
        Predicted from the first edge of the samples on.
    samples : Samples
        The driving IMU's; the rates of N samples are means over them.
    rate_errors : (N, 3) array
        `rate_error` of the samples, rad/s.
    positions : sequence of (N, 3) arrays
        Places of instruments from the centre of mass at the samples, m, body axes.

    Returns
    -------
    list of (N, 3) arrays
        By instrument, m/s². Zero after the prediction's end, and at both ends, where the interpolation has not all its
        neighbours.
    """
    count = samples.index(rotation.end)
    interval = samples.interval[:count]
    edges = samples.edges[: count + 1]
    mean_rate = rotation.mean_rate(edges) - rate_errors[:count]
    mean_acceleration = np.diff(rotation.rate(edges), axis=0) / interval[:, None]
    abscissae, weights = gauss_legendre(QUADRATURE_NODES)
    inside = rotation.rate((edges[:-1, None] + interval[:, None] * abscissae).ravel())
    inside = inside.reshape(count, QUADRATURE_NODES, 3)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    products = np.stack([(inside[:, :, i] * inside[:, :, j]) @ weights for i, j in pairs], axis=1)
    complete = slice(EDGE_REACH, count - EDGE_REACH)
    errors = []
    for position in positions:
        exact = lever_arm_acceleration_of_products(mean_acceleration, products, position[:count])
        interpolated = lever_arm_acceleration(interval, mean_rate, position[:count], samples.unit[:count])
        error = np.zeros((len(samples.time), 3))
        error[complete] = (exact - interpolated)[complete]
        errors.append(error)
    return errors


def interpolation_errors(
    rotation: PredictedRotation,
    bins: TimeBins,
    samples: Samples,
    records: Sequence[ImuRecord],
    effects: Sequence[EffectInstance],
) -> InterpolationErrors:
    """Errors of all readings' interpolation.

    Parameters
    ----------
    rotation : PredictedRotation
        Predicted from the first to the last edge of the bins.
    bins : TimeBins
        Time bins of the comparison.
    samples : Samples
        The driving IMU's.
    records : sequence of ImuRecord
        The driving IMU, then the checking ones.
    effects : sequence of EffectInstance
        For whose sensor errors the records are corrected.
    """
    driving, *_ = records
    of_records = [(record, record is driving) for record in records]

    def of_bins(record: ImuRecord, is_driving: bool, error: Array) -> Array:
        if is_driving:  # its samples end where bins end
            return bin_means(bins.edges, record.time, record.interval, error)
        return resampling_error(rotation, bins, record, error)

    rates = [rate_error(rotation, record, effects, is_driving) for record, is_driving in of_records]
    of_samples = rates[0][driving.index_at(samples.middle)]
    lever_arm = lever_arm_error(rotation, samples, of_samples, [positions_at(record, samples) for record in records])
    node_angle, node_rate = node_errors(rotation, bins, FINE_NODES_PER_BIN)
    return InterpolationErrors(
        lever_arm=tuple(bin_means(bins.edges, samples.time, samples.interval, error) for error in lever_arm),
        rate=tuple(of_bins(*record, error) for record, error in zip(of_records, rates, strict=True)),
        step_response=tuple(step_response(record, effects, is_driving) for record, is_driving in of_records),
        node_angle=node_angle,
        node_rate=node_rate,
    )


def positions_at(record: ImuRecord, samples: Samples) -> Array:
    """Place of an IMU from the centre of mass at the samples of the driving one ``(N, 3)``, m, body axes."""
    return record.position[record.index_at(samples.middle)]
