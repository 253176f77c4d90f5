"""Parity of two IMUs of one rigid vehicle: the part of their difference that constant errors do not explain.

Input: records of both in body axes, bad samples NaN. Method: parity of two redundant sensors (Potter & Suman 1977,
AGARD-AG-224; Gertler 1998, Fault Detection and Diagnosis in Engineering Systems, chapter 5). The readings of the second
IMU are moved to the place and samples of the first (`pair_of`); their difference is regressed on what constant errors
of either IMU add to it (`_regressors`): biases, all scale errors and misalignments, lever arm, delay, and a drift of
the clocks. Output (`parity_of`): the remainder, its variances by the noise of both and by their stated errors as far as
these vary in flight, and the delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from edl_filter.estimation.interpolating_spline import PiecewiseSpline
from edl_filter.imu_model.lever_arm import EDGE_REACH, lever_arm_acceleration, mean_derivative
from edl_filter.telemetry.record import ImuRecord
from edl_filter.telemetry.relative_calibration import FEWEST_SAMPLES
from edl_filter.telemetry.resampling import covered, interpolation_sigma, means_between, readings_integral
from edl_filter.types import Array, BoolArray

#: Iterations of the delay.
_DELAY = 3
#: Largest delay that is a constant error, s: that of the catalogue of effects.
_LARGEST_DELAY = 2.0


@dataclass(frozen=True)
class Pair:
    """Two IMUs, and what their comparison needs.

    Attributes
    ----------
    reference, checked : ImuRecord
    usable : (N,) boolean array
        Samples of the reference that are direct readings before the end of the comparison.
    rate, force : (N, 3) arrays
        Readings of the reference, the force at the place of the checked IMU; zero where lost.
    arm_accelerations : tuple of (N, 3) arrays
        Of a lever arm of one metre along each axis, by the rates of the reference, m/s².
    arm_error : (N,) array
        One sigma of the force by the interpolation between the rates' samples (`interpolation_sigma`), m/s².
    integral : PiecewiseSpline
        Of the checked IMU's readings.
    """

    reference: ImuRecord
    checked: ImuRecord
    usable: BoolArray
    rate: Array
    force: Array
    arm_accelerations: tuple[Array, Array, Array]
    arm_error: Array
    integral: PiecewiseSpline


@dataclass(frozen=True)
class Parity:
    """Difference of two IMUs that constant errors do not explain, and what it has without a fault.

    Attributes
    ----------
    value, noise, varying : (N, 3) arrays
        Parity, NaN where one IMU has no reading; its variances by noise and by errors that vary in flight.
    attenuation : (N, 3) array
        What the noise of the regressors adds to the parity by the bias of the scale (errors in variables: Fuller 1987,
        Measurement Error Models, section 1.1): the reading of the axis about its mean, times the share of its noise in
        the squares that are left of it by the other regressors.
    delay, delay_sigma : float
        By how much the checked IMU is late, s.
    """

    value: Array
    noise: Array
    varying: Array
    attenuation: Array
    delay: float
    delay_sigma: float

    @property
    def square(self) -> Array:
        """Squared length in units of the variance (N,)."""
        return np.asarray(np.sum(self.value**2 / (self.noise + self.varying), axis=1))


def pair_of(reference: ImuRecord, checked: ImuRecord, end: float) -> Pair:
    """Two IMUs with what their comparison needs.

    Parameters
    ----------
    reference, checked : ImuRecord
        Records in body axes with comparable samples (`comparable_records`); NaN where samples are lost.
    end : float
        End of the comparison, s: the parachute.

    Returns
    -------
    Pair
    """
    rate, force = np.nan_to_num(reference.angular_rate), np.nan_to_num(reference.specific_force)

    nearest = checked.index_at(reference.middle)
    usable = reference.complete & ~reference.filled
    usable = minimum_filter1d(usable.astype(np.int8), 2 * EDGE_REACH + 1, mode="nearest") > 0  # changes reach across
    arm = checked.position[nearest] - reference.position
    usable &= ~reference.coning_corrected & ~reference.sculling_corrected & (reference.time <= end)
    if usable.any():
        usable &= reference.unit == np.bincount(reference.unit[usable]).argmax()
    return Pair(
        reference,
        checked,
        usable,
        rate,
        force + lever_arm_acceleration(reference.interval, rate, arm, reference.unit),
        _arm_accelerations(reference, rate),
        interpolation_sigma(reference.interval, rate) * np.linalg.norm(arm, axis=1),
        readings_integral(checked, checked.specific_force, checked.angular_rate),
    )


def parity_of(pair: Pair, triad: str, rows: BoolArray, delay: float) -> Parity:
    """Parity of one triad.

    Parameters
    ----------
    pair : Pair
        Of `pair_of`.
    triad : str
        ``force`` or ``rate``.
    rows : (N,) boolean array
        Samples to which the regression is fitted.
    delay : float
        First estimate, s.

    Returns
    -------
    Parity
        Infinite where the rows are too few.
    """
    reference = pair.reference
    edges = reference.edges
    own = pair.rate if triad == "rate" else pair.force
    own_noise = reference.rate_noise if triad == "rate" else reference.force_noise
    change = mean_derivative(reference.interval, own)
    noise, varying = variances(pair, triad, own)
    precision = 1.0 / np.sqrt(noise)
    for iteration in range(_DELAY):
        used = pair.usable & covered(pair.checked, edges + delay)
        fitted = used & rows
        if np.count_nonzero(fitted) < FEWEST_SAMPLES:
            infinite = np.where(pair.usable[:, None], np.inf, np.full((1, 3), np.nan))
            ones = np.ones_like(own)
            return Parity(infinite, ones, ones, ones, delay, np.inf)
        force, rate = means_between(pair.integral, edges + delay)
        difference = (force if triad == "force" else rate) - own
        columns: tuple[Array, ...] = ()
        if triad == "force":  # an error or a delay of one IMU's gyros is in the lever-arm acceleration by its rates
            columns = (*pair.arm_accelerations, *_arm_accelerations(reference, np.ascontiguousarray(rate)))
        parity = np.full_like(own, np.nan)
        delays, weights, delay_variances = np.zeros(3), np.zeros(3), np.zeros(3)
        attenuation = np.zeros_like(own)
        for k in range(3):
            design, weight = _regressors(reference.time, own, change, columns, k), precision[fitted, k]
            scaled = weight[:, None] * design[fitted]
            size = np.maximum(np.linalg.norm(scaled, axis=0), 1e-300)
            scaled /= size
            values = np.linalg.lstsq(scaled, weight * difference[fitted, k], rcond=1e-10)[0] / size
            parity[used, k] = difference[used, k] - design[used] @ values
            delays[k], weights[k] = values[4], np.sum((weight * change[fitted, k]) ** 2)
            if iteration < _DELAY - 1:
                continue
            inverse = np.diag(np.linalg.pinv(scaled.T @ scaled, rcond=1e-12, hermitian=True)) / size**2
            delay_variances[k] = np.mean((weight * parity[fitted, k]) ** 2) * inverse[4]
            share = min(float(np.sum((weight * own_noise[fitted]) ** 2)) * inverse[1 + k], 1.0)
            attenuation[:, k] = share * (own[:, k] - np.mean(own[fitted, k]))
        delay_sigma = np.inf
        if weights.any():
            delay = float(np.clip(delay + np.average(delays, weights=weights), -_LARGEST_DELAY, _LARGEST_DELAY))
            delay_sigma = float(np.sqrt(np.sum(weights**2 * delay_variances)) / np.sum(weights))
    return Parity(parity, noise, varying, attenuation, delay, delay_sigma)


def _arm_accelerations(reference: ImuRecord, rate: Array) -> tuple[Array, Array, Array]:
    """Lever-arm accelerations (N, 3) for one metre along each axis, by rates (N, 3) in the samples of the reference."""
    x, y, z = (
        lever_arm_acceleration(reference.interval, rate, np.tile(axis, (len(rate), 1)), reference.unit)
        for axis in np.eye(3)
    )
    return x, y, z


def _regressors(time: Array, own: Array, change: Array, columns: Sequence[Array], axis: int) -> Array:
    """Derivatives (N, P) of one axis of the difference by bias, scale, misalignments, delay, drift and lever arm."""
    return np.column_stack(
        [
            np.ones(len(own)),
            *own.T,
            -change[:, axis],
            -(time - time.mean()) * change[:, axis],
            *(column[:, axis] for column in columns),
        ]
    )


def variances(pair: Pair, triad: str, own: Array) -> tuple[Array, Array]:
    """Variances of the parity: by the noise of both IMUs, and by stated errors that may vary in flight.

    Parameters
    ----------
    pair : Pair
        Of `pair_of`.
    triad : str
        ``force`` or ``rate``.
    own : (N, 3) array
        Readings of the reference, m/s² or rad/s.

    Returns
    -------
    noise, varying : (N, 3) arrays
        Squares of that unit.

    Notes
    -----
    A scale error is along the reading of its axis, a misalignment across the readings of the others. Gyros have no
    stated misalignment; theirs counts as large as the scale error.
    """
    nearest = pair.checked.index_at(pair.reference.time)
    along = own**2
    across = np.sum(along, axis=1, keepdims=True) - along
    variance, varying = np.zeros_like(own), np.zeros_like(own)
    for record, rows in ((pair.reference, slice(None)), (pair.checked, nearest)):
        errors = record.errors[0]
        noise, bias, scale, misalignment = (
            (
                record.force_noise,
                errors.accelerometer_bias,
                errors.accelerometer_scale,
                errors.accelerometer_misalignment,
            )
            if triad == "force"
            else (record.rate_noise, errors.gyro_bias, errors.gyro_scale, errors.gyro_scale)
        )
        variance += noise[rows, None] ** 2
        varying += bias**2 + scale**2 * along + misalignment**2 * across
    return variance + pair.arm_error[:, None] ** 2 if triad == "force" else variance, varying
