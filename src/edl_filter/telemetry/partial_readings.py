"""Readings of a triad of which one axis is lost, and the estimate of the lost axis.

Input: readings in the axes of the IMU with NaN in the lost axis. The two axes that are read are kept in body axes,
since the mounting may be oblique, with the unit vector of the lost axis (`partial_readings`). Method: the triad is the
reading of the two axes plus the lost axis times one number for each sample, which is estimated from predictions along
the body axes (`given_readings`) or from another IMU (`keep_read_axes`). Output: values and covariances along the body
axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edl_filter.estimation.autoregression import Interpolation
from edl_filter.types import Array

#: Least variance of a prediction that is combined with readings, relative to its largest one and absolute.
_LEAST_RELATIVE_VARIANCE, _LEAST_VARIANCE = 1e-9, 1e-24


def partial_readings(readings: Array, body_from_imu: Array) -> Array:
    """What triads read of which one axis is lost.

    Parameters
    ----------
    readings : (N, 3) array
        Of one triad, axes of the IMU; NaN where an axis is lost.
    body_from_imu : (3, 3) array
        Rotation matrix of the mounting.

    Returns
    -------
    (N, 2, 3) array
        As `ImuRecord.partial_force`.
    """
    lost = np.isnan(readings)
    one_axis = np.count_nonzero(lost, axis=1) == 1
    pair = np.stack((np.where(lost, 0.0, readings), lost.astype(np.float64)), axis=1)
    return np.where(one_axis[:, None, None], pair @ body_from_imu.T, 0.0)


def given_readings(fills: Sequence[Interpolation], readings: Array, axis: Array) -> list[Interpolation]:
    """Fills of a triad given the readings of the two axes that are not lost.

    With the reading p without its component along the lost axis, whose unit vector is a, the values are ``p + a t``.
    Predictions f_i with covariances C_i along the body axes, independent of each other, give the weighted least squares
    ``t = S Σ a_i C_i⁻¹ (f_i - p_i)`` with the covariance ``S = (Σ a_i² C_i⁻¹)⁻¹``. The predictions have 3 n values, and
    t has n. Where the mean square of the remaining 2 n residuals exceeds one, the motion is not as predicted (in an
    impact, for example), and S is multiplied by it (Birge 1932, Phys. Rev. 40, 207). The errors ``a_i t`` along the
    body axes are correlated; independent ones with the covariances ``|a_i| Σ|a_j| S`` are not smaller in any direction.

    Parameters
    ----------
    fills : sequence of three Interpolation
        Predictions of n values along the body axes, the noise of a reading included.
    readings : (n, 3) array
        Body axes, in the unit of the fills; the component along the lost axis is ignored.
    axis : (3,) array
        Unit vector of the lost axis, body axes.

    Returns
    -------
    list of three Interpolation
        Values along the body axes, with the covariances that bound the correlated errors.
    """
    read = readings - np.outer(readings @ axis, axis)
    count = len(read)
    information = []
    for fill in fills:
        least = _LEAST_RELATIVE_VARIANCE * float(np.max(np.diag(fill.covariance))) + _LEAST_VARIANCE
        information.append(np.linalg.inv(fill.covariance + least * np.eye(count)))
    difference = np.array([fill.values for fill in fills]) - read.T
    covariance = np.linalg.inv(np.einsum("i,ijk->jk", axis**2, information))
    along = covariance @ np.einsum("i,ijk,ik->j", axis, information, difference)
    residual = difference - np.outer(axis, along)
    mean_square = float(np.einsum("ij,ijk,ik->", residual, information, residual)) / (2 * count)
    covariance = covariance * max(mean_square, 1.0)
    bound = variance_factors(axis)
    return [
        replace(fill, values=read[:, i] + axis[i] * along, covariance=bound[i] * covariance)
        for i, fill in enumerate(fills)
    ]


def lost_axis(partial: Array) -> Array | None:
    """The axis that alone is lost in all samples of a stretch; None where it is another one in some, or all axes are.

    Parameters
    ----------
    partial : (n, 2, 3) array
        Of the stretch, as `ImuRecord.partial_force`.

    Returns
    -------
    (3,) array or None
        Unit vector, body axes.
    """
    axis: Array = partial[0, 1]
    return axis if axis.any() and np.all(partial[:, 1] == axis) else None


def keep_read_axes(values: Array, sigma: Array, partial: Array, rows: slice, limit: Array) -> None:
    """Replace values from another IMU and their sigmas by what is read, where one axis alone is lost; in place.

    Where the axes that are read differ from those of the other IMU by more than the limit, they are lost, too.

    Parameters
    ----------
    values, sigma : (N, 3) arrays
        Of a triad, with the values of the other IMU in the rows, and their one sigma; body axes.
    partial : (N, 2, 3) array
        As `ImuRecord.partial_force`.
    rows : slice
        Samples that were filled from the other IMU.
    limit : (N,) array
        In the unit of the values.
    """
    axis = partial[rows, 1]
    along = np.sum(axis * values[rows], axis=1, keepdims=True)
    across = values[rows] - along * axis
    agree = np.linalg.norm(partial[rows, 0] - across, axis=1) <= limit[rows]
    one_axis = (np.any(axis != 0.0, axis=1) & agree)[:, None]
    variance = np.sum(axis**2 * sigma[rows] ** 2, axis=1, keepdims=True)
    values[rows] = np.where(one_axis, partial[rows, 0] + along * axis, values[rows])
    sigma[rows] = np.where(one_axis, np.sqrt(variance_factors(axis) * variance), sigma[rows])


def variance_factors(axis: Array) -> Array:
    """Factors on the variance along an axis that give independent errors along the body axes, nowhere smaller.

    Parameters
    ----------
    axis : (..., 3) array
        Unit vectors.

    Returns
    -------
    (..., 3) array
    """
    return np.asarray(np.abs(axis) * np.sum(np.abs(axis), axis=-1, keepdims=True), np.float64)
