"""Filling of lost samples: from another IMU where it has them, elsewhere by an autoregression of each axis.

Input: a record with NaN where samples are lost, and the record of another IMU, if any. Method: the readings of the
other IMU are transferred (`transfer`); a stretch that it does not have is predicted by an autoregression of each axis
that is fitted to both sides (`estimation.autoregression`), and later, where a database is, by the vehicle's rotational
dynamics (`pipeline.dynamics_filling`). Output: the record without NaN, in each filled sample the sigma by which it may
be wrong (`ImuRecord.force_fill_sigma`), and what was done where.

The errors of a filled stretch are correlated in time. Each of its n samples has the sigma of independent errors whose
sum over the stretch has the right variance: with a common error c and independent errors s, ``√(s² + n c²)``. That of
rates includes the coning of an oscillation whose phase is not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edl_filter.errors import InputError
from edl_filter.estimation.autoregression import Interpolation, interpolate
from edl_filter.telemetry.record import ImuRecord, finite_rows
from edl_filter.telemetry.sample_checks import CheckSettings, runs
from edl_filter.telemetry.transfer import TransferredReadings, transferred
from edl_filter.types import Array, BoolArray

#: Time before the parachute from which samples are not compared: the mortar's recoil, s.
PARACHUTE_MARGIN = 1.0
#: Time after the parachute's deployment by which the canopy is full and its shock is over, s. The deceleration of both
#: rovers jumps to its peak at 1.1 to 1.3 s and falls smoothly from 2.5 s on.
INFLATION = 3.0
#: Repair of a stretch that no other IMU covers, and where dynamics have filled it anew.
BY_AUTOREGRESSION = "filled by a fitted oscillation"
BY_DYNAMICS = "filled by rotational dynamics with the database"
#: Samples on each side of a stretch to which an autoregression is fitted: at least, and relative to its length.
_LEAST_SIDE, _SIDE_RATIO = 80, 1.5
_TRIADS = ("force", "rate")


def is_complete(record: ImuRecord) -> bool:
    """Whether no value of a record is lost."""
    return bool(np.isfinite(record.specific_force).all() and np.isfinite(record.angular_rate).all())


def filled(
    record: ImuRecord, second: ImuRecord | None, settings: CheckSettings, parachute: float
) -> tuple[ImuRecord, list[tuple[float, float, str]]]:
    """A record with all lost values filled.

    Parameters
    ----------
    record : ImuRecord
        With NaN where values are lost; returned as it is where none are.
    second : ImuRecord or None
        Another IMU.
    settings : CheckSettings
        Thresholds of the checks.
    parachute : float
        Time of the parachute's deployment, s.

    Returns
    -------
    record : ImuRecord
    repairs : list of (float, float, str)
        Begin and end of each filled stretch, s, and how it was filled.

    Raises
    ------
    InputError
        A stretch is lost that is too long to be filled without another IMU.
    """
    if is_complete(record):
        return record, []
    repairs: list[tuple[float, float, str]] = []
    source = None if second is None else transferred(record, second, parachute - PARACHUTE_MARGIN)
    values = {"force": record.specific_force.copy(), "rate": record.angular_rate.copy()}
    sigmas = {"force": record.force_fill_sigma.copy(), "rate": record.rate_fill_sigma.copy()}
    noise = {"force": record.force_noise, "rate": record.rate_noise}
    lost = {triad: ~finite_rows(values[triad]) for triad in _TRIADS}
    for triad in _TRIADS:
        if source is not None:
            available = lost[triad] & source.valid
            for a, b in runs(available):
                rows = slice(a, b)
                values[triad][rows] = getattr(source, triad)[rows]
                sigmas[triad][rows] = _transfer_sigma(source, triad, rows, noise[triad][rows])
                repairs.append(_repair(record, a, b, f"filled from {second.name}" if second else ""))
            lost[triad] = lost[triad] & ~source.valid
        read = values[triad].copy()  # an autoregression is fitted to readings alone
        for a, b in runs(lost[triad]):
            _refuse_long_gap(record, a, b, settings)
            fills = _by_dynamics(record, read, a, b, parachute)
            values[triad][a:b] = np.stack([fill.values for fill in fills], axis=1)
            sigmas[triad][a:b] = fill_sigma(fills, noise[triad][a:b], record.interval[a], coning=triad == "rate")
            repairs.append(_repair(record, a, b, BY_AUTOREGRESSION))
    changed = np.any(sigmas["rate"] > 0.0, axis=1)
    complete = replace(
        record,
        specific_force=values["force"],
        angular_rate=values["rate"],
        force_fill_sigma=sigmas["force"],
        rate_fill_sigma=sigmas["rate"],
        shared_rate_noise=np.where(changed, 0.0, record.shared_rate_noise),
    )
    return complete, repairs


def _repair(record: ImuRecord, a: int, b: int, phrase: str) -> tuple[float, float, str]:
    return float(record.time[a] - record.interval[a]), float(record.time[b - 1]), phrase


def _refuse_long_gap(record: ImuRecord, a: int, b: int, settings: CheckSettings) -> None:
    start, end = record.time[a] - record.interval[a], record.time[b - 1]
    if end - start > settings.longest_gap_s or b - a >= len(record) - 2:
        raise InputError(
            f"IMU '{record.name}': no usable samples from {start:.3f} to {end:.3f} s, and no other IMU has them; "
            f"at most {settings.longest_gap_s:g} s are filled without one (sample_checks.longest_gap_s)."
        )


def _transfer_sigma(source: TransferredReadings, triad: str, rows: slice, noise: Array) -> Array:
    """Sigma (n, 3) of independent errors that are equivalent to those of n transferred samples, beyond their noise."""
    scatter, common = getattr(source, f"{triad}_scatter")[rows], getattr(source, f"{triad}_error")[rows]
    independent = np.maximum(scatter**2 - noise[:, None] ** 2, 0.25 * scatter**2)
    return np.sqrt(independent + len(scatter) * common**2)


def _by_dynamics(record: ImuRecord, values: Array, a: int, b: int, parachute: float) -> list[Interpolation]:
    """Values of the stretch ``[a, b)`` by an autoregression of each axis, with their covariances.

    A stretch is fitted to samples of the same part of the flight, before or after the parachute's shock, if that part
    is as long on each side of the stretch as the stretch itself, so that the cross-validation has both sides: another
    process acts in the other part, and the shock between them is no oscillation of either. Nearer to the shock, the
    samples of both parts are used, which bound the stretch.
    """
    side = max(_LEAST_SIDE, int(_SIDE_RATIO * (b - a)) + _LEAST_SIDE // 2)
    first, last = max(0, a - side), min(len(record), b + side)
    interval = record.interval[a]
    regular = np.abs(record.interval[first:last] - interval) < 0.2 * interval
    regular &= _same_kind(record, a)[first:last]
    same_part = _same_part(record, a, parachute)
    if same_part[a:b].all() and all(np.count_nonzero(s) >= b - a for s in (same_part[:a], same_part[b:])):
        regular &= same_part[first:last]
    fills = []
    for series in values[first:last].T:
        known = np.isfinite(series) & regular
        fills.append(interpolate(np.nan_to_num(series), known, a - first, b - first))
    return fills


def fill_sigma(fills: Sequence[Interpolation], noise: Array, interval: float, coning: bool) -> Array:
    """Sigma of independent errors of a filled stretch whose sum has the variance of the correlated ones.

    Parameters
    ----------
    fills : sequence of three Interpolation
        One for each axis; n values with the covariance of readings, their noise included.
    noise : (n,) array
        One sigma of a reading, in the unit of the values.
    interval : float
        Sampling interval, s.
    coning : bool
        Whether the values are rates (rad/s), whose coning is uncertain, too.

    Returns
    -------
    (n, 3) array
        Beyond the noise, more than zero.
    """
    count = len(noise)
    variance = np.array([fill.covariance.sum() / count for fill in fills])
    variance = np.maximum(variance - noise[:, None] ** 2, 0.25 * variance)
    if coning:
        variance = variance + _coning_variance(fills, interval) / count / interval**2
    return np.maximum(np.sqrt(variance), 1e-12)


def _coning_variance(fills: Sequence[Interpolation], interval: float) -> Array:
    """Variance (3,) of the rotation by coning about each axis that filled rates do not have, rad².

    To second order, rates p and q about two axes turn the vehicle by ``½ ∫∫ sgn(t' - t) p(t) q(t') dt dt'`` about the
    third one (Goodman & Robinson 1958, ASME J. Appl. Mech. 25, 210). The most probable rates decay to their mean in a
    long stretch, where the vehicle goes on to oscillate about both axes with phases that are not known. The covariance
    of the values has the oscillation, and independent errors with the variance of their sum do not. A mean rate is no
    oscillation, and it is left out: its rotation is the strapdown integration's.
    """

    def weighted(values: Array) -> Array:
        """Sum over all later samples minus that over all earlier ones, along the first axis."""
        total = np.cumsum(values, axis=0)
        return total[-1] - 2.0 * total + values

    variance = np.empty(3)
    for axis in range(3):
        first, second = fills[(axis + 1) % 3], fills[(axis + 2) % 3]
        spread = weighted(weighted(second.covariance).T).T
        square = float(np.sum(spread * first.covariance))
        p, q = first.values - first.values.mean(), second.values - second.values.mean()
        square += float(p @ spread @ p) + float(weighted(q) @ first.covariance @ weighted(q))
        variance[axis] = 0.25 * interval**4 * square
    return variance


def _same_part(record: ImuRecord, row: int, parachute: float) -> BoolArray:
    """Samples (N,) on the same side of the parachute's shock as the row; those in the shock are on neither."""
    before = record.time <= parachute - PARACHUTE_MARGIN
    after = record.time - record.interval >= parachute + INFLATION
    return before if before[row] else after


def _same_kind(record: ImuRecord, row: int) -> BoolArray:
    """Samples (N,) of the same instrument and kind as the row."""
    return (
        (record.unit == record.unit[row])
        & (record.coning_corrected == record.coning_corrected[row])
        & (record.sculling_corrected == record.sculling_corrected[row])
    )
