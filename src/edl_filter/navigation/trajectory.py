"""The smoothed trajectory at every sample, with its covariance.

Between two nodes the smoothed state is propagated over the samples with the smoothed sensor errors. The difference from
the next smoothed state is the estimate of the process noise in between; it is distributed over the interval as
the noise is: evenly in smooth flight, mostly into a gap where there is one. Covariances are interpolated linearly in
inertial axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from edl_filter import rotations
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.layout import Layout, State, sensor_maps
from edl_filter.navigation.smoother import Smoothed
from edl_filter.navigation.strapdown import step
from edl_filter.types import Array


@dataclass(frozen=True)
class Trajectory:
    """Navigation state along the flight, inertial axes.

    Attributes
    ----------
    time : (N,) array
        s; the initial state's time, then the end of every sample.
    position, velocity : (N, 3) arrays
        m, m/s.
    inertial_from_body : (N, 4) array
    epochs : (K,) array
        Times of the smoother's states, two or more, s.
    epoch_covariance : (K, 9, 9) array
        Of position (m), velocity (m/s) and attitude error (rad) at the epochs, the latter as an inertial rotation
        vector: ``true = exp(error) ⊗ estimate``.
    specific_force, angular_rate : (N, 3) arrays
        Corrected for the estimated sensor errors, at the centre of mass, body axes, m/s² and rad/s: means over the
        interval that ends at `time`. The first row repeats the second.
    """

    time: Array
    position: Array
    velocity: Array
    inertial_from_body: Array
    epochs: Array
    epoch_covariance: Array
    specific_force: Array
    angular_rate: Array

    @cached_property
    def covariance(self) -> Array:
        """Covariance ``(N, 9, 9)`` at every sample: many numbers, which are computed when they are asked for."""
        return self.covariance_at(self.time)

    def covariance_at(self, time: Array) -> Array:
        """Covariance ``(M, 9, 9)`` at `time` ``(M,)``, s: linear between the epochs."""
        k = np.clip(np.searchsorted(self.epochs, time, side="right") - 1, 0, len(self.epochs) - 2)
        step = self.epochs[k + 1] - self.epochs[k]
        share = np.divide(time - self.epochs[k], step, out=np.ones_like(time), where=step > 0.0)
        share = np.clip(share, 0.0, 1.0)[:, None, None]
        return np.asarray((1.0 - share) * self.epoch_covariance[k] + share * self.epoch_covariance[k + 1])


def smoothed_trajectory(problem: Problem, smoothed: Smoothed, layout: Layout) -> Trajectory:
    """Smoothed trajectory at every sample."""
    samples = problem.samples
    stops = [samples.index(t) for t in smoothed.time]
    nav = np.empty((len(samples.time) + 1, 10))
    nav[0] = smoothed.states[0].nav[:10]
    force, rate = np.empty_like(samples.force), np.empty_like(samples.rate)
    force_sigma = _with_fill(samples.force_noise, samples.force_fill_sigma)
    rate_sigma = _with_fill(samples.rate_noise, samples.rate_fill_sigma)
    for k in range(len(stops) - 1):
        start, stop = stops[k], stops[k + 1]
        if start == stop:
            continue
        state, target = smoothed.states[k], smoothed.states[k + 1]
        force_map, rate_map = sensor_maps(layout, state.errors[:, None])
        p, part = problem.planet, slice(start, stop)
        matrix = force_map[:9, 0].reshape(3, 3).T
        force[part] = samples.mean_force[part] @ matrix + force_map[9:, 0]
        rate[part] = samples.mean_rate[part] * rate_map[:3, 0] + rate_map[3:, 0]
        path = propagate_state(
            state.nav[:10],
            samples.interval[part],
            samples.force[part] @ matrix + force_map[9:, 0],
            samples.rate[part] * rate_map[:3, 0] + rate_map[3:, 0],
            p.mu,
            p.j2,
            p.gravity_radius,
        )
        motion_share = random_walk_share(samples.interval[part], force_sigma[part])
        attitude_share = random_walk_share(samples.interval[part], rate_sigma[part])
        nav[start + 1 : stop + 1] = distribute_correction(path, target, motion_share, attitude_share)
    time = np.concatenate(([smoothed.time[0]], samples.time))
    return Trajectory(
        time=time,
        position=nav[:, :3],
        velocity=nav[:, 3:6],
        inertial_from_body=nav[:, 6:],
        epochs=smoothed.time,
        epoch_covariance=inertial_covariance(smoothed),
        specific_force=np.concatenate((force[:1], force)),
        angular_rate=np.concatenate((rate[:1], rate)),
    )


def _with_fill(noise: Array, fill_sigma: Array) -> Array:
    """Root mean square over the axes (N,) of samples with `noise` (N, 3), to which filled ones add `fill_sigma`."""
    return np.asarray(np.sqrt(np.mean(noise**2 + fill_sigma**2, axis=1)))


def random_walk_share(interval: Array, noise: Array) -> Array:
    """Share of an interval's random walk variance that is reached at the end of each sample.

    Parameters
    ----------
    interval : (n,) array
        s.
    noise : (n,) array
        One sigma of each sample, m/s² or rad/s; all zero: the share of time instead.

    Returns
    -------
    (n,) array
        Ending at 1.
    """
    walk = np.cumsum((interval * noise) ** 2)
    return walk / walk[-1] if walk[-1] > 0.0 else np.cumsum(interval) / np.sum(interval)


def distribute_correction(path: Array, target: State, motion_share: Array, attitude_share: Array) -> Array:
    """Correct a propagated path so that its last row is `target`.

    Parameters
    ----------
    path : (n, 10) array
        Position (m), velocity (m/s), inertial_from_body.
    target : State
        Last state of the corrected path.
    motion_share, attitude_share : (n,) arrays
        Share of the correction of position and velocity, and of attitude, that each row takes.

    Returns
    -------
    (n, 10) array
    """
    correction = State(target.nav[:10], target.errors).minus(State(path[-1], target.errors))
    out = path.copy()
    out[:, :6] += motion_share[:, None] * correction[:6]
    # the correction of the attitude is a body vector at the end; along the path it is applied in inertial axes
    inertial = rotations.rotate(path[-1, 6:], attitude_share[:, None] * correction[6:9])
    out[:, 6:] = rotations.multiply(rotations.from_rotation_vector(inertial), path[:, 6:])
    return out


def inertial_covariance(smoothed: Smoothed) -> Array:
    """Covariance ``(K, 9, 9)`` of position (m), velocity (m/s) and inertial attitude error (rad) at the K epochs."""
    turn = np.tile(np.eye(9), (len(smoothed.time), 1, 1))
    turn[:, 6:, 6:] = rotations.to_matrix(np.array([s.nav[6:10] for s in smoothed.states]))
    return turn @ smoothed.covariance[:, :9, :9] @ np.swapaxes(turn, 1, 2)


@njit(cache=True, error_model="numpy", nogil=True)
def propagate_state(start, interval, force, rate, mu, j2, radius):
    """Propagate one state over samples and store every step.

    Parameters
    ----------
    start : (10,) array
        Position (m), velocity (m/s), inertial_from_body.
    interval, force, rate, mu, j2, radius
        As in `strapdown.propagate`.

    Returns
    -------
    (N, 10) array
        States at the ends of the samples.
    """
    x, y, z, vx, vy, vz, qx, qy, qz, qw = start
    j = 1.5 * j2 * radius * radius
    out = np.empty((interval.size, 10))
    for i in range(interval.size):
        fx, fy, fz = force[i, 0], force[i, 1], force[i, 2]
        wx, wy, wz = rate[i, 0], rate[i, 1], rate[i, 2]
        x, y, z, vx, vy, vz, qx, qy, qz, qw = step(
            x, y, z, vx, vy, vz, qx, qy, qz, qw, interval[i], fx, fy, fz, wx, wy, wz, mu, j
        )
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5] = x, y, z, vx, vy, vz
        out[i, 6], out[i, 7], out[i, 8], out[i, 9] = qx, qy, qz, qw
    return out
