"""Relative calibration of two IMUs of one vehicle: lever arm, alignment, biases, scales and clock.

Input: the records of a reference and of a checked IMU, body axes. Both measure the motion of one rigid body, so that
their difference is linear in the errors of one against the other (Groves 2013, sections 4.4 and 15.2):

    w_c - w_r = w × φ_g + b_g - τ dw/dt
    f_c - f_r = α × δ + w × (w × δ) + f × φ_f + s f_x x + b_f - τ df/dt

with δ the error of the stated lever arm, φ the small rotations of the gyro and accelerometer triads, b biases, s the
scale error along the axis of symmetry x and τ the delay of the checked IMU. To first order φ, s and b are the errors of
`imu_model.sensor_errors`, φ = -m; the gyros have a φ too, because the axes are those of the reference. Lateral forces
are too small to show their scale errors, or a rotation of the accelerometers about x: that of the gyros is used for it.
Method: least squares with weights. The variance of a difference is that of its axis, from the residuals, and in the
forces that of the lever-arm acceleration's interpolation: where the samples do not resolve an oscillation, it errs in
phase with the derivative by the lever arm. The vehicle's structure vibrates and the residuals are correlated in time;
the covariance is therefore computed from the sums of the scores over blocks that are longer than the correlation
(cluster-robust covariance, Liang & Zeger 1986). Output: `RelativeCalibration`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter import rotations
from edl_filter.imu_model.lever_arm import lever_arm_acceleration, mean_derivative
from edl_filter.imu_model.sensor_errors import reading_jacobian
from edl_filter.telemetry.record import ImuRecord, within_window
from edl_filter.telemetry.resampling import (
    GAP_REACH,
    comparable_records,
    covered_by,
    interpolation_sigma,
    means_between,
    near_lost,
    readings_integral,
    samples_less_often,
)
from edl_filter.types import Array, BoolArray

#: Fewest common samples of a calibration.
FEWEST_SAMPLES = 100
#: Length of the blocks of the covariance, s: several oscillations of an entry vehicle; at least so many blocks.
_BLOCK_LENGTH, _FEWEST_BLOCKS = 5.0, 25
#: Iterations of the weights.
_WEIGHT_ITERATIONS = 4
#: Iterations of the linearisation.
_ITERATIONS = 3
#: Least scatter of an axis and size of a column; and sigma of a parameter that the differences do not contain.
_LEAST, _UNKNOWN = 1e-60, 1e6
#: Least scatter of an axis relative to the largest one of its triad.
_LEAST_SHARE = 1e-6

#: Parameters in the order of the regression, and their numbers.
_BLOCKS = {
    "lever_arm": 3, "force_alignment": 2, "axial_scale": 1, "force_bias": 3, "rate_alignment": 3, "rate_bias": 3,
    "delay": 1,
}  # fmt: skip


@dataclass(frozen=True)
class RelativeCalibration:
    """A checked IMU against a reference IMU, body axes.

    Attributes
    ----------
    start, end : float
        Window, s since the epoch.
    samples : int
        Number of common samples.
    stated_lever_arm : (3,) array
        Place of the checked IMU from the reference IMU by the records' positions at the end of the window, m.
    lever_arm, lever_arm_sigma : (3,) arrays
        The same, estimated, and one sigma, m.
    rate_alignment, rate_alignment_sigma : (3,) arrays
        Rotation φ of the gyros, ``w_c = w_r + w_r × φ``, rad.
    force_alignment, force_alignment_sigma : (3,) arrays
        Rotation φ of the accelerometers, rad; about x it is that of the gyros.
    axial_scale, axial_scale_sigma : float
        Difference of the scale errors of the accelerometers along x.
    force_bias, force_bias_sigma : (3,) arrays
        Difference of the accelerometers' biases, m/s².
    rate_bias, rate_bias_sigma : (3,) arrays
        Difference of the gyros' biases, rad/s.
    delay, delay_sigma : float
        By how much the checked IMU's readings are late against the reference's, s.
    force_rms, rate_rms : (3,) arrays
        Root mean square of the residuals, m/s² and rad/s.
    """

    start: float
    end: float
    samples: int
    stated_lever_arm: Array
    lever_arm: Array
    lever_arm_sigma: Array
    rate_alignment: Array
    rate_alignment_sigma: Array
    force_alignment: Array
    force_alignment_sigma: Array
    axial_scale: float
    axial_scale_sigma: float
    force_bias: Array
    force_bias_sigma: Array
    rate_bias: Array
    rate_bias_sigma: Array
    delay: float
    delay_sigma: float
    force_rms: Array
    rate_rms: Array


def relative_calibration(
    reference: ImuRecord, checked: ImuRecord, start: float, end: float
) -> RelativeCalibration | None:
    """Calibrate one IMU against another over a window.

    Parameters
    ----------
    reference, checked : ImuRecord
        Records in body axes; samples that are no direct readings (`ImuRecord.coning_corrected`, gaps) are not used,
        and of each record those of the instrument that has most samples in the window.
    start, end : float
        Window, s since the epoch.

    Returns
    -------
    RelativeCalibration or None
        None if the window has fewer than `FEWEST_SAMPLES` common samples.
    """
    original, stated = reference, _places(reference, checked)
    faster = checked if samples_less_often(reference, checked) else reference  # its rates resolve the motion
    reference, checked = comparable_records(reference, checked)
    first, last = max(start, reference.start, checked.start), min(end, reference.time[-1], checked.time[-1])
    inside = within_window(reference.time, reference.interval, first, last)
    covered = covered_by(checked, _direct(checked, first, last), reference.edges)
    used = inside & _direct(reference, first, last) & covered
    if np.count_nonzero(used) < FEWEST_SAMPLES:
        return None
    offset = _places(reference, checked)
    force, rate = (np.nan_to_num(x) for x in (reference.specific_force, reference.angular_rate))

    edges = reference.edges

    def arm_acceleration(arm: Array) -> Array:
        if faster is reference:
            return lever_arm_acceleration(reference.interval, rate, arm, reference.unit)
        rows = reference.index_at(faster.middle)
        rates = np.nan_to_num(faster.angular_rate)
        acceleration = lever_arm_acceleration(faster.interval, rates, arm[rows], faster.unit)
        return means_between(readings_integral(faster, acceleration), edges)[0]

    columns = [arm_acceleration(np.tile(axis, (len(rate), 1))) for axis in np.eye(3)]
    integral = readings_integral(checked, checked.specific_force, checked.angular_rate)
    unresolved = np.zeros((6, int(used.sum())))
    if faster is reference:
        unresolved[:3] = (interpolation_sigma(reference.interval, rate) * np.linalg.norm(offset, axis=1))[used]
    error, delay = np.zeros(3), 0.0
    for _ in range(_ITERATIONS):  # products of the errors: delay times lever arm, rotation times lever arm
        predicted = force + arm_acceleration(offset + error)
        checked_force, checked_rate = means_between(integral, edges + delay)
        differences = np.hstack((checked_force - predicted, checked_rate - rate))[used].T
        design = _design(reference, predicted, rate, used, columns)
        values, sigma, scatter = _least_squares(reference.time[used], differences, design, unresolved)
        error, delay = error + values["lever_arm"], delay + float(values["delay"][0])
    times = reference.time[used]
    arm = stated[original.index_at(times[-1:] - 0.5 * reference.interval[used][-1:])][0]
    return RelativeCalibration(
        start=float(times[0] - reference.interval[used][0]),
        end=float(times[-1]),
        samples=len(times),
        stated_lever_arm=arm,
        lever_arm=arm + error,
        lever_arm_sigma=sigma["lever_arm"],
        rate_alignment=values["rate_alignment"],
        rate_alignment_sigma=sigma["rate_alignment"],
        force_alignment=np.concatenate((values["rate_alignment"][:1], values["force_alignment"])),
        force_alignment_sigma=np.concatenate((sigma["rate_alignment"][:1], sigma["force_alignment"])),
        axial_scale=float(values["axial_scale"][0]),
        axial_scale_sigma=float(sigma["axial_scale"][0]),
        force_bias=values["force_bias"],
        force_bias_sigma=sigma["force_bias"],
        rate_bias=values["rate_bias"],
        rate_bias_sigma=sigma["rate_bias"],
        delay=delay,
        delay_sigma=float(sigma["delay"][0]),
        force_rms=scatter[:3],
        rate_rms=scatter[3:],
    )


def _places(reference: ImuRecord, checked: ImuRecord) -> Array:
    """Place of the checked IMU from the reference IMU at the samples of the latter (N, 3), m."""
    return checked.position[checked.index_at(reference.middle)] - reference.position


def _direct(record: ImuRecord, first: float, last: float) -> BoolArray:
    """Samples (N,) that are readings of the instrument which has most samples in the window, away from gaps."""
    readings = ~record.coning_corrected & ~record.sculling_corrected & ~record.filled
    readings &= record.complete
    units = record.unit[readings & within_window(record.time, record.interval, first, last)]
    if not len(units):
        return np.zeros(len(readings), bool)
    readings &= record.unit == np.bincount(units).argmax()
    gaps = near_lost(~readings)
    gaps[:GAP_REACH] = gaps[-GAP_REACH:] = True
    return ~gaps


def _design(reference: ImuRecord, force: Array, rate: Array, used: BoolArray, arm: list[Array]) -> Array:
    """Derivatives ``(6, n, P)`` of the differences by the parameters: three axes of force, three of rate."""
    force_change, rate_change = (mean_derivative(reference.interval, x) for x in (force, rate))
    columns = dict(zip(_BLOCKS, np.cumsum([0, *_BLOCKS.values()]), strict=False))
    design = np.zeros((6, int(used.sum()), sum(_BLOCKS.values())))
    of_force, of_rate = design[:3], design[3:]
    errors = reading_jacobian(force[used], rate[used])
    for k in range(3):
        of_force[:, :, columns["lever_arm"] + k] = arm[k][used].T
        rotation = columns["rate_alignment"] if k == 0 else columns["force_alignment"] + k - 1
        of_force[:, :, rotation] = -errors["accelerometer_misalignment"][:, :, k].T
        of_force[:, :, columns["force_bias"] + k] = errors["accelerometer_bias"][:, :, k].T
        of_rate[:, :, columns["rate_alignment"] + k] = rotations.cross_matrix(rate[used])[:, :, k].T
        of_rate[:, :, columns["rate_bias"] + k] = errors["gyro_bias"][:, :, k].T
    of_force[:, :, columns["axial_scale"]] = errors["accelerometer_scale"][:, :, 0].T
    of_force[:, :, columns["delay"]] = -force_change[used].T
    of_rate[:, :, columns["delay"]] = -rate_change[used].T
    return design


def _at_least(scatter: Array) -> Array:
    """Scatter (6,) of the axes, limited from below."""
    largest = np.repeat(np.max(scatter.reshape(2, 3), axis=1), 3)
    return np.maximum(scatter, np.maximum(_LEAST_SHARE * largest, _LEAST))


def _least_squares(
    times: Array, differences: Array, design: Array, unresolved: Array
) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """Weighted least squares with the covariance of correlated residuals.

    Parameters
    ----------
    times : (n,) array
        s.
    differences : (6, n) array
        Of the force, m/s², and the rate, rad/s, by axis.
    design : (6, n, P) array
        Of `_design`.
    unresolved : (6, n) array
        One sigma of the differences' error by interpolation.

    Returns
    -------
    estimates, sigmas : dict
        By the names of `_BLOCKS`.
    scatter : (6,) array
        Of the residuals of each axis.

    Notes
    -----
    The variance of an axis is the weighted mean of the squared residuals less the squares of `unresolved` (estimate of
    a variance component by moments). The errors by interpolation are coherent over the oscillations of a block: their
    mean over a block has their own variance, not that divided by the number of samples, which multiplies the variance
    in the weights.
    """
    length = min(_BLOCK_LENGTH, (times[-1] - times[0]) / _FEWEST_BLOCKS)
    coherent = max(1.0, length * len(times) / (times[-1] - times[0])) * unresolved**2
    rows = design.reshape(-1, design.shape[2])
    # an axis that reads one value throughout has no scatter, and a parameter that moves nothing no size
    variance = _at_least(np.std(differences, axis=1)) ** 2
    for _ in range(_WEIGHT_ITERATIONS):
        weight = 1.0 / (variance[:, None] + coherent)
        weighted = weight.reshape(-1, 1) * rows
        normal = weighted.T @ rows
        size = np.maximum(np.sqrt(np.diag(normal)), _LEAST)
        inverse = np.linalg.pinv(normal / np.outer(size, size), hermitian=True)
        values = inverse @ (weighted.T @ differences.ravel() / size) / size
        residual = differences - design @ values
        moments = np.sum(weight**2 * (residual**2 - unresolved**2), axis=1) / np.sum(weight**2, axis=1)
        variance = _at_least(np.sqrt(np.maximum(moments, 0.0))) ** 2
    scatter = _at_least(np.std(residual, axis=1))
    scores = np.sum((residual.reshape(-1, 1) * weighted).reshape(design.shape), axis=0) / size
    _, block = np.unique(np.floor((times - times[0]) / length), return_inverse=True)
    sums = np.zeros((block[-1] + 1, scores.shape[1]))
    np.add.at(sums, block, scores)
    sandwich = inverse @ (sums.T @ sums) @ inverse * len(sums) / (len(sums) - 1.0)
    sigma = np.where(size > _LEAST, np.sqrt(np.maximum(np.diag(sandwich), 0.0)) / size, _UNKNOWN)
    ends = np.cumsum(list(_BLOCKS.values()))[:-1]
    estimates, sigmas = (dict(zip(_BLOCKS, np.split(v, ends), strict=True)) for v in (values, sigma))
    return estimates, sigmas, scatter
