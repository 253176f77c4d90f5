"""How fast the filter is, against filterpy with Python callbacks and against the extended filter, in the same run.

1. The same problem (the built-in flight: 8 Hz, 364 s, every sensor error a state) through our filter and through
   filterpy's own `UnscentedKalmanFilter` with callbacks in Python: `fx` steps one sigma point through the samples of
   an interval, `hx` predicts one sigma point's measurement. The mathematics is the same, so the answers must agree.
2. filterpy as its tutorials use it, one `predict` for each sample, on part of the flight and scaled up.
3. Nanoseconds a sigma point and sample in `strapdown.propagate`.
4. The whole reconstruction, stage by stage.

Run: ``python benchmarks/bench_filter.py``
"""

import gc
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from edl_filter.mission import Mission
from edl_filter.navigation import initial, strapdown
from edl_filter.navigation.filter import run_filter
from edl_filter.navigation.layout import State
from edl_filter.navigation.noise import process_noise
from edl_filter.pipeline.reconstruct import reconstruct

MISSIONS = Path(__file__).parent.parent / "missions"


def best(function, repeats):
    """Shortest time of several runs, s, and the last result."""
    times, result = [], None
    for _ in range(repeats):
        gc.collect()
        begin = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - begin)
    return min(times), result


# The filter as one writes it with filterpy and numpy


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


class Plain:
    """Error-state UKF on filterpy with callbacks in Python."""

    def __init__(self, problem):
        self.problem, self.layout, self.planet = problem, problem.layout, problem.planet
        state, covariance = initial.initial_estimate(
            self.layout, problem.initial, problem.entry, problem.instruments[0], problem.planet
        )
        self.reference, s, n = state, problem.settings, self.layout.size
        points = MerweScaledSigmaPoints(n, s.alpha, s.beta, s.kappa)
        self.ukf = UnscentedKalmanFilter(n, 1, 0.0, self.hx, self.fx, points)
        self.ukf.x, self.ukf.P = np.zeros(n), covariance.copy()

    def full(self, x):
        """Navigation state and other states of one sigma point."""
        nav = self.reference.nav.copy()
        nav[:6] += x[:6]
        nav[6:] = product(nav[6:], exponential(x[6:9]))
        errors = self.reference.errors.copy()
        errors[9:] += x[9:]
        return nav, errors

    def step(self, nav, errors, samples):
        """One state through the samples."""
        e = {name: errors[where] for name, where in self.layout.slices.items()}
        undo = matrix(exponential(e["accelerometer_misalignment"])).T / (1.0 + e["accelerometer_scale"])
        r, v, q = nav[:3], nav[3:6], nav[6:]
        scale = 1.0 / (1.0 + e["gyro_scale"])
        for dt, f, w in zip(samples.interval, samples.force, samples.rate, strict=True):
            half = exponential(0.5 * dt * scale * (w - e["gyro_bias"]))
            middle = product(q, half)
            q = product(middle, half)
            r = r + 0.5 * dt * v
            v = v + dt * (matrix(middle) @ (undo @ (f - e["accelerometer_bias"])) + gravity(r, self.planet))
            r = r + 0.5 * dt * v
        return np.concatenate((r, v, q / np.sqrt(q @ q)))

    def fx(self, x, dt, samples, centre):
        """Error of one sigma point about the propagated reference."""
        nav = self.step(*self.full(x), samples)
        turn = product(centre[6:] * [-1.0, -1.0, -1.0, 1.0], nav[6:])
        return np.concatenate((nav[:6] - centre[:6], logarithm(turn), x[9:]))

    def hx(self, x, constraint):
        """Measurement of one sigma point."""
        nav, errors = self.full(x)
        return constraint.predict(nav[:, None], errors[:, None], self.layout)[0]

    def recentre(self):
        """Let the reference take the mean over."""
        self.reference = State(*self.full(self.ukf.x))
        self.ukf.x = np.zeros_like(self.ukf.x)

    def predict(self, samples):
        """To the end of the samples."""
        self.ukf.Q = process_noise(self.layout, samples, self.reference.nav[6:])
        centre = self.step(self.reference.nav, self.reference.errors, samples)
        self.ukf.predict(samples=samples, centre=centre)
        self.reference = State(centre, self.reference.errors)
        self.recentre()

    def update(self, constraint):
        """With one constraint."""
        self.ukf.sigmas_f = self.ukf.points_fn.sigma_points(self.ukf.x, self.ukf.P)
        self.ukf.update(constraint.measured, R=constraint.noise, constraint=constraint)
        self.recentre()

    def run(self):
        """Through all epochs: states and covariances."""
        estimates, done = [], 0
        pending = list(self.problem.constraints)
        for epoch in self.problem.epochs:
            stop = self.problem.samples.index(epoch)
            if stop > done:
                self.predict(self.problem.samples.part(done, stop))
                done = stop
            while pending and pending[0].time <= epoch + 2e-6:
                self.update(pending.pop(0))
            estimates.append((self.reference, self.ukf.P.copy()))
        return estimates


# The measurements


def compare(problem, label):
    """Ours against `Plain` on one problem: times, ratio, largest difference in sigmas."""
    run_filter(problem)  # compiled, caches warm
    ours, filter_pass = best(lambda: run_filter(problem), 5)
    theirs, estimates = best(lambda: Plain(problem).run(), 1)
    worst = 0.0
    for node, (state, covariance) in zip(filter_pass.nodes, estimates, strict=True):
        sigma = np.sqrt(np.diag(covariance))
        worst = max(worst, np.max(np.abs(node.state.minus(state)) / sigma))
        worst = max(worst, np.max(np.abs(np.sqrt(np.diag(node.covariance)) / sigma - 1.0)))
    count = 2 * problem.layout.size + 1
    print(f"{label}: {len(problem.samples.time)} samples, {count} sigma points, {len(problem.epochs)} epochs,")
    print(f"    {len(problem.constraints)} updates")
    extended = replace(problem, settings=replace(problem.settings, method="ekf"))
    run_filter(extended)
    fast, _ = best(lambda: run_filter(extended), 5)
    print(f"    ours                                   {ours:9.3f} s")
    print(f"    ours, extended instead of unscented    {fast:9.3f} s   {fast / ours:6.2f} times ours")
    print(f"    filterpy, fx over an interval's samples{theirs:9.3f} s   {theirs / ours:6.0f} times ours")
    print(f"    largest difference                     {worst:9.1e} sigma (goal 1e-6)")
    return ours


def per_sample(problem, ours, count=200):
    """filterpy with one `predict` a sample, on the first `count` samples, scaled to all."""
    plain = Plain(problem)
    begin = time.perf_counter()
    for i in range(count):
        plain.predict(problem.samples.part(i, i + 1))
    spent = (time.perf_counter() - begin) / count * len(problem.samples.time)
    print(f"    filterpy, one predict a sample         {spent:9.3f} s   {spent / ours:6.0f} times ours")
    print(f"        (scaled from {count} samples, without updates)")


def kernel(columns=64, samples=7000):
    """Nanoseconds a sigma point and sample."""
    rng = np.random.default_rng(0)
    state = np.zeros((10, columns))
    state[0], state[4], state[9] = 3.5e6, 3000.0, 1.0
    force_map, rate_map = np.zeros((12, columns)), np.zeros((6, columns))
    force_map[[0, 4, 8]], rate_map[:3] = 1.0, 1.0
    interval = np.full(samples, 0.125)
    force, rate = 10.0 * rng.standard_normal((samples, 3)), 0.2 * rng.standard_normal((samples, 3))

    def run():
        strapdown.propagate(state.copy(), force_map, rate_map, interval, force, rate, 4.28e13, 1.96e-3, 3.396e6)

    run()
    spent, _ = best(run, 20)
    print(
        f"strapdown.propagate, {columns} sigma points, {samples} samples: "
        f"{1e9 * spent / columns / samples:.2f} ns a point and sample (goal 5)"
    )


def stages(name):
    """Time of each stage of a mission's reconstruction, first and best of five."""
    mission = Mission.load(MISSIONS / f"{name}.yaml")
    first = reconstruct(mission).timing
    runs = [reconstruct(mission).timing for _ in range(5)]
    timing = min(runs, key=lambda t: sum(t.values()))
    print(f"{name}: {sum(timing.values()):.3f} s (the first in this process {sum(first.values()):.3f} s)")
    print("    " + ", ".join(f"{stage} {spent:.3f}" for stage, spent in timing.items()))


def main():
    problem = reconstruct(Mission.load(MISSIONS / "practice_mer.yaml")).problem
    # nothing gated out, so that both meet the same constraints
    problem = replace(problem, settings=replace(problem.settings, gate_probability=1.0))
    few = replace(problem, constraints=tuple(c for c in problem.constraints if c.name != "altimeter"))
    times = np.array([c.time for c in few.constraints])
    start, end = problem.epochs[[0, -1]]
    regular = few.samples.time[[few.samples.index(t) - 1 for t in np.arange(start + 5.0, end, 5.0)]]
    edges = np.concatenate(([start], times, regular, [end]))
    edges = np.unique(np.round(edges, 6))
    sparse = replace(few, epochs=edges[np.append(True, np.diff(edges) > 1e-3)])
    ours = compare(sparse, "Built-in flight, an epoch every 5 s, no altimeter")
    per_sample(sparse, ours)
    compare(problem, "Built-in flight, every altimeter reading fused")
    kernel()
    stages("practice_mer")
    stages("mer_a")


if __name__ == "__main__":
    main()
