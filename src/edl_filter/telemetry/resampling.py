"""Two IMUs that sample at different rates, at samples that both resolve.

Input: records of both in body axes, NaN where samples are lost. A mean over a long interval follows from readings that
are more frequent, but not the reverse: readings at 4 Hz do not determine the motion of a vehicle that swings once a
second as well as the noise of an IMU does. Where one of two IMUs samples much more often, its specific force is moved
to the place of the other one by its own rates, and its means are taken over the samples of the other one (quintic
spline through the integral of the readings). Output: records that are compared sample by sample.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from edl_filter.estimation.interpolating_spline import DEGREE, PiecewiseSpline, piecewise_integral
from edl_filter.estimation.series import finite_rows
from edl_filter.imu_model.lever_arm import EDGE_REACH, edge_weights, lever_arm_acceleration
from edl_filter.telemetry.record import SAME_TIME, ImuRecord
from edl_filter.types import Array, BoolArray

#: Samples on each side of a gap that are not used: the reach of the interpolation.
GAP_REACH = EDGE_REACH
#: Ratio of the sampling intervals from which the IMU with the shorter one is averaged.
_MUCH_LONGER = 1.5


def samples_less_often(record: ImuRecord, second: ImuRecord) -> bool:
    """Whether the samples of a record are so long that those of the second IMU do not follow from them."""
    return float(np.median(record.interval)) > _MUCH_LONGER * float(np.median(second.interval))


def comparable_records(reference: ImuRecord, checked: ImuRecord) -> tuple[ImuRecord, ImuRecord]:
    """Both records so that those of the checked IMU determine means over the samples of the reference.

    Parameters
    ----------
    reference, checked : ImuRecord
        Records in body axes; NaN where samples are lost.

    Returns
    -------
    reference, checked : ImuRecord
        The same objects where the sampling intervals differ little. Otherwise the one that samples more often is at the
        place of the other one, and the reference has the longer samples.
    """
    if samples_less_often(checked, reference):
        return averaged(moved_to(reference, checked), checked), checked
    if samples_less_often(reference, checked):
        return reference, moved_to(checked, reference)
    return reference, checked


def moved_to(record: ImuRecord, target: ImuRecord) -> ImuRecord:
    """The readings of a record with the specific force at the place of another IMU.

    Parameters
    ----------
    record : ImuRecord
        Its rates give the lever-arm acceleration.
    target : ImuRecord
        The other IMU.

    Returns
    -------
    ImuRecord
        The noise of its specific force contains the error of the interpolation between the rates. The force is NaN
        where the interpolation reaches a rate that is lost.
    """
    place = target.position[target.index_at(record.middle)]
    arm, rate = place - record.position, np.nan_to_num(record.angular_rate)
    reached = near_lost(~finite_rows(record.angular_rate))
    force = record.specific_force + lever_arm_acceleration(record.interval, rate, arm, record.unit)
    error = interpolation_sigma(record.interval, rate) * np.linalg.norm(arm, axis=1)
    return replace(
        record,
        specific_force=np.where(reached[:, None], np.nan, force),
        position=place,
        force_noise=np.hypot(record.force_noise, error),
    )


def averaged(record: ImuRecord, target: ImuRecord) -> ImuRecord:
    """The means of a record over the samples of another IMU that samples less often.

    Parameters
    ----------
    record : ImuRecord
        Readings.
    target : ImuRecord
        Its samples.

    Returns
    -------
    ImuRecord
        With the errors of the first and the times of the second record; NaN where readings are lost or do not cover the
        sample. The noise of a mean is that of independent readings.
    """
    edges = target.edges
    means = means_between(readings_integral(record, record.specific_force, record.angular_rate), edges)
    force, rate = (np.where(covered(record, edges)[:, None], mean, np.nan) for mean in means)
    nearest = record.index_at(target.middle)
    share = np.sqrt(np.minimum(record.interval[nearest] / target.interval, 1.0))
    unchanged = {
        name: getattr(record, name)[nearest]
        for name in ("position", "coning_corrected", "sculling_corrected", "unit", "source")
    }
    return replace(
        record,
        **unchanged,
        time=target.time,
        interval=target.interval,
        specific_force=force,
        angular_rate=rate,
        force_noise=share * record.force_noise[nearest],
        rate_noise=share * record.rate_noise[nearest],
        shared_rate_noise=share * record.shared_rate_noise[nearest],
        force_fill_sigma=share[:, None] * record.force_fill_sigma[nearest],
        rate_fill_sigma=share[:, None] * record.rate_fill_sigma[nearest],
        partial_force=np.zeros((len(target), 2, 3)),  # the samples of a mean may differ in what they read
        partial_rate=np.zeros((len(target), 2, 3)),
    )


def with_interpolation_noise(record: ImuRecord, target: ImuRecord) -> ImuRecord:
    """A record whose noise contains the error of its means over the samples of an IMU that samples more often.

    Its sigma is the difference of a quintic and a cubic spline through the integral of the readings, the largest one
    of the three axes and of a sample with its two neighbours.

    Parameters
    ----------
    record : ImuRecord
        Readings.
    target : ImuRecord
        The other IMU.

    Returns
    -------
    ImuRecord
        The same object where it does not sample much less often.
    """
    if not samples_less_often(record, target):
        return record
    edges = target.edges
    inside = (edges >= record.start) & (edges <= record.time[-1])
    edges = edges[inside]
    at_sample = record.index_at(0.5 * (edges[1:] + edges[:-1]))
    noise = []
    errors = means_error(record, edges, record.specific_force, record.angular_rate)
    for stated, difference in zip((record.force_noise, record.rate_noise), errors, strict=True):
        error = np.zeros(len(record))
        np.maximum.at(error, at_sample, np.max(np.abs(difference), axis=1))
        noise.append(np.hypot(stated, maximum_filter1d(error, 3)))
    return replace(record, force_noise=noise[0], rate_noise=noise[1])


def means_error(record: ImuRecord, edges: Array, *triads: Array) -> list[Array]:
    """Error of means that `means_between` gives: the difference of a quintic and a cubic spline through the integral.

    Parameters
    ----------
    record : ImuRecord
        Of the readings.
    edges : (N + 1,) array
        s.
    *triads : (M, 3) arrays
        Means over the record's intervals, of any unit; NaN where one is lost.

    Returns
    -------
    list of (N, 3) arrays
        One for each triad, of any sign.
    """
    quintic, cubic = (
        means_between(readings_integral(record, *triads, degree=degree), edges) for degree in (DEGREE, DEGREE - 2)
    )
    return [first - second for first, second in zip(quintic, cubic, strict=True)]


def angular_acceleration_error(interval: Array, rate: Array, lower_reach: int = EDGE_REACH - 1) -> Array:
    """Error of angular accelerations that are interpolated between mean rates.

    The difference of an interpolation with `EDGE_REACH` samples on each side of an edge, of eighth order, and one with
    fewer, of equal samples of one instrument; beyond the ends the rates count as zero. It is large in a shock, and
    where the moment changes its slope inside a sample: at the nodes of an aerodynamic table on a vehicle that swings
    far.

    Parameters
    ----------
    interval : (N,) array
        s.
    rate : (N, 3) array
        rad/s.
    lower_reach : int
        Samples on each side of an edge for the second interpolation.

    Returns
    -------
    (N, 3) array
        rad/s², of any sign.
    """
    weights = np.array(edge_weights(EDGE_REACH))
    weights[:lower_reach] -= edge_weights(lower_reach)
    kernel = np.concatenate((weights[::-1], weights))
    error = np.column_stack(
        [np.convolve(column, kernel, mode="full")[EDGE_REACH - 1 : -EDGE_REACH + 1] for column in rate.T]
    )
    return np.asarray(np.diff(error, axis=0) / interval[:, None])


def interpolation_sigma(interval: Array, rate: Array) -> Array:
    """Length (N,) of `angular_acceleration_error` with the next lower order, rad/s²."""
    return np.asarray(np.linalg.norm(angular_acceleration_error(interval, rate), axis=1))


def near_lost(lost: BoolArray) -> BoolArray:
    """Samples (N,) within `GAP_REACH` samples of a lost one; a record may have fewer samples than that."""
    count = np.convolve(lost, np.ones(2 * GAP_REACH + 1))[GAP_REACH : GAP_REACH + len(lost)]
    return np.asarray(count > 0.5)


def covered(record: ImuRecord, edges: Array) -> BoolArray:
    """Intervals (N,) between edges (N + 1,), s, that finite readings of a record cover, with a neighbour on each side.

    Near a lost sample a spline of `readings_integral` ends, where it amplifies noise.
    """
    return covered_by(record, ~near_lost(~record.complete), edges)


def covered_by(record: ImuRecord, usable: BoolArray, edges: Array) -> BoolArray:
    """Intervals between edges that certain samples of a record cover.

    Parameters
    ----------
    record : ImuRecord
        Of N samples.
    usable : (N,) boolean array
        Samples that may cover an interval.
    edges : (M + 1,) array
        s.

    Returns
    -------
    (M,) boolean array
    """
    count = np.concatenate(([0], np.cumsum(~usable)))
    begin = np.searchsorted(record.time, edges[:-1] + SAME_TIME)
    end = np.searchsorted(record.time, edges[1:] - SAME_TIME) + 1
    inside = (edges[:-1] >= record.start - SAME_TIME) & (end <= len(record.time))
    out = np.zeros(len(edges) - 1, bool)
    out[inside] = count[end[inside]] == count[begin[inside]]
    return out


def readings_integral(record: ImuRecord, *triads: Array, degree: int = DEGREE) -> PiecewiseSpline:
    """Splines through the integrals of a record's readings over time; `means_between` evaluates them.

    Parameters
    ----------
    record : ImuRecord
        Of the readings.
    *triads : (M, 3) arrays
        Means over its intervals, of any unit; NaN where one is lost.
    degree : int
        Of the splines, odd.

    Returns
    -------
    PiecewiseSpline
        Of three values for each triad; a spline for each run of samples without a lost value.
    """
    return piecewise_integral(record.edges, record.interval, np.concatenate(triads, axis=1), degree)


def means_between(integral: PiecewiseSpline, edges: Array) -> list[Array]:
    """Means of readings between other edges than theirs.

    Parameters
    ----------
    integral : PiecewiseSpline
        Of `readings_integral`.
    edges : (N + 1,) array
        s; those outside the record count as its ends.

    Returns
    -------
    list of (N, 3) arrays
        One for each triad.
    """
    means = np.diff(integral(edges), axis=0) / np.diff(edges)[:, None]
    return np.split(means, means.shape[1] // 3, axis=1)
