"""The filter as one writes it with filterpy and numpy: `fx` and `hx` are Python and take one sigma point.

The mathematics is that of `edl_filter.navigation`, whose measurement models and process noise are used, so that the
estimates must agree.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from edl_filter.imu_model.sensor_errors import SENSOR_STATES
from edl_filter.navigation import initial
from edl_filter.navigation.filter import Problem, run_filter
from edl_filter.navigation.layout import ONBOARD, State
from edl_filter.navigation.noise import process_noise
from edl_filter.navigation.propagation import OnboardRotations


def product(p, q):
    """Hamilton product of two quaternions, scalar last."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return np.array(
        [
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ]
    )


def conjugate(q):
    """Inverse of a unit quaternion."""
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def exponential(phi):
    """Quaternion of a rotation vector."""
    angle = np.sqrt(phi @ phi)
    if angle < 1e-12:
        return np.append(0.5 * phi, 1.0)
    return np.append(np.sin(0.5 * angle) / angle * phi, np.cos(0.5 * angle))


def logarithm(q):
    """Rotation vector of a quaternion."""
    q = -q if q[3] < 0.0 else q
    s = np.sqrt(q[:3] @ q[:3])
    return 2.0 * q[:3] if s < 1e-12 else 2.0 * np.arctan2(s, q[3]) / s * q[:3]


def matrix(q):
    """Direction cosines of a quaternion."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def gravity(r, planet):
    """Point mass and J2 (thesis eq. 3.5)."""
    x, y, z = r
    r2 = x * x + y * y + z * z
    central = -planet.mu / (r2 * np.sqrt(r2))
    oblate = 1.5 * planet.j2 * planet.gravity_radius**2 / r2
    polar = 5.0 * z * z / r2
    lateral = central * (1.0 + oblate * (1.0 - polar))
    return np.array([lateral * x, lateral * y, central * (1.0 + oblate * (3.0 - polar)) * z])


def step(nav, dt, force, rate, planet):
    """One state ``(10,)`` over one sample of force and rate, body axes: drift, kick at mid-step, drift."""
    r, v, q = nav[:3], nav[3:6], nav[6:]
    half = exponential(0.5 * dt * rate)
    middle = product(q, half)
    q = product(middle, half)
    r = r + 0.5 * dt * v
    v = v + dt * (matrix(middle) @ force + gravity(r, planet))
    return np.concatenate((r + 0.5 * dt * v, v, q / np.sqrt(q @ q)))


class PlainFilter:
    """Error-state UKF on filterpy with callbacks in Python.

    Parameters
    ----------
    problem : Problem
        All constraints are fused, whatever its gate.
    """

    def __init__(self, problem: Problem):
        self.problem, self.layout, self.planet = problem, problem.layout, problem.planet
        self.unit = int(problem.samples.unit[0])
        self.reference, covariance = initial.initial_estimate(
            self.layout, problem.initial, problem.entry, problem.instruments[self.unit], problem.planet
        )
        s, n = problem.settings, self.layout.size
        points = MerweScaledSigmaPoints(n, s.alpha, s.beta, s.kappa)
        self.ukf = UnscentedKalmanFilter(n, 1, 0.0, self.hx, self.fx, points)
        self.ukf.x, self.ukf.P = np.zeros(n), covariance.copy()

    def full(self, x):
        """Navigation state and other states of one sigma point."""
        nav, errors = self.reference.nav.copy(), self.reference.errors.copy()
        nav[:6] += x[:6]
        nav[6:10] = product(nav[6:10], exponential(x[6:9]))
        errors[9:] += x[9:]
        if ONBOARD in self.layout:
            nav[10:] = product(nav[10:], exponential(x[-3:]))
            errors[-3:] = 0.0
        return nav, errors

    def propagated(self, nav, errors, samples):
        """Navigation state of one sigma point after the samples."""
        e = {n: errors[self.layout[n]] if n in self.layout else np.zeros(3) for n in SENSOR_STATES}
        undo = matrix(exponential(e["accelerometer_misalignment"])).T / (1.0 + e["accelerometer_scale"])
        scale, out = 1.0 / (1.0 + e["gyro_scale"]), nav[:10]
        for dt, f, w in zip(samples.interval, samples.force, samples.rate, strict=True):
            out = step(out, dt, undo @ (f - e["accelerometer_bias"]), scale * (w - e["gyro_bias"]), self.planet)
        if len(nav) == 10:
            return out
        jacobians = self.onboard.jacobians
        correction = sum((j[0] @ errors[self.layout[n]] for n, j in jacobians.items()), np.zeros(3))
        return np.concatenate((out, product(product(nav[10:], self.onboard.net[0]), exponential(correction))))

    def fx(self, x, dt, samples, centre):
        """Error of one sigma point about the propagated reference."""
        nav = self.propagated(*self.full(x), samples)
        out = x.copy()
        out[:6], out[6:9] = nav[:6] - centre[:6], logarithm(product(conjugate(centre[6:10]), nav[6:10]))
        if len(nav) == 14:
            out[-3:] = logarithm(product(conjugate(centre[10:]), nav[10:]))
        return out

    def hx(self, x, constraint):
        """Measurement of one sigma point."""
        nav, errors = self.full(x)
        return constraint.predict(nav[:, None], errors[:, None], self.layout)[0]

    def recentre(self):
        """Move the reference to the mean."""
        self.reference = State(*self.full(self.ukf.x))
        self.ukf.x = np.zeros_like(self.ukf.x)

    def predict(self, samples):
        """To the end of the samples."""
        self.onboard = OnboardRotations.over_all(self.layout, samples) if ONBOARD in self.layout else None
        self.ukf.Q = process_noise(self.layout, samples, self.reference.nav[6:10])
        centre = self.propagated(self.reference.nav, self.reference.errors, samples)
        self.ukf.predict(samples=samples, centre=centre)
        self.reference = State(centre, self.reference.errors)
        self.recentre()

    def update(self, constraint):
        """With one constraint."""
        self.ukf.sigmas_f = self.ukf.points_fn.sigma_points(self.ukf.x, self.ukf.P)
        self.ukf.update(constraint.measured, R=constraint.noise, constraint=constraint)
        self.recentre()

    def change_unit(self, unit):
        """Start the errors of another driving instrument from their prior."""
        keep, errors, added = np.ones(self.layout.size), self.reference.errors.copy(), np.zeros_like(self.ukf.P)
        sensor = self.layout.sensor
        keep[sensor], errors[sensor] = 0.0, 0.0
        added[sensor, sensor] = initial.sensor_prior(self.layout, self.problem.instruments[unit])
        if ONBOARD in self.layout:
            block = self.layout[ONBOARD]
            added[block, block] = self.problem.unit_change_sigma**2 * np.eye(3)
        for name, sigma in self.problem.entry.instrument_prior(self.layout).items():
            block = self.layout[name]
            keep[block], errors[block], added[block, block] = 0.0, 0.0, sigma**2 * np.eye(3)
        self.ukf.P = keep[:, None] * self.ukf.P * keep + added
        self.reference, self.unit = State(self.reference.nav, errors), unit

    def run(self):
        """Through all epochs: states and covariances after the updates, as `filter.run_filter` stores them."""
        estimates, done, samples = [], 0, self.problem.samples
        pending = list(self.problem.constraints)
        for epoch in self.problem.epochs:
            stop = samples.index(epoch)
            if stop > done:
                self.predict(samples.part(done, stop))
                done = stop
            while pending and pending[0].time <= epoch + 2e-6:
                self.update(pending.pop(0))
            estimates.append((self.reference, self.ukf.P.copy()))
            if done < len(samples.time) and samples.unit[done] != self.unit:
                self.change_unit(int(samples.unit[done]))
                estimates.append((self.reference, self.ukf.P.copy()))
        return estimates


def without_gate(problem: Problem) -> Problem:
    """The problem with all constraints accepted, so that both filters fuse the same ones."""
    return replace(problem, settings=replace(problem.settings, gate_probability=1.0))


def largest_difference(problem: Problem, estimates) -> float:
    """Largest difference of state, in sigmas, and of a sigma, relative, from the compiled filter's."""
    worst = 0.0
    for node, (state, covariance) in zip(run_filter(problem).nodes, estimates, strict=True):
        sigma = np.sqrt(np.diag(covariance))
        worst = max(worst, np.max(np.abs(node.state.minus(state)) / sigma))
        worst = max(worst, np.max(np.abs(np.sqrt(np.diag(node.covariance)) / sigma - 1.0)))
    return float(worst)
