"""The thesis's corrections of accelerations: centre of mass, bias, misalignment.

(Thomas 2011, section 3.2.)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.errors import InputError
from edl_filter.telemetry.record import ImuRecord

Array = NDArray[np.float64]

THESIS_WINDOWS = ((0.0, 10.0), (140.0, 250.0))
"""Windows of the misalignment fit, s from entry interface: no load, and load after the peak."""

# Times closer than this are one time, s
_SAME_TIME = 1e-6


@dataclass(frozen=True)
class Misalignment:
    """Projection of the axial force on the lateral difference of two IMUs.

    Attributes
    ----------
    start, end : float
        Window, s; of all windows together, their outermost limits.
    slope, slope_sigma : (2,) arrays
        Along y and z: lateral difference per axial force, rad, and one sigma.
    offset, offset_sigma : (2,) arrays
        Lateral difference at no axial force (difference of the biases), m/s², and one sigma.
    residual_rms : (2,) array
        m/s².
    samples : int
    """

    start: float
    end: float
    slope: Array
    slope_sigma: Array
    offset: Array
    offset_sigma: Array
    residual_rms: Array
    samples: int

    @property
    def rotation_vector(self) -> Array:
        """Rotation ``R`` of ``other = R(m) reference``, rad; zero about x, which the fit cannot see."""
        return np.array([0.0, -self.slope[1], self.slope[0]])


@dataclass(frozen=True)
class MisalignmentEstimate:
    """The fit in each window, and one fit of slope and offset to all of them together."""

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
        Accelerometers from the centre of mass, m, body axes. (The thesis tabulates the distance from the
        IMU to the centre of mass: the opposite sign.)

    Returns
    -------
    (N, 3) array
        m/s².
    """
    r, rate = np.asarray(position, float), np.asarray(angular_rate, float)
    lever = np.cross(np.asarray(angular_acceleration, float), r) + np.cross(rate, np.cross(rate, r))
    return np.asarray(specific_force, float) - lever


def at_centre_of_mass(record: ImuRecord, angular_acceleration: ArrayLike) -> ImuRecord:
    """`record` with its specific force moved to the centre of mass (eq. 3.3) and its position zero.

    `angular_acceleration` (N, 3), rad/s², in the middle of each interval: see
    `edl_filter.telemetry.smoothing.differentiated_rates`.
    """
    force = centre_of_mass_correction(record.specific_force, record.angular_rate, angular_acceleration, record.position)
    return replace(record, specific_force=force, position=np.zeros_like(record.position))


def bias_from_velocity_slope(
    time: ArrayLike, interval: ArrayLike, specific_force: ArrayLike, start: float, end: float
) -> tuple[Array, Array]:
    """Accelerometer bias: slope of a first-order fit to the integrated velocity before entry (Table 3.5).

    The forces must be at the centre of mass (eq. 3.3), in a window without drag. An error of a force sample
    stays in all later velocities, so the fit's usual sigma would be far too small; here the samples' own
    scatter is carried through the fit. It tends to ``sqrt(6/5)`` times the sigma of a plain mean.

    Parameters
    ----------
    time, interval : (N,) arrays
        End and length of each sample's interval, s; the intervals adjoin.
    specific_force : (N,) or (N, K) array
        Means over the intervals, m/s².
    start, end : float
        Window, s: samples whose interval lies within it are used.

    Returns
    -------
    bias, sigma : () or (K,) arrays
        m/s², with one sigma for samples whose errors are independent.

    Raises
    ------
    InputError
        Fewer than 3 samples in the window, a gap between them or NaN in them.
    """
    t, dt, force = (np.asarray(v, float) for v in (time, interval, specific_force))
    keep = (t - dt >= start - _SAME_TIME) & (t <= end + _SAME_TIME)
    t, dt, force = t[keep], dt[keep], force[keep]
    if len(t) < 3:
        raise InputError(f"The bias window {start} to {end} s holds {len(t)} samples; at least 3 are needed.")
    if not np.all(np.isfinite(force)):
        raise InputError(f"The bias window {start} to {end} s holds NaN; choose a window without a gap.")
    gap = np.flatnonzero(np.abs(np.diff(t) - dt[1:]) > _SAME_TIME)
    if gap.size:
        raise InputError(f"The bias window {start} to {end} s has a gap after {t[gap[0]]:.3f} s.")
    instant = np.concatenate((t[:1] - dt[:1], t))
    centred = instant - instant.mean()
    weight = centred / (centred @ centred)  # slope = weight @ velocity
    # velocity = running sum of force * interval, so each force weighs as all velocities from it on
    weight = np.cumsum(weight[::-1])[::-1][1:] * dt
    bias = weight @ force
    return bias, np.sqrt(weight @ weight) * force.std(axis=0, ddof=1)


def misalignment_by_projection(axial: ArrayLike, lateral: ArrayLike) -> tuple[Array, Array, Array, Array, Array]:
    """Linear least squares of a lateral difference on the axial force: its slope is a misalignment.

    Parameters
    ----------
    axial : (N,) array
        Axial specific force, m/s².
    lateral : (N, 2) array
        Difference of the two IMUs along y and z, m/s².

    Returns
    -------
    slope, slope_sigma, offset, offset_sigma, residual_rms : (2,) arrays
        rad, m/s², m/s². The sigmas come from the residuals, and are widened for residuals that follow each
        other: ``(1 + r) / (1 - r)`` times the variance, r their correlation at lag one where positive.

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
    centred = force - mean
    spread = centred @ centred
    if not spread > 0.0:
        raise InputError("A misalignment cannot be seen: the axial force does not vary in the window.")
    slope = centred @ difference / spread
    offset = difference.mean(axis=0) - slope * mean
    residual = difference - offset - np.outer(force, slope)
    power = (residual**2).sum(axis=0)
    follow = (residual[1:] * residual[:-1]).sum(axis=0) / np.where(power > 0.0, power, 1.0)
    follow = np.clip(follow, 0.0, 0.99)
    variance = power / (n - 2) * (1.0 + follow) / (1.0 - follow)
    slope_sigma = np.sqrt(variance / spread)
    offset_sigma = np.sqrt(variance * (1.0 / n + mean**2 / spread))
    return slope, slope_sigma, offset, offset_sigma, np.sqrt(power / n)


def misalignment(
    reference: ImuRecord, other: ImuRecord, windows: Sequence[tuple[float, float]] = THESIS_WINDOWS
) -> MisalignmentEstimate:
    """Misalignment of one IMU against another, as the thesis finds the rover's (Table 3.6).

    The difference ``other - reference`` along y and z is projected on the reference's axial force, in each
    window and in all together. The two need not be sampled alike: the mean force between common times
    follows from the cumulative velocity of each. Where either has a gap nothing is used.

    Parameters
    ----------
    reference, other : ImuRecord
        Both at the centre of mass: see `at_centre_of_mass`. The thesis: backshell and rover.
    windows : sequence of (start, end)
        s since the epoch.

    Raises
    ------
    InputError
        A record is not at the centre of mass, or a window holds too few common samples.
    """
    for record in (reference, other):
        if np.any(record.position != 0.0):
            raise InputError(f"IMU '{record.name}' is not at the centre of mass; correct it first (eq. 3.3).")
    if not windows:
        raise InputError("A misalignment needs at least one window.")
    forces = [_common_forces(reference, other, start, end) for start, end in windows]
    fits = tuple(_project(start, end, *pair) for (start, end), pair in zip(windows, forces, strict=True))
    together = [np.concatenate(parts) for parts in zip(*forces, strict=True)]
    start, end = min(w[0] for w in windows), max(w[1] for w in windows)
    return MisalignmentEstimate(fits, _project(start, end, *together))


def _project(start: float, end: float, reference: Array, other: Array) -> Misalignment:
    if len(reference) < 4:
        raise InputError(f"The misalignment window {start} to {end} s holds {len(reference)} common samples; 4 needed.")
    fit = misalignment_by_projection(reference[:, 0], (other - reference)[:, 1:])
    return Misalignment(start, end, *fit, samples=len(reference))


def _common_forces(a: ImuRecord, b: ImuRecord, start: float, end: float) -> tuple[Array, Array]:
    """Mean forces of both records over the intervals of the one with fewer samples in the window."""
    inside = [
        (record.time - record.interval >= start - _SAME_TIME) & (record.time <= end + _SAME_TIME) for record in (a, b)
    ]
    coarse, keep = (a, inside[0]) if inside[0].sum() <= inside[1].sum() else (b, inside[1])
    ends = coarse.time[keep]
    means = [_mean_force(record, ends - coarse.interval[keep], ends) for record in (a, b)]
    known = np.isfinite(means[0]).all(axis=-1) & np.isfinite(means[1]).all(axis=-1)
    return means[0][known], means[1][known]


def _mean_force(record: ImuRecord, begin: Array, end: Array) -> Array:
    """Mean force between times, from the cumulative velocity; NaN where the record does not cover them."""
    knots = np.concatenate(([record.start], record.time))
    step = np.diff(knots)
    known = np.isfinite(record.specific_force).all(axis=-1) & (np.abs(step - record.interval) < _SAME_TIME)
    gained = np.where(known[:, None], record.specific_force * step[:, None], 0.0)
    velocity = np.vstack((np.zeros(3), np.cumsum(gained, axis=0)))
    unknown = np.concatenate(([0.0], np.cumsum(np.where(known, 0.0, step))))
    # A force that is constant over each interval has a velocity that is linear between the knots
    change = np.stack([np.interp(end, knots, v) - np.interp(begin, knots, v) for v in velocity.T], axis=-1)
    covered = (begin >= knots[0] - _SAME_TIME) & (end <= knots[-1] + _SAME_TIME)
    covered &= np.interp(end, knots, unknown) - np.interp(begin, knots, unknown) < _SAME_TIME
    return np.where(covered[:, None], change / (end - begin)[:, None], np.nan)
