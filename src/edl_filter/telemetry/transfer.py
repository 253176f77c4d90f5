"""What one IMU would have read, from the readings of another IMU of the same rigid vehicle.

Input: the records of both, body axes. Method: the lever arm between them, alignments, biases, scale and delay are those
of `relative_calibration`, each combined with zero at its prior sigma, so that what a flight does not show stays small;
then the specific force is moved through the lever arm, and the means over the other IMU's samples become means over
the samples of the first (quintic spline of their integrals). Output: readings with their sigmas, that of the
interpolation included: in a shock, means do not determine what happens within a sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from edl_filter.estimation.series import finite_rows
from edl_filter.imu_model.lever_arm import EDGE_REACH, lever_arm_acceleration, mean_derivative
from edl_filter.imu_model.sensor_errors import remove_errors
from edl_filter.telemetry.record import ImuRecord
from edl_filter.telemetry.relative_calibration import relative_calibration
from edl_filter.telemetry.resampling import (
    angular_acceleration_error,
    covered,
    means_between,
    means_error,
    readings_integral,
)
from edl_filter.types import Array, BoolArray

#: Prior sigmas of one IMU's errors against the other where the telemetry states smaller ones: accelerometer bias
#: (m/s²), scale, alignment (rad), gyro bias (rad/s), lever arm (m), delay (s).
_PRIOR = {"force_bias": 0.02, "axial_scale": 2e-3, "alignment": 0.02, "rate_bias": 2e-4, "lever_arm": 0.05,
          "delay": 0.02}  # fmt: skip
#: Samples on each side over which the scatter of the difference between two IMUs is taken.
_SCATTER_REACH = 40
#: Samples on each side of an edge with which the error of an interpolation with `EDGE_REACH` samples is estimated. The
#: differences of two IMUs in the parachute's shock, at 8 samples a second, are 3.1 to 4.0 times what 3 samples predict
#: (4 simulated flights), on the rovers 2.1 and 2.2 times; they are 1.2 to 1.6, and 0.8, times what 2 samples predict.
_LOWER_REACH = 2


@dataclass(frozen=True)
class TransferredReadings:
    """Readings of another IMU at the place, in the axes and at the times of a reference IMU.

    Attributes
    ----------
    force, rate : (N, 3) arrays
        Means over the reference's samples, m/s² and rad/s; NaN where the other IMU has no samples.
    force_scatter, rate_scatter : (N, 3) arrays
        One sigma of the errors that are independent between samples.
    force_error, rate_error : (N, 3) arrays
        One sigma of the errors that are the same in all samples of a stretch: what the calibration does not determine.
        What remains between the IMUs because their errors are not constant is not part of it
        (`sample_filling.filled`).
    """

    force: Array
    rate: Array
    force_scatter: Array
    rate_scatter: Array
    force_error: Array
    rate_error: Array

    @property
    def valid(self) -> BoolArray:
        """Samples ``(N,)`` that the other IMU covers."""
        return finite_rows(self.force) & finite_rows(self.rate)


def transferred(
    reference: ImuRecord, source: ImuRecord, end: float, calibrated: tuple[ImuRecord, ImuRecord] | None = None
) -> TransferredReadings:
    """Readings of `source`, as `reference` would have read them.

    Parameters
    ----------
    reference, source : ImuRecord
        Records in body axes; NaN where samples are lost.
    end : float
        End of the time over which they are calibrated against each other, s: the parachute, whose shocks are no motion
        of a rigid body.
    calibrated : tuple of ImuRecord, optional
        The same records without samples that would falsify the calibration.

    Returns
    -------
    TransferredReadings
    """
    estimate = relative_calibration(*(calibrated or (reference, source)), -np.inf, end)

    def combined(name: str, prior: float) -> tuple[Array, Array]:
        """Estimate and sigma of a parameter with its prior."""
        if estimate is None:
            return np.zeros(3), np.full(3, prior)
        sigma = np.maximum(np.atleast_1d(getattr(estimate, f"{name}_sigma")), 1e-12)
        value = np.atleast_1d(getattr(estimate, name))
        if name == "lever_arm":
            value = value - estimate.stated_lever_arm
        weight = prior**2 / (prior**2 + sigma**2)
        return value * weight, sigma * np.sqrt(weight)

    arm, arm_sigma = combined("lever_arm", _PRIOR["lever_arm"])
    force_bias, force_bias_sigma = combined("force_bias", _PRIOR["force_bias"])
    rate_bias, rate_bias_sigma = combined("rate_bias", _PRIOR["rate_bias"])
    force_alignment, force_alignment_sigma = combined("force_alignment", _PRIOR["alignment"])
    rate_alignment, rate_alignment_sigma = combined("rate_alignment", _PRIOR["alignment"])
    scale, scale_sigma = (float(v[0]) for v in combined("axial_scale", _PRIOR["axial_scale"]))
    delay, delay_sigma = (float(v[0]) for v in combined("delay", _PRIOR["delay"]))
    # on the other IMU's samples: remove its errors; f × φ = m × f with the misalignment m = -φ
    rate = remove_errors(source.angular_rate, -rate_alignment, bias=rate_bias)
    force = remove_errors(source.specific_force, -force_alignment, np.array([scale, 0.0, 0.0]), force_bias)
    nearest = reference.index_at(source.middle - delay)
    offset = source.position - reference.position[nearest] + arm
    lost = ~(finite_rows(force) & finite_rows(rate))
    moved = np.where(lost[:, None], 0.0, rate)
    force = force - lever_arm_acceleration(source.interval, moved, offset, source.unit)
    arm_error = np.abs(np.cross(angular_acceleration_error(source.interval, moved, _LOWER_REACH), offset))
    arm_error[:EDGE_REACH] = arm_error[-EDGE_REACH:] = 0.0  # beyond the ends of the record are no rates
    edges = reference.edges + delay
    usable = covered(source, edges)
    integral = readings_integral(source, force, rate)
    means = [np.where(usable[:, None], mean, np.nan) for mean in means_between(integral, edges)]
    middle = source.index_at(reference.middle + delay)
    errors = [maximum_filter1d(np.abs(error), 3, axis=0) for error in means_error(source, edges, force, rate)]
    errors[0] = np.hypot(errors[0], maximum_filter1d(arm_error, 3, axis=0)[middle])
    known = np.nan_to_num(means[0]), np.nan_to_num(means[1])
    change = [mean_derivative(reference.interval, v) for v in known]
    square = np.sum(known[1] ** 2, axis=1, keepdims=True)
    force_error = np.sqrt(
        force_bias_sigma**2
        + _crossed(known[0], force_alignment_sigma)
        + np.array([scale_sigma, 0.0, 0.0]) ** 2 * known[0] ** 2
        + (delay_sigma * change[0]) ** 2
        + _crossed(change[1], arm_sigma)
        + square**2 * np.mean(arm_sigma**2)
    )
    rate_error = np.sqrt(rate_bias_sigma**2 + _crossed(known[1], rate_alignment_sigma) + (delay_sigma * change[1]) ** 2)
    scatters = [
        _scatter(own - mean, mean, error, noise)
        for own, mean, error, noise in (
            (reference.specific_force, means[0], errors[0], reference.force_noise),
            (reference.angular_rate, means[1], errors[1], reference.rate_noise),
        )
    ]
    return TransferredReadings(means[0], means[1], scatters[0], scatters[1], force_error, rate_error)


def log_prior_of_rate_errors(reference: ImuRecord, source: ImuRecord, end: float) -> float:
    """Log density of the constant errors of one IMU's rates against another's under their priors, less its maximum.

    Those of the forces are not determined by a part of the flight without much force.

    Parameters
    ----------
    reference, source : ImuRecord
        Records in body axes.
    end : float
        End of the time over which they are calibrated against each other, s.

    Returns
    -------
    float
        nats.
    """
    estimate = relative_calibration(reference, source, -np.inf, end)
    if estimate is None:
        return 0.0
    errors = (
        (estimate.rate_bias, estimate.rate_bias_sigma, _PRIOR["rate_bias"]),
        (estimate.rate_alignment, estimate.rate_alignment_sigma, _PRIOR["alignment"]),
        (np.array(estimate.delay), np.array(estimate.delay_sigma), _PRIOR["delay"]),
    )
    return -0.5 * sum(float(np.sum(value**2 / (prior**2 + sigma**2))) for value, sigma, prior in errors)


def _crossed(vectors: Array, sigma: Array) -> Array:
    """Variances (N, 3) of ``v × φ`` where the components of φ have the sigmas (3,)."""
    x, y, z = (vectors**2).T
    a, b, c = sigma**2
    return np.column_stack((y * c + z * b, z * a + x * c, x * b + y * a))


def _scatter(difference: Array, mean: Array, interpolation: Array, noise: Array) -> Array:
    """Sigma (N, 3) of the errors that are independent between samples.

    The root of a sum of variances. The first is that of the interpolation (N, 3), times what the differences between
    the two IMUs are of it in the flight, but not less than once. The second is the local variance of the differences in
    samples in which the interpolation adds less than the noise; where none is nearby, of the nearest ones. In a
    shock, where the means vary from sample to sample more than around, what remains of the differences is in the ratio
    to this variation that it has in the flight's other shocks.
    """
    known = finite_rows(difference)
    if not known.any():
        return np.sqrt(2.0 * noise[:, None] ** 2 + interpolation**2)
    variance = interpolation**2
    fourth_power = np.sum(variance[known] ** 2)
    if fourth_power > 0.0:
        variance = variance * max(np.sum(difference[known] ** 2 * variance[known]) / fourth_power, 1.0)
    smooth = known & np.all(variance <= noise[:, None] ** 2, axis=1)
    rows = np.flatnonzero(smooth if np.count_nonzero(smooth) >= _SCATTER_REACH else known)
    powers = (difference[rows], difference[rows] ** 2)
    sums = [np.concatenate((np.zeros((1, 3)), np.cumsum(power, axis=0))) for power in powers]
    middle = np.searchsorted(rows, np.arange(len(difference)))
    first, last = np.maximum(middle - _SCATTER_REACH, 0), np.minimum(middle + _SCATTER_REACH, len(rows))
    local, mean_square = ((total[last] - total[first]) / np.maximum(last - first, 1)[:, None] for total in sums)
    variation = _shock(np.nan_to_num(mean))
    power = np.sum(variation[known] ** 4)
    remaining = np.mean(np.maximum(difference[known] ** 2 - variance[known], 0.0), axis=1)
    share = np.sum(remaining * variation[known] ** 2) / power if power > 0.0 else 0.0
    shock = min(share, 1.0) * variation[:, None] ** 2
    return np.sqrt(np.maximum(mean_square - local**2, noise[:, None] ** 2) + variance + shock)


def _shock(mean: Array) -> Array:
    """Length (N,) of what a sample differs from its neighbours' mean, beyond three times what is usual around it."""
    change = np.zeros(len(mean))
    change[1:-1] = np.linalg.norm(mean[1:-1] - 0.5 * (mean[:-2] + mean[2:]), axis=1)
    usual = median_filter(change, size=2 * _SCATTER_REACH + 1, mode="nearest")
    return np.asarray(np.maximum(maximum_filter1d(change, 3) - 3.0 * usual, 0.0), float)
