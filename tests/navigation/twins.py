"""Slow, readable twins of the navigation code, and the small problems that its tests share.

No function calls the code that it checks: `rotations` and `planet` have tests of their own.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from geodetic import fixed_position
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SENSOR_STATES, SensorErrors
from edl_filter.navigation.constraints import Altimeter, LandingSite, RestGravity, RestVelocity, ZeroSpecificForce
from edl_filter.navigation.filter import Problem, Settings, build_problem
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.layout import Layout, State
from edl_filter.planet import Planet
from edl_filter.planet.gravity import gravity_vector
from edl_filter.telemetry.record import ImuRecord, InitialState

MARS = Planet(
    name="mars",
    mu=4.282837e13,
    j2=1.960454e-3,
    gravity_radius=3396190.0,
    equatorial_radius=3396190.0,
    flattening=1.0 / 169.894447,
    rotation_rate=7.088218e-5,
    prime_meridian_at_epoch=0.9,
)
#: No gravity and no rotation: with it navigation without attitude error is linear. Sigmas are small beside its radius.
VOID = Planet("void", 0.0, 0.0, 1.0, 1e6, 0.0, 0.0, 0.0)


# Strapdown


def propagate(state, force_map, rate_map, interval, force, rate, mu, j2, radius):
    """One state ``(10,)`` over all samples, step by step: drift, kick at mid-step, drift."""
    r, v, q = state[:3].copy(), state[3:6].copy(), state[6:].copy()
    matrix, offset = force_map[:9].reshape(3, 3), force_map[9:]
    for dt, f, w in zip(interval, force, rate, strict=True):
        turn = dt * (rate_map[:3] * w + rate_map[3:])
        middle = rotations.multiply(q, rotations.from_rotation_vector(0.5 * turn))
        q = rotations.normalise(rotations.multiply(q, rotations.from_rotation_vector(turn)))
        r = r + 0.5 * dt * v
        v = v + dt * (rotations.rotate(middle, matrix @ f + offset) + gravity_vector(r, mu, j2, radius))
        r = r + 0.5 * dt * v
    return np.concatenate((r, v, q))


def integrate(state, force, rate, times, planet):
    """True motion ``(K, 10)`` at `times` under body force(t) and rate(t), by DOP853 (Hairer et al. 1993)."""

    def derivative(t, y):
        w = np.append(rate(t), 0.0)
        acceleration = rotations.rotate(y[6:], force(t))
        if planet.mu:
            acceleration = acceleration + planet.gravity(y[:3])
        return np.concatenate((y[3:6], acceleration, 0.5 * rotations.multiply(y[6:], w)))

    span = times[0], times[-1]
    solution = solve_ivp(derivative, span, state, "DOP853", times, rtol=1e-12, atol=1e-12, max_step=0.1)
    return solution.y.T


def no_maps(columns):
    """Maps of sensors without errors."""
    force_map, rate_map = np.zeros((12, columns)), np.zeros((6, columns))
    force_map[[0, 4, 8]] = 1.0
    rate_map[:3] = 1.0
    return force_map, rate_map


def attitude_error(q, attitudes):
    """Angles between attitudes, rad."""
    return np.linalg.norm(rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(q), attitudes)), axis=-1)


@dataclass(frozen=True)
class Waves:
    """Smooth vector functions of time, sums of sines, whose means over intervals are known exactly.

    ``value[..., i] = constant[..., i] + sum_k amplitude[..., i, k] sin(frequency[..., i, k] t + phase[..., i, k])``.
    """

    constant: np.ndarray
    amplitude: np.ndarray
    frequency: np.ndarray
    phase: np.ndarray

    @classmethod
    def draw(cls, rng, shape, constant, amplitude, fastest, count=3):
        """Random ones: `constant` and `amplitude` one sigma of each component, angular frequencies up to `fastest`."""
        shape = (*shape, 3)
        return cls(
            np.broadcast_to(constant, shape) * rng.standard_normal(shape),
            np.broadcast_to(np.asarray(amplitude)[..., None], (*shape, count)) * rng.standard_normal((*shape, count)),
            fastest * rng.uniform(0.2, 1.0, (*shape, count)),
            rng.uniform(0.0, 2.0 * np.pi, (*shape, count)),
        )

    def __call__(self, t):
        return self.constant + np.sum(self.amplitude * np.sin(self.frequency * t + self.phase), axis=-1)

    def mean(self, start, end):
        """Exact mean from `start` to `end`."""
        a, b = self.frequency * start + self.phase, self.frequency * end + self.phase
        return self.constant + np.sum(self.amplitude * (np.cos(a) - np.cos(b)) / (b - a), axis=-1)

    def means(self, edges):
        """Means between all neighbouring `edges`, time first."""
        return np.array([self.mean(a, b) for a, b in pairwise(edges)])


# Records and samples


def record(
    edges,
    force,
    rate,
    *,
    position=None,
    force_noise=0.0,
    rate_noise=0.0,
    shared=None,
    unit=None,
    errors=None,
    coning_corrected=False,
    sculling_corrected=False,
):
    """An `ImuRecord` with sample edges `edges` (N + 1)."""
    n = len(edges) - 1
    unit = np.zeros(n, int) if unit is None else unit
    units = tuple(f"unit {i}" for i in range(unit.max() + 1))
    full = np.ones(n)
    return ImuRecord(
        name="test",
        time=np.asarray(edges[1:], float),
        interval=np.diff(edges),
        specific_force=force,
        angular_rate=rate,
        position=np.zeros((n, 3)) if position is None else np.broadcast_to(position, (n, 3)),
        force_noise=force_noise * full,
        rate_noise=rate_noise * full,
        shared_rate_noise=(rate_noise if shared is None else shared) * full,
        coning_corrected=np.full(n, coning_corrected),
        sculling_corrected=np.full(n, sculling_corrected),
        unit=unit,
        units=units,
        source=np.zeros(n, int),
        sources=("test",),
        errors=errors or tuple(SensorErrors() for _ in units),
    )


def along_axes(sigma, count):
    """``(N, 3)`` of one sigma, of one for each sample or of one for each axis of each sample."""
    sigma = np.asarray(sigma, float)
    return np.broadcast_to(sigma[:, None] if sigma.ndim == 1 else sigma, (count, 3)).copy()


def samples(interval, force, rate, force_noise=0.0, rate_noise=0.0, shared=0.0, unit=None, start=0.0):
    """`Samples` without any correction."""
    n = len(interval)
    return Samples(
        time=start + np.cumsum(interval),
        interval=np.asarray(interval, float),
        force=force,
        rate=rate,
        mean_force=force,
        mean_rate=rate,
        force_noise=along_axes(force_noise, n),
        rate_noise=along_axes(rate_noise, n),
        shared_rate_noise=along_axes(shared, n),
        coning_corrected=np.zeros(n, bool),
        unit=np.zeros(n, int) if unit is None else unit,
    )


# Process noise


def process_noise(samples, attitude):
    """Covariance ``(9, 9)`` of position, velocity and body attitude error, step by step forwards.

    The error ``(δr, δv, ψ)`` in inertial axes obeys ``δr' = δv, δv' = ψ × f``; a sample's noise enters as one
    impulse at its middle.
    """
    cov, q = np.zeros((9, 9)), attitude
    for dt, f, w, sigma_f, sigma_w in zip(
        samples.interval, samples.force, samples.rate, samples.force_noise, samples.rate_noise, strict=True
    ):
        half = 0.5 * dt
        middle = rotations.multiply(q, rotations.from_rotation_vector(half * w))
        axes = rotations.to_matrix(middle)
        cross = -rotations.cross_matrix(axes @ f)
        step = np.eye(9)
        step[:3, 3:6] = half * np.eye(3)
        step[:3, 6:] = 0.5 * half**2 * cross
        step[3:6, 6:] = half * cross
        cov = step @ cov @ step.T
        cov[3:6, 3:6] += axes @ np.diag((sigma_f * dt) ** 2) @ axes.T
        cov[6:, 6:] += axes @ np.diag((sigma_w * dt) ** 2) @ axes.T
        cov = step @ cov @ step.T
        q = rotations.multiply(q, rotations.from_rotation_vector(dt * w))
    to_body = np.eye(9)
    to_body[6:, 6:] = rotations.to_matrix(q).T
    return to_body @ cov @ to_body.T


# Textbook filters


@dataclass(frozen=True)
class Step:
    """One epoch of a linear problem: ``x = F x⁻ + u + noise(Q)``, then ``z = H x + noise(R)``."""

    transition: np.ndarray
    drive: np.ndarray
    noise: np.ndarray
    matrix: np.ndarray
    measured: np.ndarray
    measured_noise: np.ndarray


def kalman(mean, covariance, steps):
    """Kalman filter (Kalman 1960): lists of filtered means and covariances, and NIS; the start included."""
    means, covariances, nis = [mean], [covariance], []
    for s in steps:
        x = s.transition @ means[-1] + s.drive
        p = s.transition @ covariances[-1] @ s.transition.T + s.noise
        total = s.matrix @ p @ s.matrix.T + s.measured_noise
        gain = p @ s.matrix.T @ np.linalg.inv(total)
        residual = s.measured - s.matrix @ x
        nis.append(float(residual @ np.linalg.solve(total, residual)))
        means.append(x + gain @ residual)
        reduction = np.eye(len(x)) - gain @ s.matrix
        covariances.append(reduction @ p @ reduction.T + gain @ s.measured_noise @ gain.T)  # Joseph's form
    return means, covariances, nis


def rauch_tung_striebel(means, covariances, steps):
    """Smoother of Rauch, Tung and Striebel (1965) over the results of `kalman`."""
    means, covariances = list(means), list(covariances)
    for k in range(len(steps) - 1, -1, -1):
        s = steps[k]
        x = s.transition @ means[k] + s.drive
        p = s.transition @ covariances[k] @ s.transition.T + s.noise
        gain = np.linalg.solve(p, s.transition @ covariances[k]).T
        means[k] = means[k] + gain @ (means[k + 1] - x)
        covariances[k] = covariances[k] + gain @ (covariances[k + 1] - p) @ gain.T
    return means, covariances


def least_squares(mean, covariance, steps):
    """All states of a linear problem at once by weighted least squares: means and covariances.

    Unknowns are the first state and every step's noise, so that a singular Q is no obstacle.
    """
    n, count = len(mean), len(steps)
    size = n * (count + 1)
    prior = np.zeros((size, size))
    prior[:n, :n] = covariance
    maps, means = [np.eye(n, size)], [mean]
    for k, s in enumerate(steps):
        block = slice(n * (k + 1), n * (k + 2))
        prior[block, block] = s.noise
        matrix = s.transition @ maps[-1]
        matrix[:, block] += np.eye(n)
        maps.append(matrix)
        means.append(s.transition @ means[-1] + s.drive)
    design = np.concatenate([s.matrix @ m for s, m in zip(steps, maps[1:], strict=True)])
    residual = np.concatenate([s.measured - s.matrix @ x for s, x in zip(steps, means[1:], strict=True)])
    rows = np.cumsum([0] + [len(s.measured) for s in steps])
    noise = np.zeros((rows[-1], rows[-1]))
    for s, a, b in zip(steps, rows[:-1], rows[1:], strict=True):
        noise[a:b, a:b] = s.measured_noise
    gain = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + noise)
    unknown, spread = gain @ residual, prior - gain @ design @ prior
    return [x + m @ unknown for x, m in zip(means, maps, strict=True)], [m @ spread @ m.T for m in maps]


@dataclass(frozen=True)
class LinearTwin:
    """A linear problem in position, velocity and accelerometer bias, as the filter and as a textbook see it."""

    problem: Problem
    mean: np.ndarray
    covariance: np.ndarray
    steps: list


def random_covariance(rng, sigmas):
    """A covariance with the given sigmas and random correlations."""
    a = rng.standard_normal((len(sigmas), 3 * len(sigmas)))
    c = a @ a.T
    d = np.asarray(sigmas) / np.sqrt(np.diag(c))
    return c * np.outer(d, d)


def linear(seed=0, settings=None):
    """Twelve seconds in empty space with a known attitude; positions, velocities and the bias are measured."""
    rng = np.random.default_rng(seed)
    q = rotations.normalise(rng.standard_normal(4))
    turn = rotations.to_matrix(q)
    covariance = np.zeros((9, 9))
    covariance[:6, :6] = random_covariance(rng, [10.0, 20.0, 15.0, 1.0, 2.0, 0.5])
    covariance[6:, 6:] = 1e-22 * np.eye(3)  # next to nothing: filterpy's roots need more than zero
    mean = np.concatenate((100.0 + 20.0 * rng.standard_normal(3), 10.0 * rng.standard_normal(3), np.zeros(3)))
    initial = InitialState(0.0, mean[:3], mean[3:6], q, covariance)
    n = 96
    drive = samples(
        np.full(n, 0.125), 5.0 * rng.standard_normal((n, 3)), np.zeros((n, 3)), force_noise=rng.uniform(0.2, 1.0, n)
    )
    position, bias = random_covariance(rng, [3.0, 5.0, 4.0]), np.array([0.2, 0.3, 0.1])
    constraints = [
        LandingSite(4.0, mean[:3] + 10.0 * rng.standard_normal(3), position, VOID),
        RestVelocity(4.0, 0.7, VOID),
        ZeroSpecificForce(6.03, 0.3 * rng.standard_normal(3), bias),
        LandingSite(9.5, mean[:3] + 10.0 * rng.standard_normal(3), position, VOID),
        RestVelocity(12.0, 0.4, VOID),
    ]
    settings = settings or Settings(longest_interval=1.5, gate_probability=1.0)
    errors = (SensorErrors(accelerometer_bias=0.5),)
    problem = build_problem(drive, initial, EntryErrors(), errors, constraints, VOID, settings)
    full = np.zeros((9, 9))
    full[:6, :6], full[6:, 6:] = covariance[:6, :6], 0.25 * np.eye(3)
    return LinearTwin(problem, mean, full, [_linear_step(problem, turn, k) for k in range(1, len(problem.epochs))])


def _linear_step(problem, turn, k):
    """From epoch k - 1 to epoch k of `linear`."""
    s = problem.samples
    inside = (s.time > problem.epochs[k - 1] + 1e-6) & (s.time < problem.epochs[k] + 1e-6)
    transition, drive, noise = np.eye(9), np.zeros(9), np.zeros((9, 9))
    for dt, f, sigma in zip(s.interval[inside], s.force[inside], s.force_noise[inside], strict=True):
        step, gain = np.eye(9), np.zeros((9, 3))
        gain[:3], gain[3:6] = 0.5 * dt**2 * turn, dt * turn  # of a force over the sample
        step[:3, 3:6] = dt * np.eye(3)
        step[:, 6:] -= gain
        transition, drive = step @ transition, step @ drive + gain @ f
        noise = step @ noise @ step.T + gain * sigma**2 @ gain.T
    constraints = [c for c in problem.constraints if abs(c.time - problem.epochs[k]) < 1e-5]
    rows = {"landing": slice(0, 3), "rest_velocity": slice(3, 6), "pre_entry_zero_force": slice(6, 9)}
    return Step(
        transition,
        drive,
        noise,
        np.concatenate([np.eye(9)[rows[c.name]] for c in constraints]) if constraints else np.empty((0, 9)),
        np.concatenate([c.measured for c in constraints]) if constraints else np.empty(0),
        block_diag(*(c.noise for c in constraints)) if constraints else np.empty((0, 0)),
    )


def linear_vector(state):
    """A filter's state as the vector of `linear`."""
    return np.concatenate((state.nav[:6], state.errors[9:12]))


def linear_block(covariance):
    """A filter's covariance in the order of `linear`."""
    keep = np.r_[0:6, 9:12]
    return covariance[np.ix_(keep, keep)]


# filterpy with Python callbacks


def full_state(reference, x):
    """Navigation state of the reference moved by the error `x`, and the other states."""
    nav = reference.nav.copy()
    nav[:6] += x[:6]
    nav[6:] = rotations.multiply(nav[6:], rotations.from_rotation_vector(x[6:9]))
    errors = reference.errors.copy()
    errors[9:] += x[9:]
    return nav, errors


def undo_errors(layout, errors):
    """Force and rate maps of one set of sensor errors, from the definition."""
    e = {n: errors[layout[n]] if n in layout else np.zeros(3) for n in SENSOR_STATES}
    turn = rotations.to_matrix(rotations.from_rotation_vector(e["accelerometer_misalignment"]))
    matrix = turn.T @ np.diag(1.0 / (1.0 + e["accelerometer_scale"]))
    rate = 1.0 / (1.0 + e["gyro_scale"])
    force_map = np.concatenate((matrix.ravel(), -matrix @ e["accelerometer_bias"]))
    return force_map, np.concatenate((rate, -rate * e["gyro_bias"]))


def plain_filter(problem, start, covariance):
    """filterpy's own `UnscentedKalmanFilter` with Python callbacks: states, covariances and NIS at each epoch.

    The vector is the error about a reference that is moved to the mean after every step.
    """
    layout, planet, s = problem.layout, problem.planet, problem.settings
    n, reference, nis = layout.size, start, []

    def advanced(nav, errors, part):
        force_map, rate_map = undo_errors(layout, errors)
        return propagate(
            nav, force_map, rate_map, part.interval, part.force, part.rate, planet.mu, planet.j2, planet.gravity_radius
        )

    def fx(x, dt, part, centre):
        nav, errors = full_state(reference, x)
        nav = advanced(nav, errors, part)
        turn = rotations.multiply(rotations.conjugate(centre[6:]), nav[6:])
        return np.concatenate((nav[:6] - centre[:6], rotations.to_rotation_vector(turn), x[9:]))

    def hx(x, constraint):
        nav, errors = full_state(reference, x)
        return constraint.predict(nav[:, None], errors[:, None], layout)[0]

    ukf = UnscentedKalmanFilter(n, 1, 0.0, hx, fx, MerweScaledSigmaPoints(n, s.alpha, s.beta, s.kappa))
    ukf.x, ukf.P = np.zeros(n), covariance.copy()
    nodes, done = [], 0
    for epoch in problem.epochs:
        stop = int(np.sum(problem.samples.time < epoch + 1e-6))
        if stop > done:
            part = problem.samples.part(done, stop)
            centre = advanced(reference.nav, reference.errors, part)
            ukf.Q = np.zeros((n, n))
            ukf.Q[:9, :9] = process_noise(part, reference.nav[6:])
            ukf.predict(part=part, centre=centre)
            reference = State(*full_state(State(centre, reference.errors), ukf.x))
            ukf.x, done = np.zeros(n), stop
        for c in problem.constraints:
            if abs(c.time - epoch) < 1e-5:
                ukf.sigmas_f = ukf.points_fn.sigma_points(ukf.x, ukf.P)
                ukf.update(c.measured, R=c.noise, hx=hx, constraint=c)
                nis.append(float(ukf.y @ np.linalg.solve(ukf.S, ukf.y)))
                reference = State(*full_state(reference, ukf.x))
                ukf.x = np.zeros(n)
        nodes.append((reference, ukf.P.copy()))
    return nodes, nis


# Shared by the tests of the filters and of the constraints

#: Sigmas of a typical instrument.
ALL = SensorErrors(0.02, 1e-3, 2e-3, 1e-4, 1e-3)


def short_descent(settings):
    """Ten seconds of a braking, turning vehicle with every sensor error; curved constraints, four epochs with none."""
    rng = np.random.default_rng(21)
    nav = np.array([3.39e6, 2e5, -3e5, -200.0, 900.0, 300.0, 0.1, -0.3, 0.4, 0.5])
    nav[6:] = rotations.normalise(nav[6:])
    covariance = random_covariance(rng, [300.0, 500.0, 400.0, 4.0, 3.0, 5.0, 0.02, 0.03, 0.02])
    start = InitialState(0.0, nav[:3], nav[3:6], nav[6:], covariance)
    s = samples(
        np.full(80, 0.125),
        [-25.0, 1.0, -3.0] + 4.0 * rng.standard_normal((80, 3)),
        [0.3, -0.2, 0.1] + 0.2 * rng.standard_normal((80, 3)),
        force_noise=0.1,
        rate_noise=1e-3,
    )
    planet = MARS
    radius = np.linalg.norm(nav[:3])
    far = nav[:3] + 10.0 * nav[3:6]
    constraints = [
        Altimeter(3.3, 600.0, 50.0, radius - 2000.0),
        RestVelocity(5.0, 400.0, planet),
        RestGravity(7.0, 2.0, 150.0, planet),
        LandingSite(10.0, planet.rotation.to_fixed(10.0, far), 200.0**2 * np.eye(3), planet),
    ]
    return build_problem(s, start, EntryErrors(), (ALL,), constraints, planet, settings)


#: Layout with every sensor error and an attitude computed on board.
FULL = Layout.of((SensorErrors(1.0, 1.0, 1.0, 1.0, 1.0),), {"onboard_attitude": 3})
#: Time of the measurements at `points`, s.
TIME = 300.0


def points(count=4, seed=0):
    """Navigation states ``(14, S)`` some kilometres above the ground, and other states."""
    rng = np.random.default_rng(seed)
    nav = np.empty((14, count))
    for s in range(count):
        fixed = fixed_position(MARS, rng.uniform(-1, 1), rng.uniform(-3, 3), rng.uniform(1e3, 15e3))
        nav[:3, s] = MARS.rotation.to_inertial(TIME, fixed)
    nav[3:6] = 300.0 * rng.standard_normal((3, count))
    nav[6:10] = rotations.normalise(rng.standard_normal((count, 4))).T
    nav[10:] = rotations.normalise(rng.standard_normal((count, 4))).T
    return nav, 0.1 * rng.standard_normal((FULL.size, count))
