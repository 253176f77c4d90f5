"""The path along which prediction and measurement are compared: dead reckoning from one initial state.

A smoothed trajectory has absorbed part of the disagreement between model and measurement, and by a different amount at
every sample. The path here is a function of the initial state, the sensor errors and the samples alone; its error is
linear in those and in the noise of the samples, and is a nuisance state of the linear model, with the priors and
constraints of the reconstruction. The flow is evaluated about the most probable path, which deviates from the
dead-reckoned one by the noise that the samples are estimated to have.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from edl_filter import rotations
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.estimation.interpolating_spline import InterpolatingSpline, integral_spline
from edl_filter.estimation.series import interpolate_columns
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.layout import sensor_maps
from edl_filter.navigation.trajectory import propagate_state
from edl_filter.telemetry.record import SAME_TIME
from edl_filter.types import Array, IntArray

#: Nodes in a bin at which the model is evaluated.
NODES_PER_BIN = 4


@dataclass(frozen=True)
class DeadReckonedPath:
    """Dead-reckoned states at the ends of the samples.

    Attributes
    ----------
    time : (N + 1,) array
        s.
    nav : (N + 1, 10) array
        Inertial position (m) and velocity (m/s), inertial_from_body.
    force, rate : (N, 3) arrays
        Means over the samples at the centre of mass, corrected for the assumed sensor errors: m/s², rad/s, body axes.
    """

    time: Array
    nav: Array
    force: Array
    rate: Array

    def indices(self, times: Array) -> IntArray:
        """Indices ``(K,)`` of the first states at or after `times` ``(K,)``, s."""
        return np.searchsorted(self.time, times - SAME_TIME)


def dead_reckon(problem: Problem, start: Array, errors: Array, lever_arm: Array | None = None) -> DeadReckonedPath:
    """Path of a problem from one initial state.

    Parameters
    ----------
    problem : Problem
        The filter's problem: samples, planet, constraints.
    start : (10,) array
        Navigation state at the initial state's time.
    errors : (U, n) array
        Sensor errors by instrument, each in the filter's vector.
    lever_arm : (N, 3) array, optional
        As of `corrected_readings`.
    """
    samples, planet = problem.samples, problem.planet
    force, rate = _corrected(problem, errors, samples.force, samples.rate)
    nav = propagate_state(start, samples.interval, force, rate, planet.mu, planet.j2, planet.gravity_radius)
    return DeadReckonedPath(
        samples.edges,
        np.concatenate((start[None], nav)),
        *corrected_readings(problem, errors, lever_arm),
    )


def corrected_readings(problem: Problem, errors: Array, lever_arm: Array | None = None) -> tuple[Array, Array]:
    """Mean specific force and rate of the samples, corrected for sensor errors.

    Parameters
    ----------
    problem : Problem
        The filter's problem: samples, planet, constraints.
    errors : (U, n) array
        By instrument, each in the filter's vector.
    lever_arm : (N, 3) array, optional
        Mean lever-arm acceleration of the IMU, m/s²: its errors are those of the reading at its place. None: of the
        force at the centre of mass, as in the filter.

    Returns
    -------
    force, rate : (N, 3) arrays
        At the centre of mass, m/s² and rad/s, body axes.
    """
    if lever_arm is None:
        return _corrected(problem, errors, problem.samples.mean_force, problem.samples.mean_rate)
    force, rate = _corrected(problem, errors, problem.samples.mean_force + lever_arm, problem.samples.mean_rate)
    return force - lever_arm, rate


def _corrected(problem: Problem, errors: Array, force: Array, rate: Array) -> tuple[Array, Array]:
    unit = problem.samples.unit
    force_map, rate_map = sensor_maps(problem.layout, errors.T)
    true_force, true_rate = np.empty_like(force), np.empty_like(rate)
    cuts = np.concatenate(([0], np.flatnonzero(np.diff(unit)) + 1, [len(unit)]))
    for run in (slice(a, b) for a, b in pairwise(cuts)):  # one instrument at a time
        u = unit[run.start]
        true_force[run] = force[run] @ force_map[:9, u].reshape(3, 3).T + force_map[9:, u]
        true_rate[run] = rate[run] * rate_map[:3, u] + rate_map[3:, u]
    return true_force, true_rate


@dataclass(frozen=True)
class PathNodes:
    """States at the times at which the model is evaluated: the same number in each bin, and the end of the last bin.

    Attributes
    ----------
    time : (M,) array
        s.
    nav : (M, 10) array
        As in `DeadReckonedPath`.
    rate : (M, 3) array
        rad/s, body axes.
    """

    time: Array
    nav: Array
    rate: Array


def path_nodes(
    path: DeadReckonedPath,
    bins: TimeBins,
    mean_rate: Array,
    per_bin: int = NODES_PER_BIN,
    errors: tuple[Array, Array] | None = None,
) -> PathNodes:
    """States at the nodes.

    The integral of the rates is known at the bins' edges. A quintic spline through it gives the rotation since the last
    edge, and its derivative the rate. A second-order interpolation would be wrong by 1e-13 rad² per sample (motion of 1
    Hz sampled at 8 Hz), which the moments resolve.

    Parameters
    ----------
    path : DeadReckonedPath
        The dead-reckoned path.
    bins : TimeBins
        Time bins of the comparison.
    mean_rate : (B, 3) array
        Means over the bins, rad/s.
    per_bin : int
        Number of nodes in a bin.
    errors : ((M, 3), (M, 3)) arrays, optional
        By which the integral of the rate since the last edge, rad, and the rate, rad/s, exceed the interpolated ones
        (`interpolation_error.node_errors`).
    """
    edges, count = bins.edges, len(bins.interval)
    time, interpolated = node_times(bins, per_bin), rate_integral(bins, mean_rate)
    bin_index = np.append(np.repeat(np.arange(count), per_bin), count)
    edge_nav = path.nav[path.indices(edges)]
    nav = np.empty((len(time), 10))
    nav[:, :6] = CubicSpline(edges, edge_nav[:, :6], axis=0)(time)
    angle, rate = interpolated(time), interpolated.derivative()(time)
    if errors is not None:
        angle, rate = angle + errors[0], rate + errors[1]
    rotation = _rotation_since_edge(bins, angle, rate)
    nav[:, 6:] = rotations.multiply(edge_nav[bin_index, 6:], rotations.from_rotation_vector(rotation))
    return PathNodes(time, nav, rate)


def displace_nodes(nodes: PathNodes, edges: Array, deviation: Array) -> PathNodes:
    """Nodes of a path that deviates from the dead-reckoned one.

    Parameters
    ----------
    nodes : PathNodes
        Of the dead-reckoned path.
    edges : (B + 1,) array
        Edges of the bins, s.
    deviation : (B + 1, 9) array
        Of position (m), velocity (m/s) and attitude (rotation vector, rad, body axes) at the edges; linear in between.
    """
    change = interpolate_columns(nodes.time, edges, deviation)
    attitude = rotations.multiply(nodes.nav[:, 6:], rotations.from_rotation_vector(change[:, 6:]))
    return replace(nodes, nav=np.concatenate((nodes.nav[:, :6] + change[:, :6], attitude), axis=1))


def path_deviation(nav: Array, reference: Array) -> Array:
    """Deviation of states from a reference, as `displace_nodes` takes it.

    Parameters
    ----------
    nav, reference : (K, 10) arrays
        Inertial position (m) and velocity (m/s), inertial_from_body.

    Returns
    -------
    (K, 9) array
    """
    rotation = rotations.multiply(rotations.conjugate(reference[:, 6:]), nav[:, 6:])
    return np.concatenate((nav[:, :6] - reference[:, :6], rotations.to_rotation_vector(rotation)), axis=1)


def _rotation_since_edge(bins: TimeBins, angle: Array, rate: Array) -> Array:
    """Rotation vectors ``(M, 3)``, rad, from the last edge of a bin to each node; zero at the edges.

    The integral of the rate since the edge and the coning (Bortz 1971), summed from node to node with the rate linear
    between two nodes: ``½ α × Δα + h²/12 ω_before × ω_after`` with the integral α up to the node before. Without the
    coning, an attitude inside a bin of 0.125 s of a coning motion would differ by up to 10 µrad from that at its end:
    the predicted moment is then wrong by a tenth of the gyros' noise, in phase with the motion.

    Parameters
    ----------
    bins : TimeBins
        Time bins of the comparison.
    angle, rate : (M, 3) arrays
        Integral of the rate at the nodes, rad, and the rate, rad/s, body axes.
    """
    count = len(bins.interval)
    per_bin = (len(angle) - 1) // count
    by_bin = (count, per_bin, 3)
    alpha = angle[:-1].reshape(by_bin) - angle[:-1:per_bin, None]
    before, after = rate[:-1].reshape(by_bin), rate[1:].reshape(by_bin)
    step = np.diff(angle, axis=0).reshape(by_bin)
    spacing = bins.interval[:, None, None] / per_bin
    coning = 0.5 * rotations.cross(alpha, step) + spacing**2 / 12.0 * rotations.cross(before, after)
    out = np.zeros((len(angle), 3))
    inside = out[:-1].reshape(by_bin)
    inside[:] = alpha
    inside[:, 1:] += np.cumsum(coning, axis=1)[:, :-1]
    return out


def node_rates(bins: TimeBins, mean_rate: Array) -> Array:
    """Rates at the nodes ``(M, 3)``, rad/s, from means over the bins ``(B, 3)``, as in `path_nodes`."""
    return rate_integral(bins, mean_rate).derivative()(node_times(bins))


def node_times(bins: TimeBins, per_bin: int = NODES_PER_BIN) -> Array:
    """Times of the nodes ``(M,)``, s, `per_bin` in each bin."""
    fraction = np.arange(per_bin) / per_bin
    return np.append((bins.edges[:-1, None] + bins.interval[:, None] * fraction).ravel(), bins.edges[-1])


def rate_integral(bins: TimeBins, mean_rate: Array) -> InterpolatingSpline:
    """Integral of the rates ``(B, 3)``, rad/s, as a function of time; where there are none they count as zero."""
    return integral_spline(bins.edges, bins.interval, np.nan_to_num(mean_rate))
