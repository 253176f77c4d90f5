"""Filling of lost samples by rotational dynamics with the moments and forces of the aerodynamic database.

Input: telemetry whose lost stretches an autoregression has filled (`telemetry.sample_filling`), a run of the filter
with it, and the forward model. Method: along the path of that run, the rotational motion across each stretch is
smoothed from the readings on both sides, and within it from the axes that are read (`navigation.motion_smoother`).
Output: a run with telemetry in which the stretches have these values. The dynamics are used even where the
autoregression states a smaller sigma: where motion or air density change across the stretch, the autoregression is
wrong by ten of its sigmas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import FlightCondition
from edl_filter.estimation.autoregression import Interpolation
from edl_filter.estimation.series import interpolate_columns, runs
from edl_filter.imu_model.lever_arm import edge_values, lever_arm_acceleration
from edl_filter.navigation.motion_model import Window
from edl_filter.navigation.motion_smoother import Solution, predict_stretch
from edl_filter.navigation.rotational_dynamics import SIZE, PathLoads
from edl_filter.navigation.smoother import smooth
from edl_filter.navigation.trajectory import Trajectory, smoothed_trajectory
from edl_filter.pipeline.redundancy import Run
from edl_filter.telemetry.partial_readings import lost_axis, variance_factors
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, SampleFinding, Telemetry
from edl_filter.telemetry.sample_filling import (
    BY_AUTOREGRESSION,
    BY_DYNAMICS,
    PARACHUTE_MARGIN,
    SHORTEST_BY_DYNAMICS,
    fill_sigma,
    tilt_variance,
)
from edl_filter.types import Array, BoolArray, IntArray

#: A new fill changes the path of the vehicle, and with it the fill: most repetitions, and the change of the sums over a
#: stretch, in sigmas, from which on it is not repeated.
PASSES, _SAME_FILL = 4, 0.3
#: Readings on each side: at least this many, this long (s), and relative to the stretch.
_LEAST_SIDE, _LEAST_SIDE_S, _SIDE_RATIO = 80, 8.0, 1.5
#: Fewest readings before a stretch.
_FEWEST_READINGS = 20
#: Shortest bin of samples, s, most bins in a stretch, and longest step of the integration, s: a 40th of the shortest
#: period of oscillation.
_BIN, _MOST_BINS, _STEP = 0.05, 200, 0.025
#: Most stretches that are filled, the longest ones: each takes seconds.
MOST_STRETCHES = 8
#: Relative difference from which on two readings are not the same one.
_SAME_READING = 1e-9
#: Columns of rates and forces in a window.
_RATE, _FORCE = slice(0, 3), slice(3, 6)
#: Angles at which the coefficients are evaluated, rad.
_ANGLES = np.radians(np.linspace(0.0, 60.0, 61))


def filled_by_dynamics(first: Run, model: ForwardModel, parachute: float, run: Callable[[Telemetry], Run]) -> Run:
    """Fill the stretches of the driving IMU that no other IMU has by rotational dynamics, and run the filter again.

    Parameters
    ----------
    first : Run
        With the stretches filled by an autoregression.
    model : ForwardModel
        The forward model of the mission.
    parachute : float
        Time of the parachute's deployment, s: stretches that reach its margin stay as they are.
    run : callable
        Runs the filter with a telemetry.

    Returns
    -------
    Run
        `first` where no stretch has a prediction.
    """
    result, base = first, first.telemetry
    end = parachute - PARACHUTE_MARGIN
    stretches = {s for f in base.findings if _has_autoregression(f, base) for s in f.interpolated}
    long = [(a, b) for a, b in _merged(stretches) if b - a > SHORTEST_BY_DYNAMICS - SAME_TIME and b < end]
    chosen = sorted(long, key=lambda s: (s[0] - s[1], s[0]))[:MOST_STRETCHES]
    solutions: dict[tuple[float, float], Solution] = {}
    for _ in range(PASSES if chosen else 0):
        problem = result.problem
        trajectory = smoothed_trajectory(problem, smooth(result.filter_pass), result.filter_pass.layout)
        record, predicted = base.driving, set[tuple[float, float]]()
        for stretch in chosen:
            window = window_around(stretch, base.driving, result, trajectory, model, end)
            prediction = None if window is None else predict_stretch(window, solutions.get(stretch))
            if window is not None and prediction is not None:
                fills, solutions[stretch] = prediction
                record = _with_fills(record, base.driving, result.telemetry.driving, window, fills)
                predicted.add(stretch)
        if not predicted:
            return result
        findings = tuple(
            replace(f, repair=f.repair.replace(BY_AUTOREGRESSION, BY_DYNAMICS))
            if _has_autoregression(f, base) and any(a <= s and e <= b for s, e in f.interpolated for a, b in predicted)
            else f
            for f in base.findings
        )
        previous, result = result.telemetry.driving, run(replace(base, driving=record, findings=findings))
        if _largest_change(previous, record) < _SAME_FILL:
            break
    return result


def _merged(stretches: set[tuple[float, float]]) -> list[tuple[float, float]]:
    """Stretches (start and end, s) without overlap: those of two triads that overlap are one."""
    merged: list[tuple[float, float]] = []
    for start, end in sorted(stretches):
        if merged and start < merged[-1][1] - SAME_TIME:
            merged[-1] = merged[-1][0], max(end, merged[-1][1])
        else:
            merged.append((start, end))
    return merged


def _has_autoregression(finding: SampleFinding, telemetry: Telemetry) -> bool:
    """Whether a finding is of the driving IMU, and the autoregression has filled a part of it."""
    return finding.imu == telemetry.driving.name and BY_AUTOREGRESSION in finding.repair


def _largest_change(previous: ImuRecord, record: ImuRecord) -> float:
    """Largest change of the sum of the filled samples' values over a stretch and an axis, in sigmas of the sum."""
    largest = 0.0
    for start, end in runs(record.filled):
        rows = np.arange(start, end)
        for values, sigmas in (("specific_force", "force_fill_sigma"), ("angular_rate", "rate_fill_sigma")):
            change = np.sum(getattr(record, values)[rows] - getattr(previous, values)[rows], axis=0)
            variance = np.sum(getattr(record, sigmas)[rows] ** 2, axis=0)
            largest = max(largest, float(np.max(np.abs(change) / np.sqrt(np.maximum(variance, 1e-300)))))
    return largest


def window_around(
    stretch: tuple[float, float], base: ImuRecord, run: Run, trajectory: Trajectory, model: ForwardModel, end: float
) -> Window | None:
    """Readings around a stretch and what acts on the vehicle there.

    Parameters
    ----------
    stretch : tuple of two floats
        Its start and end, s.
    base : ImuRecord
        The driving IMU, filled by the autoregression.
    run : Run
        The filter's run.
    trajectory : Trajectory
        Its smoothed trajectory.
    model : ForwardModel
        The forward model of the mission.
    end : float
        Latest time of the window, s.

    Returns
    -------
    Window or None
        None where too few readings are before the stretch.
    """
    samples = run.problem.samples
    edges = trajectory.time
    first, last = (int(k) for k in np.searchsorted(edges, np.array(stretch) - SAME_TIME))
    interval = float(np.median(np.diff(edges[first : last + 1])))
    size = max(1, round(_BIN / interval), -(-(last - first) // _MOST_BINS))
    side = max(_LEAST_SIDE, round(_LEAST_SIDE_S / interval), round(_SIDE_RATIO * (last - first)) + _LEAST_SIDE // 2)
    before = np.arange(first, max(0, first - side) - 1, -size)[::-1]
    stop = min(int(np.searchsorted(edges, end + SAME_TIME)) - 1, last + side)
    inside = np.append(np.arange(first, last, size), last)
    cuts = np.concatenate((before[:-1], inside, np.arange(last, stop + 1, size)[1:]))
    if len(before) <= _FEWEST_READINGS // size or stop < last:
        return None
    counts = np.diff(cuts)
    widths = np.diff(edges)[cuts[0] : cuts[-1], None]
    lengths = np.diff(edges[cuts])[:, None]
    rows = base.index_at(samples.middle)[cuts[0] : cuts[-1]]
    axes, lost = _lost_components(base, rows, slice(first - cuts[0], last - cuts[0]))
    observed = np.add.reduceat(lost.astype(int), cuts[:-1] - cuts[0]) == 0
    rate, force = (v[cuts[0] + 1 : cuts[-1] + 1] for v in (trajectory.angular_rate, trajectory.specific_force))
    # where rates are lost, the force is that which the IMU reads: with wrong rates it cannot be transferred
    arm = np.where(np.repeat(~observed[:, :3].all(axis=1), counts)[:, None], base.position[rows], 0.0)
    force = force + lever_arm_acceleration(widths[:, 0], rate, arm, base.unit[rows])
    arm = arm[cuts[:-1] - cuts[0]]
    readings, noise = [], []
    for values, sigma in ((rate, base.rate_noise), (force, base.force_noise)):
        readings.append(np.add.reduceat(values * widths, cuts[:-1] - cuts[0]) / lengths)
        # noise of a sample that is split at an event: that of its random walk
        variance = sigma[rows] ** 2 * base.interval[rows] * widths[:, 0]
        variance = np.add.reduceat(variance, cuts[:-1] - cuts[0]) / lengths[:, 0] ** 2
        noise.append(np.repeat(np.sqrt(variance)[:, None], 3, axis=1))
    states = np.zeros((len(counts), SIZE))
    states[:, :4] = trajectory.inertial_from_body[cuts[:-1]]
    states[:, 4:7] = edge_values(lengths[:, 0], readings[0])[:-1]
    steps = max(1, int(np.ceil(lengths.max() / _STEP - SAME_TIME)))
    loads = path_loads(model, edges[cuts], trajectory.position[cuts], trajectory.velocity[cuts], steps)
    position = int(np.flatnonzero(cuts == first)[0])
    return Window(
        edges[cuts], np.hstack(readings) @ axes.T, np.hstack(noise), observed, axes, arm, position,
        position + len(inside) - 1, states, loads, steps,
    )  # fmt: skip


def _lost_components(base: ImuRecord, rows: IntArray, stretch: slice) -> tuple[Array, BoolArray]:
    """Axes (6, 6) of a window (`Window.axes`), and which components of its samples (n, 6) are lost.

    Where one axis of a triad is lost alone in the stretch, it is the first one of the triad's axes, and the others are
    observed in all samples whose values contain what they read.
    """
    axes, lost = np.eye(6), np.zeros((len(rows), 6), bool)
    for k, (sigma, partial, values) in enumerate((
        (base.rate_fill_sigma, base.partial_rate, base.angular_rate),
        (base.force_fill_sigma, base.partial_force, base.specific_force),
    )):  # fmt: skip
        columns = slice(3 * k, 3 * k + 3)
        filled, partial, values = np.any(sigma[rows] > 0.0, axis=1), partial[rows], values[rows]
        lost[:, columns] = filled[:, None]
        if not filled[stretch].any() or (axis := lost_axis(partial[stretch][filled[stretch]])) is None:
            continue
        axes[columns, columns] = _basis(axis)
        kept = _contains_readings(values, partial) & np.all(partial[:, 1] == axis, axis=1)
        lost[:, 3 * k + 1 : 3 * k + 3] &= ~kept[:, None]
    return axes, lost


def _contains_readings(values: Array, partial: Array) -> BoolArray:
    """Samples (n,) of a triad of which one axis is lost alone, and whose values contain what the others read."""
    axis = partial[:, 1]
    across = values - np.sum(values * axis, axis=1, keepdims=True) * axis
    same = np.linalg.norm(across - partial[:, 0], axis=1) <= _SAME_READING * np.linalg.norm(values, axis=1)
    return np.asarray(same & np.any(axis != 0.0, axis=1))


def _basis(axis: Array) -> Array:
    """Right-handed orthonormal axes, rows (3, 3), of which the first is given."""
    second = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    second /= np.linalg.norm(second)
    return np.array([axis, second, np.cross(axis, second)])


def path_loads(model: ForwardModel, time: Array, position: Array, velocity: Array, steps: int) -> PathLoads:
    """What acts on the vehicle along a path, at the nodes of the integration.

    Parameters
    ----------
    model : ForwardModel
        The forward model of the mission; forces and moments that effects add to the database's are not contained.
    time : (T + 1,) array
        Edges of the bins, s.
    position, velocity : (T + 1, 3) arrays
        Inertial, m and m/s.
    steps : int
        Steps of the integration in each bin.

    Returns
    -------
    PathLoads
    """
    fraction = np.arange(2 * steps) / (2 * steps)
    nodes = np.append((time[:-1, None] + np.diff(time)[:, None] * fraction).ravel(), time[-1])
    count = len(nodes)
    place, speed = (interpolate_columns(nodes, time, values) for values in (position, velocity))
    inertial_axes = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    flow = model.flow(nodes, place, speed, inertial_axes, np.zeros((count, 3)))
    # the same flow at all angles, in the plane of pitch
    angle, shape = np.tile(_ANGLES, count), (count, len(_ANGLES))
    repeated = {
        name: np.repeat(getattr(flow, name), len(_ANGLES))
        for name in ("time", "altitude", "speed", "density", "mach", "knudsen", "dynamic_pressure")
    }
    direction = np.stack((np.cos(angle), np.zeros(len(angle)), np.sin(angle)), axis=1)
    totals = model.coefficients(
        FlightCondition(
            velocity_body=repeated["speed"][:, None] * direction, rate=np.zeros((len(angle), 3)), alpha_total=angle,
            diameter=model.diameter, **repeated,
        )
    )  # fmt: skip
    _, body = next(iter(model.bodies(nodes[:1])))
    x, y, z = body.centre(model.x_over_d, model.diameter)
    coefficients = (totals.ca, totals.cn, totals.cm_nose + x * totals.cn)
    return PathLoads(
        air=flow.velocity_body,
        pressure_area=flow.dynamic_pressure * model.area,
        coefficients=np.stack([c.reshape(shape) for c in coefficients], axis=2),
        angle_step=float(_ANGLES[1]),
        cmq=np.ascontiguousarray(totals.cmq.reshape(shape)[:, 0]),
        rate_scale=model.diameter / (2.0 * np.maximum(flow.speed, 1.0)),
        diameter=model.diameter,
        mass=body.mass,
        offset=model.diameter * np.array([0.0, y, z]),
        inertia=np.ascontiguousarray(body.inertia),
        inverse=np.ascontiguousarray(np.linalg.inv(body.inertia)),
    )


def _with_fills(
    record: ImuRecord, base: ImuRecord, current: ImuRecord, window: Window, fills: list[Interpolation]
) -> ImuRecord:
    """The record with the stretch filled.

    Parameters
    ----------
    record : ImuRecord
        To be changed.
    base : ImuRecord
        Filled by the autoregression; what it has not filled, stays.
    current : ImuRecord
        With which the window's readings were computed; they differ from it by sensor errors, which the change of a
        reading does not contain to first order.
    window : Window
        Readings around the stretch.
    fills : list of six Interpolation
        Rates and specific force along the window's axes; forces where the window has them.
    """
    edges = window.time[window.first : window.last + 1]
    a, b = (int(k) for k in np.searchsorted(base.time, edges[[0, -1]] + np.array([SAME_TIME, -SAME_TIME])))
    rows, interval = slice(a, b + 1), float(np.median(base.interval[a : b + 1]))
    rate, force = _changed_readings(base, current, window, fills, rows)
    triads = [_along_body(fills[columns], window.axes[columns, columns]) for columns in (_RATE, _FORCE)]
    changed = {}
    for values, names, columns, triad, partial in (
        (rate, ("angular_rate", "rate_fill_sigma"), _RATE, triads[0], base.partial_rate),
        (force, ("specific_force", "force_fill_sigma"), _FORCE, triads[1], base.partial_force),
    ):
        lost = np.any(getattr(base, names[1])[rows] > 0.0, axis=1)
        axis = window.axes[columns, columns][0]
        if _has_single_axis(window.axes[columns, columns]):
            before = getattr(current, names[0])[rows]
            values[rows] = before + np.outer((values[rows] - before) @ axis, axis)
        else:  # samples that contain what their other axes read stay as they are
            lost = lost & ~_contains_readings(getattr(base, names[0])[rows], partial[rows])
        sigma = _sigma_of_samples(triad, window, columns, int(np.count_nonzero(lost)), interval)
        for name, new in zip(names, (values[rows], np.broadcast_to(sigma, (len(lost), 3))), strict=True):
            array = getattr(record, name).copy()
            array[rows] = np.where(lost[:, None], new, array[rows])
            changed[name] = array
    tilt = _tilt_variance(triads[0], window) / (b + 1 - a) / interval**2
    changed["force_fill_sigma"][rows] = np.sqrt(changed["force_fill_sigma"][rows] ** 2 + tilt)
    return replace(record, **changed)


def _changed_readings(
    base: ImuRecord, current: ImuRecord, window: Window, fills: list[Interpolation], rows: slice
) -> tuple[Array, Array]:
    """Rates and forces (N, 3) of `current` with the fills in the rows of the stretch, as `_with_fills` describes."""
    edges, part = window.time[window.first : window.last + 1], slice(window.first, window.last)
    values = np.stack([f.values for f in fills], axis=1)
    change = np.where(window.observed[part], 0.0, values - window.readings[part]) @ window.axes
    total = np.concatenate((np.zeros((1, 6)), np.cumsum(change * np.diff(edges)[:, None], axis=0)))
    ends = np.clip(base.edges[rows.start : rows.stop + 1], edges[0], edges[-1])
    means = interpolate_columns(ends, edges, total)
    rate_change, force_change = np.split(np.diff(means, axis=0) / base.interval[rows, None], 2, axis=1)
    rate, force = current.angular_rate.copy(), current.specific_force.copy()
    rate[rows] += rate_change
    arms = [lever_arm_acceleration(base.interval, w, base.position, base.unit) for w in (rate, current.angular_rate)]
    rates_read = ~np.any(base.rate_fill_sigma[rows] > 0.0, axis=1, keepdims=True)
    # where rates are lost, the window has the force at the place of the IMU
    force[rows] += force_change + np.where(rates_read, (arms[0] - arms[1])[rows], 0.0)
    return rate, force


def _has_single_axis(axes: Array) -> bool:
    """Whether one axis of a triad is lost alone in a window: otherwise its axes, rows (3, 3), are the body's."""
    return not np.array_equal(axes, np.eye(3))


def _along_body(fills: list[Interpolation], axes: Array) -> list[Interpolation]:
    """Fills of a triad along its axes, rows (3, 3), as fills along the body axes.

    Independent errors along the body axes are not smaller than the error along an axis that is lost alone
    (`variance_factors`).
    """
    if not _has_single_axis(axes):
        return fills
    values, bound = np.stack([f.values for f in fills], axis=1) @ axes, variance_factors(axes[0])
    return [replace(fills[0], values=values[:, i], covariance=bound[i] * fills[0].covariance) for i in range(3)]


def _sigma_of_samples(triad: list[Interpolation], window: Window, columns: slice, count: int, interval: float) -> Array:
    """Sigma (3,) of independent errors of `count` samples, s apart, with the variance of the sum over the lost bins."""
    part = slice(window.first, window.last)
    bins, lengths = ~window.observed[part, columns].all(axis=1), np.diff(window.time[part.start : part.stop + 1])
    if not bins.any() or not count:
        return np.zeros(3)
    restricted = [replace(f, values=f.values[bins], covariance=f.covariance[np.ix_(bins, bins)]) for f in triad]
    noise, length = window.noise[part, columns.start][bins], float(np.median(lengths[bins]))
    sigma = fill_sigma(restricted, noise, length, coning=columns == _RATE)
    share = float(np.sum(lengths[bins])) / (np.count_nonzero(bins) * interval)
    return np.asarray(np.sqrt(np.mean(sigma**2, axis=0) * np.count_nonzero(bins) / count) * share)


def _tilt_variance(rates: list[Interpolation], window: Window) -> Array:
    """Variance (3,) of the velocity change by filled rates where the forces are read, m²/s²; else zero."""
    part = slice(window.first, window.last)
    observed, interval = window.observed[part], float(np.median(np.diff(window.time[part.start : part.stop + 1])))
    if observed[:, _RATE].all() or not observed[:, _FORCE].any():
        return np.zeros(3)
    sigma = fill_sigma(rates, window.noise[part, 0], interval, coning=True)
    force = window.readings[part, _FORCE] @ window.axes[_FORCE, _FORCE]
    return tilt_variance(rates, sigma, force, np.zeros_like(force), interval)
