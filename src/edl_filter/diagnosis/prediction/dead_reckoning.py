"""The path along which prediction and measurement are compared: dead reckoning from one start, nothing fused.

A smoothed trajectory has eaten the very disagreement that is looked for, and in another way at every sample. The path
here is a function of the start, the sensor errors and the samples alone; what is wrong with it is a linear error that
`whitening` estimates from the same prior and the same constraints as the reconstruction.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from edl_filter import rotations
from edl_filter.diagnosis.bins import Bins
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.layout import sensor_maps
from edl_filter.navigation.trajectory import march_one

Array = NDArray[np.float64]

#: Nodes in a bin.
PER_BIN = 4


@dataclass(frozen=True)
class Path:
    """Dead-reckoned states at the ends of the samples.

    Attributes
    ----------
    time : (N + 1,) array
        s.
    nav : (N + 1, 10) array
        Inertial position, velocity, inertial_from_body.
    force, rate : (N, 3) arrays
        Means over the samples at the centre of mass, the assumed sensor errors taken off: m/s², rad/s, body axes.
    """

    time: Array
    nav: Array
    force: Array
    rate: Array


def dead_reckon(problem: Problem, start: Array, errors: Array) -> Path:
    """Path of a problem.

    Parameters
    ----------
    problem : Problem
    start : (10,) array
        At the initial state's time.
    errors : (U, n) array
        Sensor errors by instrument, each in the filter's vector.
    """
    samples, planet = problem.samples, problem.planet
    force, rate = _undone(problem, errors, samples.force, samples.rate)
    nav = march_one(start, samples.interval, force, rate, planet.mu, planet.j2, planet.gravity_radius)
    return Path(
        np.concatenate(([samples.time[0] - samples.interval[0]], samples.time)),
        np.concatenate((start[None], nav)),
        *readings(problem, errors),
    )


def readings(problem: Problem, errors: Array) -> tuple[Array, Array]:
    """Means over the samples at the centre of mass, the assumed sensor errors taken off: m/s², rad/s, ``(N, 3)``."""
    return _undone(problem, errors, problem.samples.mean_force, problem.samples.mean_rate)


def _undone(problem: Problem, errors: Array, force: Array, rate: Array) -> tuple[Array, Array]:
    """Readings without sensor errors."""
    unit = problem.samples.unit
    force_map, rate_map = sensor_maps(problem.layout, errors.T)
    real, turning = np.empty_like(force), np.empty_like(rate)
    cuts = np.concatenate(([0], np.flatnonzero(np.diff(unit)) + 1, [len(unit)]))
    for run in (slice(a, b) for a, b in pairwise(cuts)):  # one instrument at a time
        u = unit[run.start]
        real[run] = force[run] @ force_map[:9, u].reshape(3, 3).T + force_map[9:, u]
        turning[run] = rate[run] * rate_map[:3, u] + rate_map[3:, u]
    return real, turning


@dataclass(frozen=True)
class Nodes:
    """States at the times at which the model is asked, `PER_BIN` to a bin, and the end of the last.

    Attributes
    ----------
    time : (M,) array
    nav : (M, 10) array
    rate : (M, 3) array
    """

    time: Array
    nav: Array
    rate: Array


def nodes_of(path: Path, bins: Bins, mean_rate: Array) -> Nodes:
    """States at the nodes.

    The integral of the rates is known at the bins' edges; a quintic spline through it gives the turn since the last
    edge, and its derivative the rate. A second-order interpolation would be wrong by a tenth of a microradian squared
    per sample (1 Hz, 8 Hz sampling), which the moments show.

    Parameters
    ----------
    path : Path
    bins : Bins
    mean_rate : (B, 3) array
        Means over the bins, rad/s.
    """
    edges, count = bins.edges, len(bins.interval)
    time, angle = node_times(bins), _angle(bins, mean_rate)
    bin_ = np.append(np.repeat(np.arange(count), PER_BIN), count)
    at_edges = path.nav[np.searchsorted(path.time, edges - 1e-6)]
    nav = np.empty((len(time), 10))
    nav[:, :6] = CubicSpline(edges, at_edges[:, :6], axis=0)(time)
    turned = angle(time)
    turn = turned - turned[::PER_BIN][bin_]
    nav[:, 6:] = rotations.multiply(at_edges[bin_, 6:], rotations.from_rotation_vector(turn))
    return Nodes(time, nav, angle.derivative()(time))


def node_rates(bins: Bins, mean_rate: Array) -> Array:
    """Rates at the nodes ``(M, 3)``, as `nodes_of` has them."""
    return np.asarray(_angle(bins, mean_rate).derivative()(node_times(bins)), np.float64)


def node_times(bins: Bins) -> Array:
    """Times of the nodes ``(M,)``."""
    share = np.arange(PER_BIN) / PER_BIN
    return np.append((bins.edges[:-1, None] + bins.interval[:, None] * share).ravel(), bins.edges[-1])


def _angle(bins: Bins, mean_rate: Array) -> BSpline:
    """Integral of the rates."""
    steps = np.nan_to_num(mean_rate) * bins.interval[:, None]
    return make_interp_spline(bins.edges, np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0))), k=5)
