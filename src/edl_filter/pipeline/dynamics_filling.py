"""Filling of lost samples by rotational dynamics with the moments and forces of the aerodynamic database.

Input: telemetry whose lost stretches an autoregression has filled (`telemetry.sample_filling`), a run of the filter
with it, and the forward model. Method: along the path of that run, the rotational motion across each stretch is
smoothed from the readings on both sides (`navigation.motion_smoother`). Output: a run with telemetry in which the
stretches have these values. Of two methods the one with the smaller sigma would be the one that is too certain: where
motion or air density change across the stretch, which the autoregression does not model, it is wrong by ten sigmas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import FlightCondition
from edl_filter.estimation.autoregression import Interpolation
from edl_filter.imu_model.lever_arm import edge_values, lever_arm_acceleration
from edl_filter.navigation.motion_model import Window
from edl_filter.navigation.motion_smoother import Solution, predict_stretch
from edl_filter.navigation.rotational_dynamics import SIZE, PathLoads
from edl_filter.navigation.smoother import smooth
from edl_filter.navigation.trajectory import Trajectory, smoothed_trajectory
from edl_filter.pipeline.redundancy import Run
from edl_filter.telemetry.partial_readings import given_readings, lost_axis
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, SampleFinding, Telemetry
from edl_filter.telemetry.sample_filling import (
    BY_AUTOREGRESSION,
    BY_DYNAMICS,
    PARACHUTE_MARGIN,
    fill_sigma,
)
from edl_filter.types import Array

#: Shortest stretch that is filled, s: in a shorter one the autoregression is as good.
SHORTEST = 0.5
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
    long = [(a, b) for a, b in stretches if b - a > SHORTEST - SAME_TIME and b < end]
    chosen = sorted(long, key=lambda s: (s[0] - s[1], s[0]))[:MOST_STRETCHES]
    solutions: dict[tuple[float, float], Solution] = {}
    for _ in range(PASSES if chosen else 0):
        problem = result.problem
        trajectory = smoothed_trajectory(problem, smooth(result.filter_pass), result.filter_pass.layout)
        record, predicted = base.driving, set[tuple[float, float]]()
        for stretch in chosen:
            window = window_around(stretch, result, trajectory, model, end)
            prediction = None if window is None else predict_stretch(window, solutions.get(stretch))
            if window is not None and prediction is not None:
                fills, solutions[stretch] = prediction
                record = _with_fills(record, base.driving, result.telemetry.driving, window, fills)
                predicted.add(stretch)
        if not predicted:
            return result
        findings = tuple(
            replace(f, repair=f.repair.replace(BY_AUTOREGRESSION, BY_DYNAMICS))
            if _has_autoregression(f, base) and predicted.intersection(f.interpolated)
            else f
            for f in base.findings
        )
        previous, result = result.telemetry.driving, run(replace(base, driving=record, findings=findings))
        if _largest_change(previous, record) < _SAME_FILL:
            break
    return result


def _has_autoregression(finding: SampleFinding, telemetry: Telemetry) -> bool:
    """Whether a finding is of the driving IMU, and the autoregression has filled a part of it."""
    return finding.imu == telemetry.driving.name and BY_AUTOREGRESSION in finding.repair


def _largest_change(previous: ImuRecord, record: ImuRecord) -> float:
    """Largest change of the sum of the filled samples' values over a stretch and an axis, in sigmas of the sum."""
    largest = 0.0
    filled = np.flatnonzero(record.filled)
    for rows in np.split(filled, np.flatnonzero(np.diff(filled) > 1) + 1):
        for values, sigmas in (("specific_force", "force_fill_sigma"), ("angular_rate", "rate_fill_sigma")):
            change = np.sum(getattr(record, values)[rows] - getattr(previous, values)[rows], axis=0)
            variance = np.sum(getattr(record, sigmas)[rows] ** 2, axis=0)
            largest = max(largest, float(np.max(np.abs(change) / np.sqrt(np.maximum(variance, 1e-300)))))
    return largest


def window_around(
    stretch: tuple[float, float], run: Run, trajectory: Trajectory, model: ForwardModel, end: float
) -> Window | None:
    """Readings around a stretch and what acts on the vehicle there.

    Parameters
    ----------
    stretch : tuple of two floats
        Its begin and end, s.
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
    samples, record = run.problem.samples, run.telemetry.driving
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
    readings, noise = [], []
    nearest = record.index_at(samples.time - 0.5 * samples.interval)
    for values, sigma in (
        (trajectory.angular_rate, record.rate_noise),
        (trajectory.specific_force, record.force_noise),
    ):
        part = slice(cuts[0], cuts[-1])
        weighted = values[cuts[0] + 1 : cuts[-1] + 1] * widths
        readings.append(np.add.reduceat(weighted, cuts[:-1] - cuts[0]) / lengths)
        # noise of a sample that is split at an event: that of its random walk
        variance = sigma[nearest[part]] ** 2 * record.interval[nearest[part]] * widths[:, 0]
        variance = np.add.reduceat(variance, cuts[:-1] - cuts[0]) / lengths[:, 0] ** 2
        noise.append(np.repeat(np.sqrt(variance)[:, None], 3, axis=1))
    observed = np.add.reduceat(samples.filled[cuts[0] : cuts[-1]].astype(int), cuts[:-1] - cuts[0]) == 0
    states = np.zeros((len(counts), SIZE))
    states[:, :4] = trajectory.inertial_from_body[cuts[:-1]]
    states[:, 4:7] = edge_values(lengths[:, 0], readings[0])[:-1]
    steps = max(1, int(np.ceil(lengths.max() / _STEP - SAME_TIME)))
    loads = path_loads(model, edges[cuts], trajectory.position[cuts], trajectory.velocity[cuts], steps)
    position = int(np.flatnonzero(cuts == first)[0])
    return Window(
        edges[cuts], np.hstack(readings), np.hstack(noise), observed, position, position + len(inside) - 1, states,
        loads, steps,
    )  # fmt: skip


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
    place, speed = (np.stack([np.interp(nodes, time, c) for c in values.T], axis=1) for values in (position, velocity))
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
        Rates and specific force at the centre of mass.
    """
    edges = window.time[window.first : window.last + 1]
    a, b = (int(k) for k in np.searchsorted(base.time, edges[[0, -1]] + np.array([SAME_TIME, -SAME_TIME])))
    rows, inside = slice(a, b + 1), window.readings[window.first : window.last]
    partial = {"angular_rate": base.partial_rate[rows], "specific_force": base.partial_force[rows]}
    axes = {name: lost_axis(of_triad) for name, of_triad in partial.items()}
    for name, columns in (("angular_rate", slice(0, 3)), ("specific_force", slice(3, 6))):
        if (axis := axes[name]) is not None:  # the readings of the window contain the axes that are read
            fills = [
                *fills[: columns.start],
                *given_readings(fills[columns], inside[:, columns], axis),
                *fills[columns.stop :],
            ]
    predicted = np.stack([fill.values for fill in fills], axis=1)
    change = predicted - inside
    total = np.concatenate((np.zeros((1, 6)), np.cumsum(change * np.diff(edges)[:, None], axis=0)))
    ends = np.clip(base.edges[a : b + 2], edges[0], edges[-1])
    means = np.stack([np.interp(ends, edges, c) for c in total.T], axis=1)
    rate_change, force_change = np.split(np.diff(means, axis=0) / base.interval[rows, None], 2, axis=1)
    rate = current.angular_rate.copy()
    rate[rows] += rate_change
    arms = [lever_arm_acceleration(base.interval, w, base.position, base.unit) for w in (rate, current.angular_rate)]
    force = current.specific_force.copy()
    force[rows] += force_change + (arms[0] - arms[1])[rows]
    interval, count = float(np.median(base.interval[rows])), b + 1 - a
    changed = {}
    for values, names, column in (
        (rate, ("angular_rate", "rate_fill_sigma"), 0),
        (force, ("specific_force", "force_fill_sigma"), 3),
    ):
        bin_noise = window.noise[window.first : window.last, column]
        triad = fills[column : column + 3]
        sigma = fill_sigma(triad, bin_noise, float(np.median(np.diff(edges))), coning=column == 0)
        # independent errors of bins become those of samples with the same variance of the sum
        sigma = (
            np.sqrt(np.mean(sigma**2, axis=0) * len(bin_noise) / count)
            * (edges[-1] - edges[0])
            / (len(bin_noise) * interval)
        )
        lost, axis = getattr(base, names[1])[rows] > 0.0, axes[names[0]]
        if axis is not None:
            read = getattr(current, names[0])[rows]
            values[rows] = read + np.outer((values[rows] - read) @ axis, axis)
        else:  # samples of which one axis alone is lost in a part of the stretch stay as they are
            lost = lost & ~np.any(partial[names[0]][:, 1] != 0.0, axis=1, keepdims=True)
        for name, new in zip(names, (values[rows], np.broadcast_to(sigma, lost.shape)), strict=True):
            array = getattr(record, name).copy()
            array[rows] = np.where(lost, new, array[rows])
            changed[name] = array
    return replace(record, **changed)
