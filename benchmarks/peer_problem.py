"""A navigation problem that every filter can state: fifteen states, one IMU sample and one position for each epoch.

The vector is the error about a fixed reference trajectory: position (m), velocity (m/s), attitude as a rotation vector
in body axes (rad), accelerometer and gyro bias (m/s², rad/s). `transition` moves it over one sample and works on numpy
and on jax arrays, one state or one per column. The package's filter moves its reference to the estimate at each step,
which is the same to second order in the attitude error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import strapdown
from edl_filter.navigation.compiled_ukf import CompiledUKF
from edl_filter.navigation.estimator import ErrorStateFilter
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import Layout, State
from edl_filter.navigation.noise import process_noise
from edl_filter.planet import Planet
from edl_filter.types import Array

MARS = Planet("mars", 4.282837e13, 1.960454e-3, 3396190.0, 3396190.0, 5.886e-3, 7.088218e-5, 0.0)
ALPHA, BETA, KAPPA = 0.5, 2.0, 0.0
LAYOUT = Layout.of((SensorErrors(accelerometer_bias=1.0, gyro_bias=1.0),), {})
SIGMAS = np.repeat([100.0, 1.0, 1e-3, 0.02, 1e-4], 3)
FIX_SIGMA = 20.0


@dataclass(frozen=True)
class PositionFix:
    """Inertial position at one time."""

    name: ClassVar[str] = "position"
    components: ClassVar[tuple[str, ...]] = ("x (m)", "y (m)", "z (m)")
    time: float
    measured: Array
    noise: Array
    source: str = "benchmark"

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Position of each state."""
        return np.ascontiguousarray(nav[:3].T)


@dataclass(frozen=True)
class PeerProblem:
    """The problem.

    Attributes
    ----------
    samples : Samples
        One for each epoch after the first.
    reference : (T, 10) array
        Reference states at the epochs, without sensor errors.
    fixes : tuple of PositionFix
        One for each epoch.
    process_noise : (T, 15, 15) array
        Of the sample before each epoch; the first is not used.
    """

    samples: Samples
    reference: Array
    fixes: tuple[PositionFix, ...]
    process_noise: Array

    @property
    def innovations(self) -> Array:
        """Measured minus reference positions, ``(T, 3)``."""
        return np.array([f.measured for f in self.fixes]) - self.reference[:, :3]

    @property
    def inputs(self) -> Array:
        """What `transition` takes for the sample before each epoch, ``(T, 27)``; the first is not used."""
        s, before, after = self.samples, self.reference[:-1], self.reference[1:]
        rows = np.concatenate((s.interval[:, None], s.force, s.rate, before, after), axis=1)
        return np.concatenate((np.zeros((1, rows.shape[1])), rows))


def problem(epochs: int, seed: int = 0) -> PeerProblem:
    """Entry of a braking, turning vehicle with errors of about one sigma."""
    rng = np.random.default_rng(seed)
    n = epochs - 1
    interval = np.full(n, 0.125)
    time = np.cumsum(interval)
    force = np.stack([-25.0 - 5.0 * np.sin(0.1 * time), np.cos(0.3 * time), -3.0 + 0.0 * time], axis=1)
    rate = np.stack([0.2 + 0.0 * time, 0.05 * np.sin(0.7 * time), 0.05 * np.cos(0.7 * time)], axis=1)
    full = np.ones(n)
    samples = Samples(
        time=time, interval=interval, force=force, rate=rate, mean_force=force, mean_rate=rate, force_noise=0.02 * full,
        rate_noise=1e-4 * full, shared_rate_noise=0.0 * full, coning_corrected=np.zeros(n, bool), unit=np.zeros(n, int),
    )  # fmt: skip
    start = np.array([3.39e6, 2e5, -3e5, -200.0, 4900.0, 300.0, 0.1, -0.3, 0.4, 0.5])
    start[6:] /= np.linalg.norm(start[6:])
    reference = _path(start, samples, np.zeros(3), np.zeros(3))
    error = SIGMAS * rng.standard_normal(15)
    true_start = start.copy()
    true_start[:6] += error[:6]
    true_start[6:] = rotations.multiply(start[6:], rotations.from_rotation_vector(error[6:9]))
    truth = _path(true_start, samples, error[9:12], error[12:])
    noise = FIX_SIGMA**2 * np.eye(3)
    times = np.concatenate(([0.0], time))
    fixes = tuple(
        PositionFix(float(t), p + FIX_SIGMA * rng.standard_normal(3), noise)
        for t, p in zip(times, truth[:, :3], strict=True)
    )
    q = [process_noise(LAYOUT, samples.part(i, i + 1), reference[i, 6:]) for i in range(n)]
    return PeerProblem(samples, reference, fixes, np.array([np.zeros((15, 15)), *q]))


def _path(start: Array, samples: Samples, force_bias: Array, rate_bias: Array) -> Array:
    """States at all epochs of a vehicle whose sensors have biases."""
    columns, states = strapdown.LANES, [start]
    force_map, rate_map = np.zeros((12, columns)), np.zeros((6, columns))
    force_map[[0, 4, 8]], rate_map[:3] = 1.0, 1.0
    force_map[9:], rate_map[3:] = -force_bias[:, None], -rate_bias[:, None]
    state = np.repeat(start[:, None], columns, axis=1)
    for i in range(len(samples.time)):
        sample = samples.part(i, i + 1)
        strapdown.propagate(
            state,
            force_map,
            rate_map,
            sample.interval,
            sample.force,
            sample.rate,
            MARS.mu,
            MARS.j2,
            MARS.gravity_radius,
        )
        states.append(state[:, 0].copy())
    return np.array(states)


def ours(given: PeerProblem, filter_class: type = CompiledUKF) -> tuple[Array, Array]:
    """Filtered errors about the reference ``(T, 15)`` and their sigmas, by a filter of the package."""
    start = State(given.reference[0], np.zeros(15))
    estimator: ErrorStateFilter = filter_class(LAYOUT, start, np.diag(SIGMAS**2), MARS, ALPHA, BETA, KAPPA)
    states, sigmas = [], []
    for k, fix in enumerate(given.fixes):
        if k:
            estimator.predict(given.samples.part(k - 1, k))
        estimator.update(fix, estimator.innovation(fix))
        states.append(estimator.state)
        sigmas.append(estimator.covariance)
    references = [State(r, np.zeros(15)) for r in given.reference]
    means = np.array([s.minus(r) for s, r in zip(states, references, strict=True)])
    return means, np.sqrt(np.diagonal(np.array(sigmas), axis1=1, axis2=2))


def transition(xp: Any, x: Any, u: Any) -> Any:
    """Error after one sample.

    Parameters
    ----------
    xp : module
        numpy or jax.numpy.
    x : (15,) or (15, S) array
        Error before the sample.
    u : (27,) array
        Row of `PeerProblem.inputs`.
    """
    dt, force, rate, before, after = u[0], u[1:4], u[4:7], u[7:17], u[17:27]
    q = _product(before[6:], _exponential(xp, x[6], x[7], x[8]))
    f = [force[k] - x[9 + k] for k in range(3)]
    half = _exponential(xp, *[0.5 * dt * (rate[k] - x[12 + k]) for k in range(3)])
    middle = _product(q, half)
    end = _product(middle, half)
    r = [before[k] + x[k] + 0.5 * dt * (before[3 + k] + x[3 + k]) for k in range(3)]
    turned, down = _rotated(middle, f), _gravity(xp, *r)
    v = [before[3 + k] + x[3 + k] + dt * (turned[k] + down[k]) for k in range(3)]
    r = [r[k] + 0.5 * dt * v[k] for k in range(3)]
    error = _logarithm(xp, _product([-after[6], -after[7], -after[8], after[9]], end))
    changed = [r[k] - after[k] for k in range(3)] + [v[k] - after[3 + k] for k in range(3)] + list(error)
    return xp.concatenate((xp.stack(changed), x[9:]))


def _product(p: Any, q: Any) -> list[Any]:
    return [
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    ]


def _exponential(xp: Any, x: Any, y: Any, z: Any) -> list[Any]:
    half = 0.5 * xp.sqrt(x * x + y * y + z * z + 1e-30)
    factor = 0.5 * xp.sin(half) / half
    return [factor * x, factor * y, factor * z, xp.cos(half)]


def _logarithm(xp: Any, q: Any) -> list[Any]:
    s = xp.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + 1e-30)
    factor = 2.0 * xp.arctan2(s, q[3]) / s
    return [factor * q[0], factor * q[1], factor * q[2]]


def _rotated(q: Any, f: Any) -> list[Any]:
    x, y, z, w = q
    tx, ty, tz = 2.0 * (y * f[2] - z * f[1]), 2.0 * (z * f[0] - x * f[2]), 2.0 * (x * f[1] - y * f[0])
    return [
        f[0] + w * tx + y * tz - z * ty,
        f[1] + w * ty + z * tx - x * tz,
        f[2] + w * tz + x * ty - y * tx,
    ]


def _gravity(xp: Any, x: Any, y: Any, z: Any) -> list[Any]:
    r2 = 1.0 / (x * x + y * y + z * z)
    a = -MARS.mu * r2 * xp.sqrt(r2)
    h, d = 1.5 * MARS.j2 * MARS.gravity_radius**2 * r2, 5.0 * z * z * r2
    return [a * x * (1.0 + h * (1.0 - d)), a * y * (1.0 + h * (1.0 - d)), a * z * (1.0 + h * (3.0 - d))]
