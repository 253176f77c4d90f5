"""Filling of lost samples: from another IMU where it has them, elsewhere by an autoregression of each axis.

Input: a record with NaN where samples are lost, and the record of another IMU, if any. Method: the readings of the
other IMU are transferred (`transfer`), with the difference that remains between the two IMUs around the stretch; a
stretch that it does not have is predicted by an autoregression of each axis
that is fitted to both sides (`estimation.autoregression`), and later, where a database is, by the vehicle's rotational
dynamics (`pipeline.dynamics_filling`). Output: the record without NaN, in each filled sample the sigma by which it may
be wrong (`ImuRecord.force_fill_sigma`), and what was done where.

The errors of a filled stretch are correlated in time. Each of its n samples has the sigma of independent errors whose
sum over the stretch has the right variance: with a common error c and independent errors s, ``√(s² + n c²)``. What the
calibration of two IMUs does not determine is common to all samples that are transferred, whose number is n then: a
short stretch has a larger sigma in a record that has longer ones. The sigma of rates includes the coning of an
oscillation whose phase is not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edl_filter.errors import InputError
from edl_filter.estimation.autoregression import Interpolation, interpolate
from edl_filter.estimation.gauss_markov import estimate_in_stretch
from edl_filter.estimation.series import finite_rows, near_running_median, runs
from edl_filter.telemetry.partial_readings import given_readings, keep_read_axes, lost_axis
from edl_filter.telemetry.record import ImuRecord, SampleFinding
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.transfer import TransferredReadings, transferred
from edl_filter.types import Array, BoolArray, IntArray

#: Time before the parachute from which samples are not compared: the mortar's recoil, s.
PARACHUTE_MARGIN = 1.0
#: Time after the parachute's deployment by which the opening shock is over, s. The deceleration of both
#: rovers jumps to its peak at 1.1 to 1.3 s and falls smoothly from 2.5 s on.
INFLATION = 3.0
#: Repair of a stretch that no other IMU covers, and where dynamics have filled it anew.
BY_AUTOREGRESSION = "filled by a fitted oscillation"
BY_DYNAMICS = "filled by rotational dynamics with the database"
#: Shortest stretch that these fill, s: in a shorter one the autoregression is as good.
SHORTEST_BY_DYNAMICS = 0.5
#: Repair of the part of a stretch in which the parachute opens.
ACROSS_OPENING = "filled across the parachute's opening from both sides"
#: Samples on each side of a stretch to which an autoregression is fitted: at least, and relative to its length.
_LEAST_SIDE, _SIDE_RATIO = 80, 1.5
#: Latest time after the deployment at which the canopy becomes full, s: 1.1 to 1.3 s on both rovers.
_FULL = 2.0
#: Fewest values from which the drag of the full canopy is extrapolated.
_LEAST_VALUES = 8
_TRIADS = ("force", "rate")
#: Samples of the running median of a difference between two IMUs, and the departure in sigmas of an outlier.
_MEDIAN, _OUTLIER = 9, 8.0


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
        Start and end of each filled stretch, s, and how it was filled.

    Raises
    ------
    InputError
        A stretch is lost that is too long to be filled without another IMU.
    """
    if record.complete.all():
        return record, []
    partial = {"force": record.partial_force, "rate": record.partial_rate}
    repairs: list[tuple[float, float, str]] = []
    source = None if second is None else transferred(record, second, parachute - PARACHUTE_MARGIN)
    values = {"force": record.specific_force.copy(), "rate": record.angular_rate.copy()}
    sigmas = {"force": record.force_fill_sigma.copy(), "rate": record.rate_fill_sigma.copy()}
    noise = {"force": record.force_noise, "rate": record.rate_noise}
    lost = {triad: ~finite_rows(values[triad]) for triad in _TRIADS}
    for triad in _TRIADS:
        if source is not None:
            available = lost[triad] & source.valid
            kinds = _kinds(record)
            for a, b in sorted(run for kind in np.unique(kinds) for run in runs(available & (kinds == kind))):
                rows = slice(a, b)
                remaining, variance = _remaining_difference(record, source, triad, a, b, parachute)
                values[triad][rows] = getattr(source, triad)[rows] + remaining
                common = np.count_nonzero(available) * getattr(source, f"{triad}_error")[rows] ** 2
                common += (b - a) * variance
                sigmas[triad][rows] = _transfer_sigma(
                    getattr(source, f"{triad}_scatter")[rows], noise[triad][rows], common
                )
                limit = settings.disagreement_sigmas * np.linalg.norm(
                    np.hypot(sigmas[triad], noise[triad][:, None]), axis=1
                )
                keep_read_axes(values[triad], sigmas[triad], partial[triad], rows, limit)
                repairs.append(_repair(record, a, b, f"filled from {second.name}" if second else ""))
            lost[triad] = lost[triad] & ~source.valid
        read = values[triad].copy()  # an autoregression is fitted to readings alone
        for a, b in runs(lost[triad]):
            _refuse_long_gap(record, triad, a, b, settings)
            axis = lost_axis(partial[triad][a:b])
            for rows, fills, how in _interpolated(record, triad, read, a, b, parachute):
                if axis is not None:
                    fills = given_readings(fills, partial[triad][rows, 0], axis)
                values[triad][rows] = np.stack([fill.values for fill in fills], axis=1)
                sigmas[triad][rows] = fill_sigma(fills, noise[triad][rows], record.interval[a], coning=triad == "rate")
                repairs.append(_repair(record, rows.start, rows.stop, how))
                if how == ACROSS_OPENING and triad == "rate":
                    interval, force_sigma = float(record.interval[a]), sigmas["force"][rows]
                    tilt = tilt_variance(fills, sigmas["rate"][rows], values["force"][rows], force_sigma, interval)
                    sigmas["force"][rows] = np.sqrt(force_sigma**2 + tilt / len(force_sigma) / interval**2)
        if triad == "rate":
            alone = lost["rate"] & (record.time > parachute)
            sigmas["force"] = np.sqrt(
                sigmas["force"] ** 2 + _shortening(record, values["force"], sigmas["rate"], alone)
            )
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


def with_limits(record: ImuRecord, findings: Sequence[SampleFinding]) -> ImuRecord:
    """A filled record whose saturated samples are at least at the limit of their axis where their neighbours fill them.

    A reading at its limit L is censored (Tobin 1958, Econometrica 26, 24): the true value is L or beyond. Where the
    fill is below L by d, it has missed an excursion, an impact for example, of whose height only L is known. The value
    is then L, with the further sigma d that n samples of a run have in common.

    Parameters
    ----------
    record : ImuRecord
        By `filled`.
    findings : sequence of SampleFinding
        Of any record, with their interpolated parts.
    """
    values = {"force": record.specific_force.copy(), "rate": record.angular_rate.copy()}
    sigmas = {"force": record.force_fill_sigma.copy(), "rate": record.rate_fill_sigma.copy()}
    middle = record.middle
    for finding in findings:
        if finding.limit is None or finding.imu != record.name:
            continue
        limit, triad = np.array(finding.limit), finding.channel.split()[0]
        axis = limit / np.linalg.norm(limit)
        for start, end in finding.interpolated:
            rows = np.flatnonzero((middle > max(start, finding.start)) & (middle < min(end, finding.end)))
            deficit = np.maximum(np.linalg.norm(limit) - values[triad][rows] @ axis, 0.0)[:, None] * axis
            values[triad][rows] += deficit
            sigmas[triad][rows] = np.sqrt(sigmas[triad][rows] ** 2 + len(rows) * deficit**2)
    return replace(
        record,
        specific_force=values["force"],
        angular_rate=values["rate"],
        force_fill_sigma=sigmas["force"],
        rate_fill_sigma=sigmas["rate"],
    )


def _repair(record: ImuRecord, a: int, b: int, phrase: str) -> tuple[float, float, str]:
    return float(record.time[a] - record.interval[a]), float(record.time[b - 1]), phrase


def _refuse_long_gap(record: ImuRecord, triad: str, a: int, b: int, settings: CheckSettings) -> None:
    start, end = record.time[a] - record.interval[a], record.time[b - 1]
    if end - start > settings.longest_gap_s or b - a >= len(record) - 2:
        raise InputError(
            f"IMU '{record.name}': no usable samples of its {triad} from {start:.3f} to {end:.3f} s, and no other IMU "
            f"has complete ones; at most {settings.longest_gap_s:g} s are filled without one "
            "(sample_checks.longest_gap_s)."
        )


def _remaining_difference(
    record: ImuRecord, source: TransferredReadings, triad: str, a: int, b: int, parachute: float
) -> tuple[Array, Array]:
    """Difference (n, 3) of the record to the transferred readings in the stretch ``[a, b)``; variance (3,) of its mean.

    The calibration of the two IMUs is one of constant errors. What it leaves varies slowly, by itself or in proportion
    to the reading, and is interpolated from both sides: on the rovers 0.04 m/s² along the axis, since the
    accelerometers are not both linear. A stretch of bad samples may end with one that no test has marked: it would
    determine the course across the stretch, so that outliers are left out.
    """
    own = record.specific_force if triad == "force" else record.angular_rate
    difference = own - getattr(source, triad)
    side = _side(a, b) * float(np.median(record.interval[a:b]))
    middle = record.middle
    near = (middle > middle[a] - side) & (middle < middle[b - 1] + side)
    near &= finite_rows(difference) & _same_kind(record, a)
    same_part = near & _same_part(record, a, parachute)
    rows = np.flatnonzero(same_part if same_part.any() else near)
    noise = record.force_noise if triad == "force" else record.rate_noise
    rows = rows[near_running_median(difference[rows], noise[rows], _MEDIAN, _OUTLIER)]
    size = np.linalg.norm(getattr(source, triad), axis=1)
    return estimate_in_stretch(middle[rows], difference[rows], middle[a:b], [(size[rows], size[a:b])])


def _transfer_sigma(scatter: Array, noise: Array, common: Array) -> Array:
    """Sigma (n, 3) of transferred samples beyond their noise (n,).

    Input: their scatter, and the variance of the common errors multiplied by the number of samples that share them.
    """
    return np.sqrt(np.maximum(scatter**2 - noise[:, None] ** 2, 0.25 * scatter**2) + common)


def _interpolated(
    record: ImuRecord, triad: str, values: Array, a: int, b: int, parachute: float
) -> list[tuple[slice, list[Interpolation], str]]:
    """Rows, values and repair of the stretch ``[a, b)``: of two parts where the parachute opens in it."""
    opening = a + int(np.searchsorted(record.time[a:b], parachute, side="right"))
    if opening in (a, b):
        return [(slice(a, b), _by_autoregression(record, values, a, b, parachute), BY_AUTOREGRESSION)]
    before, after = _across_opening(record, triad, values, a, opening, b)
    return [(slice(a, opening), before, BY_AUTOREGRESSION), (slice(opening, b), after, ACROSS_OPENING)]


def _across_opening(
    record: ImuRecord, triad: str, values: Array, a: int, opening: int, b: int
) -> tuple[list[Interpolation], list[Interpolation]]:
    """Values of the stretches ``[a, opening)`` and ``[opening, b)`` about the parachute's deployment, of each axis.

    Before the deployment, the process before the stretch goes on. After it, the canopy fills at a time that is uniform
    between the deployment and the end of the stretch, or `_FULL` if that is earlier: a value x is u until then and v
    from then on, with u and v extrapolated from the two sides. With the probability P(t) that the canopy is full, the
    mean of x is ``u + P (v - u)``, and its covariance
    ``(P(min(s, t)) - P(s) P(t)) (v - u)(s) (v - u)(t) + (1 - max(P(s), P(t))) U(s, t) + P(min(s, t)) V(s, t)`` with the
    covariances U and V of u and v.
    """
    known, first, last = _neighbours(record, a, b)
    before, after = np.arange(first, last) < a, np.arange(first, last) >= b
    fills: tuple[list[Interpolation], list[Interpolation]] = ([], [])
    count = opening - a
    elapsed = record.interval[a] * (np.arange(b - opening) + 0.5)
    full = np.minimum(elapsed / min(_FULL, record.interval[a] * (b - opening)), 1.0)
    earlier, later = np.minimum.outer(full, full), np.maximum.outer(full, full)
    for series in values[first:last].T:
        usable, series = known & np.isfinite(series), np.nan_to_num(series)
        u = interpolate(series, usable & before, a - first, b - first)
        extrapolate = _drag_before if triad == "force" else interpolate
        v = extrapolate(series, usable & after, opening - first, b - first)
        fills[0].append(replace(u, values=u.values[:count], covariance=u.covariance[:count, :count]))
        difference = v.values - u.values[count:]
        covariance = (earlier - np.outer(full, full)) * np.outer(difference, difference)
        covariance += (1.0 - later) * u.covariance[count:, count:] + earlier * v.covariance
        fills[1].append(replace(v, values=u.values[count:] + full * difference, covariance=covariance))
    return fills


def _drag_before(series: Array, observed: BoolArray, first: int, last: int) -> Interpolation:
    """Extrapolate ``series[first:last]``, a force under a full canopy, from as many observed values after it.

    A drag ``k v²`` decelerates in proportion to itself, so that the inverse of its square root is linear in time. The
    force along an axis whose values change sign is no drag, and is extrapolated by its mean. At least `_LEAST_VALUES`
    are used, and the drag is at most four times the first of them.
    """
    length = last - first
    nearest = np.flatnonzero(observed & (np.arange(len(series)) >= last))[: max(length, _LEAST_VALUES)]
    if len(nearest) < 3:
        return interpolate(series, observed, first, last)
    x, steps = series[nearest], np.arange(first, last) - last
    if np.ptp(np.sign(x)) > 0.0 or np.any(x == 0.0):
        return Interpolation(np.full(length, x.mean()), np.var(x, ddof=1) * np.eye(length), 0, 1.0)
    inverse = np.polynomial.Polynomial.fit(nearest - last, 1.0 / np.sqrt(np.abs(x)), 1)
    least = 0.5 / np.sqrt(np.abs(x[0]))
    drag, fitted = (np.sign(x[0]) / np.maximum(inverse(t), least) ** 2 for t in (steps, nearest - last))
    return Interpolation(drag, float(np.sum((x - fitted) ** 2) / (len(x) - 2)) * np.eye(length), 1, 1.0)


def tilt_variance(
    fills: Sequence[Interpolation], rate_sigma: Array, force: Array, force_sigma: Array, interval: float
) -> Array:
    """Variance of the velocity change in a filled stretch by errors of filled rates, beyond that of `rate_sigma`.

    With the error δω of the rates, the attitude in the stretch is wrong by θ = ∫ δω dt, and the velocity change by
    ``∫ θ × f dt``. Independent errors of the sum of the rates' variance do not have the angles in the stretch: an
    oscillation has large ones that vanish at its end. The variance is that with the covariance of the values, less that
    of independent errors with `rate_sigma`, and the product of both variances, of the angles and of the force, which no
    linear propagation has.

    Parameters
    ----------
    fills : sequence of three Interpolation
        Rates, rad/s.
    rate_sigma : (n, 3) array
        Of `fill_sigma`, rad/s.
    force, force_sigma : (n, 3) arrays
        Filled specific force and its sigma by `fill_sigma`, m/s².
    interval : float
        Sampling interval, s.

    Returns
    -------
    (3,) array
        About the body axes at the beginning, m²/s².
    """
    count = len(force)
    summed = interval * np.tril(np.ones((count, count)))
    out = np.zeros(3)
    for axis in range(3):
        covariance = fills[axis].covariance
        mean_square = float(np.mean(np.diag(summed @ covariance @ summed.T)))
        for along, lateral in (((axis + 1) % 3, (axis + 2) % 3), ((axis + 2) % 3, (axis + 1) % 3)):
            weight = interval * summed.T @ force[:, along]  # of δω about `axis` in the velocity along `lateral`
            excess = float(weight @ covariance @ weight) - float(np.sum((weight * rate_sigma[:, axis]) ** 2))
            out[lateral] += max(excess, 0.0) + mean_square * interval**2 * float(np.sum(force_sigma[:, along] ** 2))
    return out


def _shortening(record: ImuRecord, force: Array, rate_sigma: Array, filled: BoolArray) -> Array:
    """Variance (N, 3) of forces, at filled rates under the canopy, by which a force that is turned is shorter.

    An attitude that is wrong by θ changes the force along an axis by ``-½ θ² f``, with θ across it, which no linear
    propagation has. Of normal angles with the sigmas a and b about the two other axes, the mean square of ``½ θ²`` is
    ``¼ (a² + b²)² + ½ (a⁴ + b⁴)``. The angles grow over a group of filled samples, not more than `_FULL` apart, and
    remain for `_FULL` after it; from then on the filter's own sigma points have them. The error is common to the group.
    """
    variance = np.zeros_like(force)
    rows = np.flatnonzero(filled)
    for group in np.split(rows, np.flatnonzero(np.diff(record.time[rows]) > _FULL) + 1) if len(rows) else []:
        part = slice(group[0], int(np.searchsorted(record.time, record.time[group[-1]] + _FULL)))
        interval = record.interval[part, None]
        angle = np.cumsum(np.where(filled[part, None], (rate_sigma[part] * interval) ** 2, 0.0), axis=0)
        across = np.stack([np.delete(angle, axis, axis=1) for axis in range(3)], axis=2)  # (n, 2, 3)
        mean_square = 0.25 * np.sum(across, axis=1) ** 2 + 0.5 * np.sum(across**2, axis=1)
        change = np.sum(np.sqrt(mean_square) * np.abs(force[part]) * interval, axis=0)
        variance[group] = change**2 / len(group) / np.mean(record.interval[group]) ** 2
    return variance


def _side(a: int, b: int) -> int:
    """Number of samples on each side from which the stretch ``[a, b)`` is estimated."""
    return max(_LEAST_SIDE, int(_SIDE_RATIO * (b - a)) + _LEAST_SIDE // 2)


def _neighbours(record: ImuRecord, a: int, b: int) -> tuple[BoolArray, int, int]:
    """Samples ``[first, last)`` about the stretch ``[a, b)``, and which of them are of its kind and regular."""
    side = _side(a, b)
    first, last = max(0, a - side), min(len(record), b + side)
    interval = record.interval[a]
    regular = np.abs(record.interval[first:last] - interval) < 0.2 * interval
    return regular & _same_kind(record, a)[first:last], first, last


def _by_autoregression(record: ImuRecord, values: Array, a: int, b: int, parachute: float) -> list[Interpolation]:
    """Values of the stretch ``[a, b)`` by an autoregression of each axis, with their covariances.

    A stretch is fitted to samples of the same part of the flight, before or after the parachute's shock, if that part
    is as long on each side of the stretch as the stretch itself, so that the cross-validation has both sides: another
    process acts in the other part, and the shock between them is no oscillation of either. Nearer to the shock, the
    samples of both parts are used, which bound the stretch.
    """
    regular, first, last = _neighbours(record, a, b)
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
    kinds = _kinds(record)
    return np.asarray(kinds == kinds[row])


def _kinds(record: ImuRecord) -> IntArray:
    """A number (N,) for each sample's instrument and kind."""
    return 4 * record.unit + 2 * record.coning_corrected + record.sculling_corrected
