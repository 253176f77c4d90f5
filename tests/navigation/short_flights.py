"""Simulated short flights for the consistency tests: the truth is integrated by another integrator.

The body's rate and the specific force at the centre of mass are smooth functions of time; DOP853 integrates the
motion of all flights at once. Instruments give exact means over their samples, with errors drawn from the priors in
the order misalignment, scale, bias, and white noise.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import twins
from scipy.integrate import solve_ivp

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SENSOR_STATES, SensorErrors
from edl_filter.navigation import constraints as models
from edl_filter.navigation import initial as entry_state
from edl_filter.navigation.filter import EntryErrors, Problem, Settings, build_problem
from edl_filter.navigation.increments import effective_samples
from edl_filter.navigation.layout import Layout, State
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import Gas
from edl_filter.telemetry.record import InitialState

END, RATE = 60.0, 8
FORCE_NOISE, RATE_NOISE = 0.05, 2e-3
PLANET = twins.MARS
AIR = Atmosphere(
    altitude=np.array([0.0, 50e3, 100e3]),
    log_density=np.log(0.015) - np.array([0.0, 50e3, 100e3]) / 11e3,
    temperature=np.array([220.0, 180.0, 150.0]),
    wind=np.array([[10.0, -5.0], [40.0, 20.0], [60.0, 30.0]]),
    gas=Gas(),
)
#: Sigmas of position (m), velocity (m/s) and attitude (rad) at the start.
START = np.repeat([20.0, 0.3, 3e-3], 3)
SETTINGS = Settings(longest_interval=5.0, gate_probability=1.0)


@dataclass(frozen=True)
class LocalVelocity:
    """Velocity against the ground: east, north, up. A constraint that the package does not have."""

    name: ClassVar[str] = "velocity"
    components: ClassVar[tuple[str, ...]] = ("east (m/s)", "north (m/s)", "up (m/s)")
    time: float
    velocity: np.ndarray
    sigma: np.ndarray
    planet: Planet
    source: str = "test"

    @property
    def measured(self):
        return self.velocity

    @property
    def noise(self):
        return np.diag(self.sigma**2)

    def predict(self, nav, errors, layout):
        position = nav[:3].T
        enu = self.planet.enu_from_inertial(self.time, position)
        return np.einsum("sij,sj->si", enu, self.planet.velocity_relative(position, nav[3:6].T))


@dataclass(frozen=True)
class Flight:
    """A problem for the filter, and the truth at the requested times."""

    problem: Problem
    truth: dict[float, State]


@dataclass(frozen=True)
class Motion:
    """True motion of many flights: states ``(times, flights, 10)``."""

    force: twins.Waves
    rate: twins.Waves
    times: np.ndarray
    states: np.ndarray

    def at(self, time, flight):
        return self.states[int(np.argmin(np.abs(self.times - time))), flight]


def fly(rng, count, times):
    """True motion of `count` braking, turning vehicles."""
    force = twins.Waves.draw(rng, (count,), [3.0, 1.0, 1.0], [3.0, 1.0, 1.0], 0.5)
    force.constant[:, 0] -= 12.0
    rate = twins.Waves.draw(rng, (count,), [0.15, 0.05, 0.05], [0.05, 0.05, 0.05], 0.5)
    start = np.empty((count, 10))
    up = rotations.normalise(rng.standard_normal((count, 3)))
    start[:, :3] = 3.45e6 * up
    start[:, 3:6] = 3000.0 * rotations.normalise(np.cross(up, rng.standard_normal((count, 3)))) - 300.0 * up
    start[:, 6:] = rotations.normalise(rng.standard_normal((count, 4)))

    def derivative(t, y):
        y = y.reshape(count, 10)
        w = np.concatenate((rate(t), np.zeros((count, 1))), axis=1)
        acceleration = rotations.rotate(y[:, 6:], force(t)) + PLANET.gravity(y[:, :3])
        return np.concatenate((y[:, 3:6], acceleration, 0.5 * rotations.multiply(y[:, 6:], w)), axis=1).ravel()

    times = np.unique(np.append(times, [0.0, END]))
    solution = solve_ivp(derivative, (0.0, END), start.ravel(), "DOP853", times, rtol=1e-11, atol=1e-9)
    return Motion(force, rate, times, solution.y.T.reshape(len(times), count, 10))


def draw_errors(rng, priors):
    """True errors of one instrument, by name."""
    return {name: getattr(priors, name) * rng.standard_normal(3) for name in SENSOR_STATES}


def read(rng, force, rate, errors, force_noise, rate_noise):
    """What an instrument reads ``(N, 3)`` of true means."""
    turned = rotations.rotate(rotations.from_rotation_vector(errors["accelerometer_misalignment"]), force)
    measured = (1.0 + errors["accelerometer_scale"]) * turned + errors["accelerometer_bias"]
    turning = (1.0 + errors["gyro_scale"]) * rate + errors["gyro_bias"]
    return (
        measured + force_noise[:, None] * rng.standard_normal(force.shape),
        turning + rate_noise[:, None] * rng.standard_normal(rate.shape),
    )


def measure(rng, constraint, state, layout, field):
    """The constraint with a noisy measurement of the true state in place of its `field`."""
    value = constraint.predict(state.nav[:, None], state.errors[:, None], layout)[0]
    value = value + np.linalg.cholesky(constraint.noise) @ rng.standard_normal(len(value))
    return replace(constraint, **{field: value if np.ndim(getattr(constraint, field)) else float(value[0])})


def error_vector(layout, errors):
    """Sensor errors by name as the filter's vector."""
    full = np.zeros(layout.size)
    for name in SENSOR_STATES:
        if name in layout:
            full[layout[name]] = errors[name]
    return full


def sensor_flights(seed, count, times):
    """One instrument away from the centre of mass with every error; measured are air, ground and velocities."""
    rng = np.random.default_rng(seed)
    priors = SensorErrors(0.01, 5e-4, 1e-3, 2e-4, 1e-3)
    layout = Layout.of((priors,), {})
    motion = fly(rng, count, [*times, 17.3, 20.0, 40.0])
    edges = np.linspace(0.0, END, round(END * RATE) + 1)
    mean_force, mean_rate = motion.force.means(edges), motion.rate.means(edges)
    arms = rng.uniform(-0.5, 0.5, (count, 3))
    felt = mean_force + felt_more(motion.rate, edges, arms)
    noise = np.ones(len(edges) - 1)
    flights = []
    for k in range(count):
        errors = draw_errors(rng, priors)
        force, rate = read(rng, felt[:, k], mean_rate[:, k], errors, FORCE_NOISE * noise, RATE_NOISE * noise)
        record = twins.record(edges, force, rate, position=arms[k], force_noise=FORCE_NOISE, rate_noise=RATE_NOISE)
        full = error_vector(layout, errors)
        truth = {t: State(motion.at(t, k), full) for t in motion.times}
        start = truth[0.0].plus(np.concatenate((-START * rng.standard_normal(9), np.zeros(layout.size - 9)))).nav
        initial = InitialState(0.0, start[:3], start[3:6], start[6:], np.diag(START**2))
        statements = [
            (models.Altimeter(17.3, 0.0, 10.0, 3.39e6), "height"),
            (LocalVelocity(20.0, np.zeros(3), np.array([0.5, 0.5, 0.2]), PLANET), "velocity"),
            (models.DynamicPressure(40.0, 0.0, 2.0, 0.0, PLANET, AIR), "pressure"),
            (LocalVelocity(40.0, np.zeros(3), np.array([0.3, 0.5, 0.4]), PLANET), "velocity"),
            (models.LandingSite(END, np.zeros(3), 15.0**2 * np.eye(3), PLANET), "position"),
        ]
        measurements = [measure(rng, c, truth[c.time], layout, field) for c, field in statements]
        problem = build_problem(
            effective_samples(record), initial, EntryErrors(), (priors,), measurements, PLANET, SETTINGS, times
        )
        flights.append(Flight(problem, truth))
    return flights


def felt_more(rate, edges, arms):
    """Means ``(N, flights, 3)`` of ``α × r + ω × (ω × r)``: the first from the edges' rates, the second by Gauss."""
    length = np.diff(edges)
    tangential = np.cross(np.diff([rate(t) for t in edges], axis=0), arms) / length[:, None, None]
    nodes, weights = np.polynomial.legendre.leggauss(3)
    centripetal = np.zeros_like(tangential)
    for x, w in zip(nodes, weights, strict=True):
        turn = np.array([rate(t) for t in edges[:-1] + 0.5 * (1 + x) * length])
        centripetal += 0.5 * w * np.cross(turn, np.cross(turn, arms))
    return tangential + centripetal


GAP, CHANGE = (25.0, 25.5), 40.0
GAP_FORCE_NOISE, GAP_RATE_NOISE = 0.3, 0.05


def onboard_flights(seed, count, times):
    """Entry epoch, frame and on-board attitude are states; a gap only the latter bridges; the instrument changes."""
    rng = np.random.default_rng(seed)
    priors = (SensorErrors(0.02, gyro_bias=3e-4), SensorErrors(0.05, gyro_bias=1e-3))
    epoch_sigma, frame_sigma, onboard_sigma, change_sigma = 0.05, 2e-5, 2e-4, 3e-3
    every = np.arange(5.0, END, 5.0)
    motion = fly(rng, count, [*times, *every])
    fine = np.linspace(0.0, END, round(END * RATE) + 1)
    inside = (fine[1:] > GAP[0] + 1e-6) & (fine[1:] < GAP[1] + 1e-6)
    keep = np.append(True, ~inside | (np.abs(fine[1:] - GAP[1]) < 1e-6))
    edges = fine[keep]
    gap = np.diff(edges) > 0.2
    unit = (edges[1:] > CHANGE + 1e-6).astype(int)
    fine_unit = (fine[1:] > CHANGE + 1e-6).astype(int)
    mean_force, mean_rate = motion.force.means(fine), motion.rate.means(fine)
    group = np.cumsum(keep[:-1]) - 1  # the sample each fine one is in
    length = np.bincount(group)
    flights = []
    for k in range(count):
        # what the instruments read at 8 Hz, on board; telemetry lost the gap, for which it has a guess
        both = [draw_errors(rng, p) for p in priors]
        noise = np.ones(len(fine) - 1)
        readings = [
            read(rng, mean_force[:, k], mean_rate[:, k], e, FORCE_NOISE * noise, RATE_NOISE * noise) for e in both
        ]
        force, rate = (np.where(fine_unit[:, None] == 0, readings[0][i], readings[1][i]) for i in (0, 1))
        record = twins.record(fine, force, rate, unit=fine_unit)
        turns = rotations.from_rotation_vector(effective_samples(record).onboard_rate / RATE)
        force, rate = (np.stack([np.bincount(group, a) / length for a in x.T], axis=1) for x in (force, rate))
        force[gap] += GAP_FORCE_NOISE * rng.standard_normal((gap.sum(), 3))
        rate[gap] += GAP_RATE_NOISE * rng.standard_normal((gap.sum(), 3))
        record = replace(
            twins.record(edges, force, rate, unit=unit),
            force_noise=np.where(gap, np.hypot(GAP_FORCE_NOISE, FORCE_NOISE / 2), FORCE_NOISE),
            rate_noise=np.where(gap, np.hypot(GAP_RATE_NOISE, RATE_NOISE / 2), RATE_NOISE),
            shared_rate_noise=np.where(gap, RATE_NOISE / 2, RATE_NOISE),
        )
        # the start: drawn with its correlations, then taken off the truth
        true = motion.at(0.0, k)
        stated = rotations.normalise(rng.standard_normal(4))
        entry = EntryErrors(epoch_sigma, frame_sigma, stated, onboard_sigma)
        layout = Layout.of(priors, entry.states)
        about = InitialState(0.0, true[:3], true[3:6], true[6:], np.diag(START**2))
        _, covariance = entry_state.initial_estimate(layout, about, entry, priors[0], PLANET)
        delta = np.linalg.cholesky(covariance) @ rng.standard_normal(layout.size)
        delta[layout.sensor] = error_vector(layout, both[0])[layout.sensor]
        start = State(true, np.zeros(layout.size)).plus(-delta).nav
        initial = InitialState(0.0, start[:3], start[3:6], start[6:], np.diag(START**2))
        # the attitude as it was computed on board
        onboard = np.empty((len(fine), 4))
        onboard[0] = rotations.multiply(stated, rotations.from_rotation_vector(delta[-3:]))
        step = rotations.from_rotation_vector(change_sigma * rng.standard_normal(3))
        for i, turn in enumerate(turns):
            onboard[i + 1] = rotations.multiply(onboard[i], turn)
            if abs(fine[i + 1] - CHANGE) < 1e-6:
                before_change, onboard[i + 1] = onboard[i + 1].copy(), rotations.multiply(onboard[i + 1], step)
        truth = {}
        for t in motion.times:
            i = int(np.argmin(np.abs(fine - t)))
            full = error_vector(layout, both[1] if t > CHANGE + 1e-6 else both[0])
            for name in ("entry_epoch", "entry_frame"):
                full[layout[name]] = delta[layout[name]]
            carried = before_change if abs(t - CHANGE) < 1e-6 else onboard[i]
            truth[t] = State(np.concatenate((motion.at(t, k), carried)), full)
        measurements = []
        for t in every:
            q = rotations.multiply(truth[t].nav[10:], rotations.from_rotation_vector(1e-3 * rng.standard_normal(3)))
            measurements.append(models.OnboardAttitude(t, q, 1e-3))
        statements = [
            (models.LandingSite(10.0, np.zeros(3), 30.0**2 * np.eye(3), PLANET), "position"),
            (LocalVelocity(20.0, np.zeros(3), np.array([0.5, 0.5, 0.2]), PLANET), "velocity"),
            (models.Altimeter(45.0, 0.0, 10.0, 3.39e6), "height"),
            (LocalVelocity(55.0, np.zeros(3), np.array([0.3, 0.5, 0.4]), PLANET), "velocity"),
        ]
        measurements += [measure(rng, c, truth[c.time], layout, field) for c, field in statements]
        samples = effective_samples(record)
        problem = build_problem(
            samples, initial, entry, priors, measurements, PLANET, SETTINGS, times, unit_change_sigma=change_sigma
        )
        flights.append(Flight(problem, truth))
    return flights
