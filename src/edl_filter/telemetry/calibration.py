"""Corrections of accelerations as in the thesis (Thomas 2011, section 3.2): centre of mass, bias, misalignment.

Input: IMU records or arrays of specific force, rate and angular acceleration. Output: specific force at the centre of
mass (lever-arm correction, eq. 3.3), accelerometer bias before entry, misalignment of one IMU relative to another.
`compare` does both for two records, as the thesis compares rover and backshell.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.errors import InputError
from edl_filter.estimation.series import finite_rows, interpolate_columns
from edl_filter.imu_model.lever_arm import lever_arm_acceleration_at
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, sample_edges, within_window
from edl_filter.telemetry.smoothing import batch_polynomial, differentiated_rates
from edl_filter.types import Array

THESIS_WINDOWS = ((0.0, 10.0), (140.0, 250.0))
"""Windows of the misalignment fit, s from entry interface: without load, and after peak load."""

#: Points of the second-order batch polynomial, as in the thesis at 8 Hz.
BATCH = 7


@dataclass(frozen=True)
class Misalignment:
    """Fit of the lateral difference of two IMUs to the axial force.

    Attributes
    ----------
    start, end : float
        Window, s; for several windows together, the earliest start and the latest end.
    slope, slope_sigma : (2,) arrays
        Lateral difference per axial force along y and z, rad, and one sigma: the rotation vector m of
        ``checked = R(m) reference`` is (0, -slope z, slope y); the fit does not observe the rotation about x.
    offset, offset_sigma : (2,) arrays
        Lateral difference at zero axial force (difference of the biases), m/s², and one sigma.
    residual_rms : (2,) array
        m/s².
    samples : int
        Number of samples of the fit.
    """

    start: float
    end: float
    slope: Array
    slope_sigma: Array
    offset: Array
    offset_sigma: Array
    residual_rms: Array
    samples: int


@dataclass(frozen=True)
class MisalignmentEstimate:
    """The fit in each window, and one fit to all windows together."""

    windows: tuple[Misalignment, ...]
    all: Misalignment


def centre_of_mass_correction(
    specific_force: ArrayLike, angular_rate: ArrayLike, angular_acceleration: ArrayLike, position: ArrayLike
) -> Array:
    """Specific force at the centre of mass: ``A_imu - α × r - ω × (ω × r)`` (thesis eq. 3.3).

    Parameters
    ----------
    specific_force : (N, 3) array
        At the accelerometers, m/s², body axes.
    angular_rate, angular_acceleration : (N, 3) arrays
        rad/s and rad/s², body axes, at the same times.
    position : (3,) or (N, 3) array
        Position of the accelerometers relative to the centre of mass, m, body axes. (The title of
        thesis table 3.4 says "from the IMU to COM", its nomenclature the opposite; the table's digits are lost.)

    Returns
    -------
    (N, 3) array
        m/s², body axes.
    """
    acceleration, rate = np.asarray(angular_acceleration, float), np.asarray(angular_rate, float)
    lever_arm = lever_arm_acceleration_at(acceleration, rate, np.asarray(position, float))
    return np.asarray(specific_force, float) - lever_arm


def at_centre_of_mass(record: ImuRecord, angular_acceleration: ArrayLike) -> ImuRecord:
    """Transfer the specific force of a record to the centre of mass (eq. 3.3).

    Parameters
    ----------
    record : ImuRecord
        At the position of the accelerometers.
    angular_acceleration : (N, 3) array
        rad/s², body axes, in the middle of each interval: see
        `edl_filter.telemetry.smoothing.differentiated_rates`.

    Returns
    -------
    ImuRecord
        Its positions are zero.
    """
    force = centre_of_mass_correction(record.specific_force, record.angular_rate, angular_acceleration, record.position)
    return replace(record, specific_force=force, position=np.zeros_like(record.position))


def bias_from_velocity_slope(
    time: ArrayLike, interval: ArrayLike, specific_force: ArrayLike, start: float, end: float
) -> tuple[Array, Array]:
    """Accelerometer bias: slope of a first-order fit to the integrated velocity before entry (Table 3.5).

    The forces must be at the centre of mass (eq. 3.3), in a window without drag. The error of a force sample is
    contained in all later velocities, so that the formal sigma of the fit would be far too small: sigma is therefore
    computed by propagating the scatter of the force samples through the fit. It tends to ``sqrt(6/5)`` times the sigma
    of the mean.

    Parameters
    ----------
    time, interval : (N,) arrays
        End and length of each sample's interval, s; the intervals adjoin.
    specific_force : (N,) or (N, K) array
        Means over the intervals, m/s².
    start, end : float
        Window, s; samples are used whose interval lies within it.

    Returns
    -------
    bias, sigma : () or (K,) arrays
        m/s²; one sigma for samples with independent errors.

    Raises
    ------
    InputError
        Fewer than 3 samples in the window, a gap between them or NaN in them.
    """
    t, dt, force = (np.asarray(v, float) for v in (time, interval, specific_force))
    inside = within_window(t, dt, start, end)
    t, dt, force = t[inside], dt[inside], force[inside]
    if len(t) < 3:
        raise InputError(f"The bias window {start} to {end} s holds {len(t)} samples; at least 3 are needed.")
    if not np.all(np.isfinite(force)):
        raise InputError(f"The bias window {start} to {end} s holds NaN; choose a window without a gap.")
    gap = np.flatnonzero(np.abs(np.diff(t) - dt[1:]) > SAME_TIME)
    if gap.size:
        raise InputError(f"The bias window {start} to {end} s has a gap after {t[gap[0]]:.3f} s.")
    edges = sample_edges(t, dt)
    deviation = edges - edges.mean()
    velocity_weight = deviation / (deviation @ deviation)  # slope = velocity_weight @ velocity
    # The velocity is the cumulative sum of force * interval: a force has the weight of all velocities after it
    force_weight = np.cumsum(velocity_weight[::-1])[::-1][1:] * dt
    bias = force_weight @ force
    return bias, np.sqrt(force_weight @ force_weight) * force.std(axis=0, ddof=1)


def misalignment_by_projection(axial: ArrayLike, lateral: ArrayLike) -> tuple[Array, Array, Array, Array, Array]:
    """Misalignment as the slope of a linear least-squares fit of the lateral difference to the axial force.

    Parameters
    ----------
    axial : (N,) array
        Axial specific force, m/s².
    lateral : (N, 2) array
        Difference of the two IMUs along y and z, m/s².

    Returns
    -------
    slope, slope_sigma, offset, offset_sigma, residual_rms : (2,) arrays
        rad, rad, m/s², m/s², m/s². The sigmas are computed from the residuals and enlarged for correlated residuals:
        the variance is multiplied by ``(1 + r) / (1 - r)``, where r is their lag-one autocorrelation if positive,
        otherwise 0.

    Raises
    ------
    InputError
        Fewer than 4 samples, or an axial force that does not vary.
    """
    force, difference = np.asarray(axial, float), np.asarray(lateral, float)
    n = len(force)
    if n < 4:
        raise InputError(f"A misalignment needs at least 4 common samples; there are {n}.")
    mean = force.mean()
    deviation = force - mean
    sum_of_squares = deviation @ deviation
    if not sum_of_squares > 0.0:
        raise InputError("A misalignment cannot be seen: the axial force does not vary in the window.")
    slope = deviation @ difference / sum_of_squares
    offset = difference.mean(axis=0) - slope * mean
    residual = difference - offset - np.outer(force, slope)
    residual_squares = (residual**2).sum(axis=0)
    autocorrelation = (residual[1:] * residual[:-1]).sum(axis=0) / np.where(
        residual_squares > 0.0, residual_squares, 1.0
    )
    autocorrelation = np.clip(autocorrelation, 0.0, 0.99)
    variance = residual_squares / (n - 2) * (1.0 + autocorrelation) / (1.0 - autocorrelation)
    slope_sigma = np.sqrt(variance / sum_of_squares)
    offset_sigma = np.sqrt(variance * (1.0 / n + mean**2 / sum_of_squares))
    return slope, slope_sigma, offset, offset_sigma, np.sqrt(residual_squares / n)


def misalignment(
    reference: ImuRecord, checked: ImuRecord, windows: Sequence[tuple[float, float]] = THESIS_WINDOWS
) -> MisalignmentEstimate:
    """Misalignment of one IMU relative to another, as the thesis determines the rover's (Table 3.6).

    The difference ``checked - reference`` along y and z is fitted to the axial force of the reference, in each window
    and in all windows together. The sampling of the two may differ: the mean forces between common times are computed
    from the cumulative velocity of each. Times at which one of them has a gap are omitted.

    Parameters
    ----------
    reference, checked : ImuRecord
        Both at the centre of mass: see `at_centre_of_mass`. In the thesis: backshell and rover.
    windows : sequence of (start, end)
        s since the epoch.

    Returns
    -------
    MisalignmentEstimate

    Raises
    ------
    InputError
        A record is not at the centre of mass, or a window has too few common samples.
    """
    for record in (reference, checked):
        if np.any(record.position != 0.0):
            raise InputError(f"IMU '{record.name}' is not at the centre of mass; correct it first (eq. 3.3).")
    if not windows:
        raise InputError("A misalignment needs at least one window.")
    forces = [_common_forces(reference, checked, start, end) for start, end in windows]
    fits = tuple(_fit(start, end, *pair) for (start, end), pair in zip(windows, forces, strict=True))
    all_forces = [np.concatenate(parts) for parts in zip(*forces, strict=True)]
    start, end = min(w[0] for w in windows), max(w[1] for w in windows)
    return MisalignmentEstimate(fits, _fit(start, end, *all_forces))


def compare(
    reference: ImuRecord, checked: ImuRecord, until: float, windows: Sequence[tuple[float, float]] = THESIS_WINDOWS
) -> MisalignmentEstimate | None:
    """Misalignment and bias difference of `checked` relative to `reference`, both at the centre of mass.

    Parameters
    ----------
    reference, checked : ImuRecord
        In the thesis: backshell and rover.
    until : float
        Latest end of the last window, s since the epoch: parachute deployment.
    windows : sequence of (start, end)
        s since the epoch. Windows that one of the records does not cover are omitted.

    Returns
    -------
    MisalignmentEstimate or None
        None if no window is covered.
    """
    first = max(reference.start, checked.start)
    last = min(reference.time[-1], checked.time[-1], until)
    covered = [(a, min(b, last)) for a, b in windows if a >= first - SAME_TIME and min(b, last) - a > 5.0]
    if not covered:
        return None
    return misalignment(
        record_at_centre_of_mass(reference.between(first, last)),
        record_at_centre_of_mass(checked.between(first, last)),
        covered,
    )


def record_at_centre_of_mass(record: ImuRecord) -> ImuRecord:
    """Transfer a record to the centre of mass (thesis eq. 3.3), with smoothed rates and accelerations from them."""
    middle = record.middle
    rate = batch_polynomial(middle, record.angular_rate, BATCH)
    acceleration = differentiated_rates(middle, rate, lambda t, v: batch_polynomial(t, v, BATCH))
    return at_centre_of_mass(record, np.asarray(acceleration))


def _fit(start: float, end: float, reference: Array, checked: Array) -> Misalignment:
    """Misalignment from the mean forces (N, 3) of both IMUs over common intervals."""
    if len(reference) < 4:
        raise InputError(f"The misalignment window {start} to {end} s holds {len(reference)} common samples; 4 needed.")
    estimate = misalignment_by_projection(reference[:, 0], (checked - reference)[:, 1:])
    return Misalignment(start, end, *estimate, samples=len(reference))


def _common_forces(a: ImuRecord, b: ImuRecord, start: float, end: float) -> tuple[Array, Array]:
    """Mean forces of both records over the intervals of the one with fewer samples in the window."""
    inside = [within_window(record.time, record.interval, start, end) for record in (a, b)]
    coarse, selected = (a, inside[0]) if inside[0].sum() <= inside[1].sum() else (b, inside[1])
    ends = coarse.time[selected]
    means = [_mean_force(record, ends - coarse.interval[selected], ends) for record in (a, b)]
    covered = finite_rows(means[0]) & finite_rows(means[1])
    return means[0][covered], means[1][covered]


def _mean_force(record: ImuRecord, start: Array, end: Array) -> Array:
    """Mean forces (K, 3) between times, from the cumulative velocity; NaN where the record does not cover them."""
    knots = record.edges
    step = np.diff(knots)
    measured = finite_rows(record.specific_force) & (np.abs(step - record.interval) < SAME_TIME)
    velocity_increment = np.where(measured[:, None], record.specific_force * step[:, None], 0.0)
    velocity = np.vstack((np.zeros(3), np.cumsum(velocity_increment, axis=0)))
    missing_time = np.concatenate(([0.0], np.cumsum(np.where(measured, 0.0, step))))
    # A force that is constant over each interval has a velocity that is linear between the knots
    change = interpolate_columns(end, knots, velocity) - interpolate_columns(start, knots, velocity)
    covered = (start >= knots[0] - SAME_TIME) & (end <= knots[-1] + SAME_TIME)
    covered &= np.interp(end, knots, missing_time) - np.interp(start, knots, missing_time) < SAME_TIME
    return np.where(covered[:, None], change / (end - start)[:, None], np.nan)
